"""Accuracies from the residuals: variance components by restricted maximum likelihood (theory 7).

The covariance of the errors is Sigma(t) = V_0 + sum_c e^(t_c) V_c, with V_0 what is given and t the
logarithms of factors on what is to be estimated. With the model linearised at the estimate, J its
Jacobian, R the rows of the priors and M = J^T Sigma^-1 J + R^T R, twice the negative logarithm
of the restricted likelihood is, up to a constant (Patterson & Thompson 1971),

    -2 l = log|Sigma| + log|M| + phi,     phi = min over x of |L^-1 (y - v - J x)|^2 + |rho + R x|^2

log|M| accounts for the parameters that were fitted with the same readings: without it, as in
maximum likelihood, accuracies come out too good. With P = Sigma^-1 - Sigma^-1 J M^-1 J^T Sigma^-1
and q = Sigma^-1 (y - v - J x), the derivatives by t and the expected information are

    d(-2 l)/dt_c = e^(t_c) (tr P V_c - q^T V_c q)       I_cd = e^(t_c + t_d) tr(P V_c P V_d) / 2

so Newton's method with I (Fisher's scoring), shortened where -2 l would rise, finds t, and I^-1 is
its covariance. For repeated readings of one quantity this is the variance with n - 1, and for
groups of equal size the estimator of the analysis of variance.

Where a factor falls to `LOWEST`, the residuals show nothing of it. Its interval, and that of one of
which they show hardly any, begins at zero and ends where -2 l is 3.84 above its minimum. Components
that the readings cannot separate keep their ratio (a pseudo-inverse of I moves only what is
seen).

The errors are e = own + B z with the shared errors z of variance one. So -2 l is found from one
least-squares problem for z and x together (the mixed model equations of Henderson 1950), by the
triangular factor T of

    [ B/s  J/s  y/s ]                   -2 l = sum ln s^2 + 2 sum ln |T_ii| + T_ll^2
    [  1    0    0  ]                   S    = (T^T T)^-1 , the covariance of (z, x)
    [  0    R  -rho ]

with T_ll the last entry, and T^T T that of the columns of z and x. Then B^T P B = 1 - S_zz,
P B = D^-1 [B, J] S_z and P = D^-1 - D^-1 [B, J] S [B, J]^T D^-1 with D = diag(s^2), and B^T q is
the mean of z. The rows of readings enter by a triangular factor for each component, made once: the
cost at a t does not depend on how many readings there are.

Directions of the parameters that neither readings nor priors see are left out of J, and so are
parameters on a bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular

from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Bools, Floats
from geoident.model.results.bands import NORMAL_95

LOWEST = -18.0
"""Logarithm of the smallest factor of a variance: a ten-thousandth of the first accuracy."""

HIGHEST = 18.0
"""Logarithm of the largest factor of a variance: ten thousand times the first accuracy."""

_UNSEEN = 1e-8
"""Directions of the parameters with singular values below this part of the largest are left out."""

_INSEPARABLE = 1e-6
"""Eigenvalues of the information, scaled to a diagonal of ones, below which components cannot be
separated."""

_TAKES_PART = 0.1
"""Entry of a unit vector of such a direction from which on a component has a part in it."""

_NO_INFORMATION = 1e-12
"""Least diagonal of the information by which it is scaled: no division by zero."""

_NOTHING = 1e-3
"""Information on a logarithm of a variance below which the residuals show nothing of it."""

_HARDLY = 4.0
"""Half width of an interval of t from which on it begins at zero: a factor of 7 on the accuracy."""

_MOST_STEPS, _LONGEST, _CONVERGED = 100, 3.0, 1e-7
"""Steps of Fisher's scoring at most, the longest and the last of them in t. A factor of e^3 on a
variance is as far as the information at one t can be trusted; six steps reach either end."""

_MOST_HALVINGS, _ROUNDING_OF_LIKELIHOOD = 30, 1e-12
"""Of one step, down to a billionth; and the part by which -2 l may rise by rounding."""


class VariancePoints(NamedTuple):
    """Accuracies that are possible beside the most likely ones.

    Args:
        points: (K, c) logarithms of factors on the variances, from the most likely ones.
        odds: (K,) with the sum one.
        flat: (K,) logarithms of their weights before any reading.
    """

    points: Floats
    odds: Floats
    flat: Floats


@dataclass(frozen=True)
class VarianceComponents:
    """The factors of c components of variance.

    Args:
        log_factor: (c,) t.
        covariance: (c, c) of t.
        lower: (c,) lower end of the 95 % interval of t; -inf where the residuals show nothing.
        upper: (c,) upper end; inf where the readings cannot separate it from the others.
        minus_two_l: -2 l, up to a constant.
        possible: those that are possible as well; None where all are known well enough.
    """

    log_factor: Floats
    covariance: Floats
    lower: Floats
    upper: Floats
    minus_two_l: float
    possible: VariancePoints | None = None


@dataclass(frozen=True)
class LikelihoodTerms:
    """-2 l at one t, its gradient (c,) and the expected information (c, c)."""

    value: float
    gradient: Floats
    information: Floats


class Likelihood(Protocol):
    """-2 l of the logarithms t (c,) of the factors of components."""

    def value(self, t: Floats) -> float:
        """-2 l at t (c,)."""

    def terms(self, t: Floats) -> LikelihoodTerms:
        """-2 l at t (c,) with its derivatives."""

    def weak_prior(self, t: Floats) -> float:
        """What of -2 l at t (c,) was known before any residual."""


@dataclass(frozen=True)
class ConditionalLikelihood:
    """The likelihood of the first c of c + 1 components, at a given factor of the last.

    A weak prior keeps the others near what is stated: what explains all residuals by itself would
    let the rest vanish.

    Args:
        whole: of all of them.
        last: logarithm of the factor of the last.
        spread: standard deviation of the logarithm of an accuracy, before any residual.
    """

    whole: Likelihood
    last: float
    spread: float

    def value(self, t: Floats) -> float:
        """-2 l at t (c,), with the prior."""
        return self.whole.value(np.append(t, self.last)) + self.weak_prior(t)

    def terms(self, t: Floats) -> LikelihoodTerms:
        """The same with its derivatives by these."""
        terms = self.whole.terms(np.append(t, self.last))
        return LikelihoodTerms(
            terms.value + self.weak_prior(t),
            terms.gradient[:-1] + 0.5 * t / self.spread**2,
            terms.information[:-1, :-1] + 0.25 * np.eye(len(t)) / self.spread**2,
        )

    def weak_prior(self, t: Floats) -> float:
        """What of -2 l at t (c,) was known before any residual."""
        return float(np.sum((0.5 * t / self.spread) ** 2))


class RestrictedLikelihood:
    """-2 l of the factors of components, for a model that is linear near the estimate.

    Args:
        structure: the errors of the g readings.
        gap: (g,) measured less computed readings at the estimate, SI.
        jacobian: (g, q) derivatives of the computed readings by directions of the parameters.
        prior: (k,) residuals of the priors at the estimate.
        prior_rows: (k, q) their derivatives; with the Jacobian of full rank.
    """

    def __init__(
        self,
        structure: ErrorStructure,
        gap: Floats,
        jacobian: Floats,
        prior: Floats,
        prior_rows: Floats,
    ) -> None:
        self.structure = structure
        self.gap = gap
        self.jacobian = jacobian
        self.prior = prior
        self.prior_rows = prior_rows
        # readings of each component, those of given size last
        self._members = [structure.component == c for c in (*range(len(structure.names)), -1)]
        self._count = np.array([np.count_nonzero(one) for one in self._members], dtype=np.float64)

    @cached_property
    def _factors(self) -> list[Floats]:
        """Triangular factors of [B, J, y] / s at factors of one, one for each component."""
        own = np.column_stack([self.jacobian, self.gap])
        rows = sp.csr_array(sp.hstack([self.structure.columns, sp.csr_array(own)]))
        rows = sp.csr_array(sp.diags_array(1.0 / self.structure.sd) @ rows)
        return [_triangular(sp.csr_array(rows[np.flatnonzero(one)])) for one in self._members]

    def value(self, t: Floats) -> float:
        """-2 l at t (c,)."""
        return self._solved(t)[0]

    def weak_prior(self, t: Floats) -> float:
        """What of -2 l at t (c,) was known before any residual: nothing."""
        return 0.0

    def _solved(self, t: Floats) -> tuple[float, list[Floats], Floats]:
        """-2 l, the rows of each component and the factor T of all rows, at t (c,)."""
        k, q = self.structure.columns.shape[1], self.jacobian.shape[1]
        root = np.exp(0.5 * np.append(t, 0.0))  # the last one for -1: given
        scale = np.append(root[self.structure.column_component], np.ones(q + 1))
        own = [factor * scale / r for factor, r in zip(self._factors, root, strict=True)]
        priors = np.column_stack([np.zeros((len(self.prior), k)), self.prior_rows, -self.prior])
        zero = np.zeros((1, k + q + 1))  # so that there are as many rows as columns
        rows = np.vstack([*own, np.eye(k, k + q + 1), priors, zero])
        T: Floats = np.asarray(np.linalg.qr(rows, mode="r"))
        value = 2.0 * float(np.log(self.structure.sd).sum()) + float(self._count @ np.append(t, 0))
        value += 2.0 * float(np.log(np.abs(np.diag(T)[:-1])).sum()) + float(T[-1, -1]) ** 2
        return value, own, T

    def terms(self, t: Floats) -> LikelihoodTerms:
        """-2 l at t (c,) with its derivatives."""
        k, numbers = self.structure.columns.shape[1], range(len(t))
        value, own, T = self._solved(t)
        inverse = solve_triangular(T[:-1, :-1], np.eye(len(T) - 1))
        S, mean = inverse @ inverse.T, inverse @ T[:-1, -1]
        shared = np.eye(k) - S[:k, :k]  # B^T P B
        columns = [np.flatnonzero(self.structure.column_component == c) for c in numbers]
        squares = [float(np.sum((own[c] @ np.append(-mean, 1.0)) ** 2)) for c in numbers]
        gram = [own[c][:, :-1].T @ own[c][:, :-1] for c in numbers]
        moved = [S @ one for one in gram]
        gradient, both = np.zeros(len(t)), np.zeros((len(t), len(t)))
        for c in numbers:
            trace = self._count[c] - np.trace(moved[c]) + np.diag(shared)[columns[c]].sum()
            gradient[c] = trace - squares[c] - np.sum(mean[columns[c]] ** 2)
            both[c, c] += self._count[c] - 2.0 * np.trace(moved[c])
            mixed = np.einsum("ij,ij->j", S[:, :k], gram[c] @ S[:, :k])
            for d in numbers:
                both[c, d] += np.sum(moved[c] * moved[d].T) + mixed[columns[d]].sum()
                both[d, c] += mixed[columns[d]].sum()
                both[c, d] += np.sum(shared[np.ix_(columns[c], columns[d])] ** 2)
        return LikelihoodTerms(value, gradient, 0.5 * both)


def _triangular(rows: sp.csr_array) -> Floats:
    """A triangular factor (at most n, n) of rows (m, n), dense some rows at a time."""
    n = rows.shape[1]
    factor = np.zeros((0, n))
    for some in np.array_split(np.arange(rows.shape[0]), -(-rows.shape[0] * n // _ENTRIES) or 1):
        stacked = np.vstack([factor, rows[some].toarray()])
        factor = np.asarray(np.linalg.qr(stacked, mode="r"))
    return factor


_ENTRIES = 4_000_000
"""Of the rows of readings that are made dense at once (32 MB)."""


def likelihood_at(
    problem: Problem, structure: ErrorStructure, values: Floats, readings: Floats, jacobian: Floats
) -> RestrictedLikelihood:
    """The restricted likelihood with the model linearised at the estimate.

    Args:
        problem: the used readings and the parameters.
        structure: the errors of the readings.
        values: (n,) the estimate, SI.
        readings: (g,) v there, SI.
        jacobian: (g, n) its derivative, SI.
    """
    scaling, (lower, upper) = Scaling(problem.parameters), problem.bounds
    free = (values > lower) & (values < upper)
    J = (jacobian * scaling.dp_dx(values))[:, free]
    R = scaling.prior_jacobian(values)[:, free]
    gap, prior = problem.measured - readings, scaling.prior_residuals(values)
    return seen_likelihood(structure, problem.sd, gap, (J, R), prior)


def seen_likelihood(
    structure: ErrorStructure, sd: Floats, gap: Floats, rows: tuple[Floats, Floats], prior: Floats
) -> RestrictedLikelihood:
    """The restricted likelihood, without directions that neither readings nor priors see.

    Args:
        structure: the errors of the readings.
        sd: (g,) sizes by which rows of readings count beside those of priors, SI.
        gap: (g,) v* - v, SI.
        rows: derivatives of the readings (g, n), SI, and of the priors (m, n), by scaled unknowns.
        prior: (m,) residuals of the priors.
    """
    J, R = rows
    _, S, Vt = np.linalg.svd(np.concatenate([J / sd[:, None], R]), full_matrices=False)
    seen = Vt[_UNSEEN * S.max(initial=0.0) < S].T
    return RestrictedLikelihood(structure, gap, J @ seen, prior, R @ seen)


def estimate_components(likelihood: Likelihood, start: Floats) -> VarianceComponents:
    """The factors that the residuals make most likely.

    Args:
        likelihood: of the factors.
        start: (c,) logarithms of factors to begin with.
    """
    t, terms = likeliest_factors(likelihood, start)
    inner = (t > LOWEST) & (t < HIGHEST)
    covariance = np.zeros((len(t), len(t)))
    square = np.ix_(inner, inner)
    covariance[square], unseen = _inverse(terms.information[square])
    half = NORMAL_95 * np.sqrt(np.diag(covariance))
    lower, upper = t - half, t + half
    inseparable = np.zeros(len(t), dtype=np.bool_)
    inseparable[inner] = unseen
    small = ~inseparable & ((t <= LOWEST) | (half > _HARDLY))
    lower[inseparable | small] = -np.inf
    upper[inseparable | (t >= HIGHEST)] = np.inf
    for c in np.flatnonzero(small).tolist():
        from scipy.optimize import brentq  # noqa: PLC0415 - 0.3 s, and few fits have such an end

        def rise(x: float, c: int = c) -> float:
            """-2 l above its value at the end of an interval; component c is x, others stay."""
            trial = likelihood.value(np.where(np.arange(len(t)) == c, x, t))
            return trial - terms.value - NORMAL_95**2

        upper[c] = brentq(rise, t[c], HIGHEST) if rise(HIGHEST) > 0.0 else np.inf
    return VarianceComponents(t, covariance, lower, upper, terms.value)


def likeliest_factors(likelihood: Likelihood, start: Floats) -> tuple[Floats, LikelihoodTerms]:
    """The logarithms t (c,) of the factors that the residuals make most likely, and -2 l there.

    Fisher's scoring within `LOWEST` and `HIGHEST`. Factors of which the residuals show nothing are
    set to the lowest.

    Args:
        likelihood: of the factors.
        start: (c,) logarithms of factors to begin with.
    """
    t = np.clip(start, LOWEST, HIGHEST)
    for _ in range(_MOST_STEPS):
        at = likelihood.terms(t)
        moving = ((t > LOWEST) | (at.gradient <= 0.0)) & ((t < HIGHEST) | (at.gradient >= 0.0))
        if not moving.any():
            break
        inverse, _ = _inverse(at.information[np.ix_(moving, moving)])
        step = np.zeros(len(t))
        step[moving] = np.clip(-0.5 * inverse @ at.gradient[moving], -_LONGEST, _LONGEST)
        before = t
        for _ in range(_MOST_HALVINGS):  # until -2 l does not rise
            t = np.clip(before + step, LOWEST, HIGHEST)
            if likelihood.value(t) <= at.value + _ROUNDING_OF_LIKELIHOOD * abs(at.value):
                break
            step = 0.5 * step
        else:
            t = before
        if np.abs(t - before).max() <= _CONVERGED:
            break
    at = likelihood.terms(t)
    for c in np.flatnonzero(np.diag(at.information) < _NOTHING).tolist():
        trial = np.where(np.arange(len(t)) == c, LOWEST, t)
        if likelihood.value(trial) <= at.value + _NOTHING:
            t = trial
    return t, likelihood.terms(t)


def _inverse(information: Floats) -> tuple[Floats, Bools]:
    """Pseudo-inverse (c, c), and which components (c,) have a part in directions left out of it."""
    scale = np.sqrt(np.maximum(np.diag(information), _NO_INFORMATION))
    size, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    seen = size > _INSEPARABLE
    inverse = (vectors[:, seen] / size[seen]) @ vectors[:, seen].T / np.outer(scale, scale)
    return inverse, np.asarray(
        np.any(np.abs(vectors[:, ~seen]) > _TAKES_PART, axis=1), dtype=np.bool_
    )
