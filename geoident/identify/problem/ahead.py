"""Parts of a search that do not depend on each other, announced before they are evaluated.

The points of a grid, the members of an ensemble and descents from several starts know nothing of
each other. A search announces such parts in their order, and then evaluates them one by one. A
model that has several processes works on them meanwhile, and has the answers when their turn comes.

Results do not depend on that. Before each part and after the last the model discards what others
have left to begin from (`SpeculativeResponse.prefetch`), so that a part has the same numbers
wherever it is computed. Which parts there are does not depend on the number of processes. A part
may be announced in vain: the search may turn elsewhere before it comes to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from geoident.errors import ModelError
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import YieldSystem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.arrays import Floats
from geoident.model.methods import LossOptions
from geoident.model.parameter import Parameter
from geoident.model.response import Response

BESIDE = 8
"""Points of one part where the ground yields, as an evaluation begins from a point near by."""

BeginPart = Callable[[int], None]
"""Called with the number of a part before it is evaluated; returns when it may be."""


class SearchTask(Protocol):
    """A part of a search, which can be sent to other processes."""

    def __call__(self, response: Response) -> None:
        """Evaluate the model wherever this part is going to; the model keeps the answers."""


@runtime_checkable
class SpeculativeResponse(Response, Protocol):
    """A model that evaluates parts of a search before it is their turn."""

    @property
    def at_once(self) -> int:
        """How many parts it works on at a time; 1 where it does not work ahead."""

    def prefetch(self, tasks: Sequence[SearchTask]) -> AbstractContextManager[BeginPart]:
        """Work on parts of a search while it evaluates them one by one.

        Args:
            tasks: the parts, in their order.
        """


@dataclass(frozen=True)
class ReadingsAt:
    """A part that computes readings, and passes over points without solution.

    Args:
        points: (k, n) parameters, SI.
    """

    points: Floats

    def __call__(self, response: Response) -> None:
        """Compute them."""
        for p in self.points:
            if response.admissible(p) is not None:
                continue
            try:
                response.readings(p)
            except ModelError:
                continue


@dataclass(frozen=True)
class ProblemData:
    """A problem without its model, for a process that has its own.

    Args:
        measured: (g,) readings, SI.
        sd: (g,) their standard deviations, SI.
        parameters: the n unknowns.
        loss: how much a large residual counts.
        shared: what readings share of their errors, or None.
    """

    measured: Floats
    sd: Floats
    parameters: tuple[Parameter, ...]
    loss: LossOptions
    shared: SharedErrors | None

    def with_model(self, response: Response) -> Problem:
        """The problem with a model."""
        return Problem(response, self.measured, self.sd, self.parameters, self.loss, self.shared)


def without_model(problem: Problem) -> ProblemData:
    """The problem without its model."""
    return ProblemData(
        problem.measured, problem.sd, problem.parameters, problem.loss, problem.shared
    )


@contextmanager
def prefetching(response: Response, tasks: Iterable[SearchTask]) -> Iterator[BeginPart]:
    """Announces parts of a search to a model, if it works ahead.

    Args:
        response: the model.
        tasks: the parts, in their order.
    """
    if not isinstance(response, SpeculativeResponse):
        yield lambda number: None
        return
    with response.prefetch(list(tasks)) as turn:
        yield turn


def at_once(response: Response) -> int:
    """How many parts of a search a model works on at a time."""
    return response.at_once if isinstance(response, SpeculativeResponse) else 1


def starts_warm(response: Response) -> bool:
    """Whether evaluations begin from what earlier ones have left."""
    return isinstance(response, YieldSystem) and response.yields()


@contextmanager
def prefetched_readings(problem: Problem, points: Floats, row: int = 0) -> Iterator[BeginPart]:
    """Announces points at which readings will be computed, in their order.

    Args:
        problem: with the model.
        points: (k, n) parameters, SI.
        row: how many successive points lie near each other; 0 for all.

    Yields:
        A function to be called with the number of each point before it is evaluated.
    """
    size = BESIDE if starts_warm(problem.response) else 1
    row = row or max(len(points), 1)
    first = [k for k in range(len(points)) if k % row % size == 0]
    parts = [ReadingsAt(part) for part in np.split(points, first[1:])] if len(points) else []
    numbers = {k: number for number, k in enumerate(first)}
    with prefetching(problem.response, parts) as turn:

        def begin(k: int) -> None:
            if k in numbers:
                turn(numbers[k])

        yield begin
