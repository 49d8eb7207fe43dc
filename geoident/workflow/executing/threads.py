"""Tasks of which each starts a program of its own and waits for it: a thread for each is enough."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Generic, TypeVar

from geoident.workflow.executing.executor import Answered

T = TypeVar("T")
R = TypeVar("R")

_MOMENT = 0.2
"""Seconds between two looks whether the answers are still wanted."""


class WaitingThreads(Generic[T, R]):
    """An executor in threads of this process.

    Args:
        jobs: number of threads.
        function: answers a task; what it raises ends all.
        check: is called every moment while somebody waits; raises to end all.
        end: ends what the tasks that run have started.
    """

    def __init__(
        self,
        jobs: int,
        function: Callable[[T], R],
        *,
        check: Callable[[], None],
        end: Callable[[], None],
    ) -> None:
        self._jobs, self._function, self._check, self._end = jobs, function, check, end
        self._futures: dict[Future[R], int] = {}

    def run(self, tasks: Iterable[T]) -> Generator[Answered[R], None, None]:
        """The answers as they come, in any order; tasks go on while nobody asks for one.

        Args:
            tasks: arguments of the function.

        Raises:
            Exception: what the function or the check has raised.
        """
        self._check()
        queued = list(tasks)
        with ThreadPoolExecutor(min(self._jobs, max(len(queued), 1))) as pool:
            self._futures = {pool.submit(self._function, one): n for n, one in enumerate(queued)}
            left = set(self._futures)
            try:
                while left:
                    done, left = wait(left, timeout=_MOMENT, return_when=FIRST_COMPLETED)
                    for future in done:
                        if not future.cancelled():
                            yield Answered(self._futures[future], future.result())
                        else:
                            yield Answered(self._futures[future], None, stopped=True)
                    self._check()
            finally:
                if left:
                    self.kill()

    def ask_to_stop(self) -> None:
        """Begin no more tasks."""
        for future in self._futures:
            future.cancel()

    def kill(self) -> None:
        """End all tasks at once."""
        self.ask_to_stop()
        self._end()
