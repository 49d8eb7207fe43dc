"""What a worker of dask does with our tasks: it has them computed in processes of its own.

So a run that dies, hangs or fills the memory costs a process of ours, and not the worker; a worker
of several threads computes as many tasks at a time. The plugin brings the files, once to each
worker, also to those that come later, and takes everything away at the end.
"""

from __future__ import annotations

import platform
import shutil
import signal
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from distributed import Reschedule, WorkerPlugin, get_worker

from geoident import __version__
from geoident.workflow.executing.executor import Answered
from geoident.workflow.executing.growth import AddedPart, GrowthWatch, Resumable, found_in
from geoident.workflow.executing.parcel import Parcel, folder_of_process
from geoident.workflow.executing.processes import LocalProcesses

BEGUN = "begun"
"""Word of the event that tells that a task was begun."""

GROWN = "grown"
"""Word of the event that tells what a task has added to its files."""

_DROPPED = ("released", "cancelled", "forgotten")
"""States that a task takes which is computed while nobody waits for it any more."""

SetUpIn = Callable[[Path], Callable[[Any], Any]]
"""Is called once in each process with the folder of the files; the function answers tasks."""


class WorkerRefused(Exception):
    """A worker cannot compute for us, and none of our tasks can be given to it."""


def own_versions() -> dict[str, str]:
    """Versions on which numbers, or what is sent, depend."""
    found = {"geoident": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "h5py"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found


def differences(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    """Which versions differ, in words; empty if none does.

    >>> differences({"numpy": "2.4.1", "scipy": "1.17"}, {"numpy": "2.3.0", "scipy": "1.17"})
    'numpy 2.3.0 (here 2.4.1)'
    """
    return ", ".join(
        f"{name} {theirs.get(name) or 'missing'} (here {value})"
        for name, value in ours.items()
        if theirs.get(name) != value
    )


@dataclass(frozen=True)
class Order:
    """What all tasks of an executor have in common.

    Args:
        name: of this executor, as no other has it.
        parcel: files that they read.
        versions: of whoever asks.
        set_up: gives, in each process, the function that answers tasks.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its process was lost.
        deaf: workers belong to whoever asks, so that Ctrl-C is not for them.
        keep_every: seconds between looks at files that grow.
    """

    name: str
    parcel: Parcel
    versions: Mapping[str, str]
    set_up: SetUpIn
    time_limit: float | None
    retries: int
    deaf: bool = False
    keep_every: float = 10.0


@dataclass
class _Busy:
    pool: LocalProcesses[Any, Any]
    dropped: bool = False


@dataclass
class _Pools:
    """Processes that wait for a task, and those that have one, by the key of it."""

    idle: list[LocalProcesses[Any, Any]] = field(default_factory=list)
    busy: dict[str, _Busy] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)
    stopping: bool = False


class Relay(WorkerPlugin):
    """Takes part in a worker of dask from its beginning to its end, or that of the executor.

    Args:
        order: what is to be done there.
    """

    def __init__(self, order: Order) -> None:
        self._order = order
        self.name = order.name
        self.problem = ""
        self._folder = Path()
        self._threads = 1
        self._pools: _Pools | None = None

    def setup(self, worker: Any) -> None:
        """Lay out the files.

        Args:
            worker: of dask.
        """
        self._threads = int(worker.state.nthreads)
        self._folder = Path(worker.local_directory) / f"geoident-{self._order.parcel.digest[:16]}"
        self._pools = _Pools()
        if self._order.deaf and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        wrong = differences(self._order.versions, own_versions())
        if wrong:
            self.problem = f"has other versions: {wrong}"
            return
        missing = [name for name in self._order.parcel.programs if shutil.which(name) is None]
        if missing:
            self.problem = f"has no program '{missing[0]}'"
            return
        try:
            self._order.parcel.unpack(self._folder)
        except (OSError, ValueError) as error:
            self.problem = f"cannot take the files of the case: {error}"

    def teardown(self, worker: Any) -> None:
        """End all processes, and remove the files.

        Args:
            worker: of dask.
        """
        self.stop(at_once=True)
        for folder in self._folder.parent.glob(f"{self._folder.name}.of.*"):
            shutil.rmtree(folder, ignore_errors=True)
        if all(other is self or _folder_of(other) != self._folder
               for other in worker.plugins.values()):  # fmt: skip
            shutil.rmtree(self._folder, ignore_errors=True)

    def transition(self, key: Any, start: str, finish: str, **kwargs: Any) -> None:
        """End the process of a task that nobody waits for any more.

        Args:
            key: of the task.
            start: state that it leaves.
            finish: state that it takes.
            kwargs: what else dask says of it.
        """
        if start == "executing" and finish in _DROPPED and self._pools is not None:
            with self._pools.lock:
                busy = self._pools.busy.get(str(key))
                if busy is not None:
                    busy.dropped = True
                    busy.pool.kill()

    def stop(self, *, at_once: bool) -> None:
        """Begin no more tasks, and let those that run end soon.

        Args:
            at_once: end them now.
        """
        if self._pools is None:
            return
        with self._pools.lock:
            self._pools.stopping = True
            for busy in self._pools.busy.values():
                if at_once:
                    busy.dropped = True
                    busy.pool.kill()
                else:
                    busy.pool.ask_to_stop()
            if at_once:
                for pool in self._pools.idle:
                    pool.kill()
                    pool.__exit__(None, None, None)
                self._pools.idle.clear()

    def answer(
        self, key: str, number: int, task: Any, tell: Callable[[AddedPart], None]
    ) -> Answered[Any]:
        """Have a task computed.

        Args:
            key: of dask.
            number: of the task.
            task: argument of the function.
            tell: is told of what its files hold more, in another thread.

        Raises:
            WorkerRefused: this worker cannot.
            Exception: what the function raised.
        """
        pools = self._pools
        if self.problem or pools is None:
            raise WorkerRefused(self.problem)
        with pools.lock:
            if pools.stopping:
                return stopped_before(number)
            pool = pools.idle.pop() if pools.idle else self._new_pool()
            busy = pools.busy[key] = _Busy(pool)
        done = False
        try:
            with self._watch(number, task, pool, tell):
                answer = self._computed(task, busy)
            done = True
        finally:
            with pools.lock:
                del pools.busy[key]
                keep = done and not busy.dropped and not pools.stopping
                if keep:
                    pools.idle.append(pool)
            if not keep:
                pool.__exit__(None, None, None)
        return stopped_before(number) if answer is None else replace(answer, number=number)

    def _watch(
        self,
        number: int,
        task: Any,
        pool: LocalProcesses[Any, Any],
        tell: Callable[[AddedPart], None],
    ) -> GrowthWatch:
        return GrowthWatch(
            number, task, lambda: pool.processes, self._working, tell, self._order.keep_every
        )

    def _working(self, process: int) -> Path:
        """Where a process works."""
        return folder_of_process(self._folder, process) / self._order.parcel.here

    def _computed(self, task: Any, busy: _Busy) -> Answered[Any] | None:
        """Have a task computed, again where its process is lost; None if it was stopped before."""
        losses: tuple[str, ...] = ()
        while True:
            answers = list(busy.pool.run([task]))
            if not answers:
                return None
            losses = (*losses, *answers[0].losses)
            answer = replace(answers[0], losses=losses)
            if not answer.set_aside or len(losses) > self._order.retries or busy.dropped:
                return answer
            task = self._resumed(task, answer.process)

    def _resumed(self, task: Any, process: int) -> Any:
        """A task with what the process that was lost over it has left."""
        if isinstance(task, Resumable):
            task = task.resumed(found_in(task, self._working(process)))
        shutil.rmtree(folder_of_process(self._folder, process), ignore_errors=True)
        return task

    def _new_pool(self) -> LocalProcesses[Any, Any]:
        order = self._order
        return LocalProcesses(
            1,
            partial(order.set_up, self._folder),
            time_limit=order.time_limit,
            retries=0,
            sharing=self._threads,
        )


def stopped_before(number: int) -> Answered[Any]:
    """The answer of a task that was never begun."""
    return Answered(number, None, stopped=True)


def _folder_of(plugin: object) -> Path | None:
    return plugin._folder if isinstance(plugin, Relay) else None


def relayed(name: str, number: int, task: Any) -> Answered[Any]:
    """Called by dask in a thread of a worker: has a task computed there.

    Args:
        name: of the executor.
        number: of the task.
        task: argument of its function.

    Raises:
        Reschedule: this worker does not know of the executor yet.
        Exception: what the function raised.
    """
    worker = get_worker()
    plugin = worker.plugins.get(name)
    if not isinstance(plugin, Relay):
        raise Reschedule
    key = str(worker.get_current_task())
    worker.log_event(
        name, {BEGUN: number, "key": key, "worker": worker.address, "host": platform.node()}
    )

    def tell(growth: AddedPart) -> None:
        worker.log_event(name, {GROWN: growth.number, "key": key, "file": growth.file,
                                "at": growth.at, "content": growth.content})  # fmt: skip

    return plugin.answer(key, number, task, tell)


async def stop_relay(name: str, at_once: bool, dask_worker: Any = None) -> None:
    """Called by dask on each worker: lets the tasks of an executor end.

    It is asynchronous since dask waits for the end of any other function.

    Args:
        name: of the executor.
        at_once: end them now.
        dask_worker: the worker, which dask fills in.
    """
    plugin = dask_worker.plugins.get(name)
    if isinstance(plugin, Relay):
        plugin.stop(at_once=at_once)


def problem_of(name: str, dask_worker: Any = None) -> str:
    """Called by dask on each worker: why it cannot compute for an executor; empty if it can.

    Args:
        name: of the executor.
        dask_worker: the worker, which dask fills in.
    """
    plugin = dask_worker.plugins.get(name)
    return plugin.problem if isinstance(plugin, Relay) else ""
