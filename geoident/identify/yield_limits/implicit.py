"""The implicit formulation: a search over the parameters alone (theory 5).

The complementarity system of every stage counts as solved: the response is a function of the
parameters alone, continuous and piecewise smooth, with the exact derivative of the active pieces.
Its discrepancy has many local minima. The way to the global one is

    scan        all strengths lowered together from what hardly yields (`starts`),
    descent     Gauss-Newton from its best point, or from the given start if that is better,
    restarts    descents from around the best point (`starts`), until the readings are met exactly
                or some of them in a row found nothing better; one that has come as low as the best
                point is left where its next step promises nothing better,
    elsewhere   plain descents from other places where strengths ended unreached,
    certificate what kind of point it is (`stationarity`); on from there where a side of it is
                lower.

On the way planes that no strain point reaches are brought as near as can be (`unreached`): the
response is the same to the last digit, and they yield as soon as others give way. In every other
descent they rise out of the way with each step, and are brought near again where it ended.

Parameters at which the ground collapses have no discrepancy and are stepped back from; the start
may be one of them. Then it retreats towards stronger ground (`starts`), and the scan looks whether
there is better.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Iterate, Step
from geoident.identify.least_squares.descent import Descent, Ending, Evaluator, Stopping
from geoident.identify.least_squares.gauss_newton import gauss_newton_descent, gauss_newton_step
from geoident.identify.least_squares.several_starts import halton_starts
from geoident.identify.least_squares.trust_region import TrustBox
from geoident.identify.problem.ahead import ProblemApart, apart, at_once, in_turns
from geoident.identify.problem.outcome import History, Observer, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.responses import YieldSystem
from geoident.identify.yield_limits.starts import Restarts, raised, strength_scan
from geoident.identify.yield_limits.stationarity import (
    GLOBAL,
    NONE,
    StationarityCheck,
    YieldIterate,
    certificate,
    check,
    open_above,
    strengths,
    yield_evaluator,
)
from geoident.model.arrays import Bools, Floats
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions
from geoident.model.response import Response
from geoident.model.yielding import Certificate

EXACT = 1e-4
"""Residuals below this part of the accuracies meet the readings exactly."""

SAME = 1e-3
"""A discrepancy lower by less than this part is no better one."""

_KINK = 1e-5
"""Steps shorter than this, relative, only go back and forth over a kink."""

_TRIAL_STEPS, _SLOW, _FAR = 12, 3, 10.0
"""Steps of a restart; after the first few, phi must be below this many times the best."""

_BESIDE, _NEXT, _NO_LOWER = 1.0, 0.3, 3e-3
"""A restart is left where phi is no more than this above the best (a standard deviation of the
parameters; where residuals are not explained, as many times more as these are), and its next step
is no longer than this, relative, and does not promise to end lower than the best by this part."""

ROOM = 0.5
"""How far, relative, an unreached plane that is to stay out of the way rises with each step."""

_ROUNDS = 3
"""How often a descent goes on from a better point at the side of a kink."""

_FALLBACKS = 8
"""Starts that are tried where neither the start nor the strongest ground has a solution."""

_STALLED = (
    "The search ended at a kink of the response near which points are better: raise restarts or "
    "max_evaluations, or go on with the method simplex."
)

_AT_KINK = (
    "The search ended at a kink of the response, where points begin or cease to yield; the slopes "
    "to all its sides say that nothing near is better."
)


def _tried(descents: int) -> str:
    """What further descents have shown, a sentence with a space before it; empty without any."""
    if not descents:
        return ""
    count = "One further descent" if descents == 1 else f"{descents} further descents"
    return f" {count} found nothing better."


def implicit(problem: Problem, options: ComplementarityOptions, observe: Observer) -> Outcome:
    """Minimises the discrepancy over the parameters, the stages solved for every trial.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: restarts, tolerance, budget.
        observe: is told of every trial; its reason to stop ends the search.

    Returns:
        The best point that was evaluated, with its certificate.

    Raises:
        ModelError: no start has a solution.
    """
    return ImplicitSearch(problem, options, observe).run()


def descend(problem: Problem, options: ComplementarityOptions, observe: Observer) -> Outcome:
    """One descent from the start, and what kind of point it ends at: no scan.

    For a problem that differs little from one that was solved: the start is its solution. It
    restarts only where it stalls at a kink near which points are better.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: tolerance, budget.
        observe: is told of every trial; its reason to stop ends the search.

    Raises:
        ModelError: the start has no solution.
    """
    return ImplicitSearch(problem, options, observe).descend()


def certificate_at(problem: Problem, p: Floats, history: History) -> Certificate | None:
    """What kind of point an end of another search is.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        p: (n,) the end, SI.
        history: is told of the points around it that are compared.

    Returns:
        The certificate; None where the model has no solution.
    """
    model = _yield_system(problem)
    evaluator = yield_evaluator(Discrepancy(problem), history, model)
    point = evaluator.try_point(evaluator.scaling.to_scaled(p))
    if point is None:
        return None
    exact = point.phi <= _exact(problem)
    found = check(evaluator, point, exact=exact, spent=lambda: history.stop is not None)
    return certificate(found, model.activity(point.p), model.names, exact=exact)


def _yield_system(problem: Problem) -> YieldSystem:
    assert isinstance(problem.response, YieldSystem)
    return problem.response


def _exact(problem: Problem) -> float:
    """The discrepancy below which the readings are met exactly."""
    return EXACT**2 * len(problem.measured)


def is_better(found: Iterate, best: Iterate) -> bool:
    """A point is lower by more than what counts as the same."""
    return found.phi < (1.0 - SAME) * best.phi


def _waiting_step(box: TrustBox, point: YieldIterate, radius: float) -> Step:
    """The best step; unreached planes stay where they are."""
    return gauss_newton_step(box, point, radius)


def _rising_step(box: TrustBox, point: YieldIterate, radius: float) -> Step:
    """The best step; unreached planes rise out of its way.

    Where they all yield at once, the ground may collapse.
    """
    step = gauss_newton_step(box, point, radius)
    if not point.unreached.any():
        return step
    return replace(step, d=np.where(point.unreached, box.sides(point.x, ROOM)[1], step.d))


@dataclass(frozen=True)
class RestartLook:
    """A restart as a part of the search (`ahead`).

    Args:
        problem: apart from its model.
        options: of the search.
        x: (n,) where it begins.
        best: the best point.
        number: of the restart.
    """

    problem: ProblemApart
    options: ComplementarityOptions
    x: Floats
    best: Iterate
    number: int

    def __call__(self, response: Response) -> None:
        """Make it."""
        search = ImplicitSearch(self.problem.of(response), self.options, lambda iteration: None)
        search.restart(self.x, self.best, self.number)


class ImplicitSearch:
    """One run of the implicit formulation.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: restarts, tolerance, budget.
        observe: is told of every trial; its reason to stop ends the search.

    Attributes:
        evaluator: of all points.
        descent: how to go down, as the last restart did.
        tried: restarts so far.
    """

    def __init__(
        self, problem: Problem, options: ComplementarityOptions, observe: Observer
    ) -> None:
        steps = GaussNewtonOptions(tolerance=options.tolerance)
        discrepancy = Discrepancy(problem)
        history = History("complementarity", problem.response, observe)
        self.model = _yield_system(problem)
        self.evaluator: Evaluator[YieldIterate] = yield_evaluator(discrepancy, history, self.model)
        self.scaling, box = self.evaluator.scaling, self.evaluator.box
        stopping = Stopping(box, options.tolerance)
        self.descents = [
            Descent(self.evaluator, partial(step, box), stopping, steps.max_iterations)
            for step in (_rising_step, _waiting_step)
        ]
        self.descent = self.descents[0]
        self.plain: Descent[Iterate] = gauss_newton_descent(discrepancy, steps, history)
        self.history = history
        self.problem = problem
        self.options = options
        self.remarks: list[str] = []
        self.exact = _exact(problem)
        self.tried = 0
        self._first = problem.response.counts.evaluations

    def run(self) -> Outcome:
        """All of the module's head.

        Raises:
            ModelError: no start has a solution.
        """
        best, found = self.settled(self.from_elsewhere(self.improve(self.begin())))
        return self.outcome(best, found)

    def descend(self) -> Outcome:
        """A descent from the start and its certificate.

        Raises:
            ModelError: the start has no solution.
        """
        start = self.evaluator.evaluate(self.scaling.start)
        self.evaluator.record(self.scaling.start, start, 0.0, "start")
        self.descent = self.descents[1]
        best, found = self.settled(self.descent.run(start, self.stuck))
        if found.lower is not None and not self.spent():  # changed weights make other kinks
            best, found = self.settled(self.improve(found.lower))
        return self.outcome(best, found)

    def settled(self, best: Ending[YieldIterate]) -> tuple[Ending[YieldIterate], StationarityCheck]:
        """An ending from which no side of a kink leads on, as far as a few rounds go."""
        found = self.check(best)
        for _ in range(_ROUNDS):
            if found.lower is None or self.spent():
                break
            best = self.descent.run(found.lower, self.stuck)
            found = self.check(best)
        return best, found

    def begin(self) -> YieldIterate:
        """The given start or the best point of the scan, whichever is better.

        Raises:
            ModelError: no start has a solution.
        """
        start, refused = None, None
        try:
            start = self.evaluator.evaluate(self.scaling.start)
        except ModelError as error:
            self.remarks.append(f"The search began elsewhere than at the start: {error.message}")
            refused = error
        note = "start" if start is not None else "start: no solution"
        self.evaluator.record(self.scaling.start, start, 0.0, note)
        point = start or self.fallback()
        if point is None:
            assert refused is not None
            raise refused
        strength = strengths(point.activity, self.scaling.slope(point.p))
        if start is None and (start := self.retreat(strength)) is not None:
            point = start
        if not strength.any() or point.phi <= self.exact:
            return point
        return strength_scan(self.evaluator, strength, start) or point

    def fallback(self) -> YieldIterate | None:
        """Any point that has a solution, where the start has none: the strongest ground first."""
        scaling = self.scaling
        corner = np.where(np.isfinite(scaling.upper), scaling.upper, scaling.start)
        places = (corner, *halton_starts(scaling, _FALLBACKS))
        found = (self.evaluator.start(x, "rescue") for x in places)
        return next((point for point in found if point is not None), None)

    def retreat(self, strength: Bools) -> YieldIterate | None:
        """The start with its strengths raised until the ground stands, or None.

        What was found with the readings of fewer stages is often a little too weak for the later
        ones, and right in all else.

        Args:
            strength: (n,) parameters that are raised together.
        """
        if not strength.any():
            return None
        for x in raised(self.scaling, strength):
            if self.spent():
                return None
            point = self.evaluator.start(x, "stronger")
            if point is not None:
                return point
        return None

    def improve(self, start: YieldIterate) -> Ending[YieldIterate]:
        """The best ending of a descent from a start and of restarts around it."""
        self.descent = self.descents[0]
        best = self.descent.run(start, self.stuck)
        restarts = Restarts(self.strength_of(best.point), self.options.seed)
        fruitless, left = 0, self.options.restarts
        while left > 0 and not self.enough(best, fruitless):
            most = min(left, self.patience(best) - fruitless)
            for ending in self.restarted(restarts, best.point, most):
                left -= 1
                better = ending is not None and is_better(ending.point, best.point)
                fruitless = 0 if better else fruitless + 1
                lower = ending is not None and ending.point.phi < best.point.phi
                if ending is not None and lower:
                    best = ending
                if lower or self.enough(best, fruitless):
                    break
        return self.descent.run(best.point, self.stuck)

    def enough(self, best: Ending[YieldIterate], fruitless: int) -> bool:
        """No further restart is needed, or may be made."""
        met = best.point.phi <= self.exact
        return self.spent() or met or fruitless >= self.patience(best)

    def restarted(
        self, restarts: Restarts, best: YieldIterate, most: int
    ) -> Iterator[Ending[YieldIterate] | None]:
        """Descents from around the best point in turn; None where there is no solution.

        Several are looked at ahead: they are the right ones as long as none of them is lower.

        Args:
            restarts: where they begin.
            best: the best point.
            most: how many at most.
        """
        count = min(most, at_once(self.problem.response))
        known = Iterate(best.x, best.p, best.model)
        places, drawn = [], deepcopy(restarts)
        for _ in range(count):
            places.append(self.place(drawn, best))
        looks = [
            RestartLook(apart(self.problem), self.options, x, known, self.tried + k)
            for k, x in enumerate(places)
        ]
        with in_turns(self.problem.response, looks) as turn:
            for k in range(count):
                turn(k)
                x = self.place(restarts, best)
                ending = self.restart(x, known, self.tried)
                self.tried += 1
                yield ending

    def place(self, restarts: Restarts, best: YieldIterate) -> Floats:
        """Where a restart begins, x (n,)."""
        return self.scaling.clip(restarts.around(best, self.evaluator.box.unit(best.x)))

    def restart(self, x: Floats, best: Iterate, number: int) -> Ending[YieldIterate] | None:
        """One descent, left where it ends no lower than the best; None without a solution.

        Args:
            x: (n,) where it begins.
            best: the best point.
            number: of the restart, from 0; every other one lets unreached planes rise.
        """
        self.descent = self.descents[number % 2]
        start = self.evaluator.start(x, "restart")

        def give_up(steps: int, radius: float, lowest: float) -> bool:
            far = steps >= _SLOW and lowest > _FAR * best.phi
            return far or steps >= _TRIAL_STEPS or self.stuck(steps, radius, lowest)

        freedom = max(len(self.problem.measured) - len(self.scaling), 1)
        beside = best.phi + _BESIDE * max(1.0, best.phi / freedom)

        def returns(point: Iterate, full: Step) -> bool:
            promised = point.phi - full.gain
            no_lower = full.length <= _NEXT and promised >= (1.0 - _NO_LOWER) * best.phi
            return no_lower and best.phi <= point.phi <= beside

        return None if start is None else self.descent.run(start, give_up, returns)

    def from_elsewhere(self, best: Ending[YieldIterate]) -> Ending[YieldIterate]:
        """Where strengths ended unreached: what a plain descent finds, if it is better.

        With cohesion and friction both free, the ground may seem elastic with either far off; the
        search then stays there, since what it knows of one strength holds only beside the other.
        """
        if not best.point.unreached.any() or best.point.phi <= self.exact or self.spent():
            return best
        for x in (self.scaling.start, self.weakened(best.point)):
            start = self.plain.evaluator.start(x, "plain descent")
            if start is None:
                continue
            found = self.plain.run(start, self.stuck)
            if is_better(found.point, best.point):
                best = self.improve(self.evaluator.evaluate(found.point.x))
        return best

    def weakened(self, point: YieldIterate) -> Floats:
        """A point (n,) like this one, with all that moves planes half way to the weak side."""
        moves = np.any(point.activity.slopes != 0.0, axis=0)
        start, lower = self.scaling.start, self.scaling.lower
        half = 0.5 * (start + np.where(np.isfinite(lower), lower, start))
        return np.where(moves, half, point.x)

    def check(self, best: Ending[YieldIterate]) -> StationarityCheck:
        """What one-sided derivatives say of the best ending.

        Where few readings are met far better than their accuracies, there is a lower point beside
        nearly every kink, by less than anybody will ever notice.
        """
        exact, least = best.point.phi <= self.exact, self.options.tolerance
        return check(self.evaluator, best.point, exact=exact, spent=self.spent, least=least)

    def stuck(self, number: int, radius: float, lowest: float) -> bool:
        """The descent goes back and forth over a kink, or may cost no more.

        Args:
            number: of steps made.
            radius: of the trust region.
            lowest: phi so far; it plays no part.
        """
        return (number > 0 and radius <= _KINK) or self.spent()

    def spent(self) -> bool:
        """The evaluations are used up, or somebody stopped the search."""
        used = self.model.counts.evaluations - self._first
        return used >= self.options.max_evaluations or self.history.stop is not None

    def patience(self, best: Ending[YieldIterate]) -> int:
        """Restarts in a row without a better point that end the search.

        Few where what is left of the residuals is what the accuracies explain (chi-squared of the
        degrees of freedom, three standard deviations to both sides); more where something is
        unexplained, or the readings are more exact than stated.
        """
        n = len(self.scaling)
        freedom = max(len(self.problem.measured) - n, 1)
        if abs(best.point.phi - freedom) <= 3.0 * np.sqrt(2.0 * freedom):
            return max(n, 2)
        return 3 * max(n * (n + 1) // 2, 2)

    def strength_of(self, point: YieldIterate) -> Bools:
        """Strengths (n,) at a point."""
        return strengths(point.activity, self.scaling.slope(point.p))

    def outcome(self, best: Ending[YieldIterate], found: StationarityCheck) -> Outcome:
        """The best point with its certificate and the reason for stopping."""
        point, exact = best.point, best.point.phi <= self.exact
        above = () if exact else self.open_above(point)
        proof = certificate(
            found, self.model.activity(point.p), self.model.names, exact=exact, above=above
        )
        outcome = self.history.outcome(point.p, point.phi, *self.ending(best, proof))
        return replace(outcome, remarks=tuple(self.remarks), certificate=proof)

    def open_above(self, point: YieldIterate) -> list[str]:
        """Strengths of which the readings do not exclude that no point reaches their planes."""
        reached = self.strength_of(point) & ~point.unreached
        found = open_above(self.evaluator, point, reached, spent=self.spent)
        return [self.model.names[i] for i in np.flatnonzero(found)]

    def ending(self, best: Ending[YieldIterate], proof: Certificate) -> tuple[str, str]:
        """Status and reason."""
        if proof.kind == GLOBAL:
            return "converged", proof.remarks[0]
        if self.spent():
            return "not-converged", (
                f"The search was not finished in {self.options.max_evaluations} evaluations: raise "
                "max_evaluations, start nearer to the expected values or give tighter bounds."
            )
        if proof.kind == NONE:
            return "not-converged", _STALLED
        return "converged", f"{_AT_KINK if best.abandoned else best.reason}{_tried(self.tried)}"
