"""Pressure tunnel tests: cohesion, friction and in-situ stress from a diameter under pressure.

After G. Gioda and G. Maier, Direct search solution of an inverse problem in elastoplasticity:
identification of cohesion, friction angle and in situ stress by pressure tunnel tests, Int. J.
Numer. Methods Eng. 15 (1980). The data are our own, of like size: a chamber of 3 m in soft rock.

The wall first yields at the pressure s (1 + sin phi) + c cos phi. A curve that ends soon after it
tells no more than that sum of the three; one that goes on, and back to no pressure, tells each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import accumulate

import numpy as np
import pytest
from support.cases import model, rollers
from support.tunnels import walled
from support.yielding import constant, mohr, rock

from geoident.forward.model import StagedModel
from geoident.forward.openings.closed_forms import GroundState, Opening, Rock, mohr_coulomb
from geoident.identify.assessment.uncertainty import Assessment, assess
from geoident.identify.problem.methods import identify
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.model.actions import Pressure
from geoident.model.case import Stage
from geoident.model.dual import Dual
from geoident.model.gauges import Channel
from geoident.model.methods import ComplementarityOptions, MethodOptions, SimplexOptions
from geoident.model.parameter import Parameter, Scalar
from geoident.model.results.findings import sentences_of

MPa, DEG = 1e6, np.pi / 180
RADIUS, E, NU = 1.5, 2e9, 0.25
TRUTH = np.array([0.8 * MPa, 30 * DEG, 1.2 * MPa])
ACCURACY = 0.02e-3
UP = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0)
CYCLE = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 3.0, 1.5, 0.5, 0.0)
PARAMETERS = (
    Parameter("c", 2 * MPa, 0.1 * MPa, 8 * MPa, "log", None, "pressure", "MPa"),
    Parameter("phi", 40 * DEG, 10 * DEG, 60 * DEG, "linear", None, "angle", "deg"),
    Parameter("s", 2 * MPa, 0.2 * MPa, 6 * MPa, "linear", None, "pressure", "MPa"),
)
FEW = ComplementarityOptions(restarts=2)


@dataclass(frozen=True)
class Chamber:
    """A pressure chamber: its readings are the changes of its diameter since it was dug."""

    pressures: tuple[float, ...]
    layers: int = 36
    n: int = 1
    known: Mapping[str, float] = field(default_factory=dict)

    @property
    def free(self) -> tuple[Parameter, ...]:
        return tuple(q for q in PARAMETERS if q.name not in self.known)

    @property
    def pairs(self) -> list[tuple[str, str]]:
        return [("D", f"{number}: {p} MPa") for number, p in enumerate(self.pressures)]

    def staged(self) -> StagedModel:
        mesh = walled("quad8", n=self.n, layers=self.layers, radius=RADIUS, reach=30 * RADIUS)
        c, phi, s = (
            Scalar(self.known[q.name]) if q.name in self.known else Scalar(1.0, q.name)
            for q in PARAMETERS
        )
        loads = [
            Stage(name, loads={"water": Pressure("wall", Scalar(p * MPa))})
            for (_, name), p in zip(self.pairs, self.pressures, strict=True)
        ]
        # half of the diameter is in the model: its change counts twice
        across = Channel(
            "D", "D", "displacement", None, (RADIUS, 0.0), (2.0, 0.0), ACCURACY, "dug", ("D",)
        )
        return model(
            mesh,
            parameters=self.free,
            materials={"rock": rock(E, NU, mohr(c, phi))},
            groups={"core": "rock", "rock": "rock"},
            supports=rollers(2),
            in_situ=constant(*[replace(s, factor=-s.factor)] * 3),
            stages=(Stage("dug", excavate=("core",)), *loads),
            channels=(across,),
        )

    def readings(self, p: np.ndarray) -> np.ndarray:
        return self.staged().response(self.pairs).readings(p)


def problem(chamber: Chamber, measured: np.ndarray, sd: float = ACCURACY) -> Problem:
    response = chamber.staged().response(chamber.pairs)
    return Problem(response, measured, np.full(len(measured), sd), chamber.free)


def found(given: Problem, *methods: MethodOptions) -> tuple[Outcome, Assessment]:
    outcome = identify(given, methods, lambda iteration: None)
    return outcome, assess(given, outcome.values, given.response.evaluate(outcome.values)[1])


def finer(chamber: Chamber) -> Chamber:
    return replace(chamber, layers=60, n=2)


def yield_pressure(p: Sequence[float]) -> float:
    c, phi, s = p
    return float(s * (1 + np.sin(phi)) + c * np.cos(phi))


def test_curve_is_that_of_the_closed_form(verification):
    """Up to 6 MPa, in ground that ends at 30 radii; the way back yields again, without closed form.

    With phi = 30 deg and nu = 0.25 the closed form has a divisor that is zero.
    """
    c, phi, s, young, nu = (Dual(np.array([x])) for x in (*TRUTH, E, NU))
    ground = Opening(RADIUS, Rock(young, nu, s, s), mohr_coulomb(c, phi, phi))
    pressures = [Dual(np.array([p * MPa])) for p in UP]
    opened = ground.under(Dual(np.zeros(1)))
    states = accumulate(pressures, GroundState.onward, initial=opened)
    wall = [float(state.displacement(np.array([RADIUS])).value[0]) for state in states]
    exact = 2 * (np.array(wall[1:]) - wall[0])
    found = Chamber(UP).readings(TRUTH)
    np.testing.assert_allclose(found, exact, rtol=0.007)
    verification("pressure-tunnel", "", UP, exact=exact, found=found)


@pytest.mark.slow  # with noise: the next
def test_complementarity_recovers_all_three_from_a_cycle_of_pressure():
    chamber = Chamber(CYCLE)
    outcome, known = found(problem(chamber, finer(chamber).readings(TRUTH)), FEW)
    assert outcome.status == "converged"
    assert known.determined.all()
    np.testing.assert_allclose(outcome.values, TRUTH, rtol=0.02)


def test_estimate_under_noise_is_as_far_off_as_it_says():
    """On the mesh of the readings, since the error of a mesh is no noise."""
    chamber = Chamber(CYCLE, layers=16)
    noise = ACCURACY * np.random.default_rng(3).standard_normal(len(CYCLE))
    once = ComplementarityOptions(restarts=0)
    outcome, known = found(problem(chamber, chamber.readings(TRUTH) + noise), once)
    off = outcome.values - TRUTH
    assert off @ np.linalg.solve(known.covariance, off) < 16.3  # chi-squared of three, 99.9 %
    assert (known.sd / TRUTH < 0.02).all()


@pytest.mark.slow
def test_simplex_agrees():
    chamber = Chamber(CYCLE)
    given = problem(chamber, finer(chamber).readings(TRUTH))
    best, _ = found(given, FEW)
    for start in (TRUTH * 1.3, TRUTH * [0.7, 1.2, 0.8]):
        moved = [replace(q, start=float(x)) for q, x in zip(PARAMETERS, start, strict=True)]
        outcome, _ = found(replace(given, parameters=tuple(moved)), SimplexOptions())
        np.testing.assert_allclose(outcome.values, best.values, rtol=2e-3)


@pytest.mark.slow  # one that ends before: below
def test_what_a_curve_that_ends_soon_after_yielding_tells():
    """The sum at which the wall yields, not the strengths; s only where it stands for the sum.

    From weak ground, so that derivatives tell the way. From strong ground, where nothing yields by
    the pressure, one seed in eight ends at a sum a tenth too high, which meets the readings within
    their accuracy too; which seed, depends on the last digits, so on the processor.
    """
    chamber = Chamber((1.0, 2.0, 2.5, 2.75, 3.0, 3.25))
    given = problem(chamber, finer(chamber).readings(TRUTH))
    weak = zip(PARAMETERS, (0.5 * MPa, 20 * DEG, 1.0 * MPa), strict=True)
    given = replace(given, parameters=tuple(replace(q, start=start) for q, start in weak))
    outcome, known = found(given, FEW)
    assert yield_pressure(outcome.values) == pytest.approx(yield_pressure(TRUTH), rel=0.02)
    assert not known.determined[:2].any()
    (finding,) = [text for text in sentences_of(known.findings) if "cannot separate" in text]
    assert finding.startswith("The readings cannot separate c")
    assert "phi" in finding


def test_a_curve_that_ends_before_yielding_tells_nothing_of_the_strength():
    chamber = Chamber((0.5, 1.0, 1.5, 2.0), layers=16)
    _, known = found(problem(chamber, chamber.readings(TRUTH)), FEW)
    assert not known.determined.any()
    assert {f"The readings do not determine {q.name}." for q in PARAMETERS} <= {
        *sentences_of(known.findings)
    }


def test_what_does_not_yield_is_bounded_from_below():
    """By the excavation, where all else is known: 2 s = 2 c cos(phi) / (1 - sin(phi))."""
    _, phi, s = TRUTH
    chamber = Chamber((0.5, 1.0, 1.5, 2.0), known={"phi": phi, "s": s})
    outcome, known = found(problem(chamber, chamber.readings(TRUTH[:1])), FEW)
    assert not known.determined.any()
    assert outcome.certificate is not None
    least = s * (1 - np.sin(phi)) / np.cos(phi)
    assert outcome.certificate.lower_bounds["c"] == pytest.approx(least, rel=0.1)
