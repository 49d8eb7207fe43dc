"""Published benchmarks: yield limits and hardening of a foundation beam and of a truss.

The models find* and nappi_* of MPECLIB give geometry, flexibilities, loads, bounds and readings, as
one program with equilibrium constraints each; here they are input to the program's own core. Their
objective is the sum of the absolute residuals. Its optimum is zero where the last figure of a find*
model is 0 and for all nappi models: readings without noise. (The library as stored has no table of
optima; the others, with 5 % noise, were found by solving the published equations as they are, with
IPOPT from six starts.)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.array_model import ArrayModel
from support.derivatives import assert_exact
from support.frames import foundation, truss

from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.full_space import full_space
from geoident.identify.yield_limits.implicit import implicit
from geoident.model.methods import ComplementarityOptions, HuberOptions
from geoident.model.results.result import Iteration

FOUNDATION = np.array([125.0, 1.6, 125.0, 0.0, 171.5, 0.08, 171.5, 0.0])
"""Behind the published readings: k of beam and spring, up and down, then H."""

TRUSS = np.array([309.0, 180.0, 90.0, 40.0])
"""k of chords and diagonals, then H."""

FULL = ComplementarityOptions(formulation="full-space")

NOISY = {"a35t": 0.3223935, "b15t": 0.1863684, "b15s": 0.1863684, "c15t": 0.0083907}
"""Lowest sum of absolute residuals of the published equations."""


def silent(entry: Iteration) -> str | None:
    return None


def problem(name: str, accuracy: float = 1e-2) -> Problem:
    """A find* model, or nappi_* where the name is one letter."""
    system, measured, parameters = truss(name) if len(name) == 1 else foundation(name)
    sd = np.full(len(measured), accuracy)
    return Problem(ArrayModel(system), measured, sd, parameters)


@pytest.mark.parametrize("name", ["a10t", "b10l", "c10s", "a30t", "c30l"])
def test_the_core_answers_with_the_published_readings_of_the_beam(name: str, verification) -> None:
    given = problem(name)
    found = given.response.readings(FOUNDATION)
    assert found == pytest.approx(given.measured, abs=1e-11)
    number = np.arange(1, len(found) + 1)
    verification("mpeclib", f"find{name}", number, exact=given.measured, found=found)


@pytest.mark.parametrize("name", ["a", "b", "c", "d"])
def test_the_core_answers_with_the_published_readings_of_the_truss(name: str, verification) -> None:
    given = problem(name)
    found = given.response.readings(TRUSS)
    assert found == pytest.approx(given.measured, abs=1e-10)
    number = np.arange(1, len(found) + 1)
    verification("mpeclib", f"nappi_{name}", number, exact=given.measured, found=found)


@pytest.mark.parametrize("name", ["b", pytest.param("c30t", marks=pytest.mark.slow)])
def test_derivatives_by_distances_and_hardening_are_exact(name: str) -> None:
    model = problem(name).response
    p = 1.03 * (TRUSS if name == "b" else np.maximum(FOUNDATION, 1e-3))
    assert_exact(model, p, model.names, step=1e-4, rtol=1e-6)


QUICK = ("c", "a10t")
"""Of a truss and a beam; the others are of the same two."""
LONG = ("a", "b", "d", "b30t", "c10t")
HARDEST = ("c10l", "c30l")


@pytest.mark.parametrize(
    "name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)]
)
def test_the_implicit_method_reaches_the_published_optimum(name: str, verification) -> None:
    given = problem(name)
    found = implicit(given, ComplementarityOptions(), silent)
    met(found)
    readings = given.response.readings(found.values)
    number = np.arange(1, len(readings) + 1)
    variant = f"nappi_{name}" if len(name) == 1 else f"find{name}"
    verification("mpeclib-fit", variant, number, exact=given.measured, found=readings)


@pytest.mark.parametrize(
    "name", ["c", "b10s", *(pytest.param(name, marks=pytest.mark.slow) for name in ("a", "b", "d"))]
)
def test_full_space_reaches_the_published_optimum(name: str) -> None:
    met(full_space(problem(name), FULL, silent))


@pytest.mark.slow
@pytest.mark.parametrize("bounds", ["t", "s", "l"])
@pytest.mark.parametrize("load", ["10", "30"])
@pytest.mark.parametrize("gauges", ["a", "b", "c"])
def test_both_reach_every_published_optimum_without_noise(
    gauges: str, load: str, bounds: str
) -> None:
    given = problem(gauges + load + bounds)
    met(full_space(given, FULL, silent))
    if gauges + load + bounds not in HARDEST:
        met(implicit(given, ComplementarityOptions(), silent))


@pytest.mark.slow
@pytest.mark.xfail(
    strict=False,
    reason="eight numbers from the loosest bounds and the fewest gauges: restarts go along what "
    "the readings do not see at all, and rounding decides which of their directions come; some "
    "seeds end in other minima. The full-space formulation reaches the optimum.",
)
@pytest.mark.parametrize("name", HARDEST)
def test_the_implicit_method_reaches_the_hardest_published_optima(name: str) -> None:
    met(implicit(problem(name), ComplementarityOptions(), silent))


@pytest.mark.slow
@pytest.mark.parametrize("name", NOISY)
def test_absolute_residuals_of_noisy_readings_are_as_low_as_published(
    name: str, verification
) -> None:
    """Huber's loss with a small delta is the sum of absolute residuals."""
    given = problem(name)
    found = full_space(replace(given, loss=HuberOptions(1e-3)), FULL, silent)
    total = np.abs(given.response.readings(found.values) - given.measured).sum()
    assert total == pytest.approx(NOISY[name], rel=1e-3)
    verification("mpeclib-noise", f"find{name}", ["sum"], exact=NOISY[name], found=total)


def met(found: Outcome) -> None:
    """The readings, of the order of one, are met to 1e-5 (accuracies are 1e-2)."""
    assert found.status == "converged"
    assert found.objective < 1e-6
