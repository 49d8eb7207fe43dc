"""A response whose answers other processes may know before they are asked for (`ahead`).

What they have evaluated goes into the log of the response, as if it had been computed here. The
search asks in its own order, and waits where the part whose turn it is has not come back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from geoident.errors import ModelError
from geoident.identify.problem.ahead import ReadingsAt, SearchTask
from geoident.model.arrays import Floats
from geoident.model.results.costs import NO_COST, Counts
from geoident.workflow.executing.executor import Answered

EvaluationArrays = Mapping[str, Floats]


@dataclass
class Recording:
    """What a part of a search has evaluated; a log that nobody else sees.

    Args:
        evaluations: kind, parameters (n,) and arrays of each.
        failures: kind and parameters (n,) of each that has no solution, and why.
        spent: what all of it has cost.
    """

    evaluations: list[tuple[str, Floats, EvaluationArrays]] = field(default_factory=list)
    failures: list[tuple[str, Floats, ModelError]] = field(default_factory=list)
    spent: Counts = NO_COST

    def find(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """What was kept for this kind of evaluation at p (n,), or None."""
        for known, place, arrays in self.evaluations:
            if known == kind and place.tobytes() == p.tobytes():
                return arrays
        return None

    def add(self, kind: str, p: Floats, arrays: EvaluationArrays) -> None:
        """Keep an evaluation.

        Args:
            kind: of evaluation.
            p: (n,) where.
            arrays: (...) what was found, by name.
        """
        self.evaluations.append((kind, p.copy(), dict(arrays)))


class Beside(Protocol):
    """Processes that work on parts of a search: `running.workers.ModelWorkers`, or a toy."""

    def at_once(self, tasks: Sequence[SearchTask] = ()) -> int:
        """How many work on parts of a search; 1 for this one alone."""

    def evaluate_ahead(
        self,
        tasks: Sequence[SearchTask],
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None],
    ) -> Iterator[Answered[Recording]]:
        """What parts of a search have evaluated, as it comes, in any order."""

    def check(self) -> None:
        """Raise `Interrupted` if a stop was wished."""

    @property
    def stopping(self) -> bool:
        """Whether a stop was wished."""


@dataclass(frozen=True)
class ResponseBeside:
    """Where else a response is computed.

    Args:
        processes: that have the same model.
        pairs: channel and stage of its readings.
        times: when each was read.
    """

    processes: Beside
    pairs: Sequence[tuple[str, str]]
    times: Sequence[float | None]


class Keeps(Protocol):
    """A response that keeps what it was told."""

    def merge(self, recording: Recording) -> None:
        """Keep what another process has evaluated."""

    def has_answer(self, kind: str, p: Floats) -> bool:
        """Whether the answer at p (n,) is kept, or known to be none."""

    def logged(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """The answer at p (n,) if it is kept; raises `ModelError` where there is none."""


class Prefetched:
    """Parts of a search that other processes work on, and the turn of each.

    Nothing is begun before something is asked that is not known: a run that goes on finds most of
    it in its log.

    Args:
        response: keeps what they evaluate.
        where: they work.
        tasks: the parts, in their order.

    Attributes:
        turn: number of the part whose turn it is.
    """

    def __init__(self, response: Keeps, where: ResponseBeside, tasks: Sequence[SearchTask]) -> None:
        self.turn = 0
        self._response, self._where, self._tasks = response, where, tasks
        self._sent: list[int] = []
        self._answers: Iterator[Answered[Recording]] | None = None
        self._lost: dict[int, str] = {}
        self._done: set[int] = set()

    def known(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """The answer at p (n,), once the part whose turn it is has come back.

        Raises:
            ModelError: there is none.
            Interrupted: a stop was asked for.
        """
        if self._answers is None:
            self._begin()
        while self.turn in self._sent and self.turn not in self._done:
            if not self._one_more():
                break
            self._where.processes.check()
        found = self._response.logged(kind, p)
        if found is None and self.turn in self._lost:
            message = "No process computes the model at a parameter vector: the last one {}."
            raise ModelError(message.format(self._lost[self.turn]))
        return found

    def end(self) -> None:
        """What runs is of no use any more; where a stop was asked for, what it has found is."""
        if self._answers is None:
            return
        while self._where.processes.stopping and self._one_more():
            pass
        closed = getattr(self._answers, "close", None)
        if closed is not None:
            closed()

    def _begin(self) -> None:
        """Send the part whose turn it is, and those after it, as far as they ask what is new."""
        tasks = []
        for number, task in enumerate(self._tasks[self.turn :], start=self.turn):
            left = self._new(task)
            if left is not None:
                tasks.append(left)
                self._sent.append(number)
        where = self._where
        self._answers = where.processes.evaluate_ahead(tasks, where.pairs, where.times)

    def _new(self, task: SearchTask) -> SearchTask | None:
        """What of a part is not known; None for nothing."""
        if not isinstance(task, ReadingsAt):
            return task
        response = self._response
        new = [not (response.has_answer("readings", p) or response.has_answer("evaluate", p))
               for p in task.points]  # fmt: skip
        return ReadingsAt(task.points[new]) if any(new) else None

    def _one_more(self) -> bool:
        """Take the next answer; whether there was one."""
        assert self._answers is not None
        answer = next(self._answers, None)
        if answer is None:
            return False
        number = self._sent[answer.number]
        self._done.add(number)
        if answer.value is not None:
            self._response.merge(answer.value)
        elif answer.set_aside:
            self._lost[number] = answer.losses[-1] if answer.losses else "was lost"
        return True
