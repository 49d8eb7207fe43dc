"""Condensation: how it ends, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from geoident.errors import InputError, ModelError
from geoident.identify.least_squares.condensation import (
    condensation,
    condensation_faults,
    independent_readings,
)
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats
from geoident.model.methods import CondensationOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.response import Condensed
from geoident.model.results.costs import Counts
from geoident.model.results.result import Iteration

EQUATION = CondensationOptions(weighting="equation")
OUTPUT = CondensationOptions(weighting="output")
REST = "The next step would change no parameter by more than 1e-06, relative."
ROUNDING = "The changes do not fall below 1.1e-04, relative: what is left is rounding."
FOLLOW = "go on from here with the method gauss-newton."


def go_on(_: Iteration) -> None:
    return None


# --- how it ends ---


@dataclass
class Map:
    """A model whose condensed equations lead from p to f(p): for the ways an iteration can go."""

    f: Callable[[Floats], Floats]
    limit: float = np.inf
    names: tuple[str, ...] = ("p1",)
    why_not: str | None = None
    flexibility: Floats = field(default_factory=lambda: np.eye(1))

    @property
    def counts(self) -> Counts:
        return Counts()

    def obstacle(self) -> str | None:
        return self.why_not

    def admissible(self, p: Floats) -> str | None:
        return "too large" if p[0] > self.limit else None

    def readings(self, p: Floats) -> Floats:
        return p

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        raise NotImplementedError

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        S = self.flexibility
        return Condensed(p, S, np.ones((len(S), 1)), self.f(p))


def problem(model: Map, *, start: float = 2.0, prior: Prior | None = None) -> Problem:
    parameter = Parameter("p1", start=start, lower=1e-3, upper=1e12, scale="log", prior=prior)
    return Problem(model, np.ones(1), np.ones(1), (parameter,))


def iterate(model: Map, *, start: float = 2.0, options: CondensationOptions = OUTPUT) -> Outcome:
    return condensation(problem(model, start=start), options, go_on)


def test_cycle_is_said() -> None:
    outcome = iterate(Map(lambda p: 4.5 / p))
    assert outcome.status == "not-converged"
    assert outcome.reason == f"The iteration goes round in a cycle: {FOLLOW}"
    assert len(outcome.iterations) == 3  # 2, 2.25 and 2 again
    length = pytest.approx(np.log(2.25 / 2.0))
    assert [at.step for at in outcome.iterations] == [0.0, length, length]
    assert outcome.values == pytest.approx([2.0])


def test_approach_to_a_cycle_is_said() -> None:
    outcome = iterate(Map(lambda p: 3.2 * p * (1.0 - p)), start=0.45)
    assert "cycle" in outcome.reason
    assert len(outcome.iterations) < 30


@pytest.mark.parametrize(("length", "steps"), [(3, 3), (6, 6), (7, 40)])
def test_cycles_of_up_to_six_steps_are_seen_when_they_close(length: int, steps: int) -> None:
    """Round and round over so many values, up and down."""
    values = 1.0 + 0.1 * np.array([0, 4, 1, 5, 2, 6, 3])[:length]

    def following(p: Floats) -> Floats:
        return values[[(int(np.argmin(np.abs(values - p))) + 1) % length]]

    outcome = iterate(Map(following), start=1.0, options=replace(OUTPUT, max_iterations=40))
    assert len(outcome.iterations) == steps + 1
    assert ("cycle" in outcome.reason) == (length <= 6)


def test_divergence_is_said_and_the_best_iterate_returned() -> None:
    outcome = iterate(Map(lambda p: p**1.5), start=1.1)
    assert outcome.status == "not-converged"
    assert outcome.reason == (
        f"The iteration diverges, each step is longer than the one before: {FOLLOW}"
    )
    assert outcome.values == pytest.approx([1.1])


def test_slow_iteration_is_said() -> None:
    outcome = iterate(Map(lambda p: 0.9 * p + 0.1), options=replace(OUTPUT, max_iterations=7))
    assert outcome.status == "not-converged"
    last = np.log((1.0 + 0.9**6) / (1.0 + 0.9**7))
    assert outcome.reason == (
        f"The iteration did not converge in 7 steps, the last changed a parameter by {last:.1e}, "
        f"relative: raise max_iterations, or {FOLLOW}"
    )
    assert len(outcome.iterations) == 8
    assert outcome.values == pytest.approx([1.0 + 0.9**7])


@pytest.mark.parametrize(
    ("second", "said"),
    [(0.9e-4, REST), (1.1e-4, ROUNDING), (1.1e-3, REST)],
)
def test_two_changes_are_enough_to_see_rounding(second: float, said: str) -> None:
    """The first is 1e-4; the second is no shorter, and no longer than the root of 1e-6."""

    def following(p: Floats) -> Floats:
        return 2.0 * np.exp([1e-4 if p[0] < 2.00001 else 1e-4 + second])

    outcome = iterate(Map(following), options=replace(OUTPUT, tolerance=1e-6))
    assert outcome.status == "converged"
    assert outcome.reason == said
    assert len(outcome.iterations) == (2 if said == ROUNDING else 3)


def test_rounding_is_rest() -> None:
    outcome = iterate(Map(lambda p: 1.0 + 1e-6 * np.sin(1e9 * p)))
    assert outcome.status == "converged"
    assert "rounding" in outcome.reason


def test_step_to_parameters_without_solution_is_shortened() -> None:
    outcome = iterate(Map(lambda p: 3.0 + 0.5 * (3.0 - p), limit=3.2))
    assert outcome.status == "converged"
    assert outcome.values == pytest.approx([3.0], rel=1e-7)
    assert outcome.iterations[1].note == "shortened: no solution"
    nowhere = iterate(Map(lambda p: p + 1e6, limit=2.0))
    assert nowhere.status == "not-converged"
    assert nowhere.reason == (
        "The condensed equations lead to parameters at which the model has no solution: give "
        f"tighter bounds, or {FOLLOW}"
    )


@pytest.mark.parametrize(("halvings", "found"), [(0, True), (1, True), (9, True), (10, False)])
def test_a_step_is_halved_nine_times(halvings: int, found: bool) -> None:
    """From 2 towards 18; the limit lies above what so many halvings lead to."""
    limit = 2.0 + 1.01 * 16.0 / 2.0**halvings
    model = Map(lambda p: np.array([18.0]), limit=limit)
    outcome = iterate(model, options=replace(OUTPUT, max_iterations=1))
    assert ("at which the model has no solution" in outcome.reason) != found
    assert len(outcome.iterations) == (2 if found else 1)
    if found:
        reached = 2.0 + 16.0 / 2.0**halvings
        last = outcome.iterations[1]
        assert last.values == pytest.approx([reached])
        assert last.step == pytest.approx(np.log(reached / 2.0))
        assert last.note == ("shortened: no solution" if halvings else "accepted")
        words = f"changed a parameter by {last.step:.1e}, relative"
        assert (words in outcome.reason) == (halvings > 0)


@pytest.mark.parametrize(("growing", "said"), [(6, "in 40 steps"), (7, "diverges")])
def test_six_changes_in_a_row_that_grow_are_divergence(growing: int, said: str) -> None:
    """Up in steps of a factor that grows so often, then smaller ones in turn."""
    factors = [1.1 + 0.1 * k for k in range(growing)] + [1.05, 1.04] * 30
    ends = 2.0 * np.cumprod([1.0, *factors])

    def following(p: Floats) -> Floats:
        return ends[[int(np.argmin(np.abs(ends / p - 1.0))) + 1]]

    outcome = iterate(Map(following), options=replace(OUTPUT, max_iterations=40))
    assert said in outcome.reason
    assert len(outcome.iterations) == (41 if growing == 6 else 8)


def test_numbers_that_are_none_are_said() -> None:
    model = Map(lambda p: p)
    model.condense = lambda p, measured, sd: Condensed(  # type: ignore[method-assign]
        p, np.eye(1), np.full((1, 1), np.nan), p
    )
    with pytest.raises(ModelError, match="misfit is not a finite number") as caught:
        iterate(model)
    assert "Check the units" in caught.value.hint
    endless = Map(lambda p: p)
    endless.readings = lambda p: np.full(1, np.inf)  # type: ignore[method-assign]
    endless.condense = lambda p, measured, sd: Condensed(  # type: ignore[method-assign]
        np.full(1, np.inf), np.eye(1), np.ones((1, 1)), p
    )
    with pytest.raises(ModelError, match="misfit is not a finite number"):
        iterate(endless)


@pytest.mark.parametrize(("part", "rows"), [(0.9e-9, [0]), (1.1e-9, [0, 2])])
def test_rows_that_are_new_by_a_billionth_are_independent(part: float, rows: list[int]) -> None:
    """The second row is zero; the third leaves the direction of the first by a part."""
    S = np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [5.0, 0.0, 5.0 * part]])
    assert len(independent_readings(S)) == len(rows)
    assert independent_readings(np.diag([3.0, 0.0, 1e-100])).tolist() == [0, 2]


def test_a_cycle_is_closed_to_a_thousandth_of_its_step() -> None:
    """2, 4, and back to 2 but for a part of ln 2."""
    for part, closed in ((0.9e-3, True), (1.1e-3, False)):
        back = 2.0 * 2.0**-part  # so far from 2, and the step there as much longer
        ends = {2.0: 4.0, 4.0: back}

        def following(p: Floats, ends: dict[float, float] = ends, back: float = back) -> Floats:
            return np.array([ends.get(float(p[0].round(9)), back * 1.5)])

        outcome = iterate(Map(following), options=replace(OUTPUT, max_iterations=2))
        assert ("cycle" in outcome.reason) == closed


def test_start_without_solution_is_an_error() -> None:
    with pytest.raises(ModelError, match="too large"):
        iterate(Map(lambda p: p, limit=1.0))


def test_observer_stops_it() -> None:
    case = problem(Map(lambda p: 0.9 * p + 0.1))
    outcome = condensation(case, OUTPUT, lambda at: "enough" if at.number == 2 else None)
    assert (outcome.status, outcome.reason) == ("out-of-budget", "enough")
    assert len(outcome.iterations) == 3
    assert outcome.objective == min(at.objective for at in outcome.iterations)


def test_flexibility_that_cannot_be_inverted_names_the_remedy() -> None:
    S = np.array([[0.0, 0.0], [1.0, 0.0]])
    model = Map(lambda p: np.ones(2), flexibility=S)
    with pytest.raises(ModelError) as caught:
        iterate(model, options=EQUATION)
    assert caught.value.message == (
        "The readings cannot be turned into forces: the flexibility of the model at the gauges is "
        "singular."
    )
    assert caught.value.hint == "Use weighting: output."


# --- what it refuses ---


class Answers:
    """A model that offers readings only."""

    names = ("p1",)
    counts = Counts()

    def admissible(self, p: Floats) -> str | None:
        return None

    def readings(self, p: Floats) -> Floats:
        raise AssertionError("Nothing is computed before the refusal.")

    evaluate = readings


def test_model_without_affine_equations_is_refused() -> None:
    parameters = (Parameter("p1", start=1.0, lower=0.1, upper=10.0),)
    with pytest.raises(InputError, match="no equations that are affine") as refusal:
        condensation(Problem(Answers(), np.ones(1), np.ones(1), parameters), OUTPUT, go_on)  # type: ignore[arg-type]
    (fault,) = refusal.value.faults
    assert fault.code == "method-not-possible"
    assert fault.hint == "Use the method gauss-newton or simplex."


def test_obstacle_of_the_model_is_passed_on() -> None:
    with pytest.raises(InputError, match="not possible: Poisson's ratio is a parameter"):
        iterate(Map(lambda p: p, why_not="Poisson's ratio is a parameter."))


def test_prior_is_refused_with_errors_in_forces() -> None:
    case = problem(Map(lambda p: p), prior=Prior(1.0, 0.1))
    (fault,) = condensation_faults(case.response, case.parameters, EQUATION)
    assert "takes no priors (p1)" in fault.message
    assert fault.hint == (
        "Use weighting: output, leave out the priors, or use the method gauss-newton."
    )
    assert condensation_faults(case.response, case.parameters, OUTPUT) == ()
    with pytest.raises(InputError, match="takes no priors"):
        condensation(case, EQUATION, go_on)
