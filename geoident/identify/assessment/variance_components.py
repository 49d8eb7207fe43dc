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

Of many readings all this takes sums alone: the products [B, J, y]^T diag(1/s^2) [B, J, y] of the
readings of each component, made once. With Sigma^-1 by Woodbury's formula (`problem.errors`) they
give -2 l and its derivatives at any t, at a cost that does not depend on how many readings there
are.

Directions of the parameters that neither readings nor priors see are left out of J, and so are
parameters on a bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_solve

from geoident.identify.problem.errors import (
    FEW,
    Covariance,
    ErrorStructure,
    SharedErrors,
    products,
)
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
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

_END_WITHIN = 1e-3
"""Width of the bracket of an upper end in t: the accuracy there within 0.05 %."""

_NOTHING = 1e-3
"""Information on a logarithm of a variance below which the residuals show nothing of it."""

_HARDLY = 4.0
"""Half width of an interval of t from which on it begins at zero: a factor of 7 on the accuracy."""

_MOST_STEPS, _LONGEST, _CONVERGED = 100, 3.0, 1e-7
"""Steps of Fisher's scoring at most, the longest and the last of them in t. A factor of e^3 on a
variance is as far as the information at one t can be trusted; six steps reach either end."""

_MOST_HALVINGS, _ROUNDING_OF_LIKELIHOOD = 30, 1e-12
"""Of one step, down to a billionth; and the part by which -2 l may rise by rounding."""

_CHI_SQUARED_95 = NORMAL_95**2
"""Rise of -2 l at the ends of a 95 % interval of one factor."""


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
        self._few = len(gap) <= FEW
        self._unshared = SharedErrors(structure.columns)  # where there are no columns

    @cached_property
    def _parts(self) -> list[_Part]:
        return [_part(self.structure, c) for c in range(len(self.structure.names))]

    @cached_property
    def _sums(self) -> _Sums:
        return _sums(self.structure, np.column_stack([self.jacobian, self.gap]))

    def value(self, t: Floats) -> float:
        """-2 l at t (c,)."""
        by_itself = self._few or self.structure.columns.shape[1] > _MANY_SHARED
        return self._densely(t)[0] if by_itself else self._solved(t).value

    def terms(self, t: Floats) -> LikelihoodTerms:
        """-2 l at t (c,) with its derivatives."""
        return self._terms_densely(t) if self._few else self._terms_of_sums(t)

    def weak_prior(self, t: Floats) -> float:
        """What of -2 l at t (c,) was known before any residual: nothing."""
        return 0.0

    def _terms_densely(self, t: Floats) -> LikelihoodTerms:
        """The same with matrices (g, g): exact however small the own errors are."""
        value, sigma, q, M = self._densely(t)
        pull = sigma.solve(self.jacobian)
        P = sigma.inverse - pull @ np.linalg.solve(M, pull.T)
        moved = [part.times(P) for part in self._parts]  # V_c P
        size = np.exp(t)
        trace = np.array([np.trace(V) for V in moved])
        squares = np.array([part.squares(q) for part in self._parts])
        both = [[float(np.sum(A * B.T)) for B in moved] for A in moved]
        information = 0.5 * np.outer(size, size) * np.array(both).reshape(len(t), len(t))
        return LikelihoodTerms(value, size * (trace - squares), information)

    def _densely(self, t: Floats) -> tuple[float, Covariance, Floats, Floats]:
        """-2 l, Sigma, q and M."""
        sd, shared = self.structure.at(t)
        sigma = Covariance(sd, shared or self._unshared)
        J, R = self.jacobian, self.prior_rows
        M = J.T @ sigma.solve(J) + R.T @ R
        x = np.linalg.solve(M, J.T @ sigma.solve(self.gap) - R.T @ self.prior)
        left = self.gap - J @ x
        q = sigma.solve(left)
        prior = self.prior + R @ x
        _, log_det = np.linalg.slogdet(M)
        value = sigma.log_determinant() + float(log_det) + float(left @ q + prior @ prior)
        return value, sigma, q, M

    def _terms_of_sums(self, t: Floats) -> LikelihoodTerms:
        """The same of the sums alone."""
        s = self._solved(t)
        k, n = len(s.inverse), len(s.x)
        # P = 1/D - 1/D F S F^T 1/D  and  P B = 1/D F Y  with F = [B, J]
        steps = np.vstack([-s.inverse @ s.BJ, np.eye(n)])
        S = steps @ np.linalg.solve(s.M, steps.T)
        S[:k, :k] += s.inverse
        Y = -steps @ np.linalg.solve(s.M, s.BJ.T @ s.inverse)
        Y[:k] += s.inverse
        shared = np.eye(k) - s.inverse - s.inverse @ s.BJ @ np.linalg.solve(s.M, s.BJ.T) @ s.inverse
        z = s.inverse @ (s.By - s.BJ @ s.x)  # B^T q
        q = np.concatenate([-z, -s.x, [1.0]])  # q = 1/D [F, y] times it
        numbers = range(len(t))
        own = [s.of_own[c] for c in numbers]
        part = [S @ each[:-1, :-1] for each in own]
        columns = [np.flatnonzero(self.structure.column_component == c) for c in numbers]
        trace = np.array([
            self._sums.count[c] - np.trace(part[c]) + shared[columns[c], columns[c]].sum()
            for c in numbers
        ])  # fmt: skip
        squares = np.array([q @ own[c] @ q + z[columns[c]] @ z[columns[c]] for c in numbers])
        both = np.zeros((len(t), len(t)))
        for c in numbers:
            mixed = np.einsum("ij,ij->j", Y, own[c][:-1, :-1] @ Y)
            for d in numbers:
                both[c, d] += np.sum(part[c] * part[d].T) + mixed[columns[d]].sum()
                both[d, c] += mixed[columns[d]].sum()
                both[c, d] += np.sum(shared[np.ix_(columns[c], columns[d])] ** 2)
            both[c, c] += self._sums.count[c] - 2.0 * np.trace(part[c])
        return LikelihoodTerms(s.value, trace - squares, 0.5 * both)

    def _solved(self, t: Floats) -> _Solved:
        """What follows of the sums at t (c,)."""
        structure, k = self.structure, self.structure.columns.shape[1]
        root = np.exp(0.5 * np.append(t, 0.0))  # the last one for -1: given
        beside = np.ones(self.jacobian.shape[1] + 1)  # of the Jacobian and the readings
        scale = np.concatenate([root[structure.column_component], beside])
        of_own = [
            (each * scale[:, None] * scale) / r**2
            for each, r in zip(self._sums.each, root, strict=True)
        ]
        total = np.sum(of_own, axis=0)
        BB, BJ, By = total[:k, :k], total[:k, k:-1], total[:k, -1]
        JJ, Jy, yy = total[k:-1, k:-1], total[k:-1, -1], total[-1, -1]
        R = np.linalg.cholesky(BB + np.eye(k))
        inverse = np.asarray(cho_solve((R, True), np.eye(k)))
        J_, prior = self.prior_rows, self.prior
        M = JJ - BJ.T @ inverse @ BJ + J_.T @ J_
        pull = Jy - BJ.T @ inverse @ By
        x = np.linalg.solve(M, pull - J_.T @ prior)
        lowest = yy - By @ inverse @ By - 2.0 * x @ pull + x @ (M - J_.T @ J_) @ x
        left = prior + J_ @ x
        _, log_det = np.linalg.slogdet(M)
        value = self._sums.log_variance + float(self._sums.count @ np.append(t, 0.0))
        value += 2.0 * float(np.log(np.diag(R)).sum()) + float(log_det)
        return _Solved(value + float(lowest + left @ left), of_own, inverse, BJ, By, M, x)


@dataclass(frozen=True)
class _Part:
    """V_c = diag(own) + B B^T at a factor of one: own (g,), B (g, k)."""

    own: Floats
    B: Floats

    def times(self, matrix: Floats) -> Floats:
        """V_c times a matrix (g, g)."""
        return np.asarray(self.own[:, None] * matrix + self.B @ (self.B.T @ matrix))

    def squares(self, q: Floats) -> float:
        """q^T V_c q."""
        shared = self.B.T @ q
        return float(q @ (self.own * q) + shared @ shared)


def _part(structure: ErrorStructure, c: int) -> _Part:
    own = np.where(structure.component == c, structure.sd**2, 0.0)
    columns = structure.columns[:, np.flatnonzero(structure.column_component == c)]
    return _Part(own, np.asarray(columns.toarray()))


@dataclass(frozen=True)
class _Solved:
    """-2 l at one t, and what it is made of: parts of [B, J, y]^T D^-1 [B, J, y]."""

    value: float
    of_own: list[Floats]
    inverse: Floats
    BJ: Floats
    By: Floats
    M: Floats
    x: Floats


@dataclass(frozen=True)
class _Sums:
    """All that the likelihood takes of g readings, at factors of one.

    Args:
        each: [B, J, y]^T diag(1/s^2) [B, J, y] of the readings of every component, those of
            given size last.
        count: of readings, likewise.
        log_variance: sum of ln s^2 of all.
    """

    each: list[Floats]
    count: Floats
    log_variance: float


def _sums(structure: ErrorStructure, more: Floats) -> _Sums:
    """The sums, with the columns (g, n + 1) that stand beside those of shared errors."""
    weight = structure.sd**-2.0
    numbers = [*range(len(structure.names)), -1]
    return _Sums(
        [_products(structure.columns, more, weight * (structure.component == c)) for c in numbers],
        np.array([np.count_nonzero(structure.component == c) for c in numbers], dtype=np.float64),
        2.0 * float(np.log(structure.sd).sum()),
    )


def _products(columns: sp.csr_array, more: Floats, weight: Floats) -> Floats:
    """[B, M]^T diag(weight) [B, M] of B (g, k) and M (g, n), dense some rows at a time."""
    k, g = columns.shape[1] + more.shape[1], len(weight)
    if columns.nnz < _SPARSE * columns.shape[0] * columns.shape[1]:
        return products(sp.csr_array(sp.hstack([columns, sp.csr_array(more)])), weight)
    total = np.zeros((k, k))
    for rows in np.array_split(np.arange(g), max(1, -(-g * k // _SMALL))):
        total += products(np.hstack([columns[rows].toarray(), more[rows]]), weight[rows])
    return total


_MANY_SHARED = 2000
"""Shared errors from which on sums of their products cost more than to solve with all readings."""

_SPARSE = 0.1
"""Part of the entries below which a matrix is taken as sparse."""

_SMALL = 4_000_000
"""Entries of a matrix that is made dense."""


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
    scaling = Scaling(problem.parameters)
    free = _free(problem, values)
    J = (jacobian * scaling.slope(values))[:, free]
    R = scaling.prior_jacobian(values)[:, free]
    rows = np.concatenate([J / problem.sd[:, None], R])
    _, S, Vt = np.linalg.svd(rows, full_matrices=False)
    seen = Vt[_UNSEEN * S.max(initial=0.0) < S].T
    return RestrictedLikelihood(
        structure,
        problem.measured - readings,
        J @ seen,
        scaling.prior_residuals(values),
        R @ seen,
    )


def _free(problem: Problem, values: Floats) -> Bools:
    """Parameters (n,) that are not on a bound."""
    lower, upper = problem.bounds
    return np.asarray((values > lower) & (values < upper), dtype=np.bool_)


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
        upper[c] = _upper_end(likelihood, t, c, terms.value + _CHI_SQUARED_95)
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
        before, t = t, _descend(likelihood, t, step, at.value)
        if np.abs(t - before).max() <= _CONVERGED:
            break
    at = likelihood.terms(t)
    lowest = at.value
    for c in np.flatnonzero(np.diag(at.information) < _NOTHING).tolist():
        trial = t.copy()
        trial[c] = LOWEST
        if likelihood.value(trial) <= lowest + _NOTHING:
            t = trial
    return t, likelihood.terms(t)


def _descend(likelihood: Likelihood, t: Floats, step: Floats, value: float) -> Floats:
    """The end of a step, halved until -2 l does not rise above its value; t if it always does."""
    for _ in range(_MOST_HALVINGS):
        trial = np.clip(t + step, LOWEST, HIGHEST)
        if likelihood.value(trial) <= value + _ROUNDING_OF_LIKELIHOOD * abs(value):
            return trial
        step = 0.5 * step
    return t


def _inverse(information: Floats) -> tuple[Floats, Bools]:
    """Pseudo-inverse (c, c), and which components (c,) have a part in directions left out of it."""
    scale = np.sqrt(np.maximum(np.diag(information), _NO_INFORMATION))
    size, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    seen = size > _INSEPARABLE
    inverse = (vectors[:, seen] / size[seen]) @ vectors[:, seen].T / np.outer(scale, scale)
    return inverse, np.asarray(
        np.any(np.abs(vectors[:, ~seen]) > _TAKES_PART, axis=1), dtype=np.bool_
    )


def _upper_end(likelihood: Likelihood, t: Floats, c: int, level: float) -> float:
    """The factor of a component, the others as they are, at which -2 l reaches a level."""
    low, high = LOWEST, HIGHEST

    def at(x: float) -> float:
        trial = t.copy()
        trial[c] = x
        return likelihood.value(trial)

    if at(high) < level:
        return np.inf
    while high - low > _END_WITHIN:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if at(middle) < level else (low, middle)
    return high
