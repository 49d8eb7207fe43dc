"""Derivatives of runs: differences with a step by the noise, updates between, central at the end.

At the first point every parameter is moved once (forward differences; theory 4.7). At the next
ones the derivatives are brought up to date by what the run there has shown (Broyden 1965): the
smallest change with which they explain the difference to the nearest point; where noise alone
explains it they stay as they are. Where they predicted it badly, all parameters are moved again.
At its end a search asks for central differences, which decide.

All runs of one difference are independent, and are made together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.forward.external.noise import line_of, noise_of, steps_of
from geoident.forward.external.runs import FailedRun
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter

MakeRuns = Callable[[Sequence[Floats]], list[Floats | FailedRun]]
"""Readings (m,) at several p (n,), SI."""

UNPREDICTED = 0.2
"""Part of a change of the readings not predicted, from which on all derivatives are renewed."""
NOISE_SD = 3.0
"""Standard deviations of the noise of a run within which a difference of two may be noise."""
SPACING = 1e-3
"""Relative distance of the points from which the noise is estimated."""
NOISE_UNKNOWN = 1e-7
"""Relative noise that is assumed where runs nearby fail: that of single precision."""
QUANTA = 16.0
"""Smallest step, in the smallest changes that are written."""


@dataclass(frozen=True)
class Linear:
    """Readings and their derivatives at a point.

    Args:
        p: (n,) where.
        v: (m,) readings.
        dv_dp: (m, n) derivatives.
        updates: how often these were brought up to date since all parameters were moved.
    """

    p: Floats
    v: Floats
    dv_dp: Floats
    updates: int = 0


class Differences:
    """Readings of runs and their derivatives.

    Args:
        run: makes runs.
        parameters: the n unknowns.
        seen: (n,) which of them the runs depend on.
        weights: (m,) 1 / standard deviation of the readings.
        quantum: smallest changes (n,) of the parameters at a point that are seen.
        written: the parameters (n,) as they are seen.
    """

    def __init__(
        self,
        run: MakeRuns,
        parameters: Sequence[Parameter],
        seen: Bools,
        weights: Floats,
        quantum: Callable[[Floats], Floats],
        written: Callable[[Floats], Floats],
    ) -> None:
        self._run = run
        self._log = np.array([q.scale == "log" for q in parameters], dtype=bool)
        self._lower = np.array([q.lower for q in parameters], dtype=np.float64)
        self._upper = np.array([q.upper for q in parameters], dtype=np.float64)
        self._reference = np.array([_size(q) for q in parameters], dtype=np.float64)
        self._seen, self._weights = seen, weights
        self._quantum, self._written = quantum, written
        self._known: list[Linear] = []
        self._exact: dict[bytes, Linear] = {}
        self._steps: tuple[float, float] | None = None
        self.noise: Floats | None = None

    def values(self, p: Floats) -> Floats:
        """Readings (m,) at p (n,).

        Raises:
            ModelError: the run failed.
        """
        return required(self._run([p])[0])

    def linear(self, p: Floats) -> Linear:
        """Readings and derivatives at p (n,), as good as a search needs them.

        Raises:
            ModelError: the run failed, or those that the derivatives need.
        """
        exact = self._exact.get(p.tobytes())
        if exact is not None:
            return exact
        known = next((one for one in self._known if np.array_equal(one.p, p)), None)
        if known is not None:
            return known
        v = self.values(p)
        linear = self._updated(p, v) or self._forward(p, v)
        self._known.append(linear)
        return linear

    def is_exact(self, p: Floats) -> bool:
        """Whether central differences are known at p (n,)."""
        return p.tobytes() in self._exact

    def exact(self, p: Floats) -> Linear:
        """Readings and derivatives at p (n,) by central differences.

        Raises:
            ModelError: the run failed, or those that the derivatives need.
        """
        linear = self._exact.get(p.tobytes())
        if linear is None:
            linear = self._central(p, self.values(p))
            self._exact[p.tobytes()] = linear
            self._known.append(linear)
        return linear

    def doubt(self, p: Floats) -> Floats:
        """(m, n) error of central differences at p (n,) by noise, three standard deviations."""
        if self.noise is None or self._steps is None:
            return np.zeros((len(self._weights), len(p)))
        return np.asarray(3.0 * self.noise[:, None] / np.abs(self._step(p, self._steps[1])))

    def _sizes(self, p: Floats) -> Floats:
        """(n,) by which a relative step is multiplied."""
        return np.where(self._log, np.abs(p), self._reference)

    def _updated(self, p: Floats, v: Floats) -> Linear | None:
        """Derivatives by Broyden's update from the nearest point; None where that is too far."""
        if not self._known:
            return None
        sizes = self._sizes(p)
        near = min(
            reversed(self._known), key=lambda one: float(np.linalg.norm((p - one.p) / sizes))
        )
        move = np.where(self._seen, (p - near.p) / sizes, 0.0)
        length = float(move @ move)
        if length == 0.0:
            return Linear(p, v, near.dv_dp, near.updates)
        residual = v - near.v - near.dv_dp @ (p - near.p)
        noise = 0.0
        if self.noise is not None:
            noise = NOISE_SD * float(np.linalg.norm(self._weights * self.noise))
        change = float(np.linalg.norm(self._weights * (v - near.v)))
        far = float(np.linalg.norm(self._weights * residual)) > UNPREDICTED * change + noise
        if far or near.updates > 2 * int(self._seen.sum()):
            return None
        if float(np.linalg.norm(self._weights * residual)) <= noise:
            return Linear(p, v, near.dv_dp, near.updates)  # within the noise
        dv_dp = near.dv_dp + np.outer(residual, move / sizes) / length
        return Linear(p, v, dv_dp, near.updates + 1)

    def _steps_at(self, p: Floats, v: Floats) -> tuple[float, float]:
        """Relative steps of forward and central differences; the noise is estimated once."""
        if self._steps is None:
            sizes = np.where(self._seen, self._sizes(p), 0.0)
            points = line_of(p, sizes, self._lower, self._upper, SPACING)
            runs = self._run(points[1:])
            values = [run for run in runs if not isinstance(run, FailedRun)]
            if len(values) == len(runs):
                self.noise = noise_of(np.stack([v, *values]))
            else:
                self.noise = NOISE_UNKNOWN * np.abs(v)
            self._steps = steps_of(self.noise, v, self._weights)
        return self._steps

    def _step(self, p: Floats, relative: float) -> Floats:
        """Steps (n,) of the parameters, into the wider side of their bounds."""
        size = np.maximum(relative * self._sizes(p), QUANTA * self._quantum(p))
        room = np.maximum(self._upper - p, p - self._lower)
        size = np.minimum(size, 0.5 * room)
        return np.where(self._upper - p >= size, size, -size)

    def _seen_step(self, p: Floats, j: int, h: float) -> float:
        """The change of a parameter in the digits that are written."""
        return float(self._written(_moved(p, j, h))[j] - p[j])

    def _forward(self, at: Floats, v: Floats) -> Linear:
        p = self._written(at)
        step = self._step(p, self._steps_at(p, v)[0])
        step = np.array([self._seen_step(p, j, h) for j, h in enumerate(step.tolist())])
        moves = [(j, step[j]) for j in np.flatnonzero(self._seen).tolist()]
        runs = dict(zip(moves, self._run([_moved(p, j, h) for j, h in moves]), strict=True))
        back = [(j, -h) for (j, h), run in runs.items() if isinstance(run, FailedRun)]
        if any(not self._lower[j] <= p[j] + h <= self._upper[j] for j, h in back):
            required(FailedRun("there is no room for a step"))
        runs |= dict(zip(back, self._run([_moved(p, j, h) for j, h in back]), strict=True))
        dv_dp = np.zeros((len(v), len(p)))
        for (j, h), run in runs.items():
            if (j, -h) not in back:  # that one failed
                dv_dp[:, j] = (required(run) - v) / h
        return Linear(at, v, dv_dp)

    def _central(self, at: Floats, v: Floats) -> Linear:
        """Second order, on one side where a bound leaves no other; first where a run fails."""
        p = self._written(at)
        step = np.abs(self._step(p, self._steps_at(p, v)[1]))
        columns = np.flatnonzero(self._seen).tolist()
        sides = {
            j: tuple(self._seen_step(p, j, h) for h in self._sides(p[j], step[j], j))
            for j in columns
        }
        moves = [(j, h) for j in columns for h in sides[j]]
        runs = dict(zip(moves, self._run([_moved(p, j, h) for j, h in moves]), strict=True))
        dv_dp = np.zeros((len(v), len(p)))
        for j in columns:
            a, b = sides[j]
            first, second = runs[j, a], runs[j, b]
            if isinstance(first, FailedRun):
                dv_dp[:, j] = (required(second) - v) / b
            elif isinstance(second, FailedRun):
                dv_dp[:, j] = (first - v) / a
            else:  # the parabola through three points
                slope_a, slope_b = (first - v) / a, (second - v) / b
                dv_dp[:, j] = (b * slope_a - a * slope_b) / (b - a)
        return Linear(at, v, dv_dp)

    def _sides(self, value: float, h: float, j: int) -> tuple[float, float]:
        """The two moves of a parameter: to both sides, or twice to that which has room."""
        if value + h > self._upper[j]:
            return -h, -2.0 * h if value - 2.0 * h >= self._lower[j] else -0.5 * h
        if value - h < self._lower[j]:
            return h, 2.0 * h if value + 2.0 * h <= self._upper[j] else 0.5 * h
        return h, -h


def required(run: Floats | FailedRun) -> Floats:
    """The readings (m,) of a run.

    Raises:
        ModelError: it failed.
    """
    if isinstance(run, FailedRun):
        raise ModelError(f"The run of the model failed: {run}.")
    return run


def _moved(p: Floats, j: int, h: float) -> Floats:
    point = p.copy()
    point[j] += h
    return point


def _size(parameter: Parameter) -> float:
    """The size of a linear parameter, SI."""
    size, width = abs(parameter.start), parameter.upper - parameter.lower
    if not np.isfinite(width) or width <= 0.0:
        return size or 1.0
    return min(width, max(size, 0.1 * width))
