"""A part of the work in a process that is forked, while this one goes on.

What it finds comes back pickled. It says nothing, asks nobody, and what it cannot do this process
does itself: a failure there is none here, so errors are told once, by who began.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Generic, Self, TypeVar

FoundBeside = TypeVar("FoundBeside")


def processors() -> int:
    """How many processors this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def may_fork() -> bool:
    """Whether a forked process goes on safely: on Linux, from a program of one thread."""
    return sys.platform == "linux" and threading.active_count() == 1


class WorkBeside(Generic[FoundBeside]):
    """Work that a forked process does meanwhile, where there is a processor for it.

    Used as a context: at its end the process is gone.

    Args:
        work: what is done there; its answer must not be None.
    """

    def __init__(self, work: Callable[[], FoundBeside | None]) -> None:
        self._process, self._answer = 0, -1
        if processors() < 2 or not may_fork():
            return
        try:
            reads, writes = os.pipe()
        except OSError:  # no more files, no more processes, no memory: the work is done here
            return
        try:
            with warnings.catch_warnings():
                # Threads of libraries of linear algebra, which know how to survive a fork.
                warnings.simplefilter("ignore", DeprecationWarning)
                process = os.fork()
        except OSError:
            os.close(reads)
            os.close(writes)
            return
        if not process:
            _work(work, reads, writes)
        os.close(writes)
        self._process, self._answer = process, reads

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process:
            with suppress(ProcessLookupError):
                os.kill(self._process, signal.SIGKILL)
            self._end()

    def found(self) -> FoundBeside | None:
        """What was found there, asked once; None where it was not, or nobody looked for it."""
        if not self._process:
            return None
        with os.fdopen(os.dup(self._answer), "rb") as answer:
            pickled = answer.read()
        if self._end() != 0:
            return None
        answer_of: FoundBeside = pickle.loads(pickled)
        return answer_of

    def _end(self) -> int:
        """Wait for the end of the process; its exit status."""
        os.close(self._answer)
        process, self._process = self._process, 0
        return os.waitpid(process, 0)[1]


def _work(work: Callable[[], FoundBeside | None], reads: int, writes: int) -> None:
    """What the forked process does; it ends here, without the ends of its parent."""
    status = 1
    try:
        gc.disable()  # it ends soon
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.close(reads)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nothing, stream)
        found = work()
        if found is not None:
            with os.fdopen(writes, "wb") as answer:
                pickle.dump(found, answer, pickle.HIGHEST_PROTOCOL)
            status = 0
    finally:
        os._exit(status)
