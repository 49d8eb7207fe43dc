"""Gauss-Newton in a trust region, with bounds (theory 4.2).

With the weighted residuals r and their Jacobian J in the scaled parameters x (see `discrepancy`),
each iteration minimises the linearised discrepancy

    m(d) = |r + J d|^2    over    lower <= x + d <= upper  and  d in the trust region

exactly (see `bounded`). The trust region is a box too: no parameter changes by more than a factor
exp(radius) in one step (see `trust`). A box joins with the bounds to a box, so bounds need no
special treatment: a step ends on a bound, and leaves it, as the Kuhn-Tucker conditions of m ask.
A direction that J does not see has no part in the step: a parameter without information stays
where it started.

Which trials are kept, and the next radius, is decided in `walk`. A trial point where the model has
no solution is rejected.

Every trial costs one evaluation of the model, with the Jacobian from the same factorization, and
nothing is evaluated twice. The search ends on what the *next* step promises, before paying for it:

    step    the step without trust region is not longer than ``tolerance`` (relative), or
    gain    it promises to lower phi by less than ``tolerance`` min(phi, 1e4): phi is in squared
            standard deviations, so with 1e-8 this step is below a hundredth of one.

Where residuals vanish at the solution, convergence is quadratic and the first rule ends it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Point, Step, Walk
from geoident.identify.least_squares.bounded import bounded_least_squares
from geoident.identify.least_squares.starting_points import spread_starts
from geoident.identify.least_squares.trust import TrustBox
from geoident.identify.objective.discrepancy import Discrepancy
from geoident.identify.problem.history import History
from geoident.identify.problem.problem import Observer, Outcome, Problem
from geoident.model.arrays import Floats
from geoident.model.methods import GaussNewtonOptions

NEGLIGIBLE = 1e-6
"""A promised gain of a thousandth of a standard deviation, squared."""


_STALLED = (
    "No shorter step lowers the discrepancy, although the derivatives promise it: the readings of "
    "the model are not smooth here; go on with the method simplex."
)
_FLAT = "The discrepancy is flat here: it has no slope along any parameter that is free to move."
_HOPELESS = "The descent was given up: it did not come near to the best point."
_ROUNDING = "The discrepancy cannot be lowered further: what is left is rounding."


Hopeless = Callable[[Walk, int], bool]
"""Whether a descent that has made this many steps is to be given up."""


@dataclass(frozen=True)
class Ending:
    """Where one descent ended, and why."""

    point: Point
    status: str
    reason: str


def gauss_newton(problem: Problem, options: GaussNewtonOptions, observe: Observer) -> Outcome:
    """Minimises the discrepancy with its exact Jacobian, theory [20] and 4.2.

    Args:
        problem: readings, model and parameters.
        options: tolerance, steps, starts.
        observe: is told of every trial; its reason to stop ends the search.

    Returns:
        The best point that was evaluated.

    Raises:
        ModelError: the model has no solution at the start.
    """
    return Search(problem, options, History("gauss-newton", problem.response, observe)).run()


class Search:
    """One run: what all its descents share.

    Args:
        problem: readings, model and parameters.
        options: tolerance, steps, starts.
        history: is told of every evaluation.
    """

    def __init__(self, problem: Problem, options: GaussNewtonOptions, history: History) -> None:
        self.discrepancy = Discrepancy(problem)
        self.scaling = self.discrepancy.scaling
        self.box = TrustBox(self.scaling)
        self.options = options
        self.history = history

    def run(self) -> Outcome:
        """All starts; the first must have a solution, the others give what they can."""
        point = self.evaluate(self.scaling.start)
        self.record(point.x, point, 0.0, "start")
        best = self.descend(point)
        for number, x in enumerate(spread_starts(self.scaling, self.options.starts - 1), start=2):
            if self.history.stop is not None:
                break
            further = self.try_point(x)
            note = f"start {number}" + (": no solution" if further is None else "")
            self.record(x, further, 0.0, note)
            if further is not None:
                best = min(best, self.descend(further), key=lambda ending: ending.point.phi)
        return self.outcome(best)

    def outcome(self, best: Ending) -> Outcome:
        """The best ending, or the observer's reason to stop."""
        status, reason = best.status, best.reason
        if self.history.stop is not None:
            status, reason = "out-of-budget", self.history.stop
        return Outcome(best.point.p, best.point.phi, status, reason, self.history.iterations)

    def descend(self, start: Point, hopeless: Hopeless | None = None) -> Ending:
        """Goes down from a start until a rule of the module's head ends it.

        Args:
            start: where from.
            hopeless: is asked before every step whether the descent is worth going on.
        """
        walk = Walk(start)
        for number in range(self.options.max_iterations):
            ending = self.ended(walk)
            if ending is None and hopeless is not None and hopeless(walk, number):
                ending = Ending(walk.best, "not-converged", _HOPELESS)
            if ending is not None:
                return ending
            point, step = walk.point, self.step(walk.point, walk.radius)
            trial = self.try_point(self.box.reach(point.x, step.d))
            note = walk.judge(step, trial)
            self.record(self.box.reach(point.x, step.d), trial, step.length, note)
            if note == "rejected" and self.negligible(point):
                return Ending(walk.best, "converged", _ROUNDING)
        return self.ended(walk) or Ending(walk.best, "not-converged", self.exhausted())

    def ended(self, walk: Walk) -> Ending | None:
        """The end of a descent, or None while there is something to do."""
        reason = self.finished(walk.point, self.step(walk.point, np.inf))
        if reason and walk.point is not walk.best:
            walk.return_to_best()
        elif reason:
            return Ending(walk.best, "converged", reason)
        if walk.radius <= self.options.tolerance and self.flat(walk.best):
            return Ending(walk.best, "converged", _FLAT)
        if walk.radius <= self.options.tolerance or self.history.stop is not None:
            return Ending(walk.best, "not-converged", _STALLED)
        return None

    def step(self, point: Point, radius: float) -> Step:
        """The best step of the linearised problem at a point, no longer than ``radius``."""
        J, r = point.model.jacobian, point.model.residual
        d = bounded_least_squares(J, r, *self.box.sides(point.x, radius))
        change = J @ d
        gain = -float(change @ (2.0 * r + change))
        return Step(d, self.box.length(point.x, d), gain)

    def finished(self, point: Point, full: Step) -> str | None:
        """Why nothing is left to do, judged by the step that would come next."""
        tolerance = self.options.tolerance
        if full.length <= tolerance:
            return f"The next step would change no parameter by more than {tolerance:g}, relative."
        if full.gain <= max(tolerance * min(point.phi, 1e4), 1e-14 * point.phi):
            return f"The next step would lower the discrepancy by no more than {full.gain:.1e}."
        return None

    def negligible(self, point: Point) -> bool:
        """The unrestricted step is so short, for so little gain, that only rounding rejects it."""
        full = self.step(point, np.inf)
        return full.gain <= NEGLIGIBLE and full.length <= np.sqrt(self.options.tolerance)

    def flat(self, point: Point) -> bool:
        """The residuals are orthogonal to all that the parameters, bounds allowing, can change."""
        J, r = point.model.jacobian, point.model.residual
        g = J.T @ r
        low, high = self.box.sides(point.x, 1.0)
        g[((g > 0.0) & (low == 0.0)) | ((g < 0.0) & (high == 0.0))] = 0.0
        size = np.linalg.norm(J, axis=0) * np.linalg.norm(r)
        return bool(np.all(np.abs(g) <= np.sqrt(self.options.tolerance) * size))

    def exhausted(self) -> str:
        """That the steps were used up, and what to do."""
        steps = self.options.max_iterations
        return (
            f"The search did not converge in {steps} steps: raise max_iterations, "
            "start nearer to the expected values or give tighter bounds."
        )

    def evaluate(self, x: Floats) -> Point:
        """The model at x (n,); raises ModelError where it has no solution."""
        p = self.scaling.to_natural(x)
        return Point(x, p, self.discrepancy.linearize(p))

    def try_point(self, x: Floats) -> Point | None:
        """The model at x (n,), or None where it has no solution."""
        try:
            return self.evaluate(x)
        except ModelError:
            return None

    def record(self, x: Floats, point: Point | None, length: float, note: str) -> None:
        """Notes a point that was evaluated.

        Args:
            x: (n,) where.
            point: what was found, or None for no solution.
            length: of the step that led there.
            note: such as ``accepted``.
        """
        phi = np.inf if point is None else point.phi
        self.history.record(self.scaling.to_natural(x), phi, step=length, note=note)
