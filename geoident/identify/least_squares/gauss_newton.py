"""Gauss-Newton in a trust region, with bounds (theory 4.2).

With the weighted residuals r and their Jacobian J in the scaled parameters x (see
`problem.problem.Discrepancy`), each iteration minimises the linearised discrepancy

    m(d) = |r + J d|^2    over    lower <= x + d <= upper  and  d in the trust region

exactly (see `trust_region`). The trust region is a box too: no parameter changes by more than a
factor exp(radius) in one step. So bounds need no special treatment: a step ends on a bound, and
leaves it, as the Kuhn-Tucker conditions of m ask. A direction that J does not see has no part in
the step: a parameter without information stays where it started.

What it does step by step: `descent`. Further starts, and what becomes of them: `several_starts`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.least_squares.acceptance import FIRST_RADIUS, Iterate, Step
from geoident.identify.least_squares.descent import Descent, Evaluator, Stopping
from geoident.identify.least_squares.several_starts import SAME, SeveralStarts
from geoident.identify.least_squares.trust_region import TrustBox, bounded_least_squares
from geoident.identify.problem.ahead import ProblemData, without_model
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Bools, Floats
from geoident.model.methods import GaussNewtonOptions, HuberOptions, StudentOptions
from geoident.model.response import Response

MODES_GAIN = 10.0
"""Times the gain at which a descent by modes of a field may end.

What is left then moves nothing by a thousandth of its standard deviation, and steps by modes, far
from quadratic where residuals stay, gain a twentieth of the last one: each is an evaluation.
"""


def gauss_newton(
    problem: Problem,
    options: GaussNewtonOptions,
    on_iteration: OnIteration,
    *,
    method: str = "gauss-newton",
) -> Outcome:
    """Minimises the discrepancy with its exact Jacobian, theory [20] and 4.2.

    Descents begin at the given start and where needed at others. Where the given start has no
    solution, the first of the others that has one takes its place, if several were asked for.

    Args:
        problem: readings, model and parameters.
        options: tolerance, steps, starts.
        on_iteration: is called with every trial; its reason to stop ends the search.
        method: its name in the history.

    Returns:
        The best point that was evaluated, and the other minima that descents came to.

    Raises:
        ModelError: the model has no solution at the start, or at any where there are several.
    """
    history = History(method, problem.response, on_iteration)
    also: Sequence[Floats] = ()
    if isinstance(problem.loss, StudentOptions) and options.starts == "automatic":
        start, convex = problem.start, replace(problem, loss=HuberOptions())
        first = _several_starts(convex, replace(options, starts=1), history).run().values
        problem = problem.begun_at(first)
        also = [Discrepancy(problem).scaling.to_scaled(start), *_led_by_parts(problem, first)]
    return _several_starts(problem, options, history, also).run()


def _several_starts(
    problem: Problem, options: GaussNewtonOptions, history: History, also: Sequence[Floats] = ()
) -> SeveralStarts:
    return SeveralStarts(
        gauss_newton_descent(Discrepancy(problem), options, history),
        None if options.starts == "automatic" else options.starts,
        lambda x: DescentTask(without_model(problem), options, x),
        also,
    )


PARTS, LED = 200, 4
"""Parts of the readings that are tried where the loss is Student's, and starts that they give."""

_REWEIGHTED = 40
"""Steps from the answer of a part to a minimum of the linearised readings."""


def _led_by_parts(problem: Problem, p: Floats) -> list[Floats]:
    """Starts x (n,) near the lowest minima of Student's loss of the readings linearised at p (n,).

    As many readings as there are parameters say where one minimum may be (elemental subsets;
    Rousseeuw and Leroy 1987), reweighted least squares go down to it; no evaluation of the model
    but one.
    """
    scaling = Discrepancy(problem).scaling
    v, dv_dp = problem.response.evaluate(p)
    J, r = problem.whiten(dv_dp * scaling.dp_dx(p)), problem.whiten(v - problem.measured)
    P, rho, x = scaling.prior_jacobian(p), scaling.prior_residuals(p), scaling.to_scaled(p)
    g, n = J.shape
    assert isinstance(problem.loss, StudentOptions)
    nu = problem.loss.nu
    if g < 2 * n or not np.isfinite(J).all():
        return []
    rng = np.random.default_rng(0)
    parts = np.array([rng.permutation(g)[:n] for _ in range(PARTS)])
    d = -np.einsum("sij,sj->si", np.linalg.pinv(J[parts]), r[parts])
    low, high = scaling.lower - x, scaling.upper - x
    weak = P.T @ P + 1e-10 * (J.T @ J).max() * np.eye(n)
    for _ in range(_REWEIGHTED):
        d = np.clip(d, low, high)
        weight = (nu + 1.0) / (nu + (r + d @ J.T) ** 2)
        normal = np.einsum("sg,gi,gj->sij", weight, J, J, optimize=True) + weak
        d = -np.linalg.solve(normal, ((weight * r) @ J + rho @ P)[..., None])[..., 0]
    d = np.clip(d, low, high)
    left = np.sum((nu + 1.0) * np.log1p((r + d @ J.T) ** 2 / nu), axis=1)
    phi = left + np.sum((rho + d @ P.T) ** 2, axis=1)
    directions: list[Floats] = []
    for k in np.argsort(phi, kind="stable").tolist():
        if all(np.linalg.norm(J @ (d[k] - one)) > SAME for one in directions):
            directions.append(d[k])
        if len(directions) == LED:
            break
    return [x + one for one in directions]


@dataclass(frozen=True)
class DescentTask:
    """A descent from a further start as a part of the search (`ahead`).

    Args:
        problem: apart from its model.
        options: of the search.
        x: (n,) where it begins.
    """

    problem: ProblemData
    options: GaussNewtonOptions
    x: Floats

    def __call__(self, response: Response) -> None:
        """Make it, as far as it may be of use."""
        problem = self.problem.with_model(response)
        history = History("gauss-newton", response, lambda iteration: None)
        starts = _several_starts(problem, self.options, history)
        point = starts.evaluator.start(self.x, "start")
        if point is not None:
            starts.down(point, further=False)


def gauss_newton_descent(
    discrepancy: Discrepancy, options: GaussNewtonOptions, history: History
) -> Descent[Iterate]:
    """A plain descent.

    Args:
        discrepancy: what is to be lowered.
        options: tolerance and steps.
        history: is told of every trial; its reason to stop ends the descent.
    """
    evaluator = Evaluator(discrepancy, history, lambda point: point)
    box = evaluator.box
    modes = any(q.field for q in discrepancy.problem.parameters)
    gain = options.tolerance * (MODES_GAIN if modes else 1.0)
    return Descent(
        evaluator,
        lambda point, radius: gauss_newton_step(box, point, radius),
        Stopping(box, options.tolerance, gain, discrepancy.noise_of_phi),
        options.max_iterations,
    )


def gauss_newton_step(box: TrustBox, point: Iterate, radius: float) -> Step:
    """The best step of the linearised problem.

    Args:
        box: measures steps and knows the bounds.
        point: where from.
        radius: length at most; may be infinite.
    """
    J, r = point.linearization.jacobian, point.linearization.residual
    d = bounded_least_squares(J, r, *box.sides(point.x, radius))
    change = J @ d
    gain = -float(change @ (2.0 * r + change))
    return Step(d, box.length(point.x, d), gain)


def phi_after_step(box: TrustBox, point: Iterate, free: Bools) -> float:
    """The linearised discrepancy after the best first step of some parameters.

    Args:
        box: measures steps and knows the bounds.
        point: where from.
        free: (n,) the parameters that move.
    """
    if not free.any():
        return point.phi
    J, r = point.linearization.jacobian[:, free], point.linearization.residual
    low, high = box.sides(point.x, FIRST_RADIUS)
    d = bounded_least_squares(J, r, low[free], high[free])
    return float(np.sum((r + J @ d) ** 2))
