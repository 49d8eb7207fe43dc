"""Simplex search for the smallest discrepancy (theory 4.3).

The direct search of Nelder & Mead, as the founding paper uses it (section 5, figure 7): it asks
for values of the discrepancy only, so it serves any model, elastic or plastic, and where phi has
kinks. With n free parameters it keeps n+1 vertices, x_l the best of them, x_s the second worst,
x_h the worst, and c the centroid of all but x_h. One iteration:

    reflect    x_r = c + alpha (c - x_h)                    accepted if phi_l <= phi_r < phi_s
    expand     x_e = c + gamma (x_r - c)                    tried if phi_r < phi_l; the better stays
    contract   x_c = c + beta (x_r - c)  or  c + beta (x_h - c), on the side of the better of
               x_r and x_h                                  accepted if phi_c < min(phi_r, phi_h)
    shrink     all vertices half-way towards x_l            if nothing else was accepted

An inadmissible point (outside the bounds, outside the domain of the model, no solution) has
phi = infinity, so it is rejected by the same rules, and x_l is only ever replaced by a better one.

The search rests when *both* the values and the simplex are small:

    phi_h - phi_l <= delta max(phi_l, 1)     and     max |x - x_l| <= sqrt(delta)

Equal values alone mean nothing (the vertices may lie around a minimum), and sqrt(delta) is the
size at which a smooth minimum shows such a difference. phi counts squared standard deviations, so
a difference of delta is without meaning at any phi below 1. A simplex can also collapse where
there is no minimum: so the search is repeated from a new simplex around x_l, its edges turned the
other way, ``restarts`` times; if the last repetition still found a clearly better point, the
search has not converged and says so.

Per iteration: one or two evaluations, n more for a shrink.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geoident.errors import ModelError
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Floats
from geoident.model.methods import SimplexOptions

Objective = Callable[[Floats], float]
Watch = Callable[[Floats, float, float, str], bool]
"""Is told of every iteration; True stops the search.

(best vertex (n,), the objective there, largest distance of a vertex from it, note); the note is
``start``, ``reflected``, ``expanded``, ``contracted``, ``shrunk`` or ``restart``.
"""

Vertices = tuple[Floats, Floats]
"""(n+1, n) vertices and (n+1,) their values."""

SimplexEnding = Literal["converged", "moved", "evaluations", "stopped"]

HALVINGS = 20
"""How often an edge of a new simplex is halved in search of an admissible vertex."""

_REASONS: dict[SimplexEnding, str] = {
    "converged": (
        "The simplex is small and the misfit is the same at its vertices (tolerance {delta:g})."
    ),
    "moved": (
        "The last restart still found a clearly better point: raise restarts, or continue "
        "from here with the method gauss-newton."
    ),
    "evaluations": (
        "The search did not converge in {max_evaluations} evaluations: raise "
        "max_evaluations, or continue from here with the method gauss-newton."
    ),
    "stopped": "",
}


@dataclass(frozen=True)
class Minimum:
    """Where a search ended.

    Args:
        x: (n,) best point evaluated.
        value: the objective there.
        ending: ``converged``; ``moved`` if the last restart still found a clearly better point;
            ``evaluations`` if they were used up; ``stopped`` by the watch.
    """

    x: Floats
    value: float
    ending: SimplexEnding


def simplex(problem: Problem, options: SimplexOptions, on_iteration: OnIteration) -> Outcome:
    """Minimises the misfit phi, theory [20] and 4.3, without derivatives.

    Args:
        problem: readings, model and parameters.
        options: coefficients, tolerance, budget and restarts.
        on_iteration: is called with every iteration; its reason to stop ends the search.

    Returns:
        The best point that was evaluated.

    Raises:
        ModelError: the model has no solution at the start.
    """
    phi = Discrepancy(problem)
    scaling, history = phi.scaling, History("simplex", problem.response, on_iteration)
    free = scaling.lower < scaling.upper

    def natural(y: Floats) -> Floats:
        x = scaling.start.copy()
        x[free] = y
        return scaling.to_natural(x)

    def objective(y: Floats) -> float:
        inside = np.all((y >= scaling.lower[free]) & (y <= scaling.upper[free]))
        return phi.objective(natural(y)) if inside else np.inf

    def watch(y: Floats, value: float, size: float, note: str) -> bool:
        history.record(natural(y), value, step=size, note=note)
        return history.stop is not None

    start = scaling.start[free]
    try:
        minimum = minimise(objective, start, options=options, watch=watch)
    except ModelError:  # the model's own sentence, where it has one
        why = problem.response.admissible(natural(start))
        if why is not None:
            raise ModelError(why) from None
        problem.response.readings(natural(start))
        raise
    reason = _REASONS[minimum.ending].format(
        delta=options.delta, max_evaluations=options.max_evaluations
    )
    status = "converged" if minimum.ending == "converged" else "not-converged"
    return history.outcome(natural(minimum.x), minimum.value, status, reason)


def minimise(
    objective: Objective, x0: Floats, *, options: SimplexOptions, watch: Watch | None = None
) -> Minimum:
    """Minimises a function of n variables by the simplex search with restarts.

    Args:
        objective: values at x (n,); infinite (or NaN) where x is inadmissible.
        x0: (n,) start.
        options: coefficients, tolerance, budget, restarts, and the edge of the first simplex.
        watch: see `Watch`.

    Returns:
        The best point evaluated, never worse than the start.

    Raises:
        ModelError: the objective is infinite at the start.

    >>> minimum = minimise(lambda x: (x[0] - 3.0) ** 2, np.zeros(1), options=SimplexOptions())
    >>> minimum.ending, bool(abs(minimum.x[0] - 3.0) < 1e-4)
    ('converged', True)
    """
    evaluations, delta = 0, options.delta

    def phi(x: Floats) -> float:
        """The objective; infinite, without asking, once the evaluations are used up."""
        nonlocal evaluations
        if evaluations >= options.max_evaluations:
            return np.inf
        evaluations += 1
        value = float(objective(x.copy()))
        return np.inf if np.isnan(value) else value

    x = np.array(x0, dtype=np.float64)[None, :]
    values = np.array([phi(x[0])])
    if not np.isfinite(values[0]):
        raise ModelError(
            "The model has no solution at the start of the simplex search.",
            "Give start values at which the model can be computed.",
        )

    def size(x: Floats) -> float:
        return float(np.max(np.abs(x - x[0]), initial=0.0))

    def stopped(note: str) -> bool:
        return watch is not None and watch(x[0].copy(), float(values[0]), size(x), note)

    def descended(edge: float) -> SimplexEnding:
        """Moves a new simplex around the best point until it rests, or may not go on."""
        nonlocal x, values
        if stopped("start" if len(x) == 1 else "restart"):
            return "stopped"
        x, values = _sorted(*first_simplex(phi, x[0], float(values[0]), edge))
        while values[-1] - values[0] > delta * max(abs(values[0]), 1.0) or size(x) > math.sqrt(
            delta
        ):
            if evaluations >= options.max_evaluations:
                return "evaluations"
            (x, values), note = moved(phi, x, values, options)
            if stopped(note):
                return "stopped"
        return "converged"

    ending = descended(options.size)
    for number in range(1, options.restarts + 1):
        if ending in ("evaluations", "stopped"):
            break
        before = float(values[0])
        ending = descended(options.size * (-1.0) ** number)
        # a gain clearly above the convergence tolerance
        gain = before - values[0] > math.sqrt(delta) * max(abs(before), 1.0)
        if ending == "converged" and gain:
            ending = "moved"
    return Minimum(x[0], float(values[0]), ending)


def first_simplex(phi: Objective, x0: Floats, phi0: float, edge: float) -> Vertices:
    """A simplex around x0: a step from it along each axis.

    A step that leads to an inadmissible point is tried the other way, then halved towards x0.

    Args:
        phi: infinite where a point is inadmissible.
        x0: (n,) an admissible point.
        phi0: the objective there.
        edge: length of the steps; its sign is the direction tried first.

    Returns:
        The vertices, x0 the first, and their values.
    """
    x, values = np.tile(x0, (len(x0) + 1, 1)), np.full(len(x0) + 1, phi0)
    for axis, vertex in enumerate(x[1:]):
        for step in (sign * edge / 2.0**k for k in range(HALVINGS) for sign in (1.0, -1.0)):
            vertex[axis] = x0[axis] + step
            values[axis + 1] = phi(vertex)
            if np.isfinite(values[axis + 1]):
                break
    return x, values


def moved(phi: Objective, x: Floats, values: Floats, o: SimplexOptions) -> tuple[Vertices, str]:
    """One iteration of the founding paper's figure 7, and what it did.

    Args:
        phi: the objective.
        x: (n+1, n) vertices, the best first.
        values: (n+1,) of the objective there.
        o: alpha, beta, gamma.
    """
    x_h, phi_l, phi_s, phi_h = x[-1], values[0], values[-2], values[-1]
    c = x[:-1].mean(axis=0)
    x_r = c + o.alpha * (c - x_h)
    phi_r = phi(x_r)
    x_new, phi_new, note = x_r, phi_r, "reflected"
    if phi_r < phi_l:
        x_e = c + o.gamma * (x_r - c)
        phi_e = phi(x_e)
        if phi_e < phi_r:
            x_new, phi_new, note = x_e, phi_e, "expanded"
    elif not phi_r < phi_s:
        x_c = c + o.beta * ((x_r if phi_r < phi_h else x_h) - c)
        phi_c = phi(x_c)
        if not phi_c < min(phi_r, phi_h):
            x = x[0] + 0.5 * (x - x[0])
            return _sorted(x, np.array([phi_l, *(phi(vertex) for vertex in x[1:])])), "shrunk"
        x_new, phi_new, note = x_c, phi_c, "contracted"
    return _sorted(np.vstack([x[:-1], x_new]), np.append(values[:-1], phi_new)), note


def _sorted(x: Floats, values: Floats) -> Vertices:
    """The vertices, best first; of equals the one that was there first."""
    order = np.argsort(values, kind="stable")
    return x[order], values[order]
