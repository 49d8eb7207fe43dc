"""A descent in a trust region: from a start down until nothing is left to do (theory 4.2).

It is put together from its parts, so that the search for strengths can replace some:

    evaluation   what is known of a point x, noted in the history             `Evaluator`
    proposal     the step from a point, no longer than the trust radius       `gauss_newton_step`
    acceptance   which trials are taken, and the next radius                  `Acceptance`
    stopping     when nothing is left to do                                   `Stopping`

Every trial costs one evaluation of the model, with the Jacobian from the same factorization, and
nothing is evaluated twice. A descent ends on what the *next* step promises, before paying for it:

    step    the step without trust region is not longer than ``tolerance`` (relative), or
    gain    it promises to lower phi by less than ``tolerance`` min(phi, 1e4): phi is in squared
            standard deviations, so with 1e-8 this step is below a hundredth of one.

Where residuals vanish at the solution, convergence is quadratic and the first rule ends it. A trial
where the model has no solution is rejected. Where readings are rough, as where a wall sticks and
slips, steps do not bring what they promise: two of them in a row end a descent as soon as no more
is promised than a fifth of a standard deviation is worth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Acceptance, Iterate, IterateT, Step
from geoident.identify.least_squares.trust_region import TrustBox
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy
from geoident.identify.problem.responses import HasDifferences, HasEvaluated
from geoident.model.arrays import Floats

NEGLIGIBLE = 1e-6
"""A promised gain of a thousandth of a standard deviation, squared."""

UNSEEN_SD = 2.0
"""Standard deviations of the noise of phi within which two values are not told apart."""

_SHORTEST = 1e-8
"""Radius below which what a step changes in phi is rounding, however small the tolerance."""

_STALLED = (
    "No shorter step lowers the misfit, although the derivatives predict that it falls by {:.1g}: "
    "the computed readings are not smooth here; continue with the method simplex."
)
AT_KINK = 1e-2
"""A promised gain that is not worth looking for where the readings are not smooth.

The misfit rises by 1 within a standard deviation: what is promised lies within a tenth of one. The
derivatives of ground without dilation are off by up to a few percent (theory 5.4), and promise such
gains at the very minimum.
"""
AT_ROUGH, ROUGH = 0.04, 1e-3
"""The same where two steps in a row did not bring theirs: a fifth of a standard deviation.

And in parts of phi: where the readings are met exactly, every gain is small and worth taking.
"""

_KINKED = (
    "The computed readings are not smooth here. By the derivatives the misfit could fall by at "
    "most {:.1g}, which is negligible: one standard deviation is 1."
)
_STOPPED = "The search was stopped."
_FLAT = "The misfit is flat here: it has no slope along any parameter that is free to move."
_GIVEN_UP = "The descent was stopped: it did not come near the best point."
_NOISE = (
    "The next step would lower the misfit by {:.1g}, no more than what is noise of the computed "
    "readings."
)
_ROUNDING = "The misfit cannot be lowered further: only rounding remains."
_EXHAUSTED = (
    "The search did not converge in {} steps: raise max_iterations, start nearer to the expected "
    "values or give tighter bounds."
)

GiveUp = Callable[[int, float, float], bool]
"""(steps made, trust radius, lowest phi) -> whether a descent is not worth going on."""

Leave = Callable[[IterateT, Step], bool]
"""(point, the step that comes next without trust region) -> the same."""


@dataclass(frozen=True)
class Ending(Generic[IterateT]):
    """Where one descent ended, and why.

    Args:
        point: the best point.
        status: ``converged`` or ``not-converged``.
        reason: a sentence; with its remedy where it did not converge.
        abandoned: it was not worth going on.
        stalled: no step lowered phi, although the derivatives said so.
    """

    point: IterateT
    status: str
    reason: str
    abandoned: bool = False
    stalled: bool = False


class Evaluator(Generic[IterateT]):
    """Evaluates points of one problem and notes them.

    Args:
        discrepancy: of the problem.
        history: is told of every point that is recorded.
        extend: adds to a point what a search needs beside its residuals.
    """

    def __init__(
        self, discrepancy: Discrepancy, history: History, extend: Callable[[Iterate], IterateT]
    ) -> None:
        self.discrepancy = discrepancy
        self.scaling = discrepancy.scaling
        self.box = TrustBox(self.scaling)
        self.history = history
        self._extend = extend
        self._visited: list[tuple[Floats, float, Floats]] = []  # x, phi and half its gradient

    def begins_uphill(self, part: float, fall: float) -> bool:
        """Whether between two points that were evaluated the way to the lower one begins uphill.

        Then the set of points below a value is not convex: phi is not quasi-convex, and may have
        several minima.

        Args:
            part: rise that the slope promises at least, as part of the actual fall.
            fall: of phi between the two, at least.
        """
        for x, phi, half_gradient in self._visited:
            for y, lower, _ in self._visited:
                rise = 2.0 * float(half_gradient @ (y - x))
                if phi - lower > fall and rise > part * (phi - lower):
                    return True
        return False

    def evaluate(self, x: Floats) -> IterateT:
        """The model at x (n,).

        Raises:
            ModelError: it has no solution there.
        """
        p = self.scaling.to_natural(x)
        at = self.discrepancy.linearize(p)
        self._visited.append((x, at.objective, at.jacobian.T @ at.residual))
        return self._extend(Iterate(x, p, at))

    def try_point(self, x: Floats) -> IterateT | None:
        """The model at x (n,), or None where it has no solution."""
        try:
            return self.evaluate(x)
        except ModelError:
            return None

    def sharper(self, point: IterateT) -> IterateT | None:
        """The same point with better derivatives, where there are any to be had.

        Args:
            point: that was evaluated.
        """
        response = self.discrepancy.problem.response
        if not isinstance(response, HasDifferences) or not response.sharpen(point.p):
            return None
        return self.try_point(point.x)

    def value(self, x: Floats, length: float, note: str) -> float:
        """Phi at x (n,) without derivatives, recorded; infinite where there is no solution.

        Args:
            x: (n,) where.
            length: of the step that led there.
            note: such as ``probe``.
        """
        p = self.scaling.to_natural(x)
        phi = self.discrepancy.objective(p)
        self.history.record(p, phi, step=length, note=note)
        return phi

    def evaluated_near(self, x: Floats, part: float) -> Iterator[Iterate]:
        """Points near x (n,) that this search or one before evaluated, at no cost.

        Args:
            x: (n,) where.
            part: how far, in steps of one.
        """
        response = self.discrepancy.problem.response
        if not isinstance(response, HasEvaluated):
            return
        for p in response.evaluated_points():
            other = self.scaling.to_scaled(p)
            if self.box.length(x, other - x) <= part:
                yield Iterate(other, p, self.discrepancy.linearize(p))

    def record(self, x: Floats, point: Iterate | None, length: float, note: str) -> None:
        """Notes a point that was evaluated.

        Args:
            x: (n,) where.
            point: what was found, None for no solution.
            length: of the step that led there.
            note: such as ``accepted``.
        """
        phi = np.inf if point is None else point.phi
        self.history.record(self.scaling.to_natural(x), phi, step=length, note=note)

    def start(self, x: Floats, note: str) -> IterateT | None:
        """The model at a further start x (n,), recorded with a note; None without a solution."""
        point = self.try_point(x)
        self.record(x, point, 0.0, note if point is not None else f"{note}: no solution")
        return point


@dataclass(frozen=True)
class Stopping:
    """When nothing is left to do at a point.

    Args:
        box: measures steps.
        tolerance: relative size of a step that ends a descent.
        gain: relative gain that a step promises, likewise; None for the same.
        noise: standard deviation and mean rise of phi by noise of the computed readings (g,), SI.
    """

    box: TrustBox
    tolerance: float
    gain: float | None = None
    noise: Callable[[Floats], tuple[float, float]] = lambda readings: (0.0, 0.0)

    def reason(self, point: Iterate, full: Step) -> str | None:
        """Why nothing is left to do, judged by the unrestricted step that would come next."""
        if full.length <= self.tolerance:
            return (
                f"The next step would change no parameter by more than {self.tolerance:g}, "
                "relative."
            )
        gain = self.tolerance if self.gain is None else self.gain
        if full.gain <= max(gain * min(point.phi, 1e4), 1e-14 * point.phi):
            return f"The next step would lower the misfit by no more than {full.gain:.1e}."
        _, rise = self.noise(point.linearization.readings)
        if full.gain <= max(rise, min(AT_KINK, self._unseen(point))):
            return _NOISE.format(full.gain)
        return None

    def hidden(self, point: Iterate, change: float) -> bool:
        """A change of phi at a point may be noise of the computed readings.

        Args:
            point: where phi is compared with that of others.
            change: the difference.
        """
        unseen = self._unseen(point)
        return unseen > 0.0 and change <= unseen

    def _unseen(self, point: Iterate) -> float:
        """Differences of phi at a point that noise of the computed readings may make."""
        scatter, rise = self.noise(point.linearization.readings)
        return UNSEEN_SD * math.sqrt(2.0) * scatter + rise

    def negligible(self, full: Step) -> bool:
        """The unrestricted step is so short, for so little gain, that only rounding rejects it."""
        return full.gain <= NEGLIGIBLE and full.length <= np.sqrt(self.tolerance)

    def flat(self, point: Iterate) -> bool:
        """The residuals are orthogonal to all that the parameters, bounds allowing, can change."""
        return bool(np.all(gradient_cosines(self.box, point) <= np.sqrt(self.tolerance)))


def gradient_cosines(box: TrustBox, point: Iterate) -> Floats:
    """|J_h^T r| / (|J_h| |r|) of every parameter h, (n,); 0 where a bound holds it."""
    J, r = point.linearization.jacobian, point.linearization.residual
    low, high = box.sides(point.x, 1.0)
    g = J.T @ r
    g[((g > 0.0) & (low == 0.0)) | ((g < 0.0) & (high == 0.0))] = 0.0
    size = np.linalg.norm(J, axis=0) * np.linalg.norm(r)
    cosines: Floats = np.divide(np.abs(g), size, out=np.zeros_like(g), where=size > 0.0)
    return cosines


@dataclass(frozen=True)
class Descent(Generic[IterateT]):
    """Goes down from a start until its stopping rules end it.

    Args:
        evaluator: knows the model, and the reason to stop that was given.
        propose: (point, radius) -> the best step no longer than the radius.
        stopping: when nothing is left to do.
        max_steps: at most.
    """

    evaluator: Evaluator[IterateT]
    propose: Callable[[IterateT, float], Step]
    stopping: Stopping
    max_steps: int

    def run(
        self, start: IterateT, give_up: GiveUp | None = None, leave: Leave[IterateT] | None = None
    ) -> Ending[IterateT]:
        """Goes down; where derivatives are differences, better ones have the last word.

        Args:
            start: where from.
            give_up: is asked before every step.
            leave: likewise, with what comes next.
        """
        ending = self._run(start, give_up, leave)
        while not ending.abandoned and self.evaluator.history.stop is None:
            sharper = self.evaluator.sharper(ending.point)
            if sharper is None:
                break
            ending = self._run(sharper, give_up, leave)
        return ending

    def _run(
        self, start: IterateT, give_up: GiveUp | None, leave: Leave[IterateT] | None
    ) -> Ending[IterateT]:
        control, vain = Acceptance(start), 0
        for number in range(self.max_steps):
            point = control.point
            full = self.propose(point, np.inf)
            ending = self._ended(control, full)
            if ending is not None:
                return ending
            if control.point is not point:  # back from a detour
                point = control.point
                full = self.propose(point, np.inf)
            if (give_up and give_up(number, control.radius, control.best.phi)) or (
                leave and leave(point, full)
            ):
                return Ending(control.best, "not-converged", _GIVEN_UP, abandoned=True)
            step = self.propose(point, control.radius)
            x = self.evaluator.box.reach(point.x, step.d)
            trial = self.evaluator.try_point(x)
            note = control.judge(step, trial)
            self.evaluator.record(x, trial, step.length, note)
            if note == "rejected" and self.stopping.negligible(full):
                return Ending(control.best, "converged", _ROUNDING)
            if note == "rejected" and self.stopping.hidden(point, full.gain):
                return Ending(control.best, "converged", _NOISE.format(full.gain))
            kept = trial is not None and point.phi - trial.phi >= 0.25 * step.gain
            vain = 0 if kept else vain + 1
            promised = self.propose(control.best, np.inf).gain
            if vain >= 2 and promised <= min(AT_ROUGH, ROUGH * control.best.phi):
                return Ending(control.best, "converged", _KINKED.format(promised))
        exhausted = Ending(control.best, "not-converged", _EXHAUSTED.format(self.max_steps))
        return self._ended(control, self.propose(control.point, np.inf)) or exhausted

    def _ended(self, control: Acceptance[IterateT], full: Step) -> Ending[IterateT] | None:
        """The end of a descent, or None while there is something to do.

        Args:
            control: where the descent is; goes back to its best point after a vain detour.
            full: the step that comes next, without trust region.
        """
        best, point = control.best, control.point
        reason = self.stopping.reason(point, full)
        if reason and (point is best or self.stopping.hidden(best, point.phi - best.phi)):
            return Ending(point, "converged", reason)
        if reason:  # the detour led nowhere
            control.return_to_best()
        if control.radius <= max(self.stopping.tolerance, _SHORTEST):
            if self.stopping.flat(best):
                return Ending(best, "converged", _FLAT)
            promised = self.propose(best, np.inf).gain
            if promised <= AT_KINK:
                return Ending(best, "converged", _KINKED.format(promised))
            return Ending(best, "not-converged", _STALLED.format(promised), stalled=True)
        if self.evaluator.history.stop is not None:
            return Ending(best, "not-converged", _STOPPED)
        return None
