"""Condensation: how it ends, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from geoident.errors import InputError, ModelError
from geoident.identify.least_squares.condensation import condensation
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
FOLLOW = "continue from here with the method gauss-newton."


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


def test_prior_is_refused_with_errors_in_forces() -> None:
    case = problem(Map(lambda p: p), prior=Prior(1.0, 0.1))
    with pytest.raises(InputError) as refusal:
        condensation(case, EQUATION, go_on)
    (fault,) = refusal.value.faults
    assert "takes no priors (p1)" in fault.message
    assert fault.hint == (
        "Use weighting: output, leave out the priors, or use the method gauss-newton."
    )
    assert condensation(case, OUTPUT, go_on).iterations
