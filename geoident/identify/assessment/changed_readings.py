"""The least misfit of readings that are changed, where the model is linear about one point."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from geoident.errors import ModelError
from geoident.identify.problem.losses import robust_scale
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import Covariance, SharedErrors
from geoident.model.arrays import Floats, Ints


class Linearized:
    """A problem with its model linearised at one point, and the least misfit of changed readings.

    Args:
        problem: with the squared loss.
        p: (n,) parameters, SI.
        answer: readings v (g,) of the model there and dv/dp (g, n), SI; None: it is asked.

    Raises:
        ModelError: the model has no solution there.
    """

    def __init__(
        self, problem: Problem, p: Floats, answer: tuple[Floats, Floats] | None = None
    ) -> None:
        v, dv_dp = problem.response.evaluate(p) if answer is None else answer
        scaling = Scaling(problem.parameters)
        J, d = dv_dp * scaling.dp_dx(p), problem.measured - v
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(d))):
            raise ModelError("The readings are not finite.")
        self.problem, self.values, self.readings, self.slope = problem, p, v, dv_dp
        none = SharedErrors(sp.csr_array((len(d), 0)))
        self.covariance = problem.covariance or Covariance(problem.sd, none)
        R, rho = scaling.prior_jacobian(p), scaling.prior_residuals(p)
        self.pull = self.covariance.solve(J)
        # what nothing determines stays within its bounds, or within a factor of 20
        width = np.minimum(scaling.upper - scaling.lower, _WIDEST)
        sizes, vectors = np.linalg.eigh(J.T @ self.pull + R.T @ R + np.diag(width**-2.0))
        half = vectors / np.sqrt(np.maximum(sizes, _ROUNDING * sizes[-1]))
        self.C = half @ half.T
        force = self.covariance.solve(d)
        h = J.T @ force - R.T @ rho
        self.objective = float(d @ force + rho @ rho)
        self.least = self.objective - float(h @ self.C @ h)
        self.force = force - self.pull @ (self.C @ h)
        self.root = self.pull @ half

    def curvature(self, columns: sp.csc_array) -> Floats:
        """The diagonal of a, (k,), of directions u (g, k)."""
        counts = np.diff(columns.indptr)
        alone, several = np.flatnonzero(counts == 1), np.flatnonzero(counts > 1)
        at = columns.indptr[alone]
        left = np.zeros(columns.shape[1])
        left[alone] = columns.data[at] ** 2 * self.own[columns.indices[at]]
        U = columns[:, several]
        between, taken = self.covariance.inverse_along(U)
        whole = between.diagonal() - np.sum(taken**2, axis=1)
        of_several = whole - np.sum(np.asarray(U.T @ self.root) ** 2, axis=1)
        left[several] = np.where(of_several > _NOTHING * whole, of_several, 0.0)
        return left

    def with_normal(self, columns: sp.csc_array, pull: Floats) -> tuple[float, float]:
        """What is gained where the sizes t of directions u (g, k) are normal, of variance one.

        A is M - Q Q^T with M sparse, so that nothing of size (k, k) is made.

        Args:
            columns: the directions.
            pull: (k,) b of them.

        Returns:
            b^T (1 + A)^-1 b, by which the least misfit falls, and log |1 + A|.
        """
        between, taken = self.covariance.inverse_along(columns)
        Q = np.column_stack([taken, columns.T @ self.root])
        factor = splu(sp.csc_array(sp.eye_array(len(Q)) + between))
        moved = factor.solve(np.column_stack([Q, pull]))
        inner, of_pull = np.eye(Q.shape[1]) - Q.T @ moved[:, :-1], Q.T @ moved[:, -1]
        fall = pull @ moved[:, -1] + of_pull @ np.linalg.solve(inner, of_pull)
        spread = np.log(np.abs(factor.U.diagonal())).sum() + np.linalg.slogdet(inner)[1]
        return float(fall), float(spread)

    @cached_property
    def own(self) -> Floats:
        """The diagonal (g,) of a for single readings by one; 0 where a reading decides alone."""
        whole = self.covariance.inverse_diagonal
        left = whole - np.sum(self.root**2, axis=1)
        return np.where(left > _NOTHING * whole, left, 0.0)

    def residuals(self, rows: Ints) -> Floats:
        """Of those of some readings that others judge, in their own standard deviations."""
        seen = rows[self.own[rows] > 0.0]
        return np.asarray(self.force[seen] / np.sqrt(self.own[seen]))

    @cached_property
    def scatter(self) -> float:
        """Of the residuals in their standard deviations, by the median; one at least."""
        residuals = self.residuals(np.arange(len(self.own)))
        return max(1.0, robust_scale(residuals)) if residuals.size else 1.0


_WIDEST = 3.0
"""Standard deviation in scaled parameters of what the readings leave open."""
_ROUNDING = 1e-15
"""Part of the largest eigenvalue of a matrix below which one is rounding."""

_NOTHING = 1e-9
"""Part of a reading that is rounding where all of it went into the parameters."""
