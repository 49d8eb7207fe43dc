"""The proven optimum of small problems: bounds that hold, and a better point where there is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.array_model import ArrayModel
from support.footings import two_layers
from support.frames import truss

from geoident.errors import InputError
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.condensed_system import CondensedSystem, condensed
from geoident.identify.yield_limits.global_bound import global_bound
from geoident.identify.yield_limits.implicit import implicit
from geoident.identify.yield_limits.parameter_boxes import (
    EnergyInequality,
    ParameterBox,
    examined,
    form_of,
)
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions, HuberOptions
from geoident.model.parameter import Prior
from geoident.model.results.result import Iteration

GLOBAL = ComplementarityOptions(formulation="global")


def silent(entry: Iteration) -> str | None:
    return None


def condensed_of(problem: Problem) -> CondensedSystem:
    return condensed(problem, problem.response.system())  # type: ignore[attr-defined]


def multipliers(problem: Problem, p: np.ndarray) -> np.ndarray:
    """Steps of the multipliers of all pairs, in the order of the condensed system."""
    model = problem.response
    assert isinstance(model, ArrayModel)
    steps = model.analysis(p)
    return np.concatenate([step[2][s].ravel() for step in steps for s in sorted(step[2])])


@pytest.mark.parametrize("pressures", [(4.5,), (4.0, 4.5)])
def test_the_condensed_system_is_the_model(pressures: tuple[float, ...]) -> None:
    """Complementary slacks, and the misfits, from the multipliers of the analysis."""
    problem = two_layers((3, 2), pressures, start=(1.2, 1.2))
    system, p = condensed_of(problem), np.array([0.8, 0.9])
    lam = multipliers(problem, p) / system.multiplier_size
    assert lam.max() > 0.0
    scaled = p / system.reference
    slack = system.slack + system.slack_by_p @ scaled + system.slack_by_lam @ lam
    assert slack.min() > -1e-9
    assert np.abs(slack * lam).max() < 1e-9 * np.abs(lam).max()
    misfit = system.misfit + system.misfit_by_p @ scaled + system.misfit_by_lam @ lam
    expected = (problem.response.readings(p) - problem.measured) / problem.sd
    assert misfit == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("pressures", [(4.5,), pytest.param((4.0, 4.5), marks=pytest.mark.slow)])
def test_no_plane_that_is_reached_is_dropped_and_no_bound_is_too_high(
    pressures: tuple[float, ...],
) -> None:
    """Random boxes of parameters, random parameters in them."""
    problem, rng = two_layers((4, 3), pressures, start=(1.2, 1.2)), np.random.default_rng(4)
    system = condensed_of(problem)
    form = form_of(system.work[:, None] * system.slack_by_lam)
    dropped = 0
    for _ in range(3):
        centre = rng.uniform(0.85, 1.6, 2)
        half = rng.uniform(0.02, 0.15, 2) * centre
        lower, upper = (centre - half) / system.reference, (centre + half) / system.reference
        energy = EnergyInequality(system, form, lower, upper)
        may = energy.reachable()
        dropped += int((~may).sum())
        inside = rng.uniform(centre - half, centre + half, (3, 2))
        best = 1.01 * max(phi(problem, p) for p in inside)
        box = ParameterBox(lower, upper, 0.0, np.arange(system.n_pairs))
        found = examined(system, form, box, best)
        assert found is not None
        for p in inside:
            lam = multipliers(problem, p) / system.multiplier_size
            assert not np.any(lam[~may] > 0.0)
            slack = system.slack + system.slack_by_p @ (p / system.reference)
            slack += system.slack_by_lam @ lam
            assert np.all(system.work * slack >= energy.lowest() - 1e-12)
            assert np.all(found.lower * system.reference <= p + 1e-9)
            assert np.all(found.upper * system.reference >= p - 1e-9)
            assert found.bound <= phi(problem, p) * (1 + 1e-6)
    assert dropped > 50


def phi(problem: Problem, p: np.ndarray) -> float:
    return float(np.sum(((problem.response.readings(p) - problem.measured) / problem.sd) ** 2))


@pytest.mark.slow  # with a prior and two stages: the next; its parts are in tests/identify
def test_the_better_of_two_minima_is_proven() -> None:
    """Gauss-Newton ends in the worse one from this start."""
    problem = two_layers((4, 3), (4.5,), start=(1.0, 1.5))
    poor = gauss_newton(problem, GaussNewtonOptions(), silent)
    found = global_bound(problem, GLOBAL, silent)
    assert found.status == "converged"
    assert found.objective < 0.1 * poor.objective
    assert found.certificate is not None
    assert found.certificate.kind == "global"
    assert found.certificate.bound <= found.objective
    assert found.certificate.gap < 1e-4
    rng = np.random.default_rng(0)
    for p in rng.uniform(0.8, 4.0, (15, 2)):
        assert phi(problem, p) >= found.certificate.bound


@pytest.mark.parametrize(
    "pressures", [(5.0, 3.0), pytest.param((5.0, 5.2, 3.0), marks=pytest.mark.slow)]
)
def test_history_is_kept_from_stage_to_stage_and_a_prior_counts(
    pressures: tuple[float, ...],
) -> None:
    given = two_layers((3, 2), pressures, start=(1.3, 1.5))
    first = replace(given.parameters[0], prior=Prior(1.2, 0.1))
    problem = replace(given, parameters=(first, given.parameters[1]))
    found = global_bound(problem, replace(GLOBAL, gap=1e-2, restarts=10), silent)
    assert found.status == "converged"
    assert found.certificate is not None
    assert found.certificate.bound <= found.objective
    assert found.certificate.gap < 1e-2

    def objective(p: np.ndarray) -> float:  # of the analysis, stage by stage
        return phi(problem, p) + float(((p[0] - 1.2) / 0.1) ** 2)

    assert found.objective == pytest.approx(objective(found.values), rel=1e-6)
    for p in np.random.default_rng(1).uniform(0.8, 1.8, (10, 2)):
        assert objective(p) >= found.certificate.bound


@pytest.mark.slow
def test_hardening_as_a_parameter_a_much_better_point_than_one_descent_finds_is_proven() -> None:
    """A published truss with noise: products of hardening and multipliers."""
    system, exact, given = truss("d")
    parameters = tuple(replace(q, lower=20.0) for q in given)
    sd = np.full(len(exact), 0.05)
    measured = exact + sd * np.random.default_rng(1).standard_normal(len(exact))
    problem = Problem(ArrayModel(system), measured, sd, parameters)
    searched = implicit(problem, ComplementarityOptions(restarts=0), silent)
    found = global_bound(problem, replace(GLOBAL, restarts=0), silent)
    assert found.certificate is not None
    assert found.certificate.kind == "global"
    assert found.certificate.bound <= found.objective < 0.5 * searched.objective
    assert found.certificate.gap < 1e-4


def test_the_observer_ends_it_with_the_bound_so_far() -> None:
    problem = two_layers((3, 2), (4.5,), start=(1.0, 1.5))
    found = global_bound(problem, GLOBAL, lambda e: "enough" if e.note[:3] == "box" else None)
    assert (found.status, found.reason) == ("out-of-budget", "enough")
    assert found.certificate is not None
    assert found.certificate.bound < found.objective


def test_what_it_cannot_do_is_refused_with_a_reason() -> None:
    problem = two_layers((3, 2), (4.5,), start=(1.2, 1.2))
    first, second = problem.parameters
    for changed, why in (
        (replace(problem, loss=HuberOptions()), "only for the squared loss"),
        (
            replace(problem, parameters=(replace(first, upper=np.inf), second)),
            "k1 has no bounds, and a proof needs them",
        ),
        (
            replace(problem, parameters=(replace(first, prior=Prior(1, 1, "lognormal")), second)),
            "the prior of k1 is lognormal, and only a normal one is a square of it",
        ),
        (
            two_layers((9, 7), (4.5, 4.6), start=(1.2, 1.2)),
            "2016 pairs of planes and multipliers are more than 2000 (planes times strain points "
            "times stages); use a coarser mesh or fewer planes",
        ),
    ):
        with pytest.raises(InputError) as caught:
            global_bound(changed, GLOBAL, silent)
        assert why in caught.value.faults[0].message
