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
earlier stages left, so K is block lower triangular and K^-1 is the analysis through the stages. The
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
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import CHECK_UNITS, Discrepancy, Problem
from geoident.identify.problem.responses import AffineElastic
from geoident.model.arrays import Floats, Ints
from geoident.model.methods import CondensationOptions
from geoident.model.response import Condensed

INDEPENDENT = 1e-9
"""Rows of S whose part that is new is below this part of the largest count as dependent."""

LONGEST_CYCLE = 6
"""Cycles of up to so many iterations are detected."""

SHORTENINGS = 10
"""How often a step to parameters without solution is halved."""

_FOLLOW = "continue from here with the method gauss-newton."
_NO_SOLUTION = (
    "The condensed equations lead to parameters at which the model has no solution: "
    f"give tighter bounds, or {_FOLLOW}"
)


def condensation(
    problem: Problem, options: CondensationOptions, on_iteration: OnIteration
) -> Outcome:
    """Solves the condensed equations for the parameters, iterated, theory 4.1, [11-18].

    Args:
        problem: readings, parameters, and a model that is `AffineElastic`.
        options: weighting, tolerance and number of iterations.
        on_iteration: is called with every iteration; its reason to stop ends the iteration.

    Returns:
        The fixed point if it converged, or the iterate of lowest discrepancy.

    Raises:
        InputError: priors with weighting ``equation``.
        ModelError: the model has no solution at the start.
    """
    believed = [parameter.name for parameter in problem.parameters if parameter.prior is not None]
    if options.weighting == "equation" and believed:
        message = (
            "The method condensation with weighting: equation takes no priors "
            f"({', '.join(believed)}): it measures errors in forces, which cannot be weighed "
            "against the standard deviation of a prior."
        )
        hint = "Use weighting: output, leave out the priors, or use the method gauss-newton."
        raise InputError([Fault("method-not-possible", message, hint)])
    assert isinstance(problem.response, AffineElastic)  # else the method was refused
    equations = _CondensedEquations(problem, problem.response, options)
    history = History("condensation", problem.response, on_iteration)
    points: list[_CondensedIterate] = []
    changes: list[float] = []

    def record(point: _CondensedIterate, change: float, note: str) -> None:
        points.append(point)
        changes.append(change)
        history.record(point.p, point.phi, step=change, note=note)

    record(equations.at(np.clip(problem.start, *problem.bounds)), 0.0, "start")
    trouble = ""
    while history.stop is None:
        point = points[-1]
        q = equations.solution(point)
        change = equations.change(point.p, q)
        rest = ""
        if change <= options.tolerance:
            rest = (
                "The next step would change no parameter by more than "
                f"{options.tolerance:g}, relative."
            )
        elif len(points) > 1 and changes[-1] <= change <= np.sqrt(options.tolerance):
            rest = f"The changes do not fall below {change:.1e}, relative: only rounding remains."
        if rest:
            return history.outcome(point.p, point.phi, "converged", rest)
        trouble = _trouble(equations, points, changes, options)
        reached = None if trouble else equations.reached(point.p, q)
        if reached is None:
            trouble = trouble or _NO_SOLUTION
            break
        note = "accepted" if np.array_equal(reached.p, q) else "shortened: no solution"
        record(reached, equations.change(point.p, reached.p), note)
    lowest = min(points, key=lambda point: point.phi)
    return history.outcome(lowest.p, lowest.phi, "not-converged", trouble)


def _trouble(
    equations: _CondensedEquations,
    points: Sequence[_CondensedIterate],
    changes: Sequence[float],
    options: CondensationOptions,
) -> str:
    """A sign that the iteration will not come to rest, with the remedy; empty for none."""
    steps, last = len(points) - 1, points[-1].p
    near = 1e-3 * changes[-1]  # the last iterate has come back to one before
    if any(equations.change(one.p, last) < near for one in points[-1 - LONGEST_CYCLE : -2]):
        return f"The iteration goes round in a cycle: {_FOLLOW}"
    if steps > LONGEST_CYCLE and np.all(np.diff(changes[-LONGEST_CYCLE:]) > 0.0):
        return f"The iteration diverges, each step is longer than the one before: {_FOLLOW}"
    if steps >= options.max_iterations:
        return (
            f"The iteration did not converge in {steps} steps, the last changed a parameter by "
            f"{changes[-1]:.1e}, relative: raise max_iterations, or {_FOLLOW}"
        )
    return ""


@dataclass(frozen=True)
class _CondensedIterate:
    """An iterate: p (n,) SI, the condensed equations and the discrepancy there."""

    p: Floats
    model: Condensed
    phi: float


class _CondensedEquations:
    """The condensed equations of a problem, and their least-squares solution."""

    def __init__(
        self, problem: Problem, response: AffineElastic, options: CondensationOptions
    ) -> None:
        self._problem, self._response, self._options = problem, response, options
        self._discrepancy = Discrepancy(problem)
        self._scaling = self._discrepancy.scaling
        self._box = TrustBox(self._scaling)
        self._metric = problem.sd
        if problem.shared is not None:
            self._metric = problem.whiten(np.eye(len(problem.sd)))

    def at(self, p: Floats) -> _CondensedIterate:
        """The equations at p (n,), SI; raises ModelError where there is no solution."""
        why = self._response.admissible(p)
        if why is not None:
            raise ModelError(why)
        model = self._response.condense(p, self._problem.measured, self._metric)
        phi = self._discrepancy.objective_of(p, model.readings)
        if not (np.isfinite(phi) and np.all(np.isfinite(model.matrix))):
            raise ModelError("The misfit is not a finite number here.", CHECK_UNITS)
        return _CondensedIterate(p, model, phi)

    def reached(self, p: Floats, q: Floats) -> _CondensedIterate | None:
        """The iterate at q (n,), or nearer to p (n,) where there is no solution; None for none."""
        for _ in range(SHORTENINGS):
            try:
                return self.at(q)
            except ModelError:
                q = 0.5 * (p + q)
        return None

    def solution(self, point: _CondensedIterate) -> Floats:
        """p_{j+1} (n,), SI: the linear least-squares problem [18] in the bounds.

        Solved for the change from p_j in columns scaled to the size of the parameters.
        """
        p, model, (lower, upper) = point.p, point.model, self._problem.bounds
        size = self._scaling.dp_dx(p)
        errors = np.column_stack([model.matrix * size, model.matrix @ p - model.vector])
        if self._options.weighting == "equation":
            errors = _in_forces(model.flexibility, errors)
        else:
            errors = self._problem.whiten(errors)
        A = np.vstack([errors[:, :-1], self._scaling.prior_jacobian(p)])
        b = np.concatenate([errors[:, -1], self._scaling.prior_residuals(p)])
        low, high = (lower - p) / size, (upper - p) / size
        d = bounded_least_squares(A, b, low, high)
        q = np.where(d <= low, lower, np.where(d >= high, upper, p + size * d))
        return np.clip(q, lower, upper)

    def change(self, p: Floats, q: Floats) -> float:
        """Largest change of a parameter from p to q (n,), SI, relative to its size."""
        x, y = self._scaling.to_scaled(p), self._scaling.to_scaled(q)
        return self._box.length(x, y - x)


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
