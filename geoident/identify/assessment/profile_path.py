"""The posterior along a parameter over which the model is not linear.

On a bound the linearised model is known on one side only, at its end, and over a wide interval it
tells little of what is far from the estimate (theory 6.3). So for one parameter t, whose bounds
decide most of the posterior or that is known least, the posterior itself is computed at a few
points of a path on which the other parameters follow: at each the model is evaluated, one
Gauss-Newton step of the others gives the least phi there (without their bounds, which the draws
keep) and their conditional covariance C, and

    density(t) ~ exp(-phi(t) / 2) |C(t)|^(1/2)

(Laplace's approximation for the others, given t). Between the points log density, parameters and
the deviations of the readings from linear are interpolated (monotone cubics, Fritsch and Carlson).
All else is the truncated normal, whose draws are weighted by the density of their t in place of the
normal one. Other parameters that a bound truncates, or that are known little, have intervals of
paths of their own.

The farthest point comes first: where phi and the predictions are linear up to there, that is the
only evaluation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.assessment.linearity import UNCERTAIN
from geoident.identify.assessment.spectrum import admissible_ranges
from geoident.identify.assessment.truncated_normal import Posterior, truncated_normal
from geoident.identify.assessment.uncertainty import (
    Assessment,
    is_field,
    with_numbers_of,
    with_posterior,
)
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats, Ints

FIRST_POINTS = 3
"""Points to each side up to the end of the linear interval; beyond, steps grow."""

MOST_POINTS = 10
"""Points to each side: with `_GROWTH` they reach 30 intervals of the linearised model."""

_GROWTH = 1.6
"""Of a step by the one before."""

_BEYOND = 1.3
"""The first end, by that of the linear interval: a density that falls more slowly is seen."""

_NOTHING_LEFT = 9.0
"""Growth of phi beyond which a hundredth of the density is left."""

_STEEP, _RISE, _SHORTER = 6.0, 3.0, 0.1
"""Rise of phi over one step from which on it is tried again, the rise to aim at, and the least
factor on the step: a modulus that hardly changes anything at its bound may do so soon after."""

_SAME_PHI, _SAME_READING = 0.5, 0.25
"""Deviations from linear that do not count: of phi, and of predictions in standard deviations. A
density is then off by a quarter where it is a seventh of the highest: ends by a few per cent."""

_AT_ESTIMATE = 1e-3
"""Distance, in standard deviations, below which an end of the path is the estimate."""

_FOLLOWS = 0.8
"""Part of the variance of a parameter that goes with another from which on it follows that."""

_ROUNDING = 1e-12
"""Distance from a bound in x that is rounding."""

_WEAK = 10.0
"""Standard deviation, in ranges, of the others given t, so that their curvature is invertible."""

_WIDER = 1.5
"""Normal that is drawn from, by the standard deviation of the density along the path."""

_FINE = 800
"""Points at which the density along the path is integrated."""


@dataclass(frozen=True)
class PathReadings:
    """Readings and derivatives of the model at one parameter vector.

    Args:
        used: (g,) the used readings, SI.
        used_jacobian: (g, n) their derivatives.
        all: (l,) all readings of which predictions are made, SI; NaN where the model has none.
        all_jacobian: (l, n) their derivatives.
    """

    used: Floats
    used_jacobian: Floats
    all: Floats
    all_jacobian: Floats


Evaluate = Callable[[Floats], PathReadings | None]
"""The model at parameters (n,), SI; None where it has no solution."""


@dataclass(frozen=True)
class Nonlinearity:
    """How l readings deviate from linear along a profile path, at the draws of the posterior.

    Args:
        t: (m,) points of the path, from the estimate in x, in order.
        deviation: (m, l) of the readings from linear there, SI.
        drawn: (K,) t of the draws.
        undetermined: the parameter t is not determined.
        used_deviation: (m, g) of the used readings from linear, SI.
    """

    t: Floats
    deviation: Floats
    drawn: Floats
    undetermined: bool
    used_deviation: Floats

    def of(self, chosen: Bools | Ints) -> Nonlinearity:
        """Of some of the readings: (l,) which, or (k,) their numbers."""
        return replace(self, deviation=self.deviation[:, chosen])

    def at_draws(self, rows: slice) -> Floats:
        """Deviations (l', K) of some readings; beyond the path those of its ends."""
        t = np.clip(self.drawn, self.t[0], self.t[-1])
        return np.asarray(_monotone(self.t, self.deviation[:, rows])(t).T, dtype=np.float64)


@dataclass(frozen=True)
class _Point:
    """A point of the path.

    Args:
        t: of the parameter, from the estimate in x.
        dx: (n,) all parameters within their bounds, likewise.
        mean: (n,) of all given t, with the others as if they had no bounds.
        phi: there.
        within: phi at dx.
        log_density: of t, without the bounds of the others.
        deviation: (l,) of the readings at dx from linear.
        used_deviation: (g,) of the used readings likewise.
    """

    t: float
    dx: Floats
    mean: Floats
    phi: float
    within: float
    log_density: float
    deviation: Floats
    used_deviation: Floats


def path_parameter(assessment: Assessment, problem: Problem) -> int | None:
    """The parameter whose bounds decide most of the posterior; None where none do.

    It is one that a bound truncates, or that only its bounds limit while others have numbers that
    depend on it. One on its bound comes first; of these the least known in its range counts.

    Args:
        assessment: of a linearised model.
        problem: the parameters.
    """
    scaling = Scaling(problem.parameters)
    width = scaling.upper - scaling.lower
    candidates = _truncated(assessment, problem) | _loose(assessment, problem)
    if not candidates.any():
        return None
    width = np.where(np.isfinite(width), width, 1.0)
    relative = np.sqrt(np.diag(assessment.posterior.covariance)) / np.maximum(width, 1e-300)
    return int(np.argmax(np.where(candidates, relative + assessment.at_bound, -1.0)))


def _truncated(assessment: Assessment, problem: Problem) -> Bools:
    """(n,) parameters whose posterior a bound truncates."""
    near = assessment.at_bound | assessment.beyond_bounds
    return near & _varying(problem)


def _loose(assessment: Assessment, problem: Problem) -> Bools:
    """(n,) parameters that only their bounds limit, beside others that have numbers."""
    numbered = np.isfinite(assessment.sd)
    finite = np.isfinite([q.upper - q.lower for q in problem.parameters])
    return ~numbered & finite & _varying(problem) & bool((numbered & _varying(problem)).any())


def _varying(problem: Problem) -> Bools:
    """(n,) parameters that are free, and no modes of fields."""
    varies = np.array([q.lower < q.upper for q in problem.parameters], dtype=np.bool_)
    return varies & ~is_field(problem)


def _little_known(assessment: Assessment, problem: Problem, values: Floats) -> Bools:
    """(n,) parameters, of those determined, over whose interval a model may be far from linear."""
    little = np.nan_to_num(assessment.sd) > UNCERTAIN * np.abs(values)
    return np.asarray(little & assessment.determined & _varying(problem), dtype=np.bool_)


def _led(assessment: Assessment, i: int) -> Bools:
    """(n,) parameters that mostly follow parameter i, so that its path tells their intervals."""
    C = assessment.posterior.covariance
    return np.asarray(C[i] ** 2 > _FOLLOWS * C[i, i] * np.diag(C), dtype=np.bool_)


def with_profile(
    assessment: Assessment,
    problem: Problem,
    values: Floats,
    at: PathReadings,
    evaluate: Evaluate,
    i: int | None = None,
    *,
    of_used: Evaluate | None = None,
) -> tuple[Assessment, Nonlinearity | None]:
    """The assessment with the posterior itself along a parameter where the model is not linear.

    Args:
        assessment: of the model linearised at the estimate.
        problem: as `assessment` was made with.
        values: (n,) the estimate, SI.
        at: the model there.
        evaluate: the model elsewhere.
        i: the parameter; None for that of `path_parameter`.
        of_used: the same as `evaluate`, but of predictions nothing: it may cost less. Other
            parameters, of which only their own intervals are wanted, have paths of it.

    Returns:
        The assessment, as it is where there is no such parameter or all is linear; how readings
        deviate from linear along the path, or None.
    """
    i = path_parameter(assessment, problem) if i is None else i
    if i is None:
        return assessment, None
    profile = _Profile(assessment, problem, values, at, evaluate, i)
    known, curved = assessment, None
    if points := profile.points():
        known = with_posterior(assessment, problem, values, profile.posterior(points))
        curved = Nonlinearity(
            np.array([point.t for point in points]),
            np.array([point.deviation for point in points]),
            known.posterior.shift[i],
            undetermined=not known.determined[i] | known.from_prior[i],
            used_deviation=np.array([point.used_deviation for point in points]),
        )
    others = _truncated(assessment, problem) & assessment.determined
    others |= _loose(assessment, problem) & assessment.at_bound
    if curved is not None:
        others |= _little_known(assessment, problem, values) & ~_led(assessment, i)
    others[i] = False
    at_used = replace(at, all=at.used, all_jacobian=at.used_jacobian)
    for j in np.flatnonzero(others).tolist():
        profile = (
            _Profile(assessment, problem, values, at, evaluate, j)
            if of_used is None
            else _Profile(assessment, problem, values, at_used, of_used, j)
        )
        if points := profile.points():
            own = with_posterior(assessment, problem, values, profile.posterior(points))
            known = with_numbers_of(known, own, j, problem)
    return known, curved


class _Profile:
    """The path of parameter i: its points, and the posterior along it."""

    def __init__(
        self,
        assessment: Assessment,
        problem: Problem,
        values: Floats,
        at: PathReadings,
        evaluate: Evaluate,
        i: int,
    ) -> None:
        self.assessment, self.problem, self.values, self.at = assessment, problem, values, at
        self.evaluate, self.i = evaluate, i
        self.scaling = Scaling(problem.parameters)
        self.x = self.scaling.to_scaled(values)
        self.lower, self.upper = self.scaling.lower - self.x, self.scaling.upper - self.x
        self.mean, self.factor = assessment.uncut_mean, assessment.uncut_factor
        row = self.factor[i]
        self.sd = float(np.linalg.norm(row))
        self.slope = self.factor @ row / self.sd**2  # how the others follow, linearised
        self.slope[i] = 1.0
        self.estimate = self._relaxed(0.0, np.zeros(len(values)), values, at)

    def points(self) -> list[_Point]:
        """All of them in order; none where the linearised model agrees with the farthest.

        Nor are there any where the model has no solution beside the estimate.
        """
        low, high = float(self.lower[self.i]), float(self.upper[self.i])
        ends = [float(np.clip(_BEYOND * end, low, high)) for end in self._linear_ends()]
        ends = [end for end in ends if abs(end) > _AT_ESTIMATE * self.sd]
        farthest = self._point(max(ends, key=abs)) if ends else None
        if not ends or (farthest is not None and self._is_linear(farthest)):
            return []
        points = [self.estimate]
        for end in ends:
            points += self._side(end, low if end < 0.0 else high)
        # an estimate on its bound and an end there are one place
        by_t = {point.t: point for point in reversed(points)}
        return [by_t[t] for t in sorted(by_t)] if len(by_t) > 2 else []

    def _linear_ends(self) -> tuple[float, float]:
        """The interval of t by the linearised model, from the estimate."""
        unit = np.eye(len(self.x))[[self.i]]
        limits = self.lower[[self.i]], self.upper[[self.i]]
        linear = self.assessment.posterior.summary(unit, limits=limits)
        return float(linear.lower95[0]), float(linear.upper95[0])

    def _growth(self, point: _Point) -> float:
        """Growth of phi from the estimate, with what the room for the others contributes."""
        return 2.0 * (self.estimate.log_density - point.log_density)

    def _linear_growth(self, t: float) -> float:
        """Growth of phi from the estimate to t by the linearised model."""
        mean = self.mean[self.i]
        return float(((t - mean) ** 2 - mean**2) / self.sd**2)

    def _side(self, end: float, bound: float) -> list[_Point]:
        """Points to one side, until nothing is left or up to the bound.

        Where phi rises too fast for a smooth curve through the points, shorter steps go before.
        """
        points, step, far = [self.estimate], end / FIRST_POINTS, list[_Point]()
        while len(points) + len(far) <= MOST_POINTS and abs(points[-1].t) < abs(bound):
            last = points[-1]
            t = float(np.clip(last.t + step, min(0.0, bound), max(0.0, bound)))
            point = self._point(t, last)
            if point is None:
                break
            least = min(each.phi for each in points)
            nothing_left = point.phi > least + _NOTHING_LEFT
            if nothing_left and point.phi - last.phi > _STEEP:
                far.append(point)
                step *= max(_SHORTER, float(np.sqrt(_RISE / (point.phi - last.phi))))
                continue
            points.append(point)
            if nothing_left:
                break
            if len(points) > FIRST_POINTS and not far:
                step *= _GROWTH
        return points[1:] + far

    def _point(self, t: float, before: _Point | None = None) -> _Point | None:
        """The point at t, begun where the linearised model has it from the point before."""
        begin = self.slope * t if before is None else before.dx + self.slope * (t - before.t)
        dx = np.clip(begin, self.lower, self.upper)
        dx[self.i] = t
        values = self.scaling.to_natural(self.x + dx)
        readings = self.evaluate(values)
        if readings is None or not np.isfinite(readings.used).all():
            return None
        return self._relaxed(t, dx, values, readings)

    def _relaxed(self, t: float, dx: Floats, values: Floats, readings: PathReadings) -> _Point:
        """The point after one Gauss-Newton step of the others.

        Their bounds are left to the draws: what is least within them would count these twice.
        """
        dp_dx, width = self.scaling.dp_dx(values), admissible_ranges(self.scaling)
        r, A = self._rows(values, readings)
        others = np.flatnonzero((width > 0.0) & (np.arange(len(dx)) != self.i))
        rows = np.concatenate([A[:, others], np.diag(1.0 / (_WEAK * width[others]))])
        U, S, Vt = np.linalg.svd(rows, full_matrices=False)
        log_volume = -float(np.log(S).sum())
        step = np.zeros(len(dx))
        on_bounds = (self.lower >= -_ROUNDING) | (self.upper <= _ROUNDING)
        if t != 0.0 or on_bounds[others].any():  # the estimate stays where it is
            step[others] = -Vt.T @ ((U[: len(r)].T @ r) / S)
        mean = dx + step
        inside = np.clip(mean, self.lower, self.upper) if t != 0.0 else dx
        phi, within = (float(np.sum((r + A @ (to - dx)) ** 2)) for to in (mean, inside))
        deviations = [
            there + slope @ (dp_dx * (inside - dx))
            - (here + own_slope @ (self.assessment.dp_dx * inside))
            for there, slope, here, own_slope in (
                (readings.all, readings.all_jacobian, self.at.all, self.at.all_jacobian),
                (readings.used, readings.used_jacobian, self.at.used, self.at.used_jacobian),
            )
        ]  # fmt: skip
        log_density = log_volume - 0.5 * phi
        return _Point(t, inside, mean, phi, within, log_density, *map(np.nan_to_num, deviations))

    def _rows(self, values: Floats, readings: PathReadings) -> tuple[Floats, Floats]:
        """Whitened residuals and priors (r,) at parameters (n,), and their derivatives in x."""
        problem, scaling = self.problem, self.scaling
        r = [problem.whiten(readings.used - problem.measured), scaling.prior_residuals(values)]
        jacobian = readings.used_jacobian * scaling.dp_dx(values)
        A = [problem.whiten(jacobian), scaling.prior_jacobian(values)]
        return np.concatenate(r), np.concatenate(A)

    def _is_linear(self, point: _Point) -> bool:
        """Whether the density and the readings are what the linearised model has there."""
        growth = self._linear_growth(point.t)
        rows = np.nan_to_num(self.at.all_jacobian * self.assessment.dp_dx)
        sd = np.sqrt(np.einsum("ij,jk,ik->i", rows, self.assessment.posterior.covariance, rows))
        return bool(
            abs(self._growth(point) - growth) < _SAME_PHI
            and np.all(np.abs(point.deviation) <= _SAME_READING * sd + 1e-300)
        )

    def posterior(self, points: list[_Point]) -> Posterior:
        """The truncated normal with the density of the path in place of the normal one along it."""
        i, at = self.i, np.array([point.t for point in points])
        first, last = at[0], at[-1]
        log_density = _monotone(at, np.array([point.log_density for point in points]))
        fine = np.linspace(first, last, _FINE)
        weight = np.exp(log_density(fine) - log_density(fine).max())
        weight /= weight.sum()
        centre = float(weight @ fine)
        sd = _WIDER * float(np.sqrt(weight @ (fine - centre) ** 2)) + 1e-12 * self.sd
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[i], upper[i] = first, last
        # the same normal with another mean and standard deviation of t
        unit = self.factor[i] / self.sd
        factor = self.factor + np.outer(self.slope * (sd - self.sd), unit)
        mean = self.mean + self.slope * (centre - self.mean[i])
        linear = self.mean + self.slope * (at - self.mean[i])[:, None]
        bent = _monotone(at, np.array([point.mean for point in points]) - linear)

        def bend(t: Floats) -> Floats:
            return np.asarray(bent(np.clip(t, first, last)).T)

        drawn = truncated_normal(mean, factor, lower, upper, always=i, bend=bend)
        t = np.clip(drawn.shift[i], first, last)
        log_ratio = log_density(t) + 0.5 * ((t - centre) / sd) ** 2
        weight = drawn.weight * np.exp(log_ratio - log_ratio.max())
        return replace(drawn, weight=weight / weight.sum())


def _monotone(t: Floats, values: Floats) -> Callable[[Floats], Floats]:
    """Monotone cubics through values (m, ...) at t (m,)."""
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415 - half the fits need none

    interpolant: Callable[[Floats], Floats] = PchipInterpolator(t, values)
    return interpolant
