"""What several sections tell of what is common, of each of them, and of further ones (theory 15).

Everything is a mixture of normal distributions, one for each tau of the posterior of the scatter
(`restricted`): intervals are wider than those at the most likely scatter, as they must be where few
sections tell how large it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc

from geoident.identify.assessment.normal_mixture import mixture_interval
from geoident.identify.hierarchical.arrangement import SectionReadings, of_bounds
from geoident.identify.hierarchical.restricted import (
    GivenScatter,
    LinearSections,
    ScatterPosterior,
    by_common,
    most_likely,
    scatter_posterior,
)
from geoident.identify.hierarchical.search import HierarchicalFit
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats

_SEEN = 1e-6
"""Whitened derivative on a scale below which a section says nothing of a direction."""


@dataclass(frozen=True)
class Interval95:
    """Values with their 95 % intervals, each (l,), SI.

    Args:
        value: the estimate.
        sd: root of the mean square deviation from it.
        lower95: lower ends.
        upper95: upper ends.
    """

    value: Floats
    sd: Floats
    lower95: Floats
    upper95: Floats


@dataclass(frozen=True)
class FurtherSection:
    """The parameters of a section whose readings took no part, as all others tell them.

    Args:
        values: (n,) the laws, the shared parameters and the means of own priors, SI.
        interval: of these.
        means: (J, n) on the scales, from `values`, at each tau of the posterior.
        covariances: (J, n, n) likewise.
        weights: (J,) of these.
        scaling: of the parameters.
    """

    values: Floats
    interval: Interval95
    means: Floats
    covariances: Floats
    weights: Floats
    scaling: Scaling


class SectionsKnowledge:
    """What is known at the end of a search.

    Args:
        fit: the search.

    Attributes:
        scatter: posterior of the scatter.
    """

    def __init__(self, fit: HierarchicalFit) -> None:
        self._fit = fit
        self._made = fit.arrangement
        self._values = fit.outcome.values
        self.scatter: ScatterPosterior = scatter_posterior(fit.linear, fit.tau, fit.free)
        self._given: tuple[GivenScatter, ...] = tuple(
            fit.linear.given(t) for t in self.scatter.nodes
        )

    def common(self) -> Interval95:
        """Shared parameters and constants of laws (n_common,)."""
        made = self._made
        scaling = Scaling(made.unknowns[: made.n_common])
        mean = np.array([given.common for given in self._given])
        var = np.array([np.diag(given.common_covariance) for given in self._given])
        p = self._values[: made.n_common]
        return _interval(scaling, p, mean, var, self.scatter.weights)

    def section(self, s: int) -> Interval95:
        """The parameters (n,) of a section, from its own readings and all others."""
        p, _ = self._made.point(s, self._values)
        n, gap = len(p), self._fit.linear.gap[s]
        mean = np.array([given.sections[s] - gap for given in self._given])[:, :n]
        var = np.array([np.diag(given.covariances[s]) for given in self._given])[:, :n]
        return _interval(self._made.scalings[s], p, mean, var, self.scatter.weights)

    def section_covariance(self, s: int) -> Floats:
        """Of the parameters (n, n) of a section, SI, about the estimate."""
        p, _ = self._made.point(s, self._values)
        n, gap = len(p), self._fit.linear.gap[s]
        found = np.zeros((n, n))
        for weight, given in zip(self.scatter.weights, self._given, strict=True):
            off = (given.sections[s] - gap)[:n]
            found += weight * (given.covariances[s][:n, :n] + np.outer(off, off))
        slope = self._made.scalings[s].slope(p)
        return np.asarray(found * np.outer(slope, slope))

    def law(self, section: SectionReadings) -> Interval95:
        """The laws (K,) at a section, without its scatter about them."""
        made = self._made
        K, F = len(made.laws), made.n_common
        slope = Scaling(made.unknowns[:F]).slope(self._values[:F])
        x, Phi = np.zeros(K), np.zeros((K, F))
        for k in range(K):
            x[k], by = made.law(k, section.covariates, self._values)
            where = made.constants_of(k)
            Phi[k, where] = by * slope[where]
        mean = np.array([Phi @ given.common for given in self._given])
        spread = [np.einsum("kf,fg,kg->k", Phi, g.common_covariance, Phi) for g in self._given]
        scaling = Scaling([made.templates[law.parameter] for law in made.laws])
        p = np.array([made.law_value(k, x[k]) for k in range(K)])
        return _interval(scaling, p, mean, np.array(spread), self.scatter.weights, cut=False)

    def further(self, section: SectionReadings) -> FurtherSection:
        """The parameters of a section whose readings took no part.

        Args:
            section: with the parameters and covariates of it; its readings do not count.
        """
        return further_section(self._fit, section, self._given, self.scatter.weights)

    def shrinkage(self, s: int) -> Floats:
        """How much of what a section knows of its parameters (n,) comes from the others, 0 to 1.

        It is one minus the part of the readings of the section in what is known: 0 where the
        section stands for itself, 1 where it only follows the law.
        """
        linear, tau = self._fit.linear, self._fit.tau
        whole = linear.given(tau).covariances[s]
        others = linear.without(s).given(tau).covariances[s]
        n = len(self._made.sections[s].parameters)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.diag(whole)[:n] / np.diag(others)[:n]
        return np.where(np.isfinite(share), np.clip(share, 0.0, 1.0), np.nan)


def further_section(
    fit: HierarchicalFit, section: SectionReadings, given: tuple[GivenScatter, ...], weights: Floats
) -> FurtherSection:
    """The parameters of a section whose readings took no part.

    Args:
        fit: of the others.
        section: with its parameters and covariates.
        given: the posterior at each tau.
        weights: (J,) of these.
    """
    made, values = fit.arrangement, fit.outcome.values
    F, section = made.n_common, made.scaled(section)
    scaling = Scaling(section.parameters)
    p = made.further_point(section, values)
    slope = Scaling(made.unknowns[:F]).slope(values[:F])
    n = len(p)
    Phi, Z, _ = by_common(made, section, p, values, slope, n)
    own = np.zeros((n, n))
    known = {i: scaling.prior_jacobian(p)[row, i] for row, (i, _) in enumerate(scaling.priors)}
    for i, q in enumerate(section.parameters):
        if not made.is_common(q.name):
            own[i, i] = known[i] ** -2 if i in known else of_bounds(q) ** 2
    means = np.array([Phi @ one.common for one in given])
    covariances = np.array(
        [Phi @ one.common_covariance @ Phi.T + (Z * one.tau**2) @ Z.T + own for one in given]
    )
    var = np.diagonal(covariances, axis1=1, axis2=2)
    interval = _interval(scaling, p, means, var, weights)
    return FurtherSection(p, interval, means, covariances, weights, scaling)


def _interval(
    scaling: Scaling,
    p: Floats,
    mean: Floats,
    variance: Floats,
    weights: Floats,
    *,
    cut: bool = True,
) -> Interval95:
    """Values p (l,) with intervals, from deviations (J, l) on their scales and variances."""
    variance = np.maximum(variance, 0.0)
    rms = np.sqrt(weights @ (mean**2 + variance))
    low, high = mixture_interval(weights, mean, np.sqrt(variance))
    low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)  # the estimate is among them
    if cut:
        lower, upper = scaling.away(p, low), scaling.away(p, high)
    else:
        with np.errstate(over="ignore"):  # beyond all numbers: too few sections tell nothing
            lower, upper = (
                np.where(scaling.log, p * np.exp(step), p + step * scaling.reference)
                for step in (low, high)
            )
    return Interval95(p, rms * scaling.slope(p), lower, upper)


@dataclass(frozen=True)
class SectionMisfit:
    """What is left of the readings of a section.

    Args:
        scale: size of the residuals by that of their errors; NaN where nothing can be said.
        above: probability that chance makes them at least as large.
        outlying: probability that a section of the same ground is at least as far from what all
            others tell of it; NaN where nothing can be said.
    """

    scale: float
    above: float
    outlying: float


def section_misfits(fit: HierarchicalFit) -> tuple[SectionMisfit, ...]:
    """What is left of the readings of each section, and whether it is of the same ground.

    Args:
        fit: of all sections.
    """
    at_best = fit.linear.given(fit.tau)
    return tuple(
        SectionMisfit(*_left(fit.linear, at_best, s), _outlying(fit.linear, fit.tau, fit.free, s))
        for s in range(len(fit.linear.R))
    )


def total_misfit(fit: HierarchicalFit) -> tuple[float, float]:
    """Size of all residuals by their errors, and the probability of at least as much by chance."""
    at_best = fit.linear.given(fit.tau)
    parts = [_squares(fit.linear, at_best, s) for s in range(len(fit.linear.R))]
    squares, mean, spread = np.sum(np.array(parts).reshape(-1, 3), axis=0).tolist()
    return _judged(squares, mean, spread)


def _left(linear: LinearSections, given: GivenScatter, s: int) -> tuple[float, float]:
    return _judged(*_squares(linear, given, s))


def _squares(linear: LinearSections, given: GivenScatter, s: int) -> tuple[float, float, float]:
    """Squares of what is left of a section, their mean and half their variance (theory 6.5)."""
    R = linear.R[s]
    hat = R @ given.covariances[s] @ R.T
    left = linear.q[s] - R @ given.sections[s]
    mean = float(linear.rows[s] - np.trace(hat))
    spread = mean - float(np.trace(hat)) + float(np.sum(hat * hat.T))
    return float(linear.rest[s] + left @ left), mean, spread


def _judged(squares: float, mean: float, spread: float) -> tuple[float, float]:
    if mean <= 0.5 or spread <= 0.0:
        return float("nan"), 1.0
    freedom = mean**2 / spread
    above = float(chdtrc(freedom, min(squares * mean / spread, 1e300)))
    return float(np.sqrt(squares / mean)), above


def _outlying(linear: LinearSections, tau: Floats, free: Bools, s: int) -> float:
    """Probability that a section of the same ground is at least as far from the others."""
    others = linear.without(s)
    beside = scatter_posterior(others, most_likely(others, tau, free), free)
    weights, given = beside.weights, [others.given(node) for node in beside.nodes]
    means = np.array([one.sections[s] for one in given])
    mean = weights @ means
    moved = means - mean
    C = np.einsum("j,jab->ab", weights, np.array([one.covariances[s] for one in given]))
    C = C + np.einsum("j,ja,jb->ab", weights, moved, moved)
    R, own = linear.R[s], linear.W[s].any(axis=1)
    basis = _complement(R[:, own])  # what its own parameters explain says nothing
    U, S, _ = np.linalg.svd(basis.T @ R[:, ~own], full_matrices=False)
    seen = basis @ U[:, S > _SEEN]
    if not seen.shape[1]:
        return float("nan")
    d = seen.T @ (linear.q[s] - R @ mean)
    V = np.eye(len(d)) + seen.T @ R @ C @ R.T @ seen
    return float(1.0 - chdtr(len(d), float(d @ np.linalg.solve(V, d))))


def _complement(columns: Floats) -> Floats:
    """An orthonormal basis (n, m) of what is orthogonal to columns (n, k)."""
    U, S, _ = np.linalg.svd(columns, full_matrices=True)
    rank = int(np.count_nonzero(S > _SEEN))
    return np.asarray(U[:, rank:])
