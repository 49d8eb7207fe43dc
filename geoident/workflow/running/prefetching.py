"""Parts of a search that other processes evaluate before the search asks for them (`ahead`).

What they have evaluated goes into the log of the response, as if it had been computed here. The
search asks in its own order, and waits where the part whose turn it is has not come back.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.identify.problem.ahead import ReadingsAt, SearchTask
from geoident.model.arrays import Floats
from geoident.workflow.executing.executor import Answered
from geoident.workflow.running.evaluation_log import Recording
from geoident.workflow.running.workers import ModelWorkers


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
        where: they work.
        tasks: the parts, in their order.
        is_known: whether the readings at p (n,) are known.
        take: keeps what a process has evaluated.
        check: is called while somebody waits; raises to stop the run.

    Attributes:
        turn: number of the part whose turn it is.
    """

    def __init__(
        self,
        where: ResponseBeside,
        tasks: Sequence[SearchTask],
        *,
        is_known: Callable[[Floats], bool],
        take: Callable[[Recording], None],
        check: Callable[[], None],
    ) -> None:
        self.turn = 0
        self._where, self._tasks = where, tasks
        self._is_known, self._take, self._check = is_known, take, check
        self._sent: list[int] = []
        self._waited: set[int] = set()
        self._lost: dict[int, str] = {}
        self._answers: Generator[Answered[Recording], None, None] | None = None

    def wait(self) -> None:
        """Return when the part whose turn it is has come back, or was lost.

        Raises:
            Interrupted: a stop was asked for.
        """
        if self._answers is None:
            self._answers = self._begun()
        while self.turn in self._waited and self._take_next(self._answers):
            self._check()

    def require_answer(self) -> None:
        """What the part whose turn it is has not evaluated is to be computed here.

        Raises:
            ModelError: the part was lost with all the processes that have worked on it.
        """
        if self.turn in self._lost:
            message = "No process computes the model at a parameter vector: the last one {}."
            raise ModelError(message.format(self._lost[self.turn]))

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
                points = [p for p in task.points if not self._is_known(p)]
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
            self._take(answer.value)
        elif answer.set_aside:
            self._lost[number] = answer.losses[-1]
        return True
