"""Tasks in processes of this machine, which may be killed, hang, or run out of memory.

A task whose process is lost is given to a new one; one that has cost `retries` + 1 processes is set
aside. A task that takes longer than its time limit costs its process, too. Processes never outlive
the one that started them: they see its end by themselves (`worker`).
"""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import nullcontext, suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from geoident.workflow.executing.descendants import kill_with_descendants
from geoident.workflow.executing.environment import (
    environment_of_children,
    path_without_here,
    share_of_cores,
)
from geoident.workflow.executing.executor import RETRIES, Answered, SetUp
from geoident.workflow.executing.worker import RAISED

T = TypeVar("T")
R = TypeVar("R")

_BAD_STARTS = 3
"""Processes that may end by themselves before they are ready, for one task."""

_KILLED_STARTS = 30
"""The same where somebody killed them, who may have freed memory meanwhile."""

_GRACE = 5.0
"""Seconds that an idle process is given to end."""

_TICK = 0.5
"""Seconds after which a wait for answers is interrupted, so that signals are handled everywhere."""

_BEGIN = (
    "import sys; sys.path = {!r}; from geoident.workflow.executing.worker import serve; serve()"
)
"""What a process begins with. PYTHONPATH would reach programs that tasks start, too."""


class _Lost(Exception):
    """A process has ended before it answered."""


class ChildProcess(Generic[T, R]):
    """A process that answers tasks one by one, started when needed, and again after it was lost.

    Args:
        set_up: pickled, what gives the function that answers tasks; it may hold a large mesh.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its process was lost.
        environment: variables beside those of this process.
        printed: file to which what tasks print is added; None for our own standard error.
    """

    def __init__(
        self,
        set_up: bytes,
        *,
        time_limit: float | None = None,
        retries: int = RETRIES,
        environment: Mapping[str, str],
        printed: Path | None = None,
    ) -> None:
        self._set_up, self._time_limit, self._retries = set_up, time_limit, retries
        self._environment, self._printed = environment, printed
        self._process: subprocess.Popen[bytes] | None = None
        self.stopped = False
        """No more tasks are begun: a stop was asked for, or it was killed."""

    @property
    def pid(self) -> int | None:
        """Number of the process; None where there is none."""
        return None if self._process is None else self._process.pid

    def answer(self, number: int, task: T) -> Answered[R]:
        """Have a task computed, again where its process is lost.

        Args:
            number: of the task.
            task: argument of the function.

        Raises:
            RuntimeError: no process can be started.
            Exception: what the function raised.
        """
        losses: list[str] = []
        bad_starts = 0
        request = pickle.dumps(task)
        seconds = 0.0
        while not self.stopped:
            try:
                self._start()
            except _Lost as lost:
                bad_starts += 1
                most = _KILLED_STARTS if "killed" in str(lost) else _BAD_STARTS
                if bad_starts >= most and not self.stopped:
                    raise RuntimeError(
                        f"processes cannot be started: the last one {lost}"
                    ) from lost
                continue
            if self.stopped:
                break
            began = time.monotonic()
            try:
                value = self._call(request)
            except _Lost as lost:
                seconds = time.monotonic() - began
                if self.stopped:
                    break
                losses.append(str(lost))
                if len(losses) > self._retries:
                    return Answered(number, None, tuple(losses), seconds=seconds)
            else:
                return Answered(number, value, tuple(losses), seconds=time.monotonic() - began)
        return Answered(number, None, tuple(losses), stopped=True, seconds=seconds)

    def _start(self) -> None:
        """Start a process, unless one is there.

        Raises:
            _Lost: it ended before it was ready.
            Exception: what the set-up raised.
        """
        if self._process is not None and self._process.poll() is None:
            return
        self.close(0.0)
        with nullcontext() if self._printed is None else self._printed.open("ab") as printed:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _BEGIN.format(path_without_here())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=printed,
                env={**environment_of_children(), **self._environment},
                start_new_session=True,  # Ctrl-C reaches only us
            )
        try:
            self._exchange(self._process, self._set_up)
        except BaseException:
            _kill(self._process)
            raise

    def _call(self, request: bytes) -> R:
        """What the function gives.

        Raises:
            _Lost: the process has ended, or took too long.
            Exception: what the function raised.
        """
        process, limit, late = self._process, self._time_limit, threading.Event()
        assert process is not None

        def end() -> None:
            late.set()
            _kill(process)

        timer = threading.Timer(limit or 0.0, end)
        if limit is not None:
            timer.start()
        try:
            value: R = self._exchange(process, request)
        except _Lost:
            if not late.is_set():
                raise
        finally:
            timer.cancel()
        if late.is_set():
            raise _Lost(f"took longer than {limit:g} s")
        return value

    def _exchange(self, process: subprocess.Popen[bytes], request: bytes) -> Any:
        """What comes back for a request.

        Raises:
            _Lost: the process has ended.
            Exception: what was raised there.
        """
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            pickle.dump(request, process.stdin)
            process.stdin.flush()
            word, value = pickle.load(process.stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            _kill(process)
            raise _Lost(_ending(process.wait())) from None
        if word == RAISED:
            raise value
        return value

    def ask_to_stop(self) -> None:
        """Begin no more tasks, and let the one that runs end soon."""
        self.stopped = True
        if self._process is not None:
            self._process.terminate()

    def kill(self) -> None:
        """End the process and all that it has started at once, and begin no more tasks."""
        self.stopped = True
        if self._process is not None:
            _kill(self._process)

    def close(self, seconds: float = _GRACE) -> None:
        """End the process.

        Args:
            seconds: that it is given to end by itself.
        """
        process, self._process = self._process, None
        if process is None:
            return
        with suppress(OSError):
            assert process.stdin is not None
            process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
        _kill(process)
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a process at once, with the programs that it has started."""
    if process.poll() is None:
        kill_with_descendants(process.pid)
        process.kill()


def _ending(code: int) -> str:
    """How a process has ended, from its exit code.

    >>> _ending(-9), _ending(3)
    ('was killed (SIGKILL; out of memory?)', 'ended with exit code 3')
    """
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"was killed ({name}{'; out of memory?' if code == -signal.SIGKILL else ''})"


class LocalProcesses(Generic[T, R]):
    """An executor of this machine; a context, at whose end no process is left.

    Args:
        jobs: number of processes; the cores are shared out among them.
        set_up: gives, in each process, the function that answers tasks. It is pickled.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its process was lost.
    """

    def __init__(
        self,
        jobs: int,
        set_up: SetUp[T, R],
        *,
        time_limit: float | None = None,
        retries: int = RETRIES,
    ) -> None:
        self._jobs, self._set_up = jobs, set_up
        self._limits: dict[str, Any] = {"time_limit": time_limit, "retries": retries}
        self._idle: list[ChildProcess[T, R]] = []
        self._busy: list[ChildProcess[T, R]] = []
        self._stopping = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for child in self._idle:
            child.close()
        self._idle.clear()

    @property
    def workers(self) -> int:
        """Number of tasks that are computed at a time."""
        return self._jobs

    @property
    def processes(self) -> tuple[int, ...]:
        """Numbers of the processes that are there."""
        return tuple(c.pid for c in (*self._idle, *self._busy) if c.pid is not None)

    def ask_to_stop(self) -> None:
        """Begin no more tasks, and let those that run end as soon as they can."""
        self._stopping = True
        for child in tuple(self._busy):
            child.ask_to_stop()

    def kill(self) -> None:
        """End all tasks at once."""
        self._stopping = True
        for child in tuple(self._busy):
            child.kill()

    def run(self, tasks: Iterable[T]) -> Generator[Answered[R], None, None]:
        """The answers as they come, in any order.

        Args:
            tasks: arguments of the function; taken when there is a process for them.

        Raises:
            RuntimeError: processes cannot be started.
            Exception: what the function raised.
        """
        coming = enumerate(tasks)
        running: dict[Future[Answered[R]], ChildProcess[T, R]] = {}

        def give_out() -> None:
            while not self._stopping and len(running) < self._jobs:
                task = next(coming, None)
                if task is None:
                    return
                child = self._idle.pop() if self._idle else self._new_child()
                self._busy.append(child)
                running[threads.submit(child.answer, *task)] = child

        threads = ThreadPoolExecutor(self._jobs)
        try:
            give_out()
            while running:
                done, _ = wait(running, timeout=_TICK, return_when=FIRST_COMPLETED)
                for future in done:
                    child = running.pop(future)
                    self._busy.remove(child)
                    self._idle.append(child)
                give_out()  # no process idles while an answer is looked at
                for future in done:
                    yield future.result()
        finally:  # nobody waits for the answers that are left
            for child in running.values():
                child.kill()
            threads.shutdown()
            for child in running.values():
                self._busy.remove(child)
                child.close(0.0)

    @cached_property
    def _pickled(self) -> bytes:
        return pickle.dumps(self._set_up)

    def _new_child(self) -> ChildProcess[T, R]:
        return ChildProcess(self._pickled, environment=share_of_cores(self._jobs), **self._limits)
