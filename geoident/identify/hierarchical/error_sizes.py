"""How large the errors of several sections are whose models are followed in time (theory 15.3).

Beside the errors of gauges and of the model, eta, the computed course in time of each section may
be wrong by a part that changes in time, and by one that all sections have in common:

    y_s = v_s (1 + c + d_s) + e_s ,    Cov(c, c') = eta_c^2 k ,   Cov(d_s, d_s') = eta_d^2 k ,
    k   = exp(-|tau - tau'| / l) ,     tau = log(1 + t / T)

c is known by its values at nodes, between which these imply it: unknowns that all sections share.
The others are integrated over section by section, so that sizes cost as much as the sections have
readings, not as their square.

The sizes are those of the largest posterior in their logarithms. There a half-normal prior of an
eta ends at its own root mean square where the readings say nothing: an error of which they do not
tell is not none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import solve_triangular

from geoident.identify.assessment.model_error import (
    ACCURACY_SPREAD,
    FACTORS,
    PRIOR_SD,
    SIZES,
    ZERO_SD,
    ZEROS,
)
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.bands import NORMAL_95

MEMORY_SPREAD = np.log(2.0)
"""Of the logarithm of l about 1: the correlation of errors of programs (theory 9.1)."""

_LEAST, _MOST = np.log(
    [
        (SIZES[1], 1.0, 0.05, SIZES[1], SIZES[1], 0.25),
        (1.0, FACTORS[-1], ZEROS[-1], 1.0, 1.0, 4.0),
    ]
)
"""Logarithms between which sizes (6,) are sought."""

NODES = 10
"""At which what is common is known, evenly from the first to the last of all readings."""

_NOTHING = 1e-9
"""Added to covariances of the order of one, so that equal times have one."""


def correlation(moments: Floats, others: Floats, memory: float) -> Floats:
    """K (m, n) of moments tau (m,) with others (n,)."""
    return np.asarray(np.exp(-np.abs(moments[:, None] - others) / memory))


@dataclass(frozen=True)
class CommonCourse:
    """What all sections have in common, by its values at nodes.

    Args:
        nodes: (m,) moments tau.
        kinds: number of kinds of readings, each of which has one.
    """

    nodes: Floats
    kinds: int

    def basis(self, moments: Floats, kinds: Ints, memory: float) -> Floats:
        """What each of the independent unknowns, of variance one, makes of c (l, m * kinds).

        Args:
            moments: (l,) tau of the readings.
            kinds: (l,) numbers of what they read.
            memory: l.
        """
        m = len(self.nodes)
        if not m:
            return np.zeros((len(moments), 0))
        K = correlation(self.nodes, self.nodes, memory) + _NOTHING * np.eye(m)
        root = np.linalg.cholesky(K)
        between = correlation(self.nodes, moments, memory)  # as the values at the nodes imply it
        made = solve_triangular(root, between, lower=True).T
        return np.concatenate([made * (kinds == k)[:, None] for k in range(self.kinds)], axis=1)


def course_root(moments: Floats, kinds: Ints, memory: float) -> Floats:
    """A root (l, r) of the covariance of d: one course for each kind of readings.

    Of many readings it is that of a course that is known at nodes.

    Args:
        moments: (l,) tau.
        kinds: (l,) numbers of what they read.
        memory: l.
    """
    if len(moments) > _MANY:
        nodes = np.linspace(moments.min(), moments.max(), _MANY // 4)
        return CommonCourse(nodes, int(kinds.max()) + 1).basis(moments, kinds, memory)
    K = correlation(moments, moments, memory) * (kinds[:, None] == kinds)
    return np.linalg.cholesky(K + _NOTHING * np.eye(len(K)))


_MANY = 200
"""Readings up to which each has an error of its own of the course."""


@dataclass(frozen=True)
class SectionResiduals:
    """What the readings (g,) of a section are off, and what may be the cause.

    Args:
        gap: measured less computed, SI.
        jacobian: (g, q) derivatives by all unknowns of the project on their scales, SI.
        gauges: (g, g) covariance of the errors of gauges as stated, SI.
        zeros: (g, g) of errors of zeros as large as the accuracies.
        model: (g, g) of the model error at eta = 1; zero where the case states it.
        given: (g, g) of the model error that the case states.
        moved: (g,) what the model error is in parts of; zero where c and d are none.
        moments: (g,) tau.
        kinds: (g,) numbers of what they read.
    """

    gap: Floats
    jacobian: Floats
    gauges: Floats
    zeros: Floats
    model: Floats
    given: Floats
    moved: Floats
    moments: Floats
    kinds: Ints


class SizesLikelihood:
    """-2 log L of sizes (6,): eta, s, z, eta_d, eta_c, l.

    Args:
        sections: their residuals.
        common: what they have in common.
        priors: derivatives (k, q) of the rows of priors by all unknowns, and their residuals (k,).
    """

    def __init__(
        self,
        sections: Sequence[SectionResiduals],
        common: CommonCourse,
        priors: tuple[Floats, Floats],
    ) -> None:
        self._sections, self._common = sections, common
        weighted = [one.jacobian / np.sqrt(np.diag(one.gauges))[:, None] for one in sections]
        _, S, Vt = np.linalg.svd(np.concatenate([*weighted, priors[0]]), full_matrices=False)
        self._seen = Vt[_UNSEEN * S.max(initial=0.0) < S].T
        shared = common.kinds * len(common.nodes)
        rows = np.column_stack([priors[0] @ self._seen, -priors[1]])
        rows = np.column_stack([np.zeros((len(rows), shared)), rows])
        rows = np.concatenate([np.eye(shared, rows.shape[1]), rows])
        self._priors = rows.T @ rows

    def __len__(self) -> int:
        """How many sections there are."""
        return len(self._sections)

    def value(self, sizes: Floats) -> float:
        """At sizes (6,)."""
        return self.joined([self.of(s, sizes) for s in range(len(self))])

    def of(self, s: int, sizes: Floats) -> tuple[float, Floats]:
        """log|Sigma| of a section, and the products of its whitened rows."""
        one, (eta, scatter, z, of_course, of_common, memory) = self._sections[s], sizes.tolist()
        k = correlation(one.moments, one.moments, memory) * (one.kinds[:, None] == one.kinds)
        sigma = scatter**2 * (one.gauges + z**2 * one.zeros) + eta**2 * one.model + one.given
        sigma = sigma + of_course**2 * np.outer(one.moved, one.moved) * k
        basis = of_common * self._common.basis(one.moments, one.kinds, memory)
        rows = np.column_stack(
            [one.moved[:, None] * basis, one.jacobian @ self._seen, one.gap[:, None]]
        )
        L = np.linalg.cholesky(sigma + _ROUNDING * np.diag(np.diag(sigma)))
        white = solve_triangular(L, rows, lower=True)
        return 2.0 * float(np.log(np.diag(L)).sum()), white.T @ white

    def joined(self, parts: Sequence[tuple[float, Floats]]) -> float:
        """log|Sigma| + log|M| + the least sum of squares, of what `of` says of all sections."""
        products = self._priors + sum(products for _, products in parts)
        M, pull = products[:-1, :-1], products[:-1, -1]
        least = products[-1, -1] - pull @ np.linalg.solve(M, pull)
        return sum(log for log, _ in parts) + float(np.linalg.slogdet(M)[1] + least)


_ROUNDING = 1e-11
"""Part of the variances that is added where errors of models are far beyond those of gauges."""

_UNSEEN = 1e-8
"""Directions of the unknowns with singular values below this part of the largest are left out."""


def likeliest_sizes(likelihood: SizesLikelihood, start: Floats, free: Bools) -> Floats:
    """The sizes (6,) of the largest posterior in their logarithms.

    Args:
        likelihood: of the sizes.
        start: (6,) where to begin; what is not free stays.
        free: (6,) is to be found.
    """
    from scipy.optimize import minimize  # noqa: PLC0415 - 0.3 s, and only projects search

    def minus_two_log(logs: Floats) -> float:
        sizes = start.copy()
        sizes[free] = np.exp(logs)
        return likelihood.value(sizes) + _prior(sizes, free)

    least, most = _LEAST[free], _MOST[free]
    begin = np.clip(np.log(start[free]), least + _INSIDE, most - _INSIDE)
    end = minimize(
        minus_two_log, begin, method="L-BFGS-B", bounds=list(zip(least, most, strict=True))
    )
    sizes = start.copy()
    sizes[free] = np.exp(end.x)
    return sizes


_INSIDE = 0.05
"""From an end of the range, where a search begins."""


def _prior(sizes: Floats, free: Bools) -> float:
    """-2 log of the density of the logarithms of sizes (6,)."""
    sizes = np.where(free, sizes, 1.0)
    parts = (sizes / [PRIOR_SD, 1.0, ZERO_SD, PRIOR_SD, PRIOR_SD, 1.0]) ** 2 - 2.0 * np.log(sizes)
    parts[1] = (np.log(sizes[1]) / ACCURACY_SPREAD) ** 2
    parts[5] = (np.log(sizes[5]) / MEMORY_SPREAD) ** 2
    return float(parts[free].sum())


FACTORS_OF_ONE = 10.0 ** np.linspace(-1.2, 1.2, 13)
"""By which the accuracies of a section may be off beside those of all others."""

OFF = 3.0
"""From which factor on they are named."""

_LESS = (1.0, 0.25)
"""By which the errors of all models may be less than found: one section may have raised them."""

_MODELS = np.array([2.0, 4.0])
"""By which the model error of a section may be larger: the other explanation of a large misfit."""


@dataclass(frozen=True)
class AccuracyOff:
    """That gauges are not as accurate as stated.

    Args:
        factor: on their accuracies.
        or_model: a larger model error of the section explains its residuals nearly as well.
    """

    factor: float
    or_model: bool


def accuracies_off(
    likelihood: SizesLikelihood, sizes: Floats, gain: float
) -> dict[int, AccuracyOff]:
    """Sections whose gauges are not as accurate as stated.

    One after the other, the likeliest first; the scatter of all others is as found, or less, since
    one section with wrong accuracies may have raised it, as it may the errors of all models. What
    a larger model error of the section explains better is not said of its gauges.

    Args:
        likelihood: of the sizes.
        sizes: (6,) of the errors of all.
        gain: by how much -2 log L has to fall.
    """
    scatters = np.unique([1.0, np.sqrt(sizes[1]), sizes[1]])
    factors, known = (
        np.ones(len(likelihood)),
        dict[tuple[int, float, float], tuple[float, Floats]](),
    )

    def part(s: int, scatter: float, model: float = 1.0) -> tuple[float, Floats]:
        if (key := (s, scatter, model)) not in known:
            changed = sizes.copy()
            changed[1] = scatter
            changed[[0, 3]] *= model
            known[key] = likelihood.of(s, changed)
        return known[key]

    off: dict[int, AccuracyOff] = {}
    while len(off) < len(factors) // 2:
        trials: list[tuple[float, int, float, float]] = []
        as_they_are, of_models = np.inf, np.full(len(factors), np.inf)
        for scatter, less in product(scatters.tolist(), _LESS):
            parts = [part(s, scatter * factor, less) for s, factor in enumerate(factors.tolist())]
            as_they_are = min(as_they_are, likelihood.joined(parts))
            for s in range(len(factors)):
                for factor in FACTORS_OF_ONE.tolist():
                    other = [*parts[:s], part(s, scatter * factor, less), *parts[s + 1 :]]
                    trials.append((likelihood.joined(other), s, factor, scatter))
                for model in _MODELS.tolist():
                    larger = part(s, scatter * factors[s], less * model)
                    other = [*parts[:s], larger, *parts[s + 1 :]]
                    of_models[s] = min(of_models[s], likelihood.joined(other))
        best, s, factor, scatter = min(trials)
        above = float(of_models[s] - best)
        if s in off or best > as_they_are - gain or above < -(NORMAL_95**2):
            break
        factors[s] = factor
        off[s] = AccuracyOff(factor * scatter, above < NORMAL_95**2)
    return {s: one for s, one in off.items() if max(one.factor, 1.0 / one.factor) >= OFF}
