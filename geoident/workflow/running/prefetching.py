"""Parts of a search that other processes evaluate before the search asks for them (`ahead`).

What they have evaluated goes into the log of the response, as if it had been computed here. The
search asks in its own order, and waits where the part whose turn it is has not come back.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from geoident.errors import ModelError
from geoident.identify.problem.ahead import ReadingsAt, SearchTask
from geoident.model.arrays import Floats
from geoident.model.results.costs import NO_COST, Counts
from geoident.workflow.executing.executor import Answered
from geoident.workflow.running.evaluation_log import EvaluationArrays

if TYPE_CHECKING:
    from geoident.workflow.running.cached_response import CachedResponse
    from geoident.workflow.running.workers import ModelWorkers


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


@dataclass(frozen=True)
class ResponseBeside:
    """Where else a response is computed.

    Args:
        processes: that have the same model.
        pairs: channel and stage of its readings.
        times: when each was read.
    """

    processes: ModelWorkers
    pairs: Sequence[tuple[str, str]]
    times: Sequence[float | None]


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

    def __init__(
        self, response: CachedResponse, where: ResponseBeside, tasks: Sequence[SearchTask]
    ) -> None:
        self.turn = 0
        self._response, self._where, self._tasks = response, where, tasks
        self._sent: list[int] = []
        self._waited: set[int] = set()
        self._lost: dict[int, str] = {}
        self._answers: Generator[Answered[Recording], None, None] | None = None

    def known(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """The answer at p (n,), once the part whose turn it is has come back.

        Raises:
            ModelError: there is none.
            Interrupted: a stop was asked for.
        """
        if self._answers is None:
            self._answers = self._begun()
        while self.turn in self._waited and self._take_next(self._answers):
            self._where.processes.check()
        answer = self._response.logged(kind, p)
        if answer is None and self.turn in self._lost:
            message = "No process computes the model at a parameter vector: the last one {}."
            raise ModelError(message.format(self._lost[self.turn]))
        return answer

    def end(self) -> None:
        """What runs is of no use any more; where a stop was asked for, what it has found is."""
        if self._answers is not None:
            while self._where.processes.stopping and self._take_next(self._answers):
                pass
            self._answers.close()

    def _begun(self) -> Generator[Answered[Recording], None, None]:
        """Send the part whose turn it is and those after it, without points that are known."""
        tasks: list[SearchTask] = []
        for number, task in enumerate(self._tasks[self.turn :], start=self.turn):
            if isinstance(task, ReadingsAt):
                points = [p for p in task.points if not self._response.has_readings(p)]
                if not points:
                    continue
                tasks.append(ReadingsAt(np.array(points)))
            else:
                tasks.append(task)
            self._sent.append(number)
        self._waited.update(self._sent)
        where = self._where
        return where.processes.evaluate_ahead(tasks, where.pairs, where.times)

    def _take_next(self, answers: Generator[Answered[Recording], None, None]) -> bool:
        """Take the next answer; whether there was one."""
        answer = next(answers, None)
        if answer is None:
            return False
        number = self._sent[answer.number]
        self._waited.discard(number)
        if answer.value is not None:
            self._response.merge(answer.value)
        elif answer.set_aside:
            self._lost[number] = answer.losses[-1] if answer.losses else "was lost"
        return True
