"""Yield limits by complementarity (theory 5): the strengths with which the ground meets readings.

The implicit formulation takes the complementarity system of every stage as solved: the response
is a function of the parameters alone, continuous and piecewise smooth, with the exact derivative
of the active pieces. Its discrepancy has many local minima. The way to the global one is

    scan      all strengths lowered together from what hardly yields (`strength_scan`),
    descent   Gauss-Newton from its best point, or from the given start if that is better,
    restarts  descents from around the best point along what the readings hardly see (`valley`),
              until the readings are met exactly or some of them in a row found nothing better,
    waking    plain descents from elsewhere where strengths ended unreached,
    proof     what kind of point it is (`certify`); on from there where a side of it is lower.

On the way planes that no strain point reaches are brought as near as can be (`slack`): the
response is the same to the last digit, and they bite as soon as others give way. In every other
descent they go aside for each step, and are brought near again where it ended.

Parameters at which the ground collapses have no discrepancy and are stepped back from; the start
may be one of them. The formulations ``full-space`` and ``global`` are in modules of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from typing import cast

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Point, Step, Walk
from geoident.identify.least_squares.gauss_newton import Ending, Search
from geoident.identify.least_squares.starting_points import spread_starts
from geoident.identify.problem.history import History
from geoident.identify.problem.problem import Observer, Outcome, Problem
from geoident.identify.problem.protocols import YieldSystem
from geoident.identify.yield_limits.restarts import Valley
from geoident.identify.yield_limits.stationarity import (
    GLOBAL,
    NONE,
    Checked,
    certificate,
    check,
    open_above,
)
from geoident.identify.yield_limits.strength_scan import strength_scan
from geoident.identify.yield_limits.unreached import headroom, strengths, unreached
from geoident.model.arrays import Bools, Floats
from geoident.model.certificate import Activity, Certificate
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions

EXACT = 1e-4
"""Residuals below this part of the accuracies meet the readings exactly."""

CLOSE = 1e-6
"""An unreached plane is kept this far, relative, from where it is reached."""

SAME = 1e-3
"""A discrepancy lower by less than this part is no better one."""

_KINK = 1e-5
"""Steps shorter than this, relative, only go back and forth over a kink."""

_TRIAL_STEPS, _SLOW, _FAR = 12, 3, 10.0
"""Steps of a restart; after the first few, phi must be below this many times the best."""

ROOM = 0.5
"""How far, relative, an unreached plane that is to stay out of the way moves with each step."""

_ROUNDS = 3
"""How often a descent goes on from a better point at the side of a kink."""

_STALLED = (
    "The search ended at a kink of the response near which points are better: raise restarts or "
    "max_evaluations, or go on with the method simplex."
)

_RESCUES = 8
"""Starts that are tried where neither the start nor the strongest ground has a solution."""


Formulation = Callable[[Problem, ComplementarityOptions, Observer], Outcome]


def complementarity(
    problem: Problem, options: ComplementarityOptions, observe: Observer
) -> Outcome:
    """Minimises the discrepancy of a model with yield limits, theory 5.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: formulation, restarts, tolerance, budget.
        observe: is told of every trial; its reason to stop ends the search.

    Returns:
        The best point that was evaluated, with its certificate.

    Raises:
        InputError: the formulation is not possible for this model.
        ModelError: no start has a solution.
    """
    return _FORMULATIONS[options.formulation](problem, options, observe)


def _implicit(problem: Problem, options: ComplementarityOptions, observe: Observer) -> Outcome:
    return _Implicit(problem, options, observe).run()


def _other(module: str) -> Formulation:
    """A formulation of the same name as its module, which is imported when it runs."""

    def run(problem: Problem, options: ComplementarityOptions, observe: Observer) -> Outcome:
        function = getattr(import_module(f"geoident.identify.yield_limits.{module}"), module)
        return cast(Formulation, function)(problem, options, observe)

    return run


_FORMULATIONS: Mapping[str, Formulation] = {
    "implicit": _implicit,
    "full-space": _other("full_space"),
    "global": _other("global_bound"),
}


@dataclass(frozen=True)
class Seen(Point):
    """A point with the planes there, those that no strain point reaches as near as can be.

    Args:
        idle: (n,) strengths whose planes no strain point reaches.
        activity: of the evaluation.
    """

    idle: Bools
    activity: Activity


class YieldSearch(Search):
    """Evaluations and descents of a model with yield limits.

    Attributes:
        aside: unreached planes go aside in the next step, so that they do not hinder it (where
            they bite all at once the ground may collapse); else they wait where they are.
    """

    aside = True

    @property
    def model(self) -> YieldSystem:
        """The model."""
        return cast(YieldSystem, self.discrepancy.problem.response)

    def evaluate(self, x: Floats) -> Seen:
        """The model at x (n,), its unreached planes brought near."""
        point = super().evaluate(x)
        activity = self.model.activity(point.p)
        idle = unreached(activity, point.model.jacobian)
        room = headroom(activity) - CLOSE * np.abs(point.p)
        near = idle & np.isfinite(room) & (room > 0.0)
        p = np.where(near, point.p - np.where(near, room, 0.0), point.p)
        x = self.scaling.to_scaled(p)
        return Seen(x, self.scaling.to_natural(x), point.model, idle, activity)

    def step(self, point: Point, radius: float) -> Step:
        """The best step; unreached planes wait for it where they are, or go aside."""
        step = super().step(point, radius)
        idle = cast(Seen, point).idle
        if not self.aside or not idle.any():
            return step
        room = self.box.sides(point.x, ROOM)[1]
        return replace(step, d=np.where(idle, room, step.d))


def certificate_at(problem: Problem, p: Floats, history: History) -> Certificate | None:
    """What kind of point a parameter vector is; None where the model has no solution there.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        p: (n,), SI.
        history: is told of the points compared.
    """
    search = YieldSearch(problem, GaussNewtonOptions(), history)
    point = search.try_point(search.scaling.to_scaled(p))
    if point is None:
        return None
    model, activity = search.model, cast(Seen, point).activity
    exact = point.phi <= EXACT**2 * len(problem.measured)

    def stopped() -> bool:
        return history.stop is not None

    found = check(search, point, kinks=int(activity.biactive.sum()), exact=exact, spent=stopped)
    return certificate(found, model.activity(point.p), model.names, exact=exact)


class _Implicit:
    """One run of the implicit formulation."""

    def __init__(
        self, problem: Problem, options: ComplementarityOptions, observe: Observer
    ) -> None:
        steps = GaussNewtonOptions(tolerance=options.tolerance)
        history = History("complementarity", problem.response, observe)
        self.search = YieldSearch(problem, steps, history)
        self.history = history
        self.options = options
        self.remarks: list[str] = []
        self.exact = EXACT**2 * len(problem.measured)
        self.tried = 0
        self._first = problem.response.counts.evaluations

    def run(self) -> Outcome:
        """All of the module's head."""
        best = self.awake(self.improve(self.begin()))
        found = self.check(best)
        for _ in range(_ROUNDS):
            if found.lower is None or self.spent():
                break
            best = self.search.descend(found.lower, self.stuck)
            found = self.check(best)
        return self.outcome(best, found)

    def awake(self, best: Ending) -> Ending:
        """Where strengths ended unreached: what a plain descent finds, if it is better.

        With cohesion and friction both free, the ground may seem elastic with either far off; the
        search then stays there, since what it knows of one strength holds only beside the other.
        """
        if not cast(Seen, best.point).idle.any() or best.point.phi <= self.exact or self.spent():
            return best
        plain = Search(self.search.discrepancy.problem, self.search.options, self.history)
        for x in (plain.scaling.start, self.weak(best.point)):
            start = plain.try_point(x)
            plain.record(x, start, 0.0, "plain descent" if start else "plain descent: no solution")
            if start is None:
                continue
            found = plain.descend(start, self.stuck)
            if found.point.phi < (1.0 - SAME) * best.point.phi:
                best = self.improve(self.search.evaluate(found.point.x))
        return best

    def weak(self, point: Point) -> Floats:
        """A point (n,) like this one, with all that moves planes half way to the weak side."""
        slopes = cast(Seen, point).activity.slopes * self.search.scaling.slope(point.p)
        moves = np.abs(slopes).max(axis=0, initial=0.0) > 0.0
        start, lower = self.search.scaling.start, self.search.scaling.lower
        half = 0.5 * (start + np.where(np.isfinite(lower), lower, start))
        return np.where(moves, half, point.x)

    def check(self, best: Ending) -> Checked:
        """What one-sided derivatives say of the best ending."""
        point = cast(Seen, best.point)
        kinks = int(point.activity.biactive.sum())
        exact = point.phi <= self.exact
        return check(self.search, point, kinks=kinks, exact=exact, spent=self.spent)

    def begin(self) -> Seen:
        """The given start or the best point of the scan, whichever is better.

        Raises:
            ModelError: no start has a solution.
        """
        search = self.search
        start = self.first(search.scaling.start)
        seen = start or self.rescue()
        strength = strengths(seen.activity, search.scaling.slope(seen.p))
        if not strength.any() or seen.phi <= self.exact:
            return seen
        return cast(Seen, strength_scan(search, strength, start) or seen)

    def first(self, x: Floats) -> Seen | None:
        """The start, or None where the ground collapses, which is noted."""
        try:
            point = self.search.evaluate(x)
        except ModelError as error:
            self.search.record(x, None, 0.0, "start: no solution")
            self.remarks.append(f"The search began elsewhere than at the start: {error.message}")
            self.refused = error
            return None
        self.search.record(x, point, 0.0, "start")
        return point

    def rescue(self) -> Seen:
        """Any point that has a solution, where the start has none.

        Raises:
            ModelError: why the start has none, if nothing else was found.
        """
        scaling = self.search.scaling
        corner = np.where(np.isfinite(scaling.upper), scaling.upper, scaling.start)
        for x in (corner, *spread_starts(scaling, _RESCUES)):
            point = self.search.try_point(x)
            self.search.record(x, point, 0.0, "rescue" if point else "rescue: no solution")
            if point is not None:
                return cast(Seen, point)
        raise self.refused

    def improve(self, start: Point) -> Ending:
        """The best ending of a descent from a start and of restarts around it."""
        self.search.aside = True
        best = self.search.descend(start, self.stuck)
        valley = Valley(self.strength_of(best.point), self.options.seed)
        fruitless = 0
        for _ in range(self.options.restarts):
            if self.spent() or best.point.phi <= self.exact or fruitless >= self.patience(best):
                break
            ending = self.restart(valley, best)
            self.tried += 1
            better = ending is not None and ending.point.phi < (1.0 - SAME) * best.point.phi
            fruitless = 0 if better else fruitless + 1
            if ending is not None and ending.point.phi < best.point.phi:
                best = ending
        return self.search.descend(best.point, self.stuck)

    def restart(self, valley: Valley, best: Ending) -> Ending | None:
        """One descent from around the best point; None where it has no solution."""
        point, search = cast(Seen, best.point), self.search
        search.aside = self.tried % 2 == 0
        x = search.scaling.clip(valley.start(point, point.idle, search.box.unit(point.x)))
        start = search.try_point(x)
        search.record(x, start, 0.0, "restart" if start else "restart: no solution")
        if start is None:
            return None

        def hopeless(walk: Walk, number: int) -> bool:
            far = number >= _SLOW and walk.best.phi > _FAR * point.phi
            return far or number >= _TRIAL_STEPS or self.stuck(walk, number)

        return search.descend(start, hopeless)

    def stuck(self, walk: Walk, number: int) -> bool:
        """The descent goes back and forth over a kink, or may cost no more."""
        return (number > 0 and walk.radius <= _KINK) or self.spent()

    def spent(self) -> bool:
        """The evaluations are used up, or somebody stopped the search."""
        used = self.search.model.counts.evaluations - self._first
        return used >= self.options.max_evaluations or self.history.stop is not None

    def patience(self, best: Ending) -> int:
        """Restarts in a row without a better point that end the search.

        Few where what is left of the residuals is what the accuracies explain (chi-squared of the
        degrees of freedom, three standard deviations to both sides); more where something is
        unexplained, or the readings are more exact than stated.
        """
        n = len(self.search.scaling)
        freedom = max(len(self.search.discrepancy.problem.measured) - n, 1)
        if abs(best.point.phi - freedom) <= 3.0 * np.sqrt(2.0 * freedom):
            return max(n, 2)
        return 3 * max(n * (n + 1) // 2, 2)

    def strength_of(self, point: Point) -> Bools:
        """Strengths (n,) at a point."""
        activity = cast(Seen, point).activity
        return strengths(activity, self.search.scaling.slope(point.p))

    def outcome(self, best: Ending, found: Checked) -> Outcome:
        """The best point with its certificate and the reason for stopping."""
        point, model = best.point, self.search.model
        exact = point.phi <= self.exact
        above = () if exact else self.open_above(point)
        activity = model.activity(point.p)
        proof = certificate(found, activity, model.names, exact=exact, above=above)
        status, reason = self.ending(best, proof)
        return Outcome(
            point.p,
            point.phi,
            status,
            reason,
            self.history.iterations,
            remarks=tuple(self.remarks),
            certificate=proof,
        )

    def open_above(self, point: Point) -> list[str]:
        """Strengths of which the readings do not exclude that no point reaches their planes."""
        reached = self.strength_of(point) & ~cast(Seen, point).idle
        found = open_above(self.search, point, reached, spent=self.spent)
        return [self.search.model.names[i] for i in np.flatnonzero(found)]

    def ending(self, best: Ending, proof: Certificate) -> tuple[str, str]:
        """Status and reason."""
        if self.history.stop is not None:
            return "out-of-budget", self.history.stop
        if proof.kind == GLOBAL:
            return "converged", proof.remarks[0]
        if self.spent():
            return "not-converged", self.exhausted()
        if proof.kind == NONE:
            return "not-converged", _STALLED
        return "converged", f"{best.reason} {self.tried} further descents found nothing better."

    def exhausted(self) -> str:
        """That the evaluations were used up, and what to do."""
        return (
            f"The search was not finished in {self.options.max_evaluations} evaluations: raise "
            "max_evaluations, start nearer to the expected values or give tighter bounds."
        )
