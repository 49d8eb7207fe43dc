"""The posterior density that is sampled (theory 11.1), and the coordinates it is sampled in.

The density is exp(-phi/2) inside the bounds; phi holds readings and priors. A parameter without a
prior is flat in its scale: in ln p where that is ``log``, in p where it is ``linear``. A prior is a
density in the variable of its name, normal in p, lognormal in ln p, whatever the scale.

Samplers work in coordinates u that straighten what readings usually leave open: a stress over a
modulus, a product. u is ln p wherever the bounds are positive and a factor of `WIDE` apart, else p
in its reference (`Scaling`). The change of variables adds, up to constants,

    log pi(u) = -phi(p(u)) / 2 + sum_i j_i(u)

    j = ln p      for u = ln p where the density is one in p
    j = -ln p     for u = p / r where the density is one in ln p
    j = 0         else

Where accuracies were estimated they are integrated over (theory 7.5): in place of exp(-phi/2)
stands the sum over points t_k of exp(-phi_k/2) |Sigma_k|^(-1/2), with their weights before any
reading.

With a robust loss phi is that of the loss; errors that readings share are then at their best value
for each p (theory 7.2), with the squared loss they are integrated over.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import logsumexp

from geoident.errors import ModelError
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter

Answering = Callable[[Floats], Sequence[Floats | None]]
"""A model asked at many parameter vectors (k, n), SI, at once.

It answers with the used readings (g,) at each, SI; None for no solution.
"""

WIDE = 2.0
"""Upper by lower bound from which on a positive parameter is sampled by its logarithm."""


class PosteriorDensity:
    """The density of a problem in coordinates u, of the parameters whose bounds leave them free.

    Args:
        problem: readings, errors, parameters and loss.
        answering: the model; the problem's own, point by point, if None.
        possible: the problem at other accuracies, which are integrated over, with logarithms of
            their weights before any reading; none where accuracies are given.

    Attributes:
        free: (n,) parameters whose bounds do not coincide; vectors u are (m,), of these.
        lower, upper: (m,) bounds in u.
        evaluations: how often the model was asked.
    """

    def __init__(
        self,
        problem: Problem,
        answering: Answering | None = None,
        possible: Sequence[tuple[Problem, float]] = (),
    ) -> None:
        self.problem = problem
        self._possible = [
            (one, weight - 0.5 * _log_determinant(one) + 0.5 * _log_determinant(problem))
            for one, weight in possible
        ]
        self.discrepancy = Discrepancy(problem)
        lower, upper = problem.bounds
        self.free: Bools = np.asarray(upper > lower, dtype=np.bool_)
        self._log = np.array([
            q.scale == "log" or (q.lower > 0.0 and q.upper > WIDE * q.lower)
            for q in problem.parameters
        ], dtype=np.bool_)  # fmt: skip
        self._reference = np.where(self._log, 1.0, self.discrepancy.scaling.reference)
        self._bounds = lower, upper
        self.lower, self.upper = self.coordinates(lower), self.coordinates(upper)
        self.evaluations = 0
        self._answering = answering or self._one_by_one
        density_in_log = np.array([
            q.scale == "log" if q.prior is None else q.prior.kind == "lognormal"
            for q in problem.parameters
        ])  # fmt: skip
        self._jacobians = self._log.astype(np.float64) - density_in_log  # the factors of ln p

    def __len__(self) -> int:
        return int(np.count_nonzero(self.free))

    def inside(self, u: Floats) -> Bools:
        """Which of u (k, m) are within the bounds, (k,)."""
        return np.asarray(np.all((u >= self.lower) & (u <= self.upper), axis=1), dtype=np.bool_)

    def natural(self, u: Floats) -> Floats:
        """Parameters p (k, n), SI, inside the bounds, of coordinates u (k, m)."""
        whole = np.zeros((len(u), len(self.free)))
        whole[:, self.free] = u
        with np.errstate(over="ignore"):
            p = np.where(
                self._log, np.exp(np.where(self._log, whole, 0.0)), whole * self._reference
            )
        return np.asarray(np.clip(p, *self._bounds))

    def coordinates(self, p: Floats) -> Floats:
        """Coordinates u (m,) of p (n,), SI."""
        by_log = np.log(np.where(self._log, p, 1.0))
        return np.asarray(np.where(self._log, by_log, p / self._reference)[self.free])

    def rows(self, p: Floats) -> tuple[Floats, float]:
        """Derivatives (r, m) of the residuals in u at p (n,), SI, and phi there.

        Raises:
            ModelError: p is outside the domain of the model, or there is no solution.
        """
        self.evaluations += 1
        linearization = self.discrepancy.linearize(p)
        dx_du = np.where(self._log, p, self._reference) / self.discrepancy.scaling.dp_dx(p)
        return np.asarray((linearization.jacobian * dx_du)[:, self.free]), linearization.objective

    def reference(self) -> tuple[Floats, Floats]:
        """A normal density as wide as what is known before: centre and sd (m,), (m,) in u.

        Exactly the prior where that is normal in the coordinate.
        """
        pairs = zip(self.problem.parameters, self._log.tolist(), strict=True)
        known = np.array([_reference(q, by_log) for q, by_log in pairs]).reshape(-1, 2)
        centre, sd = (known / self._reference[:, None])[self.free].T
        return centre, sd

    def logarithms(self, u: Floats) -> Floats:
        """Log pi (k,) at u (k, m), up to one constant; -inf outside and where there is no solution.

        The model is not asked outside the bounds.
        """
        logarithms = np.full(len(u), -np.inf)
        inside = np.flatnonzero(self.inside(u))
        if not len(inside):
            return logarithms
        points = self.natural(u[inside])
        self.evaluations += len(points)
        for k, p, v in zip(inside, points, self._answering(points), strict=True):
            if v is not None:
                logarithms[k] = self.logarithm(p, v)
        return logarithms

    def logarithm(self, p: Floats, readings: Floats) -> float:
        """Log pi at p (n,), SI, where the model answers readings (g,)."""
        value = -0.5 * self.discrepancy.objective_of(p, readings)
        if self._possible:
            own = self.problem.whiten(readings - self.problem.measured)
            value += 0.5 * float(own @ own) + float(logsumexp(self.of_accuracies(readings)))
        some = self._jacobians != 0.0
        return value + float(self._jacobians[some] @ np.log(p[some]))

    def of_accuracies(self, readings: Floats) -> Floats:
        """Logarithms (K,) of how likely each of the accuracies is, where the model answers (g,)."""
        logarithms = []
        for problem, weight in self._possible:
            r = problem.whiten(readings - problem.measured)
            logarithms.append(weight - 0.5 * float(r @ r))
        return np.array(logarithms)

    def _one_by_one(self, points: Floats) -> list[Floats | None]:
        """What the model of the problem answers at p (k, n)."""
        response = self.problem.response
        answers: list[Floats | None] = []
        for p in points:
            try:
                answers.append(response.readings(p) if response.admissible(p) is None else None)
            except ModelError:
                answers.append(None)
        return answers


def _log_determinant(problem: Problem) -> float:
    """Of the covariance of the readings."""
    if problem.covariance is not None:
        return problem.covariance.log_determinant()
    return 2.0 * float(np.log(problem.sd).sum())


def _reference(parameter: Parameter, by_logarithm: bool) -> tuple[float, float]:
    """Centre and standard deviation of what is known before, of ln p or of p."""
    prior = parameter.prior
    if prior is not None:
        relative = prior.sd / prior.mean if prior.mean > 0.0 else 1.0
        return (float(np.log(prior.mean)), relative) if by_logarithm else (prior.mean, prior.sd)
    ends = np.array([parameter.lower, parameter.upper])
    ends = np.log(ends) if by_logarithm else ends
    if np.all(np.isfinite(ends)):
        return float(ends.mean()), 0.5 * float(np.ptp(ends))
    start = parameter.start
    return (float(np.log(start)), 2.5) if by_logarithm else (start, 5.0 * (abs(start) or 1.0))
