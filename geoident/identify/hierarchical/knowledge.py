"""What several sections tell of what is common, of each of them, and of further ones (theory 15).

Everything is a mixture of normal distributions, one for each tau of the posterior of the scatter
(`restricted_likelihood`): intervals are wider than those at the most likely scatter, as they must
be where few sections tell how large it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from geoident.identify.assessment.misfit import Misfit, judged
from geoident.identify.assessment.normal_mixture import mixture_interval
from geoident.identify.hierarchical.joint_problem import SectionReadings, sd_of_bounds
from geoident.identify.hierarchical.restricted_likelihood import (
    LinearSections,
    ScatterPosterior,
    most_likely,
    scatter_posterior,
)
from geoident.identify.hierarchical.search import HierarchicalFit
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats

_SEEN = 1e-6
"""Whitened derivative on a scale below which readings do not see a direction."""


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
        means: (J, n) on the scales, from `values`, at each tau of the posterior, where common
            unknowns that the readings push against their bounds stay there: readings that a bound
            keeps from being met better are not drawn as if it did not.
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
    """Intervals of all that a search found.

    Args:
        fit: the search.
        scatter: posterior of the scatter; None to compute it.

    Attributes:
        scatter: posterior of the scatter.
    """

    def __init__(self, fit: HierarchicalFit, scatter: ScatterPosterior | None = None) -> None:
        self._fit, self._joint, self._values = fit, fit.joint, fit.outcome.values
        self.scatter = scatter or scatter_posterior(fit.linear, fit.tau, fit.free)
        solutions = [fit.linear.given(tau) for tau in self.scatter.nodes]
        self._common = np.array([one.common for one in solutions])
        self._common_covariances = np.array([one.common_covariance for one in solutions])
        self._sections = np.array([one.sections for one in solutions]) - fit.linear.deviation
        self._covariances = np.array([one.covariances for one in solutions])

    def common(self) -> Interval95:
        """Shared parameters and constants of laws (F,)."""
        F = self._joint.n_common
        variances = np.diagonal(self._common_covariances, axis1=1, axis2=2)
        scaling = Scaling(self._joint.unknowns[:F])
        return _interval(scaling, self._values[:F], self._common, variances, self.scatter.weights)

    def section(self, s: int) -> Interval95:
        """The parameters (n,) of a section, from its own readings and all others."""
        p, _ = self._joint.point(s, self._values)
        means = self._sections[:, s, : len(p)]
        variances = np.diagonal(self._covariances[:, s], axis1=1, axis2=2)[:, : len(p)]
        scaling = Scaling(self._joint.sections[s].parameters)
        return _interval(scaling, p, means, variances, self.scatter.weights)

    def section_covariance(self, s: int) -> Floats:
        """Of the parameters (n, n) of a section, SI, about the estimate."""
        p, _ = self._joint.point(s, self._values)
        n, means = len(p), self._sections[:, s]
        C = second_moment(self.scatter.weights, means, self._covariances[:, s])[:n, :n]
        dp_dx = Scaling(self._joint.sections[s].parameters).dp_dx(p)
        return np.asarray(C * np.outer(dp_dx, dp_dx))

    def law(self, section: SectionReadings) -> Interval95:
        """The laws (K,) at a section, without its scatter about them."""
        joint = self._joint
        scaling = Scaling([joint.templates[law.parameter] for law in joint.laws])
        mu, slopes = joint.at_laws(section.covariates, self._values)
        F = joint.n_common
        common = Scaling(joint.unknowns[:F]).dp_dx(self._values[:F])
        Phi = slopes * common / scaling.dp_dx(mu)[:, None]
        means = self._common @ Phi.T
        variances = np.einsum("kf,jfg,kg->jk", Phi, self._common_covariances, Phi)
        return _interval(scaling, mu, means, variances, self.scatter.weights, cut=False)

    def further(self, section: SectionReadings) -> FurtherSection:
        """The parameters of a section whose readings took no part.

        Args:
            section: with its parameters and covariates; its readings do not count.
        """
        joint, section = self._joint, self._joint.on_common_scale(section)
        scaling = Scaling(section.parameters)
        p = joint.expected_point(section, self._values)
        Phi, Z, _ = joint.by_common(section, p, self._values)
        own = np.zeros(len(p))  # variance of what is the section's own: its prior, or its bounds
        roots = scaling.prior_jacobian(p).sum(axis=0)
        for i, q in enumerate(section.parameters):
            if q.name not in joint.templates:
                own[i] = roots[i] ** -2 if q.prior is not None else sd_of_bounds(q) ** 2
        beside = np.diag(own) + (Z * self.scatter.nodes[:, None, :] ** 2) @ Z.T
        covariances = Phi @ self._common_covariances @ Phi.T + beside
        variances, weights = np.diagonal(covariances, axis1=1, axis2=2), self.scatter.weights
        interval = _interval(scaling, p, self._common @ Phi.T, variances, weights)
        common, within = self._held_at_bounds
        held = Phi @ within @ Phi.T + beside
        return FurtherSection(p, interval, common @ Phi.T, held, weights, scaling)

    @cached_property
    def _held_at_bounds(self) -> tuple[Floats, Floats]:
        """Means (J, F) and covariances (J, F, F) of what is common, on bounds where pushed there.

        One after the other: what is held may take the push from others.
        """
        unknowns = self._joint.unknowns[: self._joint.n_common]
        mean, C = self._common, self._common_covariances
        for k, q in enumerate(unknowns):
            outward = float(self._values[k] == q.upper) - float(self._values[k] == q.lower)
            pushed = outward * mean[:, k] > 0.0
            gain = pushed[:, None] * C[:, k] / C[:, k, k][:, None]
            mean = mean - gain * mean[:, [k]]
            C = C - gain[:, :, None] * C[:, k][:, None, :]
        return mean, C

    def shrinkage(self, s: int) -> Floats:
        """The part of what is known of the parameters (n,) of a section that comes from the others.

        It is one minus the part of the readings of the section in what is known: 0 where the
        section stands for itself, 1 where it only follows the law.
        """
        linear, tau = self._fit.linear, self._fit.tau
        n = len(self._joint.sections[s].parameters)
        whole = np.diag(linear.given(tau).covariances[s])[:n]
        others = np.diag(linear.without(s).given(tau).covariances[s])[:n]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = whole / others
        return np.where(np.isfinite(share), np.clip(share, 0.0, 1.0), np.nan)


def second_moment(weights: Floats, means: Floats, covariances: Floats) -> Floats:
    """Mean (n, n) of x x^T, of a mixture with weights (J,), means (J, n), covariances (J, n, n)."""
    within = np.einsum("j,jab->ab", weights, covariances)
    return np.asarray(within + np.einsum("j,ja,jb->ab", weights, means, means))


def _interval(
    scaling: Scaling,
    p: Floats,
    mean: Floats,
    variance: Floats,
    weights: Floats,
    *,
    cut: bool = True,
) -> Interval95:
    """Values p (l,) with intervals, from deviations (J, l) on their scales and variances.

    The estimate is always inside; ``cut`` at the bounds.
    """
    variance = np.maximum(variance, 0.0)
    rms = np.sqrt(weights @ (mean**2 + variance))
    low, high = mixture_interval(weights, mean, np.sqrt(variance))
    steps = np.minimum(low, 0.0), np.maximum(high, 0.0)
    if cut:
        lower, upper = (scaling.away(p, step) for step in steps)
    else:
        with np.errstate(over="ignore"):  # infinite: too few sections for any upper end
            lower, upper = (
                np.where(scaling.log, p * np.exp(step), p + step * scaling.reference)
                for step in steps
            )
    return Interval95(p, rms * scaling.dp_dx(p), lower, upper)


def section_misfits(fit: HierarchicalFit) -> tuple[tuple[Misfit, float], ...]:
    """The residuals of each section, judged, and whether it is of the same ground.

    Returns:
        For each section its misfit, and the probability that a section of the same ground is at
        least as far from what all others tell of it; NaN where nothing can be said.
    """
    return tuple(
        (judged(*moments), _outlying(fit.linear, fit.tau, fit.free, s))
        for s, moments in enumerate(_residual_moments(fit))
    )


def total_misfit(fit: HierarchicalFit) -> Misfit:
    """All residuals, judged by their errors."""
    return judged(*_residual_moments(fit).sum(axis=0))


def _residual_moments(fit: HierarchicalFit) -> Floats:
    """Of each section the squares of its residuals, their mean and half their variance, (S, 3).

    Theory 6.5, with the part of the residuals that all unknowns together can explain.
    """
    linear, solution = fit.linear, fit.linear.given(fit.tau)
    hat = linear.R @ solution.covariances @ linear.R.swapaxes(1, 2)
    r = linear.q - np.einsum("sij,sj->si", linear.R, solution.sections)
    mean = linear.rows - np.trace(hat, axis1=1, axis2=2)
    squares_of_hat = np.einsum("sij,sji->s", hat, hat)
    half_variance = mean - np.trace(hat, axis1=1, axis2=2) + squares_of_hat
    return np.stack([linear.rest + np.sum(r**2, axis=1), mean, half_variance], axis=1)


def _outlying(linear: LinearSections, tau: Floats, free: Bools, s: int) -> float:
    """Probability that a section of the same ground is at least as far from the others.

    Judged by the readings that the section's own parameters cannot explain, by chi-squared.
    """
    others = linear.without(s)
    scatter = scatter_posterior(others, most_likely(others, tau, free), free)
    solutions = [others.given(node) for node in scatter.nodes]
    means = np.array([one.sections[s] for one in solutions])
    mean = scatter.weights @ means
    covariances = np.array([one.covariances[s] for one in solutions])
    C = second_moment(scatter.weights, means - mean, covariances)
    R, own = linear.R[s], linear.W[s].any(axis=1)
    U, S, _ = np.linalg.svd(R[:, own], full_matrices=True)
    unexplained = U[:, int(np.count_nonzero(S > _SEEN)) :]
    U, S, _ = np.linalg.svd(unexplained.T @ R[:, ~own], full_matrices=False)
    seen = unexplained @ U[:, S > _SEEN]
    if not seen.shape[1]:
        return float("nan")
    d = seen.T @ (linear.q[s] - R @ mean)
    V = np.eye(len(d)) + seen.T @ R @ C @ R.T @ seen
    return float(chdtrc(len(d), float(d @ np.linalg.solve(V, d))))
