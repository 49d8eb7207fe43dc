"""The simplex search: the same minima as an independent implementation, and no false ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.optimize import minimize

from geoident.errors import ModelError
from geoident.identify.direct.simplex import first_simplex, minimise, simplex
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats
from geoident.model.methods import SimplexOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.costs import Counts
from geoident.model.results.result import Iteration

SHARP = SimplexOptions(delta=1e-14, max_evaluations=5000, size=0.5)


def go_on(_: Iteration) -> None:
    return None


# --- the core, on the test functions of More, Garbow & Hillstrom (1981) ---


def rosenbrock(x: Floats) -> float:
    return float(100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2)


def powell_singular(x: Floats) -> float:
    a, b, c, d = x
    return float((a + 10 * b) ** 2 + 5 * (c - d) ** 2 + (b - 2 * c) ** 4 + 10 * (a - d) ** 4)


def beale(x: Floats) -> float:
    powers = x[1] ** np.arange(1, 4)
    return float(np.sum((np.array([1.5, 2.25, 2.625]) - x[0] * (1.0 - powers)) ** 2))


def himmelblau(x: Floats) -> float:
    return float((x[0] ** 2 + x[1] - 11.0) ** 2 + (x[0] + x[1] ** 2 - 7.0) ** 2)


def helical_valley(x: Floats) -> float:
    theta = np.arctan2(x[1], x[0]) / (2.0 * np.pi)
    radius = np.hypot(x[0], x[1])
    return float(100.0 * ((x[2] - 10.0 * theta) ** 2 + (radius - 1.0) ** 2) + x[2] ** 2)


CASES = {
    "rosenbrock": (rosenbrock, [-1.2, 1.0], [1.0, 1.0]),
    "powell-singular": (powell_singular, [3.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]),
    "beale": (beale, [1.0, 1.0], [3.0, 0.5]),
    "himmelblau": (himmelblau, [0.0, 0.0], [3.0, 2.0]),
    "helical-valley": (helical_valley, [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("name", CASES)
def test_finds_known_minimum(name: str) -> None:
    objective, start, minimum = CASES[name]
    found = minimise(objective, np.array(start), options=SHARP)
    assert found.ending == "converged"
    assert found.value < 1e-12
    # the Hessian of Powell's function is singular at its minimum: x is the fourth root of phi
    assert found.x == pytest.approx(minimum, abs=2e-3 if name == "powell-singular" else 1e-6)


def test_moves_are_those_of_scipy_step_by_step() -> None:
    asked: list[Floats] = []

    def record(x: Floats) -> float:
        asked.append(x.copy())
        return rosenbrock(x)

    x0 = np.array([-1.2, 1.0])
    minimise(record, x0, options=replace(SHARP, restarts=0, max_evaluations=60))
    ours, vertices = asked.copy(), np.array(asked[:3])
    asked.clear()
    with pytest.warns(RuntimeWarning, match="Maximum number of function evaluations"):
        minimize(
            record,
            x0,
            method="Nelder-Mead",
            options={"initial_simplex": vertices, "maxfev": 60, "disp": True},
        )
    assert np.allclose(ours[:55], asked[:55], rtol=0.0, atol=1e-12)


def test_equal_values_around_a_minimum_do_not_end_the_search() -> None:
    found = minimise(
        lambda x: float(x[0] ** 2), np.array([-0.25]), options=SimplexOptions(size=0.5, restarts=0)
    )
    assert found.ending == "converged"
    assert abs(found.x[0]) < 1e-4


def test_kink_is_no_obstacle() -> None:
    found = minimise(
        lambda x: float(abs(x[0] - 1.0) + 10.0 * abs(x[1] + 2.0 - x[0])),
        np.zeros(2),
        options=SimplexOptions(restarts=3),
    )
    assert found.x == pytest.approx([1.0, -1.0], abs=1e-4)


def test_inadmissible_neighbours_of_the_start_are_avoided() -> None:
    # admissible only in a sliver above and left of the start
    def objective(x: Floats) -> float:
        inside = -0.02 <= x[0] <= 0.0 and 0.0 <= x[1] <= 1.0
        return float((x[0] + 0.01) ** 2 + (x[1] - 0.7) ** 2) if inside else np.inf

    vertices, values = first_simplex(objective, np.zeros(2), objective(np.zeros(2)), 0.1)
    assert vertices == pytest.approx(np.array([[0, 0], [-0.0125, 0], [0, 0.1]]))
    assert np.all(np.isfinite(values))
    found = minimise(objective, np.zeros(2), options=SimplexOptions(restarts=2))
    assert found.x == pytest.approx([-0.01, 0.7], abs=1e-4)


def test_nan_is_inadmissible() -> None:
    found = minimise(
        lambda x: float((x[0] - 0.3) ** 2) if x[0] < 0.35 else np.nan,
        np.zeros(1),
        options=SimplexOptions(),
    )
    assert found.x == pytest.approx([0.3], abs=1e-4)


def test_restart_leaves_a_collapsed_simplex() -> None:
    # McKinnon (1998): contractions repeat forever towards the origin, which is no minimum
    def mckinnon(x: Floats) -> float:
        y = x[1] + x[1] ** 2
        return float((360.0 if x[0] <= 0.0 else 6.0) * x[0] ** 2 + y)

    root = np.array([(1 + np.sqrt(33)) / 8, (1 - np.sqrt(33)) / 8])
    trap = np.array([[0.0, 0.0], root, [1.0, 1.0]])
    steps = trap[1:] - trap[0]

    def objective(c: Floats) -> float:
        return mckinnon(trap[0] + c @ steps)

    options = SimplexOptions(size=1.0, restarts=0)
    trapped = minimise(objective, np.zeros(2), options=options)
    assert (trapped.ending, trapped.value) == ("converged", 0.0)
    assert minimise(objective, np.zeros(2), options=replace(options, restarts=1)).ending == "moved"
    free = minimise(objective, np.zeros(2), options=replace(options, restarts=2))
    assert free.ending == "converged"
    assert free.value == pytest.approx(-0.25, abs=1e-9)


# --- the identifier, on a toy model ---


@dataclass
class Curve:
    """v = (E, E K0, 1 / E) in units of the truth; no solution where ``broken`` says so."""

    broken: Callable[[Floats], bool] = lambda _: False
    outside: Callable[[Floats], str | None] = lambda _: None
    asked: list[Floats] = field(default_factory=list)
    names: tuple[str, ...] = ("E", "K0")

    @property
    def counts(self) -> Counts:
        return Counts(evaluations=len(self.asked))

    def admissible(self, p: Floats) -> str | None:
        return self.outside(p)

    def readings(self, p: Floats) -> Floats:
        self.asked.append(p.copy())
        if self.broken(p):
            raise ModelError("The ground collapses.")
        E = p[0] / 1e9
        return np.array([E, E * p[1], 1.0 / E])

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        raise NotImplementedError("The simplex search asks for no derivatives.")


E_GROUND = Parameter("E", start=1e9, lower=1e8, upper=1e11, scale="log")
K0 = Parameter("K0", start=1.0, lower=0.2, upper=4.0)
TRUTH = np.array([5e9, 2.0])


def problem(model: Curve, *parameters: Parameter, sd: float = 1e-3) -> Problem:
    measured = Curve().readings(TRUTH)
    return Problem(model, measured, np.full(3, sd), parameters or (E_GROUND, K0))


def test_recovers_parameters_of_different_size() -> None:
    model = Curve()
    outcome = simplex(problem(model), SimplexOptions(delta=1e-9), go_on)
    assert outcome.status == "converged"
    assert outcome.reason == (
        "The simplex is small and the misfit is the same at its vertices (tolerance 1e-09)."
    )
    assert outcome.values == pytest.approx(TRUTH, rel=1e-6)
    assert outcome.iterations[0].note == "start"
    assert outcome.iterations[0].values == pytest.approx([1e9, 1.0])
    assert outcome.iterations[-1].objective == outcome.objective
    assert outcome.iterations[-1].counts.evaluations == len(model.asked)


def test_never_evaluates_outside_the_bounds() -> None:
    model = Curve()
    tight = replace(E_GROUND, upper=3e9)
    outcome = simplex(problem(model, tight, K0), SimplexOptions(restarts=4), go_on)
    asked = np.array(model.asked)
    assert np.all((asked[:, 0] < 3e9) & (asked[:, 1] >= 0.2) & (asked[:, 1] <= 4.0))
    assert outcome.values[0] == pytest.approx(3e9, rel=1e-3)


def test_fixed_parameter_stays() -> None:
    fixed = Parameter("K0", start=2.0, lower=2.0, upper=2.0)
    outcome = simplex(problem(Curve(), E_GROUND, fixed), SimplexOptions(), go_on)
    assert outcome.status == "converged"
    assert outcome.values == pytest.approx(TRUTH, rel=1e-6)
    assert outcome.values[1] == 2.0


def test_collapse_and_inadmissible_parameters_are_avoided() -> None:
    model = Curve(
        broken=lambda p: p[0] > 5.2e9, outside=lambda p: "K0 too large" if p[1] > 2.1 else None
    )
    outcome = simplex(problem(model), SimplexOptions(restarts=2), go_on)
    assert outcome.values == pytest.approx(TRUTH, rel=1e-5)
    assert np.all(np.array(model.asked)[:, 1] <= 2.1)


def test_prior_takes_part() -> None:
    believed = replace(K0, prior=Prior(mean=1.0, sd=0.1))
    tight = simplex(problem(Curve(), E_GROUND, believed, sd=10.0), SimplexOptions(), go_on)
    assert tight.values[1] == pytest.approx(1.0, abs=0.05)


def test_start_without_solution_says_why() -> None:
    with pytest.raises(ModelError, match=r"The ground collapses\."):
        simplex(problem(Curve(broken=lambda _: True)), SimplexOptions(), go_on)
    with pytest.raises(ModelError, match="not in the domain"):
        simplex(problem(Curve(outside=lambda _: "not in the domain")), SimplexOptions(), go_on)


def test_a_misfit_that_is_no_number_at_the_start_is_said() -> None:
    """The model answers; what it says only overflows, so it has no sentence of its own."""
    with pytest.raises(ModelError, match="no solution at the start of the simplex search"):
        simplex(problem(Curve(), sd=1e-200), SimplexOptions(), go_on)


def test_observer_stops_the_search_with_the_best_so_far() -> None:
    seen: list[Iteration] = []

    def stop_at_20(at: Iteration) -> str | None:
        seen.append(at)
        return "The time is up." if len(seen) == 20 else None

    outcome = simplex(problem(Curve()), SimplexOptions(), stop_at_20)
    assert (outcome.status, outcome.reason) == ("out-of-budget", "The time is up.")
    assert outcome.iterations == tuple(seen)
    assert outcome.objective == min(at.objective for at in seen)
    assert outcome.objective < seen[0].objective


def test_too_few_evaluations_are_said_with_the_remedy() -> None:
    outcome = simplex(problem(Curve()), SimplexOptions(max_evaluations=30), go_on)
    assert outcome.status == "not-converged"
    assert outcome.reason == (
        "The search did not converge in 30 evaluations: raise max_evaluations, or continue from "
        "here with the method gauss-newton."
    )


class Step(Curve):
    """The readings of the truth below a modulus, none above it."""

    def readings(self, p: Floats) -> Floats:
        return Curve().readings(TRUTH) if p[0] < 0.99e9 else np.zeros(3)


@pytest.mark.parametrize("restarts", [0, 1, 2])
def test_a_last_restart_that_finds_a_better_point_is_said(restarts: int) -> None:
    """The first simplex sees the modulus at the start and above it, the next one below."""
    outcome = simplex(problem(Step()), SimplexOptions(restarts=restarts), go_on)
    assert (outcome.objective == 0.0) == (restarts > 0)
    assert outcome.status == ("not-converged" if restarts == 1 else "converged")
    better = (
        "The last restart still found a clearly better point: raise restarts, or continue from "
        "here with the method gauss-newton."
    )
    assert (outcome.reason == better) == (restarts == 1)
