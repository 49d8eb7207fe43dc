"""What is asked of whoever computes independent evaluations, and what comes back.

Campaigns, several cases and the evaluations of a sampler are the same to an executor: tasks that
know nothing of each other. `LocalProcesses` computes them on this machine; another executor only
has to fulfil `Executor`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

from geoident.processors import processors

T_contra = TypeVar("T_contra", contravariant=True)
R = TypeVar("R")

RETRIES = 2
"""Times that a task is begun again after its worker was lost."""


@dataclass(frozen=True)
class Answered(Generic[R]):
    """What became of a task.

    Args:
        number: of the task, in the order in which tasks were given.
        value: what its function returned; None where there is nothing.
        losses: of each worker that was lost over it, why.
        stopped: it was cut short, or never begun, as a stop was asked for.
        seconds: from its last beginning to its end.
    """

    number: int
    value: R | None
    losses: tuple[str, ...] = ()
    stopped: bool = False
    seconds: float = 0.0

    @property
    def set_aside(self) -> bool:
        """It has cost so many workers that it is not begun again."""
        return self.value is None and not self.stopped

    @property
    def why_set_aside(self) -> str:
        """Why there is no value, a clause, where processes were lost again and again."""
        return f"it has cost {len(self.losses)} processes, and the last one {self.losses[-1]}"


class Executor(Protocol[T_contra, R]):
    """Computes independent tasks."""

    def run(self, tasks: Iterable[T_contra]) -> Iterator[Answered[R]]:
        """The answers as they come, in any order.

        Args:
            tasks: arguments of the function; taken when there is a worker for them.
        """

    def ask_to_stop(self) -> None:
        """Begin no more tasks, and let those that run end as soon as they can."""

    def kill(self) -> None:
        """End all tasks at once."""


SetUp = Callable[[], Callable[[T_contra], R]]
"""Is called once in each worker, and gives the function that answers its tasks."""


class BegunExecutor(Executor[T_contra, R], Protocol[T_contra, R]):
    """An executor with workers of its own: a context, at whose end none is left."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    @property
    def workers(self) -> int:
        """Number of tasks that are computed at a time."""


S_contra = TypeVar("S_contra", contravariant=True)
A = TypeVar("A")


class Converted(Generic[S_contra, T_contra, R, A]):
    """An executor by another one, whose tasks and answers look otherwise.

    Args:
        executor: computes.
        sent: makes a task of it.
        kept: makes an answer of what it answers; called as answers come.
    """

    def __init__(
        self,
        executor: Executor[T_contra, A],
        sent: Callable[[S_contra], T_contra],
        kept: Callable[[A], R],
    ) -> None:
        self._executor, self._sent, self._kept = executor, sent, kept

    def run(self, tasks: Iterable[S_contra]) -> Iterator[Answered[R]]:
        """The answers as they come, in any order.

        Args:
            tasks: taken when there is a worker for them.

        Raises:
            Exception: what `kept` has raised.
        """
        for answer in self._executor.run(map(self._sent, tasks)):
            value = None if answer.value is None else self._kept(answer.value)
            yield Answered(answer.number, value, answer.losses, answer.stopped, answer.seconds)

    def ask_to_stop(self) -> None:
        """Begin no more tasks, and let those that run end as soon as they can."""
        self._executor.ask_to_stop()

    def kill(self) -> None:
        """End all tasks at once."""
        self._executor.kill()


def in_order(answers: Iterable[Answered[R]]) -> Iterator[Answered[R]]:
    """Answers in the order of their tasks, each as soon as all before it are there.

    >>> [a.number for a in in_order([Answered(1, "b"), Answered(0, "a"), Answered(2, "c")])]
    [0, 1, 2]
    """
    early: dict[int, Answered[R]] = {}
    following = 0
    for answer in answers:
        early[answer.number] = answer
        while following in early:
            yield early.pop(following)
            following += 1


CORES = "GEOIDENT_CORES"
"""Variable of the environment with the number of cores that may be used, where it is not all."""


def usable_cores() -> int:
    """Cores that this process may use: those of the machine, or its share of them."""
    cores = processors()
    limit = os.environ.get(CORES, "")
    return max(1, min(cores, int(limit))) if limit.isdecimal() else cores
