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

import numpy as np
import scipy.sparse as sp

from geoident.identify.hierarchical.joint_problem import JointUnknowns, SectionModels
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import Covariance, SharedErrors
from geoident.model.arrays import Bools, Floats, Ints

_RIDGE = 1e-9
"""Precision given to a direction that no reading sees, on scales of the order of one: it makes
matrices regular and leaves a standard deviation of 3e4."""

_LEAST = 1e-5
"""Scatter in parts of its largest below which it is zero."""

_SWEEPS = 40
"""Rounds of one scatter after the other; where two pull each other along, each goes a part of the
way."""

_GRID_NODES = {1: 201, 2: 45}
"""Nodes along each tau, of a grid for so many; for more there are points of Sobol."""

_SOBOL_POWER = 12
"""Power of two: number of these points."""

_DROP = 24.0
"""Fall of -2 log L within which nodes lie: beyond it there is 1e-5 of the posterior."""


@dataclass(frozen=True)
class GivenScatter:
    """The posterior of all unknowns at one tau, from the point of linearisation, on the scales.

    Args:
        minus_two_log: of the restricted likelihood, up to a constant.
        common: (F,) mean of f.
        common_covariance: (F, F).
        sections: (S, n) mean of x.
        covariances: (S, n, n).
    """

    minus_two_log: float
    common: Floats
    common_covariance: Floats
    sections: Floats
    covariances: Floats


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
        deviation: (S, n) of x from the law.
        rest: (S,) squares of each that nothing moves.
        rows: (S,) number of readings, and of priors of its own, of each.
        prior_squares: of priors of common unknowns.
        largest: (K,) T.
    """

    R: Floats
    q: Floats
    Phi: Floats
    Z: Floats
    W: Floats
    precision: Floats
    gradient: Floats
    deviation: Floats
    rest: Floats
    rows: Ints
    prior_squares: float
    largest: Floats

    @classmethod
    def at(cls, joint: JointUnknowns, models: SectionModels, values: Floats) -> LinearSections:
        """Linearise at a point.

        Args:
            joint: the unknowns.
            models: of the sections.
            values: (N,) unknowns, SI.
        """
        F, K, S = joint.n_common, len(joint.laws), len(joint.sections)
        n = max(len(section.parameters) for section in joint.sections)
        points = joint.points(values)
        answers = models.evaluate(points)
        Phi, Z, W = np.zeros((S, n, F)), np.zeros((S, n, K)), np.zeros((S, n, n))
        R, q, deviation = np.zeros((S, n, n)), np.zeros((S, n)), np.zeros((S, n))
        rest, rows = np.zeros(S), np.zeros(S, dtype=np.int64)
        for s, section in enumerate(joint.sections):
            scaling, p, (v, J) = Scaling(section.parameters), points[s], answers[s]
            m = len(p)
            Phi[s, :m], Z[s, :m], deviation[s, :m] = joint.by_common(section, p, values)
            own = [i for i, q_ in enumerate(section.parameters) if q_.name not in joint.templates]
            W[s, own, np.arange(len(own))] = 1.0
            # rows A x = b: whitened readings, then priors of the section's own parameters
            chosen = [row for row, (i, _) in enumerate(scaling.priors) if i in own]
            shared = section.shared or SharedErrors(sp.csr_array((len(v), 0)))
            whiten = Covariance(section.sd, shared).whiten
            rows[s] = len(v) + len(chosen)
            A, b = np.zeros((max(rows[s], n), n)), np.zeros(max(rows[s], n))
            A[: len(v), :m] = whiten(J * scaling.dp_dx(p))
            A[len(v) : rows[s], :m] = scaling.prior_jacobian(p)[chosen]
            b[: len(v)] = whiten(section.measured - v)
            b[len(v) : rows[s]] = -scaling.prior_residuals(p)[chosen]
            b += A @ deviation[s]  # as it would be on the law
            Q, R[s] = np.linalg.qr(A)
            q[s] = Q.T @ b
            rest[s] = max(float(b @ b - q[s] @ q[s]), 0.0)
        common = Scaling(joint.unknowns[:F])
        P, residuals = common.prior_jacobian(values[:F]), common.prior_residuals(values[:F])
        return cls(
            R=R,
            q=q,
            Phi=Phi,
            Z=Z,
            W=W[:, :, : int(W.sum(axis=(1, 2)).max())],
            precision=P.T @ P,
            gradient=P.T @ residuals,
            deviation=deviation,
            rest=rest,
            rows=rows,
            prior_squares=float(residuals @ residuals),
            largest=joint.largest,
        )

    def without(self, s: int) -> LinearSections:
        """As if section s had no readings."""
        R, q, rest = self.R.copy(), self.q.copy(), self.rest.copy()
        R[s], q[s], rest[s] = 0.0, 0.0, 0.0
        return replace(self, R=R, q=q, rest=rest)

    def minus_two_log(self, tau: Floats) -> float:
        """-2 log L at tau (K,), up to a constant."""
        return self.given(tau).minus_two_log

    def given(self, tau: Floats) -> GivenScatter:
        """The posterior at tau (K,).

        The normal equations are block diagonal but for f, which is found from the Schur complement;
        l = (a, w) of each section is then l0 - T f.
        """
        K = self.Z.shape[2]
        B0 = np.concatenate([self.Z * tau, self.W], axis=2)  # (S, n, K + L)
        B, RPhi = self.R @ B0, self.R @ self.Phi
        Bt = B.swapaxes(1, 2)
        H = Bt @ B
        diagonal = np.arange(H.shape[1])
        H[:, diagonal, diagonal] += np.where(diagonal < K, 1.0, _RIDGE)
        inverse = np.linalg.inv(H)
        T = inverse @ (Bt @ RPhi)
        g = np.einsum("snl,sn->sl", B, self.q)
        l0 = np.einsum("slm,sm->sl", inverse, g)
        schur = np.einsum("snf,sng->fg", RPhi, RPhi - B @ T) + self.precision
        schur += _RIDGE * np.eye(len(schur))
        right = np.einsum("snf,sn->f", RPhi, self.q) - self.gradient - np.einsum("slf,sl->f", T, g)
        C = np.linalg.inv(schur)
        f = C @ right
        squares = float(self.rest.sum() + np.sum(self.q**2)) + self.prior_squares
        squares -= float(np.sum(g * l0) + right @ f)
        logs = float(np.linalg.slogdet(H)[1].sum() + np.linalg.slogdet(schur)[1])
        by_f = self.Phi - B0 @ T
        x = np.einsum("snf,f->sn", by_f, f) + np.einsum("snl,sl->sn", B0, l0)
        covariances = by_f @ C @ by_f.swapaxes(1, 2) + B0 @ inverse @ B0.swapaxes(1, 2)
        return GivenScatter(squares + logs, f, C, x, covariances)


def most_likely(linear: LinearSections, start: Floats, free: Bools) -> Floats:
    """The tau (K,) of the largest restricted likelihood; zero where none is as likely.

    One after the other, each on a grid and between the two nodes beside its best one.

    Args:
        linear: the sections.
        start: (K,) where to begin; what is not free stays.
        free: (K,) is to be found.
    """
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - 0.3 s, and only projects search

    tau = start.copy()
    for _ in range(_SWEEPS):
        before = tau.copy()
        for k in np.flatnonzero(free).tolist():

            def value(size: float, k: int = k) -> float:
                return linear.minus_two_log(_replaced(tau, k, size))

            grid = np.log(linear.largest[k]) + np.linspace(np.log(_LEAST), 0.0, 40)
            i = int(np.argmin([value(np.exp(x)) for x in grid]))
            best = minimize_scalar(
                lambda x, value=value: value(np.exp(x)),
                bounds=(grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]),
                method="bounded",
                options={"xatol": 1e-9},
            )
            tau[k] = 0.0 if value(0.0) <= float(best.fun) + 1e-9 else float(np.exp(best.x))
        if np.all(np.abs(tau - before) <= 1e-7 * before) or free.sum() < 2:
            break
    return tau


def _replaced(tau: Floats, k: int, size: float) -> Floats:
    return np.where(np.arange(len(tau)) == k, size, tau)


@dataclass(frozen=True)
class ScatterPosterior:
    """The posterior of tau as nodes with weights.

    Args:
        nodes: (J, K) scatter on the scales.
        weights: (J,) with the sum one.
    """

    nodes: Floats
    weights: Floats

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
        return ScatterPosterior(tau[None, :], np.ones(1))
    top, least = linear.largest[dims].copy(), linear.minus_two_log(tau)
    for j, k in enumerate(dims.tolist()):  # up to where the posterior ends
        for size in np.geomspace(1e-4, 1.0, 60) * linear.largest[k]:
            if size > tau[k] and linear.minus_two_log(_replaced(tau, k, size)) > least + _DROP:
                top[j] = size
                break
    if len(dims) in _GRID_NODES:
        along = (np.arange(_GRID_NODES[len(dims)]) + 0.5) / _GRID_NODES[len(dims)]
        unit = np.stack(np.meshgrid(*[along] * len(dims)), axis=-1).reshape(-1, len(dims))
    else:
        from scipy.stats import qmc  # noqa: PLC0415 - a second, and few have so many scatters

        sobol = qmc.Sobol(len(dims), scramble=False)
        unit = sobol.random_base2(_SOBOL_POWER) + 0.5 / 2**_SOBOL_POWER
    nodes = np.tile(tau, (len(unit), 1))
    nodes[:, dims] = top * unit**2  # closer where tau is small
    values = np.array([linear.minus_two_log(node) for node in nodes])
    weights = np.exp(-0.5 * (values - values.min())) * np.prod(unit, axis=1)
    kept = weights > 1e-9 * weights.max()
    return ScatterPosterior(nodes[kept], weights[kept] / weights[kept].sum())
