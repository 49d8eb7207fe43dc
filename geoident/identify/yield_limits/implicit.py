"""The implicit formulation: a search over the parameters alone (theory 5).

The complementarity system of every stage counts as solved: the response is a function of the
parameters alone, continuous and piecewise smooth, with the exact derivative of the active pieces.
Its discrepancy has many local minima. The way to the global one is

    scan        all strengths lowered together from what hardly yields (`starts`),
    descent     Gauss-Newton from its best point, or from the given start if that is better,
    restarts    descents from around the best point (`starts`), until the readings are met exactly
                or some of them in a row found nothing better; one that has come as low as the best
                point is left where its next step promises nothing better,
    elsewhere   plain descents from other points where strengths ended unreached,
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

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Iterate, Step
from geoident.identify.least_squares.descent import Descent, Ending, Stopping
from geoident.identify.least_squares.gauss_newton import gauss_newton_descent, gauss_newton_step
from geoident.identify.least_squares.several_starts import halton_starts
from geoident.identify.least_squares.trust_region import TrustBox
from geoident.identify.problem.ahead import ProblemData, at_once, prefetching, without_model
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.responses import YieldSystem
from geoident.identify.yield_limits.starts import Restarts, raised, strength_scan
from geoident.identify.yield_limits.stationarity import (
    GLOBAL,
    NONE,
    StationarityCheck,
    certificate,
    check,
    open_above,
)
from geoident.identify.yield_limits.yield_points import YieldIterate, strengths, yield_evaluator
from geoident.model.arrays import Floats
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions
from geoident.model.response import Response
from geoident.model.yielding import Certificate

EXACT = 1e-4
"""Residuals below this part of the standard deviations meet the readings exactly."""

SAME = 1e-3
"""A misfit lower by less than this part is no better one: far below the scatter of phi."""

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

_SPENT = (
    "The search was not finished in {} evaluations: raise max_evaluations, start nearer to the "
    "expected values or give tighter bounds."
)

_STALLED = (
    "The search ended at a kink of the response near which points are better: raise restarts or "
    "max_evaluations, or continue with the method simplex."
)

_AT_KINK = (
    "The search ended at a kink of the response, where points begin or cease to yield; the slopes "
    "to all its sides say that nothing near is better."
)


def implicit(
    problem: Problem, options: ComplementarityOptions, on_iteration: OnIteration
) -> Outcome:
    """Minimises the misfit over the parameters, the stages solved for every trial.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: restarts, tolerance, budget.
        on_iteration: is called with every trial; its reason to stop ends the search.

    Returns:
        The best point that was evaluated, with its certificate.

    Raises:
        ModelError: no start has a solution.
    """
    return ImplicitSearch(problem, options, on_iteration).run()


def descend(
    problem: Problem, options: ComplementarityOptions, on_iteration: OnIteration
) -> Outcome:
    """One descent from the start, and what kind of point it ends at: no scan.

    For a problem that differs little from one that was solved: the start is its solution. It
    restarts only where it stalls at a kink near which points are better.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: tolerance, budget.
        on_iteration: is called with every trial; its reason to stop ends the search.

    Raises:
        ModelError: the start has no solution.
    """
    return ImplicitSearch(problem, options, on_iteration).descend()


def certificate_at(problem: Problem, p: Floats, history: History) -> Certificate | None:
    """What kind of point an end of another search is.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        p: (n,) the end, SI.
        history: is told of the points around it that are compared.

    Returns:
        The certificate; None where the model has no solution.
    """
    model = problem.response
    assert isinstance(model, YieldSystem)
    evaluator = yield_evaluator(Discrepancy(problem), history, model)
    point = evaluator.try_point(evaluator.scaling.to_scaled(p))
    if point is None:
        return None
    exact = point.phi <= EXACT**2 * len(problem.measured)
    checked = check(evaluator, point, exact=exact, spent=lambda: history.stop is not None)
    return certificate(checked, model.activity(point.p), model.names, exact=exact)


def is_better(point: Iterate, best: Iterate) -> bool:
    """A point is lower by more than what counts as the same."""
    return point.phi < (1.0 - SAME) * best.phi


def _step(box: TrustBox, point: YieldIterate, radius: float, *, rising: bool) -> Step:
    """The best step; unreached planes stay where they are, or rise out of its way.

    Where they all yield at once, the ground may collapse.
    """
    step = gauss_newton_step(box, point, radius)
    if not rising or not point.unreached.any():
        return step
    return replace(step, d=np.where(point.unreached, box.sides(point.x, ROOM)[1], step.d))


@dataclass(frozen=True)
class RestartTask:
    """A restart as a part of the search (`ahead`).

    Args:
        problem: apart from its model.
        options: of the search.
        x: (n,) where it begins.
        best: the best point.
        number: of the restart.
    """

    problem: ProblemData
    options: ComplementarityOptions
    x: Floats
    best: Iterate
    number: int

    def __call__(self, response: Response) -> None:
        """Make it."""
        search = ImplicitSearch(
            self.problem.with_model(response), self.options, lambda iteration: None
        )
        search.restart(self.x, self.best, self.number)


class ImplicitSearch:
    """One run of the implicit formulation.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: restarts, tolerance, budget.
        on_iteration: is called with every trial; its reason to stop ends the search.
    """

    def __init__(
        self, problem: Problem, options: ComplementarityOptions, on_iteration: OnIteration
    ) -> None:
        assert isinstance(problem.response, YieldSystem)
        self.problem, self.options, self.model = problem, options, problem.response
        discrepancy = Discrepancy(problem)
        self.history = History("complementarity", problem.response, on_iteration)
        self.evaluator = yield_evaluator(discrepancy, self.history, self.model)
        self.scaling, box = self.evaluator.scaling, self.evaluator.box
        steps = GaussNewtonOptions(tolerance=options.tolerance)
        stopping = Stopping(box, options.tolerance)
        self._rising, self._waiting = (
            Descent(
                self.evaluator, partial(_step, box, rising=rising), stopping, steps.max_iterations
            )
            for rising in (True, False)
        )
        self._descent = self._rising  # as the last restart went
        self._plain: Descent[Iterate] = gauss_newton_descent(discrepancy, steps, self.history)
        self._remarks: list[str] = []
        self._exact = EXACT**2 * len(problem.measured)
        self._freedom = max(len(problem.measured) - len(self.scaling), 1)
        self._tried = 0
        self._evaluated_before = problem.response.counts.evaluations

    def run(self) -> Outcome:
        """All of the module's head.

        Raises:
            ModelError: no start has a solution.
        """
        best = self._from_elsewhere(self._improved(self._begin()))
        return self._outcome(*self._settled(best))

    def descend(self) -> Outcome:
        """A descent from the start and its certificate.

        Raises:
            ModelError: the start has no solution.
        """
        start = self.evaluator.evaluate(self.scaling.start)
        self.evaluator.record(self.scaling.start, start, 0.0, "start")
        self._descent = self._waiting
        best, checked = self._settled(self._descent.run(start, self._stuck))
        if checked.lower is not None and not self.spent():  # changed weights make other kinks
            best, checked = self._settled(self._improved(checked.lower))
        return self._outcome(best, checked)

    def spent(self) -> bool:
        """The evaluations are used up, or somebody stopped the search."""
        used = self.model.counts.evaluations - self._evaluated_before
        return used >= self.options.max_evaluations or self.history.stop is not None

    def _begin(self) -> YieldIterate:
        """The given start or the best point of the scan, whichever is better.

        Where the start has no solution: the strongest ground, or another point that has one, and
        the start with its strengths raised until the ground stands. What was found with the
        readings of fewer stages is often a little too weak for the later ones, and right in all
        else.

        Raises:
            ModelError: no start has a solution.
        """
        scaling, evaluator = self.scaling, self.evaluator
        start: YieldIterate | None = None
        try:
            point = start = evaluator.evaluate(scaling.start)
            evaluator.record(scaling.start, start, 0.0, "start")
        except ModelError as error:
            self._remarks.append(f"The search began elsewhere than at the start: {error.message}")
            evaluator.record(scaling.start, None, 0.0, "start: no solution")
            strongest = np.where(np.isfinite(scaling.upper), scaling.upper, scaling.start)
            for x in (strongest, *halton_starts(scaling, _FALLBACKS)):
                rescue = evaluator.start(x, "rescue")
                if rescue is not None:
                    break
            else:
                raise
            point = rescue
        strength = strengths(point.activity, scaling.dp_dx(point.p))
        if start is None and strength.any():
            for x in raised(scaling, strength):
                start = None if self.spent() else evaluator.start(x, "stronger")
                if start is not None or self.spent():
                    break
            point = start or point
        if not strength.any() or point.phi <= self._exact:
            return point
        return strength_scan(evaluator, strength, start) or point

    def _improved(self, start: YieldIterate) -> Ending[YieldIterate]:
        """The best ending of a descent from a start and of restarts around it.

        Where there are several processes, restarts are computed ahead: they are the right ones as
        long as none of them is lower.
        """
        self._descent = self._rising
        best = self._descent.run(start, self._stuck)
        dp_dx = self.scaling.dp_dx(best.point.p)
        restarts = Restarts(strengths(best.point.activity, dp_dx), self.options.seed)
        fruitless, left = 0, self.options.restarts
        while left > 0 and not self._enough(best, fruitless):
            most = min(left, self._patience(best) - fruitless)
            around = best.point
            known = Iterate(around.x, around.p, around.linearization)
            drawn = deepcopy(restarts)
            places = [self._place(drawn, around) for _ in range(min(most, at_once(self.model)))]
            tasks = [
                RestartTask(without_model(self.problem), self.options, x, known, self._tried + k)
                for k, x in enumerate(places)
            ]
            with prefetching(self.model, tasks) as turn:
                for k in range(len(places)):
                    turn(k)
                    ending = self.restart(self._place(restarts, around), known, self._tried)
                    self._tried += 1
                    left -= 1
                    lower = ending is not None and ending.point.phi < best.point.phi
                    better = ending is not None and is_better(ending.point, best.point)
                    fruitless = 0 if better else fruitless + 1
                    if ending is not None and lower:
                        best = ending
                    if lower or self._enough(best, fruitless):
                        break
        return self._descent.run(best.point, self._stuck)

    def restart(self, x: Floats, best: Iterate, number: int) -> Ending[YieldIterate] | None:
        """One descent, left where it ends no lower than the best; None without a solution.

        Args:
            x: (n,) where it begins.
            best: the best point.
            number: of the restart, from 0; every other one lets unreached planes rise.
        """
        self._descent = self._waiting if number % 2 else self._rising
        start = self.evaluator.start(x, "restart")

        def give_up(steps: int, radius: float, lowest: float) -> bool:
            far = steps >= _SLOW and lowest > _FAR * best.phi
            return far or steps >= _TRIAL_STEPS or self._stuck(steps, radius, lowest)

        beside = best.phi + _BESIDE * max(1.0, best.phi / self._freedom)

        def returns(point: Iterate, full: Step) -> bool:
            promised = point.phi - full.gain
            no_lower = full.length <= _NEXT and promised >= (1.0 - _NO_LOWER) * best.phi
            return no_lower and best.phi <= point.phi <= beside

        return None if start is None else self._descent.run(start, give_up, returns)

    def _place(self, restarts: Restarts, best: YieldIterate) -> Floats:
        """Where a restart begins, x (n,)."""
        return self.scaling.clip(restarts.around(best, self.evaluator.box.unit(best.x)))

    def _enough(self, best: Ending[YieldIterate], fruitless: int) -> bool:
        """No further restart is needed, or may be made."""
        met = best.point.phi <= self._exact
        return self.spent() or met or fruitless >= self._patience(best)

    def _patience(self, best: Ending[YieldIterate]) -> int:
        """Restarts in a row without a better point that end the search.

        Few where the residuals are explained by the errors of the readings (chi-squared of the
        degrees of freedom, three standard deviations to both sides); more where something is
        unexplained, or the readings are more exact than stated.
        """
        n = len(self.scaling)
        if abs(best.point.phi - self._freedom) <= 3.0 * np.sqrt(2.0 * self._freedom):
            return max(n, 2)
        return 3 * max(n * (n + 1) // 2, 2)

    def _from_elsewhere(self, best: Ending[YieldIterate]) -> Ending[YieldIterate]:
        """Where strengths ended unreached: the end of a plain descent, if it is better.

        With cohesion and friction both free, the ground may seem elastic with either far off; the
        search then stays there, since what it knows of one strength holds only beside the other.
        Plain descents begin at the start, and with all that moves planes half way to the weak side.
        """
        point = best.point
        if not point.unreached.any() or point.phi <= self._exact or self.spent():
            return best
        moves = np.any(point.activity.slopes != 0.0, axis=0)
        start, lower = self.scaling.start, self.scaling.lower
        half = 0.5 * (start + np.where(np.isfinite(lower), lower, start))
        for x in (start, np.where(moves, half, point.x)):
            plain = self._plain.evaluator.start(x, "plain descent")
            if plain is None:
                continue
            end = self._plain.run(plain, self._stuck).point
            if is_better(end, best.point):
                best = self._improved(self.evaluator.evaluate(end.x))
        return best

    def _settled(
        self, best: Ending[YieldIterate]
    ) -> tuple[Ending[YieldIterate], StationarityCheck]:
        """An ending from which no side of a kink leads on, as far as a few rounds go.

        Where few readings are met far better than their errors, there is a lower point beside
        nearly every kink, by less than anybody will ever notice.
        """
        for rounds in range(_ROUNDS + 1):
            checked = check(
                self.evaluator,
                best.point,
                exact=best.point.phi <= self._exact,
                spent=self.spent,
                least=self.options.tolerance,
            )
            if checked.lower is None or self.spent() or rounds == _ROUNDS:
                break
            best = self._descent.run(checked.lower, self._stuck)
        return best, checked

    def _stuck(self, number: int, radius: float, lowest: float) -> bool:
        """After some steps, the descent goes back and forth over a kink, or may cost no more."""
        return (number > 0 and radius <= _KINK) or self.spent()

    def _outcome(self, best: Ending[YieldIterate], checked: StationarityCheck) -> Outcome:
        """The best point with its certificate and the reason for stopping."""
        point, names, exact = best.point, self.model.names, best.point.phi <= self._exact
        above: list[str] = []
        if not exact:
            reached = strengths(point.activity, self.scaling.dp_dx(point.p)) & ~point.unreached
            flags = open_above(self.evaluator, point, reached, spent=self.spent)
            above = [names[i] for i in np.flatnonzero(flags)]
        proof = certificate(checked, self.model.activity(point.p), names, exact=exact, above=above)
        status, reason = "converged", _AT_KINK if best.abandoned else best.reason
        if proof.kind == GLOBAL:
            reason = proof.remarks[0]
        elif self.spent():
            status, reason = "not-converged", _SPENT.format(self.options.max_evaluations)
        elif proof.kind == NONE:
            status, reason = "not-converged", _STALLED
        elif self._tried:
            descents = "One further descent" if self._tried == 1 else "{} further descents"
            reason = f"{reason} {descents.format(self._tried)} found nothing better."
        outcome = self.history.outcome(point.p, point.phi, status, reason)
        return replace(outcome, remarks=tuple(self._remarks), certificate=proof)
