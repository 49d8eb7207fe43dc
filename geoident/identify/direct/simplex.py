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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geoident.errors import ModelError
from geoident.identify.problem.outcome import History, Observer, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Floats
from geoident.model.methods import SimplexOptions

Objective = Callable[[Floats], float]
Watch = Callable[["SimplexMove"], bool]

Vertices = tuple[Floats, Floats]
SimplexEnding = Literal["converged", "moved", "evaluations", "stopped"]

HALVINGS = 20
"""How often an edge of a new simplex is halved in search of an admissible vertex."""


@dataclass(frozen=True)
class SimplexMove:
    """What one iteration did.

    Args:
        x: (n,) best vertex.
        value: the objective there.
        size: largest distance of a vertex from the best, largest component.
        note: ``start``, ``reflected``, ``expanded``, ``contracted``, ``shrunk`` or ``restart``.
    """

    x: Floats
    value: float
    size: float
    note: str


@dataclass(frozen=True)
class Minimum:
    """Where a search ended.

    Args:
        x: (n,) best point evaluated.
        value: the objective there.
        evaluations: how often the objective was asked.
        ending: ``converged``; ``moved`` if the last restart still found a clearly better point;
            ``evaluations`` if they were used up; ``stopped`` by the watch.
    """

    x: Floats
    value: float
    evaluations: int
    ending: SimplexEnding


def simplex(problem: Problem, options: SimplexOptions, observe: Observer) -> Outcome:
    """Minimises the discrepancy phi, theory [20] and 4.3, without derivatives.

    Args:
        problem: readings, model and parameters.
        options: coefficients, tolerance, budget and restarts.
        observe: is told of every iteration; its reason to stop ends the search.

    Returns:
        The best point that was evaluated.

    Raises:
        ModelError: the model has no solution at the start.
    """
    found = Discrepancy(problem)
    scaling, history = found.scaling, History("simplex", problem.response, observe)
    free = scaling.lower < scaling.upper

    def natural(y: Floats) -> Floats:
        x = scaling.start.copy()
        x[free] = y
        return scaling.to_natural(x)

    def objective(y: Floats) -> float:
        inside = np.all((y >= scaling.lower[free]) & (y <= scaling.upper[free]))
        return found.objective(natural(y)) if inside else np.inf

    def watch(at: SimplexMove) -> bool:
        history.record(natural(at.x), at.value, step=at.size, note=at.note)
        return history.stop is not None

    start = scaling.start[free]
    try:
        minimum = minimise(objective, start, options=options, watch=watch)
    except ModelError:
        _say_why(problem, natural(start))
        raise
    return history.outcome(natural(minimum.x), minimum.value, *_ending(minimum, options))


def _say_why(problem: Problem, p: Floats) -> None:
    """Raises ModelError with the model's own sentence on p (n,), SI, where it has one."""
    why = problem.response.admissible(p)
    if why is not None:
        raise ModelError(why)
    problem.response.readings(p)


def _ending(minimum: Minimum, options: SimplexOptions) -> tuple[str, str]:
    """Status and reason, a sentence with the remedy where there is one."""
    if minimum.ending == "converged":
        return "converged", (
            "The simplex is small and the misfit is the same at its vertices "
            f"(tolerance {options.delta:g})."
        )
    if minimum.ending == "moved":
        return "not-converged", (
            "The last restart still found a clearly better point: raise restarts, or go on from "
            "here with the method gauss-newton."
        )
    return "not-converged", (
        f"The search did not converge in {options.max_evaluations} evaluations: raise "
        "max_evaluations, or go on from here with the method gauss-newton."
    )


def minimise(
    objective: Objective, x0: Floats, *, options: SimplexOptions, watch: Watch | None = None
) -> Minimum:
    """Minimises a function of n variables by the simplex search with restarts.

    Args:
        objective: values at x (n,); infinite (or NaN) where x is inadmissible.
        x0: (n,) start.
        options: coefficients, tolerance, budget, restarts, and the edge of the first simplex.
        watch: is told of every iteration; True stops the search.

    Returns:
        The best point evaluated, never worse than the start.

    Raises:
        ModelError: the objective is infinite at the start.

    >>> found = minimise(lambda x: (x[0] - 3.0) ** 2, np.zeros(1), options=SimplexOptions())
    >>> found.ending, bool(abs(found.x[0] - 3.0) < 1e-4)
    ('converged', True)
    """
    search = _Simplex(objective, options, watch)
    search.open(np.asarray(x0, dtype=np.float64))
    ending = search.descend(options.size)
    for number in range(1, options.restarts + 1):
        if ending in ("evaluations", "stopped"):
            break
        before = search.best
        ending = search.descend(options.size * (-1.0) ** number)
        if ending == "converged" and _clearly_better(search.best, before, options.delta):
            ending = "moved"
    return Minimum(search.x[0], search.best, search.evaluations, ending)


def first_simplex(objective: Objective, x0: Floats, value: float, edge: float) -> Vertices:
    """A simplex around x0: a step from it along each axis.

    A step that leads to an inadmissible point is tried the other way, then halved towards x0.

    Args:
        objective: infinite where a point is inadmissible.
        x0: (n,) an admissible point.
        value: the objective there.
        edge: length of the steps; its sign is the direction tried first.

    Returns:
        (n+1, n) vertices, x0 the first, and (n+1,) their values.
    """
    vertices = np.tile(x0, (len(x0) + 1, 1))
    values = np.full(len(x0) + 1, value)
    for axis, vertex in enumerate(vertices[1:]):
        for step in _steps(edge):
            vertex[axis] = x0[axis] + step
            values[axis + 1] = objective(vertex)
            if np.isfinite(values[axis + 1]):
                break
    return vertices, values


def _steps(edge: float) -> Iterator[float]:
    """There, back, and half of it, down to `HALVINGS` times."""
    for halving in range(HALVINGS):
        yield from (edge / 2.0**halving, -edge / 2.0**halving)


def _clearly_better(value: float, before: float, delta: float) -> bool:
    """A gain far above what the tolerance lets a search that rests leave."""
    return before - value > math.sqrt(delta) * max(abs(before), 1.0)


class _Simplex:
    """The simplex and its moves: vertices (n+1, n) in ``x``, sorted by their ``values`` (n+1,)."""

    def __init__(self, objective: Objective, options: SimplexOptions, watch: Watch | None) -> None:
        self.x: Floats = np.zeros((0, 0))
        self.values: Floats = np.zeros(0)
        self.evaluations = 0
        self.options = options
        self._objective = objective
        self._watch = watch

    def value(self, x: Floats) -> float:
        """The objective at x (n,); infinite, without asking, once the evaluations are used up."""
        if self.spent:
            return np.inf
        self.evaluations += 1
        value = float(self._objective(x.copy()))
        return np.inf if np.isnan(value) else value

    @property
    def best(self) -> float:
        """The objective at the best vertex."""
        return float(self.values[0])

    @property
    def spent(self) -> bool:
        """Whether all evaluations are used up."""
        return self.evaluations >= self.options.max_evaluations

    @property
    def size(self) -> float:
        """Largest distance of a vertex from the best, largest component."""
        return float(np.max(np.abs(self.x - self.x[0]), initial=0.0))

    @property
    def rests(self) -> bool:
        """Whether values and simplex are both small."""
        delta = self.options.delta
        flat = self.values[-1] - self.best <= delta * max(abs(self.best), 1.0)
        return bool(flat and self.size <= math.sqrt(delta))

    def open(self, x0: Floats) -> None:
        """Evaluates the start x0 (n,); raises ModelError where it is inadmissible."""
        self.x, self.values = x0[None, :].copy(), np.array([self.value(x0)])
        if not np.isfinite(self.values[0]):
            raise ModelError(
                "The model has no solution at the start of the simplex search.",
                "Give start values at which the model can be computed.",
            )

    def descend(self, edge: float) -> SimplexEnding:
        """Builds a simplex around the best point and moves it until it rests, or may not go on."""
        note = "start" if len(self.x) == 1 else "restart"
        if self._stopped(note):
            return "stopped"
        self._sort(*first_simplex(self.value, self.x[0], self.best, edge))
        while not self.rests:
            if self.spent:
                return "evaluations"
            if self._stopped(self.move()):
                return "stopped"
        return "converged"

    def move(self) -> str:
        """One iteration of figure 7; returns what it did."""
        o, x_h, phi_h = self.options, self.x[-1], self.values[-1]
        c = self.x[:-1].mean(axis=0)
        x_r = c + o.alpha * (c - x_h)
        phi_r = self.value(x_r)
        if phi_r < self.best:
            return self._expand(x_r, phi_r, c + o.gamma * (x_r - c))
        if phi_r < self.values[-2]:
            return self._replace(x_r, phi_r, "reflected")
        x_c = c + o.beta * ((x_r if phi_r < phi_h else x_h) - c)
        phi_c = self.value(x_c)
        if phi_c < min(phi_r, phi_h):
            return self._replace(x_c, phi_c, "contracted")
        return self._shrink()

    def _expand(self, x_r: Floats, phi_r: float, x_e: Floats) -> str:
        """The better of the reflected and the expanded point stays."""
        phi_e = self.value(x_e)
        if phi_e < phi_r:
            return self._replace(x_e, phi_e, "expanded")
        return self._replace(x_r, phi_r, "reflected")

    def _replace(self, x: Floats, value: float, note: str) -> str:
        """Puts x (n,) in the place of the worst vertex."""
        self._sort(np.vstack([self.x[:-1], x]), np.append(self.values[:-1], value))
        return note

    def _shrink(self) -> str:
        """Draws all vertices half-way to the best, which stays."""
        x = self.x[0] + 0.5 * (self.x - self.x[0])
        values = np.array([self.best, *(self.value(vertex) for vertex in x[1:])])
        self._sort(x, values)
        return "shrunk"

    def _sort(self, x: Floats, values: Floats) -> None:
        """Takes over the vertices, best first; of equals the one that was there first."""
        order = np.argsort(values, kind="stable")
        self.x, self.values = x[order], values[order]

    def _stopped(self, note: str) -> bool:
        """Tells the watch; whether it wants the search to stop."""
        at = SimplexMove(self.x[0].copy(), self.best, self.size, note)
        return False if self._watch is None else self._watch(at)
