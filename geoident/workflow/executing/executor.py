"""What is asked of whoever computes independent evaluations, and what comes back.

Campaigns, several cases and the evaluations of a sampler are the same to an executor: tasks that
know nothing of each other. `LocalProcesses` computes them on this machine; another executor only
has to fulfil `Executor`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

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
        process: number of the process that answered, or was lost last; 0 where there was none.
    """

    number: int
    value: R | None
    losses: tuple[str, ...] = ()
    stopped: bool = False
    seconds: float = 0.0
    process: int = 0

    @property
    def set_aside(self) -> bool:
        """It has cost so many workers that it is not begun again."""
        return self.value is None and not self.stopped


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
    try:
        here = len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        here = os.cpu_count() or 1
    said = os.environ.get(CORES, "")
    return max(1, min(here, int(said))) if said.isdecimal() else here
