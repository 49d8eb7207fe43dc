"""Intervals where the accuracies themselves were estimated from the residuals (theory 7.5).

With few readings the factors e^(t_c) on the variances are known badly, and intervals at their most
likely values hold less than they say. So everything is averaged over them: at points t_k, with the
restricted likelihood and a density that is flat in t (that of the logarithm of an accuracy),

    odds_k ~ exp(l(t_k)) ,      x | t_k ~ N(x_k, C_k)

with x_k the least misfit of the linearised model at those accuracies and C_k its covariance. A
linear function of x, with an error of its own or without, is then a mixture of normals. Of one
unknown factor, no prior and g - n spare readings this is Student's t with g - n degrees of freedom,
the interval of the textbooks.

Bounds truncate what is normal (see `truncated_normal`), and that is done at the most likely
accuracies. The ends of its intervals are then farther out by the factors by which the quantiles of
the mixture are farther out than those of the normal. The degrees of freedom reported
are those of the t distribution whose 95 % interval is as much wider.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.special import ndtri, stdtrit

from geoident.identify.assessment.normal_mixture import mixture_interval
from geoident.identify.assessment.variance_components import (
    HIGHEST,
    LOWEST,
    Likelihood,
    VarianceComponents,
    VariancePoints,
)
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats, Ints
from geoident.model.results.bands import NORMAL_95

SURE = 0.1
"""Standard deviation of the logarithm of a variance below which it counts as known: then 200
readings tell of it, and intervals are not one per cent wider."""

LEAST = -9.2
"""Logarithm of the smallest factor of a variance that is weighed: of an accuracy a hundredth."""

_STEP, _LONGEST = 0.9, 1.0
"""Between two points: in standard deviations, and at most in the logarithm of a variance."""

_GRID = 2
"""Components up to which all points of a grid are taken; of more, Halton points."""

_HALTON_POINTS, _WIDER = 800, 1.5
"""Number of Halton points, and how much wider than the normal approximation they are spread."""

_RISE = 24.0
"""Rise of -2 l from which on nothing is left."""

_NOTHING = 1e-5
"""Odds, by the largest, of points that are left out."""

_UNSEEN = 1e-8
"""Directions of the parameters with singular values below this part of the largest are left out."""


def with_possible(likelihood: Likelihood, likeliest: VarianceComponents) -> VarianceComponents:
    """The factors with points that stand for all that the residuals leave possible.

    Components that the readings cannot separate keep their ratio.

    Args:
        likelihood: of the factors.
        likeliest: the factors of lowest -2 l.
    """
    best = likeliest.log_factor
    axes = _axes(likeliest)
    if not axes.shape[1]:
        return likeliest

    def rise(z: Floats) -> float:
        """Of -2 l at axes times z (d,); infinite where that is out of range."""
        t = best + axes @ z
        if np.any((t > HIGHEST) | (t < np.minimum(best, LEAST) - 1e-9)):
            return np.inf
        return likelihood.value(t) - likeliest.minus_two_l

    def reach(step: Floats, first: float = 0.0) -> float:
        """How often a step (d,) can be made until nothing is left."""
        while rise((first + 1.0) * step) < _RISE:
            first += 1.0
        return first

    ends = np.empty((axes.shape[1], 2))
    for k, unit in enumerate(np.eye(axes.shape[1])):
        if np.any(best[axes[:, k] != 0.0] <= LOWEST):  # vanished: from the smallest one weighed
            ends[k] = LEAST - LOWEST, reach(unit, LEAST - LOWEST)
        else:
            ends[k] = -reach(-unit), reach(unit)
    if len(ends) <= _GRID:
        z = np.array(list(product(*(np.arange(first, last + 0.5) for first, last in ends))))
        log_weight = np.zeros(len(z))
    else:
        z, log_weight = _halton(ends)
    rises = np.array([rise(one) for one in z])
    kept = np.isfinite(rises)
    log_odds = log_weight[kept] - 0.5 * rises[kept]
    odds = np.exp(log_odds - log_odds.max())
    some = odds > _NOTHING
    points = (z[kept] @ axes.T)[some]
    before = np.array([-0.5 * likelihood.weak_prior(best + t) for t in points])
    flat = log_weight[kept][some] + before
    return replace(likeliest, possible=VariancePoints(points, odds[some] / odds[some].sum(), flat))


def _axes(likeliest: VarianceComponents) -> Floats:
    """Directions of t (c, d) along which it is not known, one step long each."""
    best = likeliest.log_factor
    unsure = (np.diag(likeliest.covariance) > SURE**2) & np.isfinite(likeliest.upper)
    vanished = np.flatnonzero((best <= LOWEST) & np.isfinite(likeliest.upper))
    inner = np.flatnonzero(unsure & (best > LOWEST))
    size, vectors = np.linalg.eigh(likeliest.covariance[np.ix_(inner, inner)])
    axes = np.zeros((len(best), len(inner) + len(vanished)))
    axes[inner, : len(inner)] = vectors * np.sqrt(np.maximum(size, 0.0))
    longest = np.abs(axes).max(axis=0, initial=0.0)
    axes *= np.minimum(_STEP, _LONGEST / np.maximum(longest, 1e-300))
    for k, c in enumerate(vanished.tolist(), start=len(inner)):
        axes[c, k] = _LONGEST
    return axes


def _halton(ends: Floats) -> tuple[Floats, Floats]:
    """Halton points (K, d), dense in the middle, and the logarithms (K,) of their weights.

    Between ends far apart on both sides they are normal, else even.
    """
    from scipy.stats import qmc  # noqa: PLC0415 - a quarter of a second, and few fits need it

    u = qmc.Halton(len(ends), scramble=False).random(_HALTON_POINTS + 1)[1:]  # without the corner
    normal = ends[:, 0] < 0.0
    z = ends[:, 0] + u * (ends[:, 1] - ends[:, 0])
    deviates = ndtri(u[:, normal])
    width = ends[normal, 1] - ends[normal, 0]  # as far as -2 l rises by so much to both sides
    z[:, normal] = _WIDER * width / (2.0 * np.sqrt(_RISE)) * deviates
    return z, 0.5 * np.sum(deviates**2, axis=1)


@dataclass(frozen=True)
class OverAccuracies:
    """What is known of n scaled parameters at K sets of accuracies, the one in use before them.

    Args:
        odds: (K,) of the sets.
        shift: (1 + K, n) x of the least misfit, from that with the accuracies in use.
        factor: (1 + K, n, q) F: the covariance is F F^T.
    """

    odds: Floats
    shift: Floats
    factor: Floats

    @classmethod
    def of(
        cls,
        problems: Sequence[Problem],
        odds: Floats,
        values: Floats,
        readings: Floats,
        jacobian: Floats,
    ) -> OverAccuracies:
        """The linearised model at several sets of accuracies.

        Args:
            problems: the same readings, at the accuracies in use and at K others.
            odds: (K,) of the others.
            values: (n,) the estimate, SI.
            readings: (g,) v there, SI.
            jacobian: (g, n) its derivative.
        """
        scaling = Scaling(problems[0].parameters)
        J, gap = jacobian * scaling.dp_dx(values), problems[0].measured - readings
        P, rho = scaling.prior_jacobian(values), scaling.prior_residuals(values)
        first = np.concatenate([problems[0].whiten(J), P])
        size = np.linalg.norm(first, axis=0)
        unit = 1.0 / np.where(size > 0.0, size, 1.0)
        _, S, Vt = np.linalg.svd(first * unit, full_matrices=False)
        seen = unit[:, None] * Vt[_UNSEEN * S.max(initial=0.0) < S].T
        shift, factor = [], []
        for problem in problems:
            A = np.concatenate([problem.whiten(J), P]) @ seen
            r = np.concatenate([problem.whiten(gap), -rho])
            U, S, Vt = np.linalg.svd(A, full_matrices=False)
            F = seen @ (Vt.T / S)
            factor.append(F)
            shift.append(F @ (U.T @ r))
        return cls(odds, np.array(shift) - shift[0], np.array(factor))

    def pick(self, order: Ints) -> OverAccuracies:
        """The same of some parameters, by their numbers (k,)."""
        return replace(self, shift=self.shift[:, order], factor=self.factor[:, order])

    def wider(
        self, rows: Floats, more: Floats | None = None, sd: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """How much farther out than those of a normal the ends of 95 % intervals are.

        Args:
            rows: (l, n) linear functions of x, or (1 + K, l, n) one for each set of accuracies.
            more: (1 + K, l) what is added to them; None for nothing.
            sd: (1 + K, l) standard deviations of errors of their own; None for none.

        Returns:
            Factors (l,), (l,) of the lower and the upper end, from the estimate.
        """
        whole = np.broadcast_to(rows, (len(self.shift), *rows.shape[-2:]))
        variance = np.array([
            np.sum((a @ F) ** 2, axis=1) for a, F in zip(whole, self.factor, strict=True)
        ])  # fmt: skip
        mean = np.einsum("kln,kn->kl", whole[1:], self.shift[1:])
        if more is not None:
            mean = mean + (more[1:] - more[0])
        if sd is not None:
            variance = variance + sd**2
        own = np.sqrt(variance[0])
        half = NORMAL_95 * np.where(own > 0.0, own, 1.0)
        each = np.where(own > 0.0, np.sqrt(variance[1:]), 1.0)
        mean = np.where(own > 0.0, mean, 0.0)
        low, high = mixture_interval(self.odds, mean, each)
        factors = np.where(own > 0.0, np.array([-low, high]) / half, 1.0)
        return np.maximum(factors[0], 0.0), np.maximum(factors[1], 0.0)


def freedom(wider: Floats) -> Floats:
    """Degrees of freedom (l,) of the t distribution whose 95 % interval is wider by factors (l,).

    >>> freedom(np.array([2.2281388519649385 / 1.959963984540054])).round(2)
    array([10.])
    """
    log_nu = np.linspace(np.log(0.3), np.log(1e4), 600)
    factor = stdtrit(np.exp(log_nu), 0.975) / NORMAL_95
    return np.asarray(np.exp(np.interp(-wider, -factor, log_nu)))
