"""Parameters that all gauges share, from readings in time (theory 16.8).

The readings of gauge i are y_i = v_i(p) + X_i b_i + e_i, with a model v_i, terms X_i of the gauge
itself (its constant, what does not come back) and errors of a `Noise`, Sigma_i = L_i L_i^T. For
given noise the b_i go out by projection,

    r_i = (I - Q_i Q_i^T) L_i^-1 (y_i - v_i(p)) ,    Q_i spans L_i^-1 X_i

so that the sum of all r_i^T r_i is the misfit of generalized least squares in p alone: an ordinary
problem of independent readings of size one. What is known of a gauge afterwards follows from what
is known of p and, for given p, from its regression (`regression`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from geoident.identify.in_time.noise import PROCESSES, Noise
from geoident.identify.in_time.regression import GaugeState, TimeRegression
from geoident.model.arrays import Floats
from geoident.model.results.costs import Counts


class GaugeProjection:
    """Turns readings of a gauge into independent ones of size one, without its own terms.

    Args:
        noise: of its readings.
        times: (m,) s, increasing.
        X: (m, q) its own terms, of full rank.
    """

    def __init__(self, noise: Noise, times: Floats, X: Floats) -> None:
        m, elapsed = len(times), np.diff(times, prepend=times[0])
        phi, added = noise.remaining(elapsed), noise.added(elapsed)
        gain, size = np.empty((m, PROCESSES)), np.empty(m)
        a, c = noise.at_first.tolist()  # variances of the error that lasts and of the drift
        b, white = 0.0, noise.white**2
        for k, (f, g, p, q) in enumerate(np.column_stack([phi, added]).tolist()):
            a, b, c = f * f * a + p, f * g * b, g * g * c + q
            total = a + 2.0 * b + c + white
            of_a, of_c = (a + b) / total, (b + c) / total
            a, b, c = a - of_a**2 * total, b - of_a * of_c * total, c - of_c**2 * total
            gain[k], size[k] = (of_a, of_c), np.sqrt(total)
        # what those before let expect of the processes of e_k, with the sum s_j of both:
        # x_k = phi_k (x_k-1 + gain_k-1 (e_k-1 - s_k-1))
        d = PROCESSES
        self._bands = np.zeros((2 * d, m, d))
        self._bands[0] = 1.0
        for i in range(d):
            for j in range(d):
                self._bands[d + i - j, :-1, j] = -phi[1:, i] * (float(i == j) - gain[:-1, i])
        self._taken, self._size = phi[1:] * gain[:-1], size
        self._Q = np.linalg.qr(self._whitened(X))[0]

    def _whitened(self, columns: Floats) -> Floats:
        """L^-1 of columns (m, c)."""
        m, c = columns.shape
        pull = np.zeros((m, PROCESSES, c))
        pull[1:] = self._taken[:, :, None] * columns[:-1, None]
        bands = self._bands.reshape(2 * PROCESSES, -1)
        expected = solve_banded((2 * PROCESSES - 1, 0), bands, pull.reshape(-1, c))
        expected = expected.reshape(m, PROCESSES, c).sum(axis=1)
        return np.asarray((columns - expected) / self._size[:, None])

    def __call__(self, columns: Floats) -> Floats:
        """(I - Q Q^T) L^-1 of columns (m, c)."""
        white = self._whitened(columns)
        return np.asarray(white - self._Q @ (self._Q.T @ white))


Motion = Callable[[Floats], tuple[Floats, Floats]]
"""What a model says of all readings at parameters (n,): (g,), and its derivatives (g, n), SI."""


@dataclass(frozen=True)
class ProjectedResponse:
    """A model in independent readings without the terms of the gauges: a `Response`.

    Args:
        names: of the n parameters.
        motion: the model.
        why_not: why parameters (n,) are outside its domain, or None.
        cost: costs so far.
        rows: of each gauge, its readings (m,) among all g, in the order of time.
        projections: of each gauge.
    """

    names: tuple[str, ...]
    motion: Motion
    why_not: Callable[[Floats], str | None]
    cost: Callable[[], Counts]
    rows: Sequence[slice]
    projections: Sequence[GaugeProjection]

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self.cost()

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain of the model, or None if it is inside."""
        return self.why_not(p)

    def projected(self, columns: Floats) -> Floats:
        """Columns (g, c) of all readings, of each gauge by its projection."""
        parts = [of(columns[rows]) for rows, of in zip(self.rows, self.projections, strict=True)]
        return np.concatenate(parts)

    def readings(self, p: Floats) -> Floats:
        """(g,) at p (n,)."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """The same, and its Jacobian (g, n)."""
        v, jacobian = self.motion(p)
        columns = self.projected(np.column_stack([v, jacobian]))
        return columns[:, 0], columns[:, 1:]


def state_with_parameters(regression: TimeRegression, jacobian: Floats, C: Floats) -> GaugeState:
    """What is known of a gauge after its last reading, with parameters that all gauges share.

    Args:
        regression: of its readings less the model at the estimate, on its own q terms.
        jacobian: (m, n) of the model.
        C: (n, n) covariance of the parameters.

    Returns:
        Mean and covariance of (the q terms, the n parameters less their estimate, the error that
        lasts, the drift).
    """
    own, q = regression.end, regression.X.shape[1]
    of_each = [
        TimeRegression(regression.times, column, regression.X, regression.noise).end.mean
        for column in jacobian.T
    ]
    A = -np.column_stack(of_each) if of_each else np.zeros((q + PROCESSES, 0))
    n = A.shape[1]
    ends = q + PROCESSES  # the errors go last
    order = [*range(q), *range(ends, ends + n), *range(q, ends)]
    P = np.block([[own.P + A @ C @ A.T, A @ C], [C @ A.T, C]])
    mean = np.concatenate([own.mean, np.zeros(n)])
    return GaugeState(own.noise, own.time, mean[order], P[np.ix_(order, order)])
