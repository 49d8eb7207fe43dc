"""What a search is going to ask, told before it asks.

Some parts of a search know nothing of each other: the points of a grid, the members of an ensemble,
descents from several starts. A search names them in their order, and then goes through them one by
one as if there were no others. A model that has several processes works on them meanwhile, and
knows the answers when their turn comes.

What is found does not depend on that. Before each part and after the last the model forgets what
others have left to begin from (`SpeculativeResponse.turns`), so that a part has the same numbers
wherever it is computed. Which parts there are does not depend on the number of processes. A part
may be named in vain: the search may turn elsewhere before it comes to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from geoident.errors import ModelError
from geoident.identify.problem.errors import SharedErrors
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import YieldSystem
from geoident.model.arrays import Floats
from geoident.model.methods import LossOptions
from geoident.model.parameter import Parameter
from geoident.model.response import Response

BESIDE = 8
"""Points that are one part where the ground yields: an evaluation begins from one near by."""

Turn = Callable[[int], None]
"""Is told the number of the part that is begun; returns when the answers to it may be asked for."""


class SearchTask(Protocol):
    """A part of a search. It is sent to other processes."""

    def __call__(self, response: Response) -> None:
        """Ask a model all that this part is going to ask; answers are kept by the model."""


@runtime_checkable
class SpeculativeResponse(Response, Protocol):
    """A model that works on parts of a search before it is their turn."""

    @property
    def at_once(self) -> int:
        """How many parts it works on at a time; 1 where it does not look ahead."""

    def turns(self, looks: Sequence[SearchTask]) -> AbstractContextManager[Turn]:
        """Work on parts of a search meanwhile.

        Args:
            looks: they, in their order.
        """


@dataclass(frozen=True)
class ReadingsAt:
    """A part that asks for readings, and stops at no failure.

    Args:
        points: (k, n) parameters, SI.
    """

    points: Floats

    def __call__(self, response: Response) -> None:
        """Ask for them."""
        for p in self.points:
            if response.admissible(p) is not None:
                continue
            try:
                response.readings(p)
            except ModelError:
                continue


@dataclass(frozen=True)
class ProblemApart:
    """A problem apart from its model, which is elsewhere, too.

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

    def of(self, response: Response) -> Problem:
        """The problem of a model."""
        return Problem(response, self.measured, self.sd, self.parameters, self.loss, self.shared)


def apart(problem: Problem) -> ProblemApart:
    """A problem apart from its model."""
    return ProblemApart(
        problem.measured, problem.sd, problem.parameters, problem.loss, problem.shared
    )


@contextmanager
def in_turns(response: Response, looks: Iterable[SearchTask]) -> Iterator[Turn]:
    """Parts of a search, for any model.

    Args:
        response: the model.
        looks: they, in their order.
    """
    if not isinstance(response, SpeculativeResponse):
        yield lambda number: None
        return
    with response.turns(list(looks)) as turn:
        yield turn


def at_once(response: Response) -> int:
    """How many parts of a search a model works on at a time."""
    return response.at_once if isinstance(response, SpeculativeResponse) else 1


def begins_near(response: Response) -> bool:
    """Whether evaluations begin from what earlier ones have left."""
    return isinstance(response, YieldSystem) and response.yields()


@contextmanager
def asked_in_turns(problem: Problem, points: Floats, row: int = 0) -> Iterator[Turn]:
    """A model that is asked for readings at points, in their order: call before each.

    Args:
        problem: with the model.
        points: (k, n) parameters, SI.
        row: how many that follow each other lie near together; 0 for all.
    """
    size = BESIDE if begins_near(problem.response) else 1
    row = row or max(len(points), 1)
    first = [k for k in range(len(points)) if k % row % size == 0]
    parts = [ReadingsAt(part) for part in np.split(points, first[1:])] if len(points) else []
    numbers = {k: number for number, k in enumerate(first)}
    with in_turns(problem.response, parts) as turn:

        def begin(k: int) -> None:
            if k in numbers:
                turn(numbers[k])

        yield begin
