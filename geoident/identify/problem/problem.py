"""What every identifier is given: readings to be met by a model, and how far it is from them.

The model can be anything that answers as `Response` in `model.response` asks. Parameter vectors p
are in natural units (SI), in the order of ``names``; readings v(p) are ordered as the measured
values v*. The discrepancy between what was read and what the model answers, with the prior's part,
is

    phi(p) = (v* - v(p))^T W (v* - v(p)) + |prior residuals|^2,   W = diag(1/s^2)          [20]

It is the squared length of one vector of weighted residuals

    r(p) = [ (v(p) - v*) / s ;  prior residuals ]          (g + k,)

whose Jacobian in the scaled parameters is [ (dv/dp)(dp/dx) / s ; prior rows ]. Where the model has
no solution, phi is infinite. A robust loss transforms the readings' part of r (`losses`), so that
phi is the squared length all the same. Computed once: the weights. Per trial: one call of the
model.

**Errors that readings share** (theory 7), e = s own + B z. With the squared loss r is whitened,
r = L^-1 (v - v*), and nothing else changes: that is least squares with the full covariance. A
robust loss is not applied to these r: whitening mixes a wrong reading into all that share with
it. What may be wrong is what a reading has by itself, so the loss is that of the own part, and the
shared errors z, each of variance one, keep their squares and are found along,

    phi(p) = min over z of  sum rho((v - v* - B z)_i / s_i) + |z|^2  (+ the prior's part),

which for the squared loss is the same as whitening. A wrong reading is then explained by itself: it
loses its weight w, and its neighbours are judged by each other. At the minimum all is as with the
covariance diag(s^2/w) + B B^T. The rows of r are [f(u); z]; as z follows p, the Jacobian is
the part of [f' du/dp; 0] that is orthogonal to what z can do (Kaufman 1975, variable projection),
so the gradient is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from geoident.errors import ModelError
from geoident.identify.problem.losses import curvature, full_weights, transformed
from geoident.identify.problem.responses import HasNoise
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import (
    Columns,
    Covariance,
    SharedErrors,
    products,
    scaled_rows,
)
from geoident.model.arrays import Floats
from geoident.model.methods import LossOptions, SquaredOptions
from geoident.model.parameter import Parameter
from geoident.model.response import Response


@dataclass(frozen=True)
class Problem:
    """Readings to be met by a model.

    Args:
        response: the model.
        measured: (g,) readings v*, SI.
        sd: (g,) their standard deviations s, SI; the weights are 1/s^2. Of readings that share
            errors: of what each has by itself.
        parameters: the n unknowns with bounds, scale and prior; ``start`` is where to begin.
        loss: how much a large residual counts.
        shared: what readings share of their errors, or None if all are independent.
    """

    response: Response
    measured: Floats
    sd: Floats
    parameters: tuple[Parameter, ...]
    loss: LossOptions = field(default_factory=SquaredOptions)
    shared: SharedErrors | None = None

    @cached_property
    def covariance(self) -> Covariance | None:
        """Of the errors of the readings; None where they are independent."""
        return None if self.shared is None else Covariance(self.sd, self.shared)

    def whiten(self, values: Floats) -> Floats:
        """Values (g,) or (g, k) of the readings, SI, in independent standard deviations."""
        if self.covariance is not None:
            return self.covariance.whiten(values)
        return values / (self.sd if values.ndim == 1 else self.sd[:, None])

    @property
    def start(self) -> Floats:
        """(n,) where to begin, SI."""
        return np.array([q.start for q in self.parameters], dtype=np.float64)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds (n,), (n,) of the parameters, SI."""
        ends = np.array([(q.lower, q.upper) for q in self.parameters], dtype=np.float64)
        return ends.reshape(-1, 2)[:, 0], ends.reshape(-1, 2)[:, 1]

    def begun_at(self, values: Floats) -> Problem:
        """The problem with another start (n,), SI, clipped into the bounds."""
        inside = np.clip(values, *self.bounds)
        parameters = (
            replace(q, start=float(value)) for q, value in zip(self.parameters, inside, strict=True)
        )
        return replace(self, parameters=tuple(parameters))


CHECK_UNITS = "Check the units of stresses, moduli and accuracies, and the start values."


@dataclass(frozen=True)
class Linearization:
    """The weighted residuals at one point and their derivative.

    Args:
        residual: (g + k,) weighted residuals r, those of the priors last, dimensionless.
        jacobian: (g + k, n) dr/dx in the scaled parameters.
        readings: (g,) v, SI.
    """

    residual: Floats
    jacobian: Floats
    readings: Floats

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
        # asked at every step, and to look for the members of a protocol takes longer than a step
        self._noisy = problem.response if isinstance(problem.response, HasNoise) else None

    def residuals(self, p: Floats, readings: Floats) -> Floats:
        """Weighted residuals r (g + k,) at p (n,), SI, where the model answers readings (g,)."""
        f, _, z = self._transformed(readings)
        return np.concatenate([f, z, self.scaling.prior_residuals(p)])

    @property
    def latent(self) -> bool:
        """Shared errors are found beside the parameters, as the loss is robust."""
        return self.problem.shared is not None and not isinstance(self.problem.loss, SquaredOptions)

    def _transformed(self, readings: Floats) -> tuple[Floats, Floats, Floats]:
        """Rows f (g,) of the readings, their slopes f' (g,), and z (K,) where it is `latent`."""
        if self.latent:
            own, z = own_residuals(self.problem, readings)
        else:
            own, z = self.whitened_residuals(readings), np.zeros(0)
        return *transformed(self.problem.loss, own), z

    def whitened_residuals(self, readings: Floats) -> Floats:
        """White v - v* (g,) where the model answers readings v (g,), whatever the loss."""
        return self.problem.whiten(readings - self.problem.measured)

    def noise_of_phi(self, readings: Floats) -> tuple[float, float]:
        """What phi owes to noise e in the computed readings, independent, of the model's size.

        To second order phi(v + e) = phi + a^T e + e^T H e, with H = Sigma^-1 for the squared loss.
        For a robust one it is that of the covariance diag(s^2/f'^2) + B B^T.

        Args:
            readings: (g,) v, SI.

        Returns:
            The standard deviation of a^T e and the mean of e^T H e.
        """
        problem = self.problem
        if self._noisy is None:
            return 0.0, 0.0
        noise = self._noisy.noise
        if isinstance(problem.loss, SquaredOptions) and problem.covariance is not None:
            half_gradient = problem.covariance.solve(readings - problem.measured)
            curvature = problem.covariance.inverse_diagonal
        else:
            f, slope, _ = self._transformed(readings)
            size = slope / problem.sd
            half_gradient, curvature = f * size, size**2
            if problem.shared is not None:
                curvature = Covariance(1.0 / size, problem.shared).inverse_diagonal
        return 2.0 * float(np.linalg.norm(noise * half_gradient)), float(noise**2 @ curvature)

    def squares(self, p: Floats, readings: Floats) -> float:
        """Plain weighted squares with the prior's part, theory [20], whatever the loss.

        Of readings (g,) that the model answers at p (n,), SI.
        """
        prior = self.scaling.prior_residuals(p)
        misfit = self.whitened_residuals(readings)
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
        linearization = self.linearization_of(p, *self.problem.response.evaluate(p))
        with np.errstate(over="ignore", invalid="ignore"):
            size = linearization.objective + float(np.sum(linearization.jacobian**2))
        if not np.isfinite(size):  # squares overflow: every step from here would look like the last
            raise ModelError(
                "The computed readings or their misfit exceed the range of floating-point numbers.",
                CHECK_UNITS,
            )
        return linearization

    def linearization_of(self, p: Floats, readings: Floats, jacobian: Floats) -> Linearization:
        """The same where the answer of the model is known.

        Args:
            p: (n,) parameters, SI.
            readings: (g,) what the model answers, SI.
            jacobian: (g, n) its derivative.
        """
        problem, scaling = self.problem, self.scaling
        f, slope, z = self._transformed(readings)
        dv_dx = jacobian * scaling.dp_dx(p)
        if self.latent:
            assert problem.shared is not None
            rows = _projected(problem.shared, slope / problem.sd, dv_dx)
        else:
            rows = problem.whiten(dv_dx) * slope[:, None]
        return Linearization(
            np.concatenate([f, z, scaling.prior_residuals(p)]),
            np.concatenate([rows, scaling.prior_jacobian(p)]),
            readings,
        )


def _projected(shared: SharedErrors, size: Floats, dv_dx: Floats) -> Floats:
    """Rows (g + K, n) of [f(u); z] with z following the parameters (Kaufman 1975).

    Args:
        shared: what the g readings share of their errors.
        size: (g,) f'/s.
        dv_dx: (g, n) derivatives of the readings.
    """
    rows = np.concatenate([size[:, None] * dv_dx, np.zeros((len(shared), dv_dx.shape[1]))])
    for readings, errors, B in shared.blocks:
        C = scaled_rows(size[readings], B)
        A = products(C, np.ones(len(readings)))
        A[np.diag_indices_from(A)] += 1.0
        x = np.linalg.solve(A, C.T @ rows[readings])
        rows[readings] -= C @ x
        rows[len(size) + errors] = x
    return rows


def own_residuals(problem: Problem, readings: Floats) -> tuple[Floats, Floats]:
    """What is left of the residuals for each reading by itself, and the shared errors.

    Args:
        problem: readings with shared errors, and the loss.
        readings: (g,) v, SI.

    Returns:
        (v - v* - B z) / s, (g,), and z (K,), at the minimum over z.
    """
    gap = readings - problem.measured
    own = gap / problem.sd
    shared = problem.shared
    if shared is None or not np.all(np.isfinite(gap)):
        return own, np.zeros(0 if shared is None else len(shared))
    z = np.zeros(len(shared))
    for rows, numbers, B in shared.blocks:
        C = scaled_rows(1.0 / problem.sd[rows], B)
        z[numbers] = _shared_part(problem.loss, own[rows], C)
        own[rows] -= C @ z[numbers]
    return own, z


def _shared_part(options: LossOptions, u: Floats, B: Columns) -> Floats:
    """The z (k,) that minimises sum rho(u - B z) + |z|^2, from z = 0.

    Each step is that of reweighted least squares, which never goes up, or Newton's where that goes
    further down: it ends a Huber's search at once where the tails are known.

    Args:
        options: the loss.
        u: (m,) residuals in own standard deviations.
        B: (m, k) likewise.
    """
    z = np.zeros(int(B.shape[1]))
    one = np.eye(len(z))

    def value(z: Floats) -> float:
        f, _ = transformed(options, u - B @ z)
        return float(f @ f + z @ z)

    best = value(z)
    for _ in range(_MOST_STEPS):
        r = u - B @ z
        w = full_weights(options, r)
        down = B.T @ (w * r) - z
        steps = [
            np.linalg.solve(products(B, c) + one, down)
            for c in (w, np.maximum(curvature(options, r), 0.0))
        ]
        trials = [(value(z + step), step) for step in steps]
        lowest, step = min(trials, key=lambda trial: trial[0])
        z = z + step
        if best - lowest <= 1e-14 * (1.0 + best) and np.abs(step).max() <= 1e-7:
            break
        best = lowest
    return z


_MOST_STEPS = 500
"""Of the search for shared errors; a handful is usual."""
