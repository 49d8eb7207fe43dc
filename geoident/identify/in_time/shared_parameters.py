"""Parameters that all gauges share, from readings in time (theory 16.8).

The readings of gauge i are y_i = v_i(p) + X_i b_i + e_i, with a model v_i, terms X_i of the gauge
itself (its constant, what does not come back) and errors of a `Noise`, Sigma_i = L_i L_i^T. For
given noise the b_i go out by projection,

    r_i = (I - Q_i Q_i^T) L_i^-1 (y_i - v_i(p)) ,    Q_i spans L_i^-1 X_i

so that the sum of all r_i^T r_i is the misfit of generalized least squares in p alone: an ordinary
problem of independent readings of size one. What is known of a gauge afterwards follows from what
is known of p and, for given p, from its regression (`regression`).

Where the model errs, a reading has further terms Z_i u_i beside these, with coefficients u of mean
zero and covariance eta^2 K over all gauges. They add Z u to the errors, and `ErrorsOfModel` makes
those of all gauges independent once more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.in_time.innovations import whitening
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
        self._filter = whitening(noise, times)
        self._Q = np.linalg.qr(self._filter.effects(X))[0]

    def __call__(self, columns: Floats) -> Floats:
        """(I - Q Q^T) L^-1 of columns (m, c)."""
        white = self._filter.effects(columns)
        return np.asarray(white - self._Q @ (self._Q.T @ white))


class ErrorsOfModel:
    """The errors of a model in projected readings: W u beside independent ones of size one.

    W has the columns of each gauge in its rows alone. With W_i = Q_i T_i, and V, l eigenvectors and
    eigenvalues of T K T^T, the covariance of all readings is I + eta^2 Q V diag(l) V^T Q^T.

    Args:
        columns: (m, s) of each gauge, projected, SI^-1 of its coefficients.
        root: (n s, r) of their covariance K at eta = 1, gauge by gauge.
    """

    def __init__(self, columns: Sequence[Floats], root: Floats) -> None:
        factors = [np.linalg.qr(own) for own in columns]
        self._Q = [Q for Q, _ in factors]
        ends = np.cumsum([0, *(own.shape[1] for own in columns)])
        felt = [T @ root[a:b] for (_, T), a, b in zip(factors, ends, ends[1:], strict=False)]
        self._ends = np.cumsum([0, *(len(own) for own in felt)])
        self._V, size, _ = np.linalg.svd(np.concatenate(felt), full_matrices=False)
        self._l = size**2

    def independent(self, columns: Sequence[Floats], eta: float) -> list[Floats]:
        """Columns (m, c) of each gauge, made independent where errors have a size eta."""
        within = np.concatenate([Q.T @ own for Q, own in zip(self._Q, columns, strict=True)])
        shrink = 1.0 / np.sqrt(1.0 + eta**2 * self._l) - 1.0
        less = self._V @ (shrink[:, None] * (self._V.T @ within))
        parts = zip(self._Q, columns, self._ends, self._ends[1:], strict=False)
        return [own + Q @ less[a:b] for Q, own, a, b in parts]


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
        errors: of the model in the projected readings, and their size eta; None for none.
    """

    names: tuple[str, ...]
    motion: Motion
    why_not: Callable[[Floats], str | None]
    cost: Callable[[], Counts]
    rows: Sequence[slice]
    projections: Sequence[GaugeProjection]
    errors: tuple[ErrorsOfModel, float] | None = None

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
        if self.errors is not None:
            errors, eta = self.errors
            parts = errors.independent(parts, eta)
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
    of_each = [replace(regression, y=column).end.mean for column in jacobian.T]
    A = -np.column_stack(of_each) if of_each else np.zeros((q + PROCESSES, 0))
    n = A.shape[1]
    ends = q + PROCESSES  # the errors go last
    order = [*range(q), *range(ends, ends + n), *range(q, ends)]
    P = np.block([[own.P + A @ C @ A.T, A @ C], [C @ A.T, C]])
    mean = np.concatenate([own.mean, np.zeros(n)])
    return GaugeState(own.noise, own.time, mean[order], P[np.ix_(order, order)])
