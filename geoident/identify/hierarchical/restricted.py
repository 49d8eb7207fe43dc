"""The restricted likelihood of how far sections scatter about their laws (theory 15).

At one linearisation of all sections the unknowns are common ones, f (shared parameters and
constants of laws, in their scales), and of each section a, its deviations from the laws in units of
tau, and w, its own parameters. Parameters of section s move by

    x_s = Phi_s f + Z diag(tau) a_s + W_s w_s ,      a_s ~ N(0, 1)

and its whitened residuals by R_s x_s, after a QR factorization with as many rows as parameters. All
unknowns but tau are integrated over. With H the matrix of the normal equations of f, a and w, and Q
the least sum of squares,

    -2 log L(tau) = Q(tau) + log det H(tau)

exactly for a linear model with normal errors (restricted maximum likelihood), and by Laplace's
approximation otherwise: Lindstrom & Bates (1990) alternate between it and the search for all
unknowns. In units of tau nothing is singular where a scatter vanishes.

All else follows from normal posteriors at given tau, mixed over the posterior of tau with a density
that is uniform from zero to T_k, the standard deviation of a parameter of which only its bounds are
known (Gelman 2006 on uniform priors for standard deviations).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoident.identify.hierarchical.arrangement import (
    Arrangement,
    SectionModels,
    SectionReadings,
)
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats, Ints

_RIDGE = 1e-9
"""Precision of a direction that nothing sees, on scales of the order of one."""

_LEAST = 1e-5
"""Scatter in parts of its largest below which it is zero."""

_NODES = {1: 201, 2: 45}
"""Nodes along each tau, of a grid for so many; for more there are points of Sobol."""

_POINTS = 12
"""Power of two: number of these points."""

_DROP = 24.0
"""Fall of -2 log L within which nodes lie: beyond it there is 1e-5 of the posterior."""


@dataclass(frozen=True)
class GivenScatter:
    """The posterior of all unknowns at one tau, from the point of linearisation, on the scales.

    Args:
        tau: (K,) the scatter.
        minus_two_log: of the restricted likelihood, up to a constant.
        common: (F,) mean of f.
        common_covariance: (F, F).
        sections: (S, n) mean of x.
        covariances: (S, n, n).
        deviations: (S, K) mean of tau a.
    """

    tau: Floats
    minus_two_log: float
    common: Floats
    common_covariance: Floats
    sections: Floats
    covariances: Floats
    deviations: Floats


@dataclass(frozen=True)
class LinearSections:
    """All sections at one point, linearised. Arrays are padded to the longest section.

    Args:
        R: (S, n, n) whitened residuals by x, after QR.
        q: (S, n) what is left of the readings, likewise: measured minus computed on the law.
        Phi: (S, n, F) derivatives of x by f.
        Z: (S, n, K) which parameters follow which law.
        W: (S, n, L) which are of the section alone.
        precision: (F, F) of priors of f.
        gradient: (F,) half the gradient of their squares.
        gap: (S, n) how far x is from the law.
        rest: (S,) squares of each that nothing moves.
        rows: (S,) number of readings, and of priors of its own, of each.
        of_priors: squares of priors of what is common.
        largest: (K,) T.
    """

    R: Floats
    q: Floats
    Phi: Floats
    Z: Floats
    W: Floats
    precision: Floats
    gradient: Floats
    gap: Floats
    rest: Floats
    rows: Ints
    of_priors: float
    largest: Floats

    @classmethod
    def at(cls, arrangement: Arrangement, models: SectionModels, values: Floats) -> LinearSections:
        """Linearise at a point.

        Args:
            arrangement: of the unknowns.
            models: of the sections.
            values: (N,) unknowns, SI.
        """
        return _linearised(arrangement, models, values)

    @property
    def n_laws(self) -> int:
        """Number K of laws."""
        return int(self.Z.shape[2])

    def without(self, number: int) -> LinearSections:
        """As if a section had no readings."""
        R, q = self.R.copy(), self.q.copy()
        rest = self.rest.copy()
        R[number], q[number], rest[number] = 0.0, 0.0, 0.0
        return replace(self, R=R, q=q, rest=rest)

    def minus_two_log(self, tau: Floats) -> float:
        """-2 log L at tau (K,), up to a constant."""
        return self._solved(tau)[0]

    def given(self, tau: Floats) -> GivenScatter:
        """The posterior at tau (K,)."""
        value, f, C, T, l0, inverse, B0 = self._solved(tau)
        by_f = self.Phi - B0 @ T
        x = np.einsum("snf,f->sn", by_f, f) + np.einsum("snl,sl->sn", B0, l0)
        covariances = by_f @ C @ by_f.swapaxes(1, 2) + B0 @ inverse @ B0.swapaxes(1, 2)
        a = (l0 - np.einsum("slf,f->sl", T, f))[:, : self.n_laws]
        return GivenScatter(tau, value, f, C, x, covariances, a * tau)

    def _solved(self, tau: Floats) -> tuple[float, Floats, Floats, Floats, Floats, Floats, Floats]:
        K = self.n_laws
        B0 = np.concatenate([self.Z * tau, self.W], axis=2)  # (S, n, K + L)
        B, F = self.R @ B0, self._by_common
        Bt = B.swapaxes(1, 2)
        H = Bt @ B
        diagonal = np.arange(H.shape[1])
        H[:, diagonal, diagonal] += np.where(diagonal < K, 1.0, _RIDGE)
        inverse = np.linalg.inv(H)
        T = inverse @ (Bt @ F)
        g = np.einsum("snl,sn->sl", B, self.q)
        l0 = np.einsum("slm,sm->sl", inverse, g)
        schur = self._common_matrix - np.einsum("snf,snl,slg->fg", F, B, T)
        right = self._common_right - np.einsum("slf,sl->f", T, g)
        C = np.linalg.inv(schur)
        f = C @ right
        known = float(self.rest.sum()) + self.of_priors
        squares = known + float(np.sum(self.q**2) - np.sum(g * l0) - right @ f)
        logs = float(np.linalg.slogdet(H)[1].sum() + np.linalg.slogdet(schur)[1])
        return squares + logs, f, C, T, l0, inverse, B0

    @cached_property
    def _by_common(self) -> Floats:
        return np.asarray(self.R @ self.Phi)

    @cached_property
    def _common_matrix(self) -> Floats:
        found = np.einsum("snf,sng->fg", self._by_common, self._by_common) + self.precision
        return np.asarray(found + _RIDGE * np.eye(len(found)))

    @cached_property
    def _common_right(self) -> Floats:
        return np.asarray(np.einsum("snf,sn->f", self._by_common, self.q) - self.gradient)


def _linearised(made: Arrangement, models: SectionModels, values: Floats) -> LinearSections:
    F, K, S = made.n_common, len(made.laws), len(made.sections)
    n = max(len(section.parameters) for section in made.sections)
    own = [_own(made, s) for s in range(S)]
    L = max(int(flags.sum()) for flags in own)
    Phi, Z, W = np.zeros((S, n, F)), np.zeros((S, n, K)), np.zeros((S, n, L))
    R, q, gaps = np.zeros((S, n, n)), np.zeros((S, n)), np.zeros((S, n))
    rest, rows = np.zeros(S), np.zeros(S, dtype=np.int64)
    points = {s: made.point(s, values)[0] for s in range(S)}
    found = models.evaluate(points)
    common = Scaling(made.unknowns[:F])
    slope = common.slope(values[:F])
    for s, section in enumerate(made.sections):
        Phi[s], Z[s], gaps[s] = by_common(made, section, points[s], values, slope, n)
        W[s, np.flatnonzero(own[s]), np.arange(int(own[s].sum()))] = 1.0
        A, b = _rows(made, models, s, points[s], found[s], n)
        R[s], q[s], rest[s] = _compressed(A, b + A @ gaps[s])  # as it would be on the law
        rows[s] = len(b)
    P, of_priors = common.prior_jacobian(values[:F]), common.prior_residuals(values[:F])
    return LinearSections(
        R=R,
        q=q,
        Phi=Phi,
        Z=Z,
        W=W,
        precision=P.T @ P,
        gradient=P.T @ of_priors,
        gap=gaps,
        rest=rest,
        rows=rows,
        of_priors=float(of_priors @ of_priors),
        largest=made.largest,
    )


def by_common(
    made: Arrangement,
    section: SectionReadings,
    p: Floats,
    values: Floats,
    slope: Floats,
    n: int,
) -> tuple[Floats, Floats, Floats]:
    """How the parameters of a section follow from what is common, on their scales.

    Args:
        made: of the unknowns.
        section: one of them, or one that was left out.
        p: (m,) its parameters, SI.
        values: (n_common,) at least, the unknowns, SI.
        slope: (F,) of the scales of what is common.
        n: rows of the padded arrays.

    Returns:
        Phi (n, F), Z (n, K), and how far x is from the law (n,).
    """
    Phi, Z, gap = np.zeros((n, len(slope))), np.zeros((n, len(made.laws))), np.zeros(n)
    for i, parameter in enumerate(section.parameters):
        k = made.law_of(parameter.name)
        if k is not None:
            x, by = made.law(k, section.covariates, values)
            where = made.constants_of(k)
            Z[i, k], Phi[i, where] = 1.0, by * slope[where]
            gap[i] = (np.log(p[i]) if made.log[k] else p[i] / made.reference[k]) - x
        elif parameter.name in made.shared:
            Phi[i, made.shared.index(parameter.name)] = 1.0
    return Phi, Z, gap


def _own(made: Arrangement, s: int) -> Bools:
    """Which parameters (n,) of a section are its own: neither shared nor of a law."""
    names = [q.name for q in made.sections[s].parameters]
    flags = [name not in made.shared and made.law_of(name) is None for name in names]
    return np.array(flags, dtype=np.bool_)


def _rows(
    made: Arrangement,
    models: SectionModels,
    s: int,
    p: Floats,
    found: tuple[Floats, Floats],
    n: int,
) -> tuple[Floats, Floats]:
    """Whitened derivatives (g + k, n) of a section by its x, and what is left (g + k,).

    Priors of its own parameters are rows of it.
    """
    section, scaling = made.sections[s], made.scalings[s]
    problem, own = section.problem(models, s), _own(made, s)
    v, J = found
    chosen = [row for row, (i, _) in enumerate(scaling.priors) if own[i]]
    A = np.zeros((len(v) + len(chosen), n))
    A[: len(v), : len(p)] = problem.whiten(J * scaling.slope(p))
    A[len(v) :, : len(p)] = scaling.prior_jacobian(p)[chosen]
    left = problem.whiten(section.measured - v)
    return A, np.concatenate([left, -scaling.prior_residuals(p)[chosen]])


def _compressed(A: Floats, b: Floats) -> tuple[Floats, Floats, float]:
    """R (n, n) and Q^T b (n,) of a QR factorization, and the squares that are left."""
    n = A.shape[1]
    rows = np.concatenate([A, np.zeros((max(0, n - len(A)), n))])
    right = np.concatenate([b, np.zeros(len(rows) - len(b))])
    Q, R = np.linalg.qr(rows)
    inside = Q.T @ right
    return R, inside, max(float(right @ right - inside @ inside), 0.0)


def most_likely(linear: LinearSections, start: Floats, free: Bools) -> Floats:
    """The tau (K,) of the largest restricted likelihood; zero where none is as likely.

    Args:
        linear: the sections.
        start: (K,) where to begin; what is not free stays.
        free: (K,) is to be found.
    """
    tau = start.copy()
    for _ in range(_SWEEPS):
        before = tau.copy()
        for k in np.flatnonzero(free).tolist():
            tau[k] = _best(linear, tau, k)
        if np.all(np.abs(tau - before) <= 1e-7 * before) or free.sum() < 2:
            break
    return tau


_SWEEPS = 40


def _best(linear: LinearSections, tau: Floats, k: int) -> float:
    """The most likely tau_k, all others given."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - 0.3 s, and only projects search

    largest = float(linear.largest[k])

    def value(log_size: float) -> float:
        trial = tau.copy()
        trial[k] = np.exp(log_size)
        return linear.minus_two_log(trial)

    grid = np.linspace(np.log(_LEAST * largest), np.log(largest), 40)
    values = [value(x) for x in grid.tolist()]
    i = int(np.argmin(values))
    low, high = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    found = minimize_scalar(value, bounds=(low, high), method="bounded", options={"xatol": 1e-9})
    none = tau.copy()
    none[k] = 0.0
    if linear.minus_two_log(none) <= float(found.fun) + 1e-9:
        return 0.0
    return float(np.exp(found.x))


@dataclass(frozen=True)
class ScatterPosterior:
    """The posterior of tau as nodes with weights.

    Args:
        nodes: (J, K) scatter on the scales.
        weights: (J,) with the sum one.
        largest: (K,) T.
    """

    nodes: Floats
    weights: Floats
    largest: Floats

    def interval(self, k: int) -> tuple[float, float]:
        """Ends of the shortest interval that holds 95 % of tau_k."""
        sizes, place = np.unique(self.nodes[:, k], return_inverse=True)
        steps = np.bincount(place.ravel(), self.weights)
        below = np.concatenate([[0.0], np.cumsum(steps) - 0.5 * steps, [1.0]])
        sizes = np.concatenate([[0.0], sizes, [sizes[-1]]])
        first = np.linspace(0.0, 0.05, 251)
        low = np.interp(first, below, sizes)
        high = np.interp(np.minimum(first + 0.95, 1.0), below, sizes)
        best = int(np.argmin(high - low))
        return (0.0 if best == 0 else float(low[best])), float(high[best])


def scatter_posterior(linear: LinearSections, tau: Floats, free: Bools) -> ScatterPosterior:
    """The posterior of tau at a linearisation.

    Args:
        linear: the sections.
        tau: (K,) the most likely.
        free: (K,) is not given.
    """
    dims = np.flatnonzero(free)
    if not len(dims):
        return ScatterPosterior(tau[None, :], np.ones(1), linear.largest)
    top = np.array([_reach(linear, tau, int(k)) for k in dims])
    if len(dims) in _NODES:
        along = (np.arange(_NODES[len(dims)]) + 0.5) / _NODES[len(dims)]
        unit = np.stack(np.meshgrid(*[along] * len(dims)), axis=-1).reshape(-1, len(dims))
    else:
        from scipy.stats import qmc  # noqa: PLC0415 - a second, and few have so many scatters

        unit = qmc.Sobol(len(dims), scramble=False).random_base2(_POINTS) + 0.5 / 2**_POINTS
    nodes = np.tile(tau, (len(unit), 1))
    nodes[:, dims] = top * unit**2  # closer where tau is small
    values = np.array([linear.minus_two_log(node) for node in nodes])
    weights = np.exp(-0.5 * (values - values.min())) * np.prod(unit, axis=1)
    kept = weights > 1e-9 * weights.max()
    return ScatterPosterior(nodes[kept], weights[kept] / weights[kept].sum(), linear.largest)


def _reach(linear: LinearSections, tau: Floats, k: int) -> float:
    """The tau_k up to which there is anything of its posterior."""
    largest, least = float(linear.largest[k]), linear.minus_two_log(tau)
    for size in np.geomspace(1e-4 * largest, largest, 60).tolist():
        trial = tau.copy()
        trial[k] = size
        if size > tau[k] and linear.minus_two_log(trial) > least + _DROP:
            return float(size)
    return float(largest)
