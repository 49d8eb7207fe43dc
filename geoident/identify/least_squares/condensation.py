"""Condensation with iterated linear least squares (theory 4.1, [11-18], after Kavanagh).

For a model whose equations are affine in its parameters,

    K(p) u = F(p),    K = K_0 + sum_h p_h K_h,    F = F_0 + sum_h p_h F_h,    v = G u,

p enters the *equations* linearly though it enters the readings v nonlinearly. Had all displacements
been read, one linear least-squares problem would give p. The paper splits them into those read, v,
and the others, w; eliminates w with the equations W = K_WV v + K_WW w of the free displacements;
and freezes R = K_VW K_WW^-1 [14] at the current p_j:

    p_{j+1} = argmin | V - R W - L p |,   L = [H_1 v* ... H_n v*],   H_h = K_h^VV - R K_h^WV    [18]

**The same without inverses.** One factorization of K = K(p_j) gives u = K^-1 F, X = K^-1 G^T and
S = G X. Choose the displacement that obeys the free equations and meets the readings,

    z = u + X S^-1 (v* - v),      G z = v*.

Its error in the equations of other parameters q is K(q) z - F(q). In the paper's split
[1, -R] = S^-1 G K^-1 removes w as in [13], so

    [1, -R] (K(q) z - F(q)) = S^-1 (A q - b),
    A_h = G K^-1 (K_h z - F_h),    b = G K^-1 (F_0 - K_0 z).

`geoident.model.response.Condensed` holds A and b. At q = p_j, A q - b = v* - v: S^-1 (A q - b)
are the forces at the gauges that would be needed to press the model onto the readings (the
equation error), A q - b is the same error in readings. Each iteration is

    p_{j+1} = argmin | M (A_j q - b_j) |^2   (+ the prior's part)   in the bounds

    weighting ``equation``   M = S^-1 of independent readings: the paper's metric [18]
    weighting ``output``     M = diag(1/s), or L^-1 where readings share errors (theory 7): the
                             metric of phi [20], into which priors fit

*Difference from [16]*: the paper multiplies H_h with v* alone. K_h z also has
(K_h^VW - R K_h^WW) w, w = K_WW^-1 (W - K_WV v*), whose sum over h vanishes at q = p_j, and for a
single modulus always. With it, A is minus the exact derivative of the readings where the readings
are met, so that without noise the iteration is Gauss-Newton's near the solution and converges
quadratically, and it does not depend on which displacements complete the measured ones.
Without it convergence is linear at best.

**Noise.** A contains the readings v* through z, so their errors do not average out: the fixed point
A^T M^T M (v* - v) = 0 is not the least-squares estimate. With ``equation`` moreover the errors of
readings count more the closer the gauges stand: in a row of twelve blocks, all read to 2 %, the
moduli come out 20 to 40 % too low on average, against less than 1 % with ``output`` (a test shows
it). Large errors can also keep it from coming to rest, and it then says so. It is a fast way near
the solution from far away; follow it by ``gauss-newton``.

**Several stages.** K, u and F are those of all stages, stacked: du_j is driven by the stress that
earlier stages left, so K is block lower triangular and K^-1 is the march through the stages. The
algebra above holds unchanged, with the stress left computed from the corrected displacements z;
only S is no longer symmetric.

**Dependent readings** (three distances of a triangle along a line). S is singular; z then meets
the readings as well as G allows, in the metric of phi. A q - b stays in the range of G, so all rows
count with ``output``; with ``equation`` a largest independent set is chosen by QR with pivoting.

A direction of p that A does not see has no part in the step: it stays where it started.

Computed per iteration: one call of ``condense``, one small least-squares problem in a box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from geoident.errors import Fault, InputError, ModelError
from geoident.identify.least_squares.trust_region import TrustBox, bounded_least_squares
from geoident.identify.problem.outcome import History, Observer, Outcome
from geoident.identify.problem.problem import CHECK_UNITS, Discrepancy, Problem
from geoident.identify.problem.responses import AffineElastic
from geoident.model.arrays import Floats, Ints
from geoident.model.methods import CondensationOptions
from geoident.model.parameter import Parameter
from geoident.model.response import Condensed, Response

INDEPENDENT = 1e-9
"""Rows of S whose part that is new is below this part of the largest count as dependent."""

LONGEST_CYCLE = 6
"""Cycles of up to so many iterations are detected."""

SHORTENINGS = 10
"""How often a step to parameters without solution is halved."""

_FOLLOW = "go on from here with the method gauss-newton."
_OTHERS = "Use the method gauss-newton or simplex."


def condensation_faults(
    response: Response, parameters: Sequence[Parameter], options: CondensationOptions
) -> tuple[Fault, ...]:
    """Why condensation cannot be used, known before any computing; empty if it can.

    Args:
        response: the model.
        parameters: the n unknowns.
        options: the weighting decides whether priors can be used.
    """
    faults = []
    obstacle = _obstacle(response)
    if obstacle is not None:
        message = f"The method condensation is not possible: {obstacle}"
        faults.append(Fault("method-not-possible", message, _OTHERS))
    believed = [parameter.name for parameter in parameters if parameter.prior is not None]
    if options.weighting == "equation" and believed:
        message = (
            "The method condensation with weighting: equation takes no priors "
            f"({', '.join(believed)}): it measures errors in forces, which cannot be weighed "
            "against the standard deviation of a prior."
        )
        hint = "Use weighting: output, leave out the priors, or use the method gauss-newton."
        faults.append(Fault("method-not-possible", message, hint))
    return tuple(faults)


def _obstacle(response: Response) -> str | None:
    if not isinstance(response, AffineElastic):
        return "the model offers no equations that are affine in the parameters."
    return response.obstacle()


def condensation(problem: Problem, options: CondensationOptions, observe: Observer) -> Outcome:
    """Solves the condensed equations for the parameters, iterated, theory 4.1, [11-18].

    Args:
        problem: readings, parameters, and a model that is `AffineElastic`.
        options: weighting, tolerance and number of iterations.
        observe: is told of every iteration; its reason to stop ends the iteration.

    Returns:
        The fixed point if it converged, or the iterate of lowest discrepancy.

    Raises:
        InputError: the model's equations are not affine, or priors with weighting ``equation``.
        ModelError: the model has no solution at the start.
    """
    faults = condensation_faults(problem.response, problem.parameters, options)
    if faults or not isinstance(problem.response, AffineElastic):
        raise InputError(faults)
    return _FixedPointIteration(problem, problem.response, options, observe).run()


def independent_readings(flexibility: Floats) -> Ints:
    """Indices of a largest set of readings that do not depend on each other.

    A row of S = G K^-1 G^T depends on others exactly if that row of G does. Rows are taken in the
    order of QR with pivoting: each time the one with the largest part not spanned by those before.

    Args:
        flexibility: (g, g) S.

    >>> independent_readings(np.array([[2.0, 2.0], [2.0, 2.0]]))
    array([0])
    """
    size = np.linalg.norm(flexibility, axis=1)
    moved = np.flatnonzero(size > 0.0)
    if moved.size == 0:
        return moved
    rows = flexibility[moved] / size[moved, None]
    triangle, order = qr(rows.T, mode="r", pivoting=True)
    new = np.abs(np.diag(triangle))
    rank = int(np.count_nonzero(new > INDEPENDENT * new[0]))
    return np.sort(moved[order[:rank]]).astype(np.int64)


def _in_forces(flexibility: Floats, errors: Floats) -> Floats:
    """S^-1 applied to errors (g, k) in readings, for independent readings."""
    rows = independent_readings(flexibility)
    try:
        return np.asarray(np.linalg.solve(flexibility[np.ix_(rows, rows)], errors[rows]))
    except np.linalg.LinAlgError:
        raise ModelError(
            "The readings cannot be turned into forces: the flexibility of the model at the "
            "gauges is singular.",
            "Use weighting: output.",
        ) from None


@dataclass(frozen=True)
class _CondensedIterate:
    """An iterate: p (n,) SI, the condensed equations and the discrepancy there."""

    p: Floats
    model: Condensed
    phi: float


class _FixedPointIteration:
    """One run of the method."""

    def __init__(
        self,
        problem: Problem,
        response: AffineElastic,
        options: CondensationOptions,
        observe: Observer,
    ) -> None:
        self.problem = problem
        self.response = response
        self.options = options
        self.discrepancy = Discrepancy(problem)
        self.scaling = self.discrepancy.scaling
        self.box = TrustBox(self.scaling)
        self.history = History("condensation", response, observe)
        self.points: list[_CondensedIterate] = []
        self.changes: list[float] = []
        self.lower, self.upper = problem.bounds
        self.metric = problem.sd
        if problem.shared is not None:
            self.metric = problem.whiten(np.eye(len(problem.sd)))

    def run(self) -> Outcome:
        """Iterates [18] until nothing changes, or it turns out that it will not come to rest."""
        start = np.clip(self.problem.start, self.lower, self.upper)
        self.record(self.evaluate(start), 0.0, "start")
        while self.history.stop is None:
            q = self.next()
            change = self.change(self.points[-1].p, q)
            rest = self.at_rest(change)
            if rest is not None:
                return self.outcome(self.points[-1], "converged", rest)
            trouble = self.trouble() or self.advance(q)
            if trouble is not None:
                return self.outcome(self.lowest(), "not-converged", trouble)
        return self.outcome(self.lowest(), "not-converged", "")

    def evaluate(self, p: Floats) -> _CondensedIterate:
        """The condensed equations at p (n,), SI; raises ModelError where there is no solution."""
        why = self.response.admissible(p)
        if why is not None:
            raise ModelError(why)
        model = self.response.condense(p, self.problem.measured, self.metric)
        phi = self.discrepancy.objective_of(p, model.readings)
        if not (np.isfinite(phi) and np.all(np.isfinite(model.matrix))):
            raise ModelError("The misfit is not a finite number here.", CHECK_UNITS)
        return _CondensedIterate(p, model, phi)

    def next(self) -> Floats:
        """p_{j+1} (n,), SI: the linear least-squares problem [18] in the bounds.

        Solved for the change from p_j in columns scaled to the size of the parameters.
        """
        at, model = self.points[-1], self.points[-1].model
        size = self.scaling.slope(at.p)
        errors = np.column_stack([model.matrix * size, model.matrix @ at.p - model.vector])
        errors = self.weighted(errors, model)
        A = np.vstack([errors[:, :-1], self.scaling.prior_jacobian(at.p)])
        b = np.concatenate([errors[:, -1], self.scaling.prior_residuals(at.p)])
        low, high = (self.lower - at.p) / size, (self.upper - at.p) / size
        d = bounded_least_squares(A, b, low, high)
        q = np.where(d <= low, self.lower, np.where(d >= high, self.upper, at.p + size * d))
        return np.clip(q, self.lower, self.upper)

    def weighted(self, errors: Floats, model: Condensed) -> Floats:
        """M times errors (g, k) in readings."""
        if self.options.weighting == "equation":
            return _in_forces(model.flexibility, errors)
        return self.problem.whiten(errors)

    def advance(self, q: Floats) -> str | None:
        """Goes to q (n,), half-way again and again where q has no solution; or why it cannot."""
        p = self.points[-1].p
        note = "accepted"
        for _ in range(SHORTENINGS):
            try:
                self.record(self.evaluate(q), self.change(p, q), note)
            except ModelError:
                q, note = 0.5 * (p + q), "shortened: no solution"
            else:
                return None
        return (
            "The condensed equations lead to parameters at which the model has no solution: "
            f"give tighter bounds, or {_FOLLOW}"
        )

    def record(self, point: _CondensedIterate, change: float, note: str) -> None:
        """Adds an iterate."""
        self.points.append(point)
        self.changes.append(change)
        self.history.record(point.p, point.phi, step=change, note=note)

    def change(self, p: Floats, q: Floats) -> float:
        """Largest change of a parameter from p to q (n,), SI, relative to its size."""
        x, y = self.scaling.to_scaled(p), self.scaling.to_scaled(q)
        return self.box.length(x, y - x)

    def at_rest(self, change: float) -> str | None:
        """Why the next change is none; judged before paying for it."""
        tolerance = self.options.tolerance
        if change <= tolerance:
            return f"The next step would change no parameter by more than {tolerance:g}, relative."
        if len(self.points) > 1 and self.changes[-1] <= change <= np.sqrt(tolerance):
            return (
                f"The changes do not fall below {change:.1e}, relative: what is left is rounding."
            )
        return None

    def trouble(self) -> str | None:
        """Signs that the iteration will not come to rest, with the remedy."""
        steps = len(self.points) - 1
        if self.cycles():
            return f"The iteration goes round in a cycle: {_FOLLOW}"
        if steps > LONGEST_CYCLE and np.all(np.diff(self.changes[-LONGEST_CYCLE:]) > 0.0):
            return f"The iteration diverges, each step is longer than the one before: {_FOLLOW}"
        if steps >= self.options.max_iterations:
            return (
                f"The iteration did not converge in {steps} steps, the last changed a parameter by "
                f"{self.changes[-1]:.1e}, relative: raise max_iterations, or {_FOLLOW}"
            )
        return None

    def cycles(self) -> bool:
        """Whether the last iterate has come back to one before, compared with its step."""
        last = self.points[-1].p
        earlier = self.points[-1 - LONGEST_CYCLE : -2]
        near = 1e-3 * self.changes[-1]
        return any(self.change(point.p, last) < near for point in earlier)

    def lowest(self) -> _CondensedIterate:
        """The iterate of lowest discrepancy."""
        return min(self.points, key=lambda point: point.phi)

    def outcome(self, point: _CondensedIterate, status: str, reason: str) -> Outcome:
        """The answer."""
        return self.history.outcome(point.p, point.phi, status, reason)
