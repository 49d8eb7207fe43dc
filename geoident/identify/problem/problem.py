"""What every identifier is given: readings to be met by a model, and how far it is from them.

The model can be anything that answers as `Response` in `model.response` asks. Parameter vectors p
are in natural units (SI), in the order of ``names``; readings v(p) are ordered as the measured
values v*. The discrepancy between what was read and what the model answers, with the prior's part,
is

    phi(p) = (v* - v(p))^T W (v* - v(p)) + |prior residuals|^2,   W = diag(1/s^2)          [20]

It is the squared length of one vector of weighted residuals

    r(p) = [ (v(p) - v*) / s ;  prior residuals ]          (g + k,)

whose Jacobian in the scaled parameters is [ (dv/dp)(dp/dx) / s ; prior rows ]. Where the model has
no solution, phi is infinite. A robust loss transforms the readings' part of r, so that phi is
the squared length all the same. Computed once: the weights. Per trial: one call of the model.

With the weighted residual r of a reading (in its standard deviations) a loss rho replaces r^2:

    squared      rho = r^2
    huber        rho = r^2                       for |r| <= delta      (Huber 1964)
                       2 delta |r| - delta^2     beyond
    student-t    rho = (nu + 1) ln(1 + r^2/nu)   twice the negative log likelihood, less its
                                                 constant (Lange, Little & Taylor 1989)

Written as the square of a transformed residual f = sign(r) sqrt(rho), every discrepancy stays a
sum of squares: phi = |f|^2, with the Jacobian f'(r) dr/dx, f' = rho' / (2 f). Its gradient is that
of phi exactly. Gauss-Newton on f, with the trust region on phi itself, is a robust Gauss-Newton:
its curvature f'^2 lies between the true one, rho''/2, and the weight of iteratively reweighted
least squares,

    w = rho' / (2 r)        1 or min(1, delta/|r|) or (nu + 1)/(nu + r^2),

so it converges faster than reweighting, and unlike the true curvature it is never zero or negative.
Priors keep their squares: they are no readings that could be wrong.

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
from geoident.identify.problem.errors import (
    Columns,
    Covariance,
    SharedErrors,
    products,
    scaled_rows,
)
from geoident.identify.problem.responses import HasNoise
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats
from geoident.model.methods import HuberOptions, LossOptions, SquaredOptions, StudentOptions
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


_MAD = 1.482602218505602
"""Standard deviation by median of absolute values, for a normal distribution."""


def transformed(options: LossOptions, r: Floats) -> tuple[Floats, Floats]:
    """Transformed residual f = sign(r) sqrt(rho(r)) and its derivative, each (g,), for r (g,)."""
    match options:
        case HuberOptions(delta):
            return _huber(r, delta)
        case StudentOptions(nu):
            return _student(r, nu)
        case _:
            return r, np.ones_like(r)


def weights(options: LossOptions, r: Floats) -> Floats:
    """Weight w = rho'/(2 r), (g,), that a reading with residual r (g,) keeps, never above 1.

    Student's weight in the middle is (nu+1)/nu; it is cut at 1 because no reading tells more than
    its accuracy says.
    """
    match options:
        case HuberOptions(delta):
            return np.asarray(delta / np.maximum(np.abs(r), delta), dtype=np.float64)
        case StudentOptions(nu):
            return np.minimum(1.0, (nu + 1.0) / (nu + r**2))
        case _:
            return np.ones_like(r)


def robust_scale(r: Floats) -> float:
    """Scatter of the residuals r (g,), in standard deviations, by the median of their sizes.

    Near 1 if the accuracies are right, whatever a minority of wrong readings says; NaN for none.

    >>> round(robust_scale(np.array([-1.0, 0.2, 0.7, 0.5, 90.0])), 3)
    1.038
    """
    return float(_MAD * np.median(np.abs(r))) if r.size else np.nan


def _huber(r: Floats, delta: float) -> tuple[Floats, Floats]:
    size = np.maximum(np.abs(r), delta)
    tail = np.sqrt(2.0 * delta * size - delta**2)
    inside = np.abs(r) <= delta
    f = np.where(inside, r, np.sign(r) * tail)
    return f, np.where(inside, 1.0, delta / tail)


def _student(r: Floats, nu: float) -> tuple[Floats, Floats]:
    u = r**2 / nu
    safe = np.where(u > 0.0, u, 1.0)
    part = np.sqrt((nu + 1.0) / nu * np.where(u > 0.0, np.log1p(safe) / safe, 1.0))
    return r * part, (nu + 1.0) / nu / (1.0 + u) / part


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
        # asked at every step, and to look for the members of a protocol takes longer than a step
        self._noisy = problem.response if isinstance(problem.response, HasNoise) else None

    def residuals(self, p: Floats, readings: Floats) -> Floats:
        """Weighted residuals r (g + k,) at p (n,), SI, where the model answers readings (g,)."""
        if self.latent:
            own, z = own_residuals(self.problem, readings)
            f, _ = transformed(self.problem.loss, own)
            return np.concatenate([f, z, self.scaling.prior_residuals(p)])
        f, _ = transformed(self.problem.loss, self.whitened_residuals(readings))
        return np.concatenate([f, self.scaling.prior_residuals(p)])

    @property
    def latent(self) -> bool:
        """Shared errors are found beside the parameters, as the loss is robust."""
        return self.problem.shared is not None and not isinstance(self.problem.loss, SquaredOptions)

    def whitened_residuals(self, readings: Floats) -> Floats:
        """White v - v* (g,) where the model answers readings v (g,), whatever the loss."""
        return self.problem.whiten(readings - self.problem.measured)

    def noise(self) -> Floats:
        """(g,) what is not smooth in the computed readings, in their standard deviations."""
        if self._noisy is not None:
            return np.asarray(self._noisy.noise / self.problem.sd)
        return np.zeros(len(self.problem.measured))

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
        _require_finite(linearization)
        return linearization

    def linearization_of(self, p: Floats, readings: Floats, jacobian: Floats) -> Linearization:
        """The same where the answer of the model is known.

        Args:
            p: (n,) parameters, SI.
            readings: (g,) what the model answers, SI.
            jacobian: (g, n) its derivative.
        """
        rows = self._rows(readings, jacobian * self.scaling.slope(p))
        return Linearization(
            self.residuals(p, readings), np.concatenate([rows, self.scaling.prior_jacobian(p)])
        )

    def _rows(self, v: Floats, dv_dx: Floats) -> Floats:
        """Derivatives of the readings' part of the residuals, from those of the readings (g, n)."""
        problem = self.problem
        if self.latent:
            return _projected(problem, v, dv_dx)
        if problem.shared is not None:
            return problem.whiten(dv_dx)
        _, slope = transformed(problem.loss, self.whitened_residuals(v))
        return dv_dx * (slope / problem.sd)[:, None]


def _projected(problem: Problem, v: Floats, dv_dx: Floats) -> Floats:
    """Rows (g + K, n) of [f(u); z] with z following the parameters (Kaufman 1975)."""
    assert problem.shared is not None
    own, _ = own_residuals(problem, v)
    _, slope = transformed(problem.loss, own)
    size = slope / problem.sd
    rows = np.concatenate([size[:, None] * dv_dx, np.zeros((len(problem.shared), dv_dx.shape[1]))])
    for readings, shared, B in problem.shared.blocks:
        C = scaled_rows(size[readings], B)
        A = products(C, np.ones(len(readings)))
        A[np.diag_indices_from(A)] += 1.0
        x = np.linalg.solve(A, C.T @ rows[readings])
        rows[readings] -= C @ x
        rows[len(own) + shared] = x
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
            for c in (w, np.maximum(_curvature(options, r), 0.0))
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


def full_weights(options: LossOptions, r: Floats) -> Floats:
    """rho'/(2 r), (g,), not cut: the weight with which reweighted least squares goes down."""
    if isinstance(options, StudentOptions):
        return np.asarray((options.nu + 1.0) / (options.nu + r**2))
    return weights(options, r)


def _curvature(options: LossOptions, r: Floats) -> Floats:
    """rho''/2, (g,)."""
    match options:
        case HuberOptions(delta):
            return np.asarray(np.abs(r) <= delta, dtype=np.float64)
        case StudentOptions(nu):
            return np.asarray((nu + 1.0) * (nu - r**2) / (nu + r**2) ** 2)
        case _:
            return np.ones_like(r)


def _require_finite(linearization: Linearization) -> None:
    """Refuse numbers whose squares overflow: every step from there would look like the last."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = linearization.objective + float(np.sum(linearization.jacobian**2))
    if not np.isfinite(squares):
        raise ModelError(
            "The computed readings or their misfit exceed the range of floating-point numbers.",
            CHECK_UNITS,
        )
