"""Tasks in processes of this machine, which may be killed, hang, or run out of memory.

Each worker has a pipe of its own, so that one that dies in the middle of a word harms no other. A
task whose worker is lost goes to another one; one that has cost `retries` + 1 workers is set aside.
A task that takes longer than its time limit costs its worker, too. Workers never outlive who asks:
they see the end of that process by themselves (`worker`).
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from multiprocessing import current_process, get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Generic, Self, TypeVar

from geoident.workflow.executing.executor import CORES, RETRIES, Answered, SetUp, usable_cores
from geoident.workflow.executing.family import end_family
from geoident.workflow.executing.worker import READY, VALUE, serve

T = TypeVar("T")
R = TypeVar("R")

_TICK = 0.5
"""Seconds after which limits are looked at, at the latest."""

_BAD_STARTS = 3
"""Workers that may end before they are ready, one after the other, until nobody tries again."""

_KILLED_STARTS = 30
"""The same where the last one was killed: that was somebody else, and may have an end."""

_GRACE = 5.0
"""Seconds that an idle worker is given to end."""

_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_HELD = (signal.SIGINT, signal.SIGTERM)

_SAFE, _BY_US = "PYTHONSAFEPATH", "geoident"
"""Variable that keeps Python from putting the current folder first, and our value of it."""

_STARTING = threading.Lock()
"""Processes are started one after the other: the environment that they inherit is that of all."""


@dataclass
class _Task(Generic[T]):
    number: int
    argument: T
    losses: list[str] = field(default_factory=list)


@dataclass
class _Worker(Generic[T]):
    process: SpawnProcess
    connection: Connection
    ready: bool = False
    task: _Task[T] | None = None
    began: float = 0.0


class LocalProcesses(Generic[T, R]):
    """An executor of this machine; a context, at whose end no process is left.

    Args:
        jobs: number of workers; the cores are shared out among them.
        set_up: gives, in each worker, the function that answers tasks. It is pickled.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its worker was lost.
        sharing: number of workers among which the cores are shared out, where others than these
            compute here as well; None for `jobs`.
    """

    def __init__(
        self,
        jobs: int,
        set_up: SetUp[T, R],
        *,
        time_limit: float | None = None,
        retries: int = RETRIES,
        sharing: int | None = None,
    ) -> None:
        self._jobs = jobs
        self._sharing = sharing or jobs
        self._set_up = set_up
        self._time_limit = time_limit
        self._retries = retries
        self._workers: list[_Worker[T]] = []
        self._stopping = False
        self._bad_starts = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for worker in self._workers:
            worker.connection.close()
            if worker.task is not None:
                _kill(worker)
        over = time.monotonic() + _GRACE
        for worker in self._workers:
            worker.process.join(max(0.0, over - time.monotonic()))
            if worker.process.is_alive():
                _kill(worker)
                worker.process.join()
        self._workers.clear()

    @property
    def processes(self) -> tuple[int, ...]:
        """Numbers of the processes that are there."""
        return tuple(w.process.pid for w in self._workers if w.process.pid is not None)

    def ask_to_stop(self) -> None:
        """Begin no more tasks, and let those that run end as soon as they can."""
        self._stopping = True
        for worker in tuple(self._workers):
            if worker.task is not None and worker.process.pid is not None:
                with suppress(OSError):
                    os.kill(worker.process.pid, signal.SIGTERM)

    def kill(self) -> None:
        """End all tasks at once."""
        self._stopping = True
        for worker in tuple(self._workers):
            _kill(worker)

    def run(self, tasks: Iterable[T]) -> Iterator[Answered[R]]:
        """The answers as they come, in any order.

        Args:
            tasks: arguments of the function; taken when there is a worker for them.

        Raises:
            RuntimeError: workers cannot be started.
            Exception: what the function raised.
        """
        coming = enumerate(tasks)
        again: deque[_Task[T]] = deque()
        try:
            while True:
                if not self._stopping:
                    self._give_out(coming, again)
                busy = [worker for worker in self._workers if worker.task is not None]
                if not busy:
                    break
                for answer in self._answers(busy, again):
                    if not self._stopping:  # nobody idles while the answer is looked at
                        self._give_out(coming, again)
                    yield answer
        finally:  # who asked may have lost interest
            self._drop_busy()
        for left in again:
            yield Answered(left.number, None, tuple(left.losses), stopped=True)

    def _drop_busy(self) -> None:
        """End the workers whose answers nobody waits for."""
        for worker in [worker for worker in self._workers if worker.task is not None]:
            self._workers.remove(worker)
            _kill(worker)
            worker.process.join()
            worker.connection.close()

    def _give_out(self, coming: Iterator[tuple[int, T]], again: deque[_Task[T]]) -> None:
        """Give every idle worker a task, and start workers as long as there are tasks for them."""
        idle = [worker for worker in self._workers if worker.task is None]
        while idle or len(self._workers) < self._jobs:
            if again:
                task = again.popleft()
            else:
                following = next(coming, None)
                if following is None:
                    return
                task = _Task(*following)
            worker = idle.pop() if idle else self._start()
            worker.task = task
            worker.began = time.monotonic()
            if worker.ready:
                self._send(worker)

    def _send(self, worker: _Worker[T]) -> None:
        worker.began = time.monotonic()
        with suppress(BrokenPipeError, ConnectionResetError):  # it is found to be dead in a moment
            if worker.task is not None:
                worker.connection.send(worker.task.argument)

    @cached_property
    def _told(self) -> bytes:
        """What sets a worker up, pickled once for all of them: it may hold a large mesh."""
        return pickle.dumps(self._set_up)

    def _start(self) -> _Worker[T]:
        here, there = get_context("spawn").Pipe()
        process = get_context("spawn").Process(target=serve, args=(there, self._told), daemon=True)
        with (
            _STARTING,
            cores_shared(self._sharing),
            _signals_blocked(),
            _may_have_children(),
            _no_script(),
            nothing_from_here(),
        ):
            process.start()
        there.close()
        worker: _Worker[T] = _Worker(process, here)
        self._workers.append(worker)
        return worker

    def _answers(self, busy: list[_Worker[T]], again: deque[_Task[T]]) -> Iterator[Answered[R]]:
        """What has happened: answers, lost workers, limits that are over."""
        waited: list[Any] = [w.connection for w in busy] + [w.process.sentinel for w in busy]
        happened = set(wait(waited, self._patience(busy)))
        for worker in busy:
            if worker.connection in happened or worker.process.sentinel in happened:
                found = self._heard(worker, again)
                if found is not None:
                    yield found
            elif self._too_long(worker):
                _kill(worker)
                worker.process.join()
                found = self._lost(worker, again, f"took longer than {self._time_limit:g} s")
                if found is not None:
                    yield found

    def _patience(self, busy: list[_Worker[T]]) -> float:
        if self._time_limit is None:
            return _TICK
        first = min(w.began for w in busy) + self._time_limit - time.monotonic()
        return min(_TICK, max(0.0, first))

    def _too_long(self, worker: _Worker[T]) -> bool:
        limit = self._time_limit
        return limit is not None and worker.ready and time.monotonic() - worker.began > limit

    def _heard(self, worker: _Worker[T], again: deque[_Task[T]]) -> Answered[R] | None:
        """What a worker says; a worker that is gone may have said its last word before."""
        try:
            word, value = worker.connection.recv()
        except (EOFError, OSError):
            worker.process.join()
            return self._lost(worker, again, _why(worker.process.exitcode))
        if word == READY:
            worker.ready = True
            self._bad_starts = 0
            if not self._stopping:
                self._send(worker)
                return None
            self._give_back(worker, again)
            return None
        if word != VALUE:
            raise value
        task, worker.task = worker.task, None
        assert task is not None
        seconds = time.monotonic() - worker.began
        pid = worker.process.pid or 0
        return Answered(task.number, value, tuple(task.losses), seconds=seconds, process=pid)

    def _give_back(self, worker: _Worker[T], again: deque[_Task[T]]) -> None:
        """A task that a worker has not begun when a stop was asked for."""
        if worker.task is not None:
            again.append(worker.task)
        worker.task = None

    def _lost(self, worker: _Worker[T], again: deque[_Task[T]], why: str) -> Answered[R] | None:
        """A worker is gone, and its task with it; the task is begun again, or set aside."""
        self._workers.remove(worker)
        worker.connection.close()
        task = worker.task
        assert task is not None
        if not worker.ready:
            self._bad_starts += 1
            most = _KILLED_STARTS if (worker.process.exitcode or 0) < 0 else _BAD_STARTS
            if self._bad_starts >= most and not self._stopping:
                raise RuntimeError(f"processes cannot be started: the last one {why}")
            again.append(task)  # it has not begun
            return None
        seconds, pid = time.monotonic() - worker.began, worker.process.pid or 0
        if self._stopping:
            return Answered(task.number, None, tuple(task.losses), True, seconds, pid)
        task.losses.append(why)
        if len(task.losses) <= self._retries:
            again.append(task)
            return None
        return Answered(task.number, None, tuple(task.losses), False, seconds, pid)


def _kill(worker: _Worker[T]) -> None:
    """End a process at once, with the programs that it has started."""
    if worker.process.exitcode is None:
        end_family(worker.process.pid)
    worker.process.kill()


def _why(code: int | None) -> str:
    """Why a process is gone, from its exit code.

    >>> _why(-9), _why(3)
    ('was killed (SIGKILL; out of memory?)', 'ended with exit code 3')
    """
    if code is None or code >= 0:
        return f"ended with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"was killed ({name}{'; out of memory?' if code == -signal.SIGKILL else ''})"


@contextmanager
def cores_shared(jobs: int) -> Iterator[None]:
    """Threads of libraries for a process that is started meanwhile: its share of the cores.

    What the environment says of OMP_NUM_THREADS holds for all libraries of which it says nothing:
    their own variables go before it.

    Args:
        jobs: among how many processes the cores are shared.
    """
    share = str(max(1, usable_cores() // jobs))
    names = (*_THREADS, CORES)
    before = {name: os.environ.get(name) for name in names}
    threads = os.environ.get("OMP_NUM_THREADS") or share
    os.environ.update({name: before[name] or threads for name in _THREADS})
    os.environ[CORES] = share
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def path_without_here() -> list[str]:
    """Where a process of ours looks for modules: as this one, but not in the current folder.

    That is kept only where geoident itself lies in it.
    """
    here, own = Path.cwd(), Path(__file__).parents[3]
    folders = [Path(folder).resolve() for folder in sys.path]
    return [given for given, folder in zip(sys.path, folders, strict=True)
            if folder != here or folder == own]  # fmt: skip


@contextmanager
def safe_children() -> Iterator[None]:
    """Keep processes that are started meanwhile from looking for modules in the current folder.

    Python looks there first where it is begun by ``-c`` or ``-m``, as `multiprocessing` does,
    before anybody can tell it something else.
    """
    ours = not os.environ.get(_SAFE)
    if ours:
        os.environ[_SAFE] = _BY_US
    try:
        yield
    finally:
        if ours:
            os.environ.pop(_SAFE, None)


@contextmanager
def nothing_from_here() -> Iterator[None]:
    """The same, and such a process is not told to look there by `multiprocessing` either."""
    path = sys.path
    sys.path = path_without_here()
    try:
        with safe_children():
            yield
    finally:
        sys.path = path


def environment_of_programs() -> dict[str, str]:
    """The environment for programs of users, which may well import what lies beside them."""
    return {name: value for name, value in os.environ.items() if (name, value) != (_SAFE, _BY_US)}


@contextmanager
def _no_script() -> Iterator[None]:
    """Keep a process that is started meanwhile from running the script that we are called from.

    It would run again from its first line where it does not guard itself; nothing of it is needed.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Hold signals back from a process that is started meanwhile, until it can hear them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _HELD)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _may_have_children() -> Iterator[None]:
    """Let a process be started that is a daemon itself, such as a worker of dask.

    Daemons must have no children since these would outlive them; ours do not (`worker`).
    """
    own: dict[str, object] = getattr(current_process(), "_config", {})
    daemon = own.pop("daemon", None)
    try:
        yield
    finally:
        if daemon is not None:
            own["daemon"] = daemon
