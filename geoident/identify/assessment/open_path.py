"""The posterior along a parameter that its bound leaves open, where the model is not linear there.

On a bound the linearised model is known on one side only, at its end: it says little of what is
predicted far from there (theory 6.3). So for the parameter t whose bound cuts most, the posterior
is looked at itself, at a few points along the path on which the others follow: at each the model is
evaluated, one Gauss-Newton step of the others gives the least phi there and their conditional
covariance C, and

    density(t) ~ exp(-phi(t) / 2) |C(t)|^(1/2)

(Laplace's approximation for the others, given t). Between the points log density, parameters and
what the readings deviate from linear are interpolated (monotone cubics). All else is the cut normal
of `posterior`, whose points are given the density of their t in place of the normal one.

The farthest point comes first: where phi and the predictions are linear up to there, one evaluation
is all that it costs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.assessment.posterior import Posterior, cut_normal
from geoident.identify.assessment.uncertainty import Assessment, with_posterior
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats

POINTS = 3
"""To each side, at first."""

_MOST_POINTS = 10
_ENOUGH = 9.0
"""Growth of phi beyond which nothing of the posterior is left to see."""

_SAME_PHI = 0.5
_SAME_READING = 0.25
"""Deviations from linear, of phi and in standard deviations of predictions, that do not count."""

_FINE = 800


@dataclass(frozen=True)
class Answers:
    """What the model says at one parameter vector.

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


@dataclass(frozen=True)
class OpenPath:
    """The points of a path, the estimate among them, in the order of t.

    Args:
        parameter: number of the open parameter.
        t: (m,) its distance from the estimate in x.
        dx: (m, n) all parameters from the estimate in x.
        log_density: (m,).
        bend: (m, l) deviation of readings from linear, SI.
    """

    parameter: int
    t: Floats
    dx: Floats
    log_density: Floats
    bend: Floats

    def bent(self, t: Floats) -> Floats:
        """Deviations of the readings from linear (l, K) at t (K,)."""
        at = np.clip(t, self.t[0], self.t[-1])
        return np.asarray(_monotone(self.t, self.bend)(at).T, dtype=np.float64)


@dataclass(frozen=True)
class _Point:
    t: float
    dx: Floats
    phi: float
    log_density: float
    bend: Floats


Evaluate = Callable[[Floats], Answers | None]
"""The model at parameters (n,), SI; None where it has no solution."""


def open_parameter(assessment: Assessment, problem: Problem, values: Floats) -> int | None:
    """The parameter whose bound cuts the posterior most; None where no bound does.

    Args:
        assessment: of a linearised model.
        problem: the parameters.
        values: (n,) the estimate, SI.
    """
    scaling = Scaling(problem.parameters)
    cut = assessment.at_bound & (scaling.upper > scaling.lower) | assessment.beyond_bounds
    cut &= np.array([not q.field for q in problem.parameters], dtype=np.bool_)
    if not cut.any():
        return None
    width = np.where(np.isfinite(scaling.upper - scaling.lower), scaling.upper - scaling.lower, 1.0)
    spread = np.sqrt(np.diag(assessment.posterior.covariance)) / np.maximum(width, 1e-300)
    return int(np.argmax(np.where(cut, spread + assessment.at_bound, -1.0)))


def followed(
    assessment: Assessment, problem: Problem, values: Floats, at: Answers, evaluate: Evaluate
) -> tuple[Assessment, OpenPath | None]:
    """The assessment with the posterior itself along what a bound leaves open.

    Args:
        assessment: of the model linearised at the estimate.
        problem: as `assessment` was made with.
        values: (n,) the estimate, SI.
        at: the model there.
        evaluate: the model elsewhere.

    Returns:
        The assessment, as it is where nothing is open or all is linear; and the path, or None.
    """
    i = open_parameter(assessment, problem, values)
    if i is None:
        return assessment, None
    search = _PathSearch(assessment, problem, values, at, evaluate, i)
    points = search.points()
    # an estimate on its bound and the end of the way there are one place
    points = None if points is None else _distinct(points)
    if points is None or len(points) < 3:
        return assessment, None
    path = OpenPath(
        i,
        np.array([point.t for point in points]),
        np.array([point.dx for point in points]),
        np.array([point.log_density for point in points]),
        np.array([point.bend for point in points]),
    )
    posterior = _along(path, search)
    return with_posterior(assessment, problem, values, posterior), path


class _PathSearch:
    """Points along the path of a parameter.

    Args:
        assessment: of the linearised model.
        problem: the readings and parameters.
        values: (n,) the estimate, SI.
        at: the model there.
        evaluate: the model elsewhere.
        i: number of the open parameter.
    """

    def __init__(
        self,
        assessment: Assessment,
        problem: Problem,
        values: Floats,
        at: Answers,
        evaluate: Evaluate,
        i: int,
    ) -> None:
        self.assessment, self.problem, self.values = assessment, problem, values
        self.at, self.evaluate, self.i = at, evaluate, i
        self.scaling = Scaling(problem.parameters)
        self.x = self.scaling.to_scaled(values)
        self.lower, self.upper = self.scaling.lower - self.x, self.scaling.upper - self.x
        self.mean, self.factor = assessment.uncut_mean, assessment.uncut_factor
        row = self.factor[i]
        self.size = float(np.linalg.norm(row))
        self.slope = self.factor @ row / self.size**2
        self.slope[i] = 1.0
        here = self._judged(0.0, np.zeros(len(values)), values, at)
        assert here is not None
        self.here = here

    def points(self) -> list[_Point] | None:
        """All of them; None where the linearised model says the same."""
        found = [self.here]
        mixture = self.assessment.posterior.of(np.eye(len(self.values))[[self.i]], np.zeros(1))
        low, high = (
            float(end[0])
            for end in mixture.interval(
                np.array([self.lower[self.i]]), np.array([self.upper[self.i]])
            )
        )
        ends = [1.3 * end for end in (low, high)]
        bounds = float(self.lower[self.i]), float(self.upper[self.i])
        far = [float(np.clip(end, *bounds)) for end in ends]
        far = [end for end in far if abs(end) > 1e-3 * self.size]
        if not far:
            return None
        first = self._point(max(far, key=abs))
        if first is not None and self._is_linear(first):
            return None
        for end in far:
            found += self._side(end, bounds[0] if end < 0.0 else bounds[1])
        return found

    def _side(self, end: float, bound: float) -> list[_Point]:
        """Points to one side, up to where nothing is left or the bound."""
        found, step, t = [self.here], end / POINTS, 0.0
        while len(found) <= _MOST_POINTS and abs(t) < abs(bound):
            t = float(np.clip(t + step, min(0.0, bound), max(0.0, bound)))
            point = self._point(t, found[-1])
            if point is None:
                break
            found.append(point)
            least = min(each.phi for each in found)
            if point.phi > least + _ENOUGH:
                break
            if len(found) > POINTS:
                step *= 1.6
        return found[1:]

    def _point(self, t: float, before: _Point | None = None) -> _Point | None:
        """The point at t, begun where the linearised model or the point before has it."""
        dx = self.slope * t
        if before is not None:
            dx = before.dx + self.slope * (t - before.t)
        dx = np.clip(dx, self.lower, self.upper)
        dx[self.i] = t
        values = self.scaling.to_natural(self.x + dx)
        answers = self.evaluate(values)
        return None if answers is None else self._judged(t, dx, values, answers)

    def _judged(self, t: float, dx: Floats, values: Floats, answers: Answers) -> _Point | None:
        """After one Gauss-Newton step of the other parameters."""
        problem, scaling = self.problem, self.scaling
        if not np.isfinite(answers.used).all():
            return None
        slope = scaling.slope(values)
        r = np.concatenate(
            [problem.whiten(answers.used - problem.measured), scaling.prior_residuals(values)]
        )
        A = np.concatenate(
            [problem.whiten(answers.used_jacobian * slope), scaling.prior_jacobian(values)]
        )
        width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 10.0)
        others = np.flatnonzero((width > 0.0) & (np.arange(len(dx)) != self.i))
        weak = np.diag(1.0 / (10.0 * width[others])) if len(others) else np.zeros((0, 0))
        step = np.zeros(len(dx))
        log_density = 0.0
        if len(others):
            U, S, Vt = np.linalg.svd(np.concatenate([A[:, others], weak]), full_matrices=False)
            step[others] = -Vt.T @ ((U[: len(r)].T @ r) / S)
            log_density = -float(np.log(S).sum())
        step = np.clip(step, self.lower - dx, self.upper - dx)
        left = r + A @ step
        phi = float(left @ left)
        moved = dx + step
        now = answers.all + answers.all_jacobian @ (slope * step)
        linear = self.at.all + self.at.all_jacobian @ (self.assessment.slope * moved)
        bend = np.nan_to_num(now - linear) if t else np.zeros(len(now))
        if t == 0.0:  # the estimate itself
            return _Point(0.0, dx, float(r @ r), log_density, bend)
        return _Point(t, moved, phi, log_density - 0.5 * phi, bend)

    def _is_linear(self, point: _Point) -> bool:
        """Whether phi and the readings are what the linearised model has there."""
        pressed = (point.t - self.mean[self.i]) ** 2 - self.mean[self.i] ** 2
        grown = pressed / self.size**2
        rows = self.at.all_jacobian * self.assessment.slope
        sd = self.assessment.posterior.of(np.nan_to_num(rows), np.zeros(len(rows))).rms
        return bool(
            abs(point.phi - self.here.phi - grown) < _SAME_PHI
            and np.all(np.abs(point.bend) <= _SAME_READING * sd + 1e-300)
        )


def _distinct(points: Iterable[_Point]) -> list[_Point]:
    """Points in their order along the path, the first of those at one place."""
    found: list[_Point] = []
    for point in sorted(points, key=lambda point: point.t):
        if not found or point.t > found[-1].t:
            found.append(point)
    return found


def _monotone(t: Floats, values: Floats) -> Callable[[Floats], Floats]:
    """Monotone cubics (Fritsch and Carlson) through values (m, ...) at t (m,)."""
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415 - half the fits need none

    found: Callable[[Floats], Floats] = PchipInterpolator(t, values)
    return found


def _along(path: OpenPath, search: _PathSearch) -> Posterior:
    """The cut normal with the density of the path in place of the normal one along it."""
    i, size = path.parameter, search.size
    fine = np.linspace(path.t[0], path.t[-1], _FINE)
    log_density = path.log_density.copy()
    here = int(np.argmin(np.abs(path.t)))
    log_density[here] -= 0.5 * search.here.phi
    spline = _monotone(path.t, log_density)
    weight = np.exp(spline(fine) - spline(fine).max())
    weight /= weight.sum()
    centre = float(weight @ fine)
    spread = 1.5 * float(np.sqrt(weight @ (fine - centre) ** 2)) + 1e-12 * size
    lower, upper = search.lower.copy(), search.upper.copy()
    lower[i], upper[i] = path.t[0], path.t[-1]
    unit = search.factor[i] / size
    factor = search.factor - np.outer(search.slope * size, unit)
    factor = factor + np.outer(search.slope * spread, unit)
    mean = search.mean + search.slope * (centre - search.mean[i])
    cut = cut_normal(mean, factor, lower, upper, always=i)
    t = np.clip(cut.shift[i], path.t[0], path.t[-1])
    log_ratio = spline(t) + 0.5 * ((t - centre) / spread) ** 2
    weight = cut.weight * np.exp(log_ratio - log_ratio.max())
    linear = path.t[:, None] * search.slope
    shift = cut.shift + _monotone(path.t, path.dx - linear)(t).T
    shift = np.clip(shift, search.lower[:, None], search.upper[:, None])
    return replace(cut, shift=shift, weight=weight / weight.sum())
