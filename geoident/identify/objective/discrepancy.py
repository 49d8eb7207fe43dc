"""The discrepancy between what was read and what the model answers, with the prior's part.

    phi(p) = (v* - v(p))^T W (v* - v(p)) + |prior residuals|^2,   W = diag(1/s^2)          [20]

It is the squared length of one vector of weighted residuals

    r(p) = [ (v(p) - v*) / s ;  prior residuals ]          (g + k,)

whose Jacobian in the scaled parameters is [ (dv/dp)(dp/dx) / s ; prior rows ]. Where the model has
no solution, phi is infinite. A robust loss transforms the readings' part of r (see `loss`), so
that phi is the squared length all the same.

Computed once: the weights. Per trial: one call of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.identify.objective.loss import transformed
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats

CHECK_UNITS = "Check the units of stresses, moduli and accuracies, and the start values."


@dataclass(frozen=True)
class Linearization:
    """The weighted residuals at one point and their derivative.

    Args:
        residual: (g + k,) weighted residuals r, those of the priors last, dimensionless.
        jacobian: (g + k, n) dr/dx in the scaled parameters.
    """

    residual: Floats
    jacobian: Floats

    @property
    def objective(self) -> float:
        """The discrepancy phi with the prior's part."""
        return float(self.residual @ self.residual)


class Discrepancy:
    """phi(p) of a problem.

    Args:
        problem: readings, standard deviations, model and parameters.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.scaling = Scaling(problem.parameters)

    def residuals(self, p: Floats, readings: Floats) -> Floats:
        """Weighted residuals r (g + k,) at p (n,), SI, where the model answers readings (g,)."""
        f, _ = transformed(self.problem.loss, self.misfit(readings))
        return np.concatenate([f, self.scaling.prior_residuals(p)])

    def misfit(self, readings: Floats) -> Floats:
        """(v - v*) / s (g,) where the model answers readings v (g,), whatever the loss."""
        return (readings - self.problem.measured) / self.problem.sd

    def squares(self, p: Floats, readings: Floats) -> float:
        """Plain weighted squares with the prior's part, theory [20], whatever the loss.

        Of readings (g,) that the model answers at p (n,), SI.
        """
        prior = self.scaling.prior_residuals(p)
        misfit = self.misfit(readings)
        return float(misfit @ misfit + prior @ prior)

    def objective_of(self, p: Floats, readings: Floats) -> float:
        """Phi at p (n,), SI, where the answer (g,) of the model is known; infinite where NaN."""
        r = self.residuals(p, readings)
        with np.errstate(over="ignore"):  # infinite is right for what overflows
            return float(r @ r) if np.all(np.isfinite(r)) else np.inf

    def objective(self, p: Floats) -> float:
        """The discrepancy phi at p (n,), SI; infinite where the model has no solution.

        Never raises `geoident.errors.ModelError`.
        """
        response = self.problem.response
        if response.admissible(p) is not None:
            return np.inf
        try:
            return self.objective_of(p, response.readings(p))
        except ModelError:
            return np.inf

    def linearize(self, p: Floats) -> Linearization:
        """Residuals and their Jacobian in x at p (n,), SI, from one evaluation of the model.

        Raises:
            ModelError: p is outside the domain of the model, or there is no solution.
        """
        why = self.problem.response.admissible(p)
        if why is not None:
            raise ModelError(why)
        v, dv_dp = self.problem.response.evaluate(p)
        _, slope = transformed(self.problem.loss, self.misfit(v))
        rows = dv_dp * self.scaling.slope(p) * (slope / self.problem.sd)[:, None]
        found = Linearization(
            self.residuals(p, v), np.concatenate([rows, self.scaling.prior_jacobian(p)])
        )
        _require_finite(found)
        return found


def _require_finite(found: Linearization) -> None:
    """Refuse numbers whose squares overflow: every step from there would look like the last."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = found.objective + float(np.sum(found.jacobian**2))
    if not np.isfinite(squares):
        raise ModelError(
            "The computed readings or their misfit exceed the range of floating-point numbers.",
            CHECK_UNITS,
        )
