"""A grid whose points are answered by a reduced model, where it is estimated to be close enough.

With estimates e of the errors of the readings and E = |e / s|, the discrepancy phi of readings with
weighted residuals r is off by no more than E (2 |r| + E): errors that are shared and robust losses
make it less. So far from the readings, where phi is large, the reduced model may be coarse.

The reduced model is kept in the checkpoint, since the analyses of which it is made take long: a
scan that is killed goes on with it. Its answers take milliseconds and are given again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field, replace

import numpy as np

from geoident.forward.model import StagedModel
from geoident.forward.reduced.kept import RestoredModel, kept_model
from geoident.forward.reduced.response import ReducedResponse
from geoident.forward.reducible import ReducibleResponse
from geoident.identify.direct.scan import grid_axes
from geoident.identify.problem.ahead import BeginPart, ReadingsAt, SearchTask, at_once, prefetching
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.io.result.reduced import reduced_bytes, reduced_from_bytes
from geoident.model.arrays import Floats
from geoident.model.methods import ScanOptions
from geoident.model.response import Response
from geoident.model.results.costs import NO_COST, Counts
from geoident.model.results.reduced import KeptReducedModel
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.reduced_answers import ByReducedModel, reduced_around

NEAR = 0.001
"""Part of the discrepancy by which it may be off on a grid, beside `LEAST`."""

LEAST = 0.01
"""Error of the discrepancy that does not matter."""

MOST_ANALYSES_OF_GRID = 10
"""Analyses of which the reduced model of a grid is made at most: grids are wide."""

_WORTH = 10
"""Points for each analysis of which the reduced model is made, from which on it is made."""

_MOST = 0.9
"""Part of the points of a grid at which a kept model must be close enough to be the only one."""

KEPT = "a reduced model that was kept"
"""What it is called then."""

_TRAINING = 400
"""Points of the grid at which its error is looked at."""

_REDUCED = "reduced model"
"""Kind of what is kept in the checkpoint."""


@dataclass
class ReadingsByReduced(ByReducedModel):
    """A response whose readings (g,) are those of a reduced model where the discrepancy is right.

    Args:
        inner: the model, with readings (g,).
        discrepancy: of the problem.
        spent: what making the reduced model has cost.
    """

    inner: Response
    discrepancy: Discrepancy
    spent: Counts
    _known: dict[bytes, Floats | None] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self.inner.names

    @property
    def counts(self) -> Counts:
        """Costs so far: of the model, and of making the reduced one."""
        made, own = self.spent, self.inner.counts
        return replace(own + made, analyses=max(own.analyses, made.analyses))

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain of the model, or None if it is inside."""
        return self.inner.admissible(p)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,)."""
        reduced = self._by_reduced(p)
        del self._known[p.tobytes()]  # asked once
        if reduced is not None:
            self.by_reduced += 1
            return reduced
        self.by_model += 1
        return self.inner.readings(p)

    def _by_reduced(self, p: Floats) -> Floats | None:
        """v(p), (g,), of the reduced model where it is close enough."""
        key = p.tobytes()
        if key not in self._known:
            (v,), (error,) = self.reduced.estimated(p[None])
            self._known[key] = v if self._close(p, v, error) else None
        return self._known[key]

    @property
    def at_once(self) -> int:
        """How many parts of a search the model works on at a time."""
        return at_once(self.inner)

    @contextmanager
    def prefetch(self, tasks: Sequence[SearchTask]) -> Iterator[BeginPart]:
        """Have the model work on what the reduced one does not answer.

        Args:
            tasks: parts of a search, in their order.
        """
        left = tasks if at_once(self.inner) == 1 else [self._for_the_model(task) for task in tasks]
        numbers = {n: k for k, n in enumerate(n for n, task in enumerate(left) if task is not None)}
        with prefetching(self.inner, [task for task in left if task is not None]) as turn:

            def begin(number: int) -> None:
                if number in numbers:
                    turn(numbers[number])

            yield begin

    def _for_the_model(self, task: SearchTask) -> SearchTask | None:
        """What of a part the reduced model does not answer; None for nothing."""
        if not isinstance(task, ReadingsAt):
            return task
        points = [p for p in task.points if self.admissible(p) is None]
        points = [p for p in points if self._by_reduced(p) is None]
        return ReadingsAt(np.array(points)) if points else None

    def part_close(self, points: Floats) -> float:
        """At which part of some points (k, n) the reduced model is close enough."""
        readings, error = self.reduced.estimated(points)
        close = [self._close(*each) for each in zip(points, readings, error, strict=True)]
        return float(np.mean(close)) if close else 0.0

    def _close(self, p: Floats, v: Floats, error: Floats) -> bool:
        """Whether the discrepancy of readings v (g,) at p (n,) is right, with their errors."""
        off = float(np.linalg.norm(error / self.discrepancy.problem.sd))
        residual = float(np.linalg.norm(self.discrepancy.whitened_residuals(v)))
        phi = self.discrepancy.objective_of(p, v)
        return bool(off * (2.0 * residual + off) <= LEAST + NEAR * phi)

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its exact Jacobian, (g, n), by the model."""
        return self.inner.evaluate(p)

    @property
    def note(self) -> str:
        """How many points are whose, a sentence."""
        close = f"misfit is estimated to be off by at most {100 * NEAR:.2g} % and {LEAST:g}"
        return self.shares("points of the grid", close)


def with_reduced_readings(
    problem: Problem,
    response: Response,
    options: ScanOptions,
    kept: ReducedResponse | None = None,
    beside: ReducedInLog | None = None,
) -> Problem:
    """The problem of a scan, with a reduced model where the case has one and it saves time.

    Args:
        problem: of the scan.
        response: of the model in the readings of the problem, not logged.
        options: the grid.
        kept: a reduced model in these readings that was made before. Where it is close enough at
            most points of the grid, or there are few of them, no other one is made.
        beside: the checkpoint, with what an earlier run has left there; None for none.
    """
    axes = grid_axes(problem.parameters, options)
    count = math.prod(len(axis) for axis in axes.values())
    training = _training(problem, response, axes)
    worth = count >= _WORTH * MOST_ANALYSES_OF_GRID and isinstance(response, ReducibleResponse)
    if kept is not None:
        led = ReadingsByReduced(kept, problem.response, Discrepancy(problem), NO_COST, whose=KEPT)
        if not worth or led.part_close(training) >= _MOST:
            return replace(problem, response=led)
    if not worth or not isinstance(response, ReducibleResponse):
        return problem
    if not len(training):
        return problem
    centre = training[len(training) // 2]
    known = None if beside is None else beside.find(centre)
    if known is None:
        before = response.counts
        reduced = reduced_around(response, centre, training, MOST_ANALYSES_OF_GRID)
        if reduced is None:
            return problem
        after = response.counts
        known = reduced, replace(after - before, analyses=after.analyses)
        if beside is not None:
            known = beside.add(centre, *known, response)
    led = ReadingsByReduced(known[0], problem.response, Discrepancy(problem), known[1])
    return replace(problem, response=led)


class ReducedInLog:
    """The reduced model of a scan in its checkpoint.

    Args:
        log: the checkpoint.
        model: of the case.
        pairs: channels and stages of the readings that are used.
        times: when each was read, where it is known.
    """

    def __init__(
        self,
        log: Log,
        model: StagedModel,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None],
    ) -> None:
        self.log, self._model, self._pairs, self._times = log, model, pairs, times

    def find(self, centre: Floats) -> tuple[ReducedResponse, Counts] | None:
        """The reduced model around a point (n,) and what it has cost; None if it is not there."""
        known = self.log.find(_REDUCED, centre)
        if known is None:
            return None
        kept = reduced_from_bytes(known["file"].astype(np.uint8).tobytes())
        return self._restored(kept), Counts(*map(int, known["cost"]))

    def add(
        self, centre: Floats, reduced: ReducedResponse, spent: Counts, response: ReducibleResponse
    ) -> tuple[ReducedResponse, Counts]:
        """Keep a reduced model; what comes back is what an interrupted run would find of it.

        Args:
            centre: (n,) around which it was made.
            reduced: the model.
            spent: what it has cost.
            response: of whose analyses it is made.
        """
        kept = kept_model(reduced, self._model, response.visited())
        content = np.frombuffer(reduced_bytes(kept), dtype=np.uint8).astype(np.float64)
        cost = np.array(astuple(spent), dtype=float)
        self.log.add(_REDUCED, centre, {"file": content, "cost": cost})
        return self._restored(kept), spent

    def _restored(self, kept: KeptReducedModel) -> ReducedResponse:
        return RestoredModel(kept, self._model.case).response(self._pairs, self._times)


def _training(problem: Problem, response: Response, axes: Mapping[str, Floats]) -> Floats:
    """Some points (k, n) of a grid that are in the domain."""
    count = math.prod(len(axis) for axis in axes.values())
    names = [q.name for q in problem.parameters]
    every = np.linspace(0, count - 1, min(count, _TRAINING)).astype(np.int64)
    places = np.unravel_index(np.unique(every), [len(axis) for axis in axes.values()])
    training = np.repeat(problem.start[None], len(places[0]), axis=0)
    for (name, axis), place in zip(axes.items(), places, strict=True):
        training[:, names.index(name)] = axis[place]
    return training[[response.admissible(p) is None for p in training]]
