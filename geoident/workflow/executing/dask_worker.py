"""What a worker of dask does with our tasks: it has them computed in processes of its own.

So a run that dies, hangs or fills the memory costs a process of ours, and not the worker; a worker
of several threads computes as many tasks at a time. The plugin comes to each worker, also to those
that join later, brings the files, and takes everything away at the end.
"""

from __future__ import annotations

import os
import pickle
import platform
import shutil
import signal
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

from distributed import Reschedule, WorkerPlugin, get_worker

from geoident.workflow.executing.environment import share_of_cores
from geoident.workflow.executing.executor import Answered, SetUp
from geoident.workflow.executing.parcel import Parcel
from geoident.workflow.executing.processes import ChildProcess
from geoident.workflow.executing.resumable import LINES, Resumable, size_of
from geoident.workflow.executing.versions import decisive_versions

_PART = 4_000_000
"""Bytes of a journal that come back at a time."""

_MOST = 64_000_000
"""Bytes of a journal that come back while its task goes on."""

_DROPPED = ("released", "cancelled", "forgotten")
"""States that a task takes which is computed while nobody waits for it any more."""


class WorkerRefused(Exception):
    """A worker cannot compute for us, and none of our tasks can be given to it."""


@dataclass(frozen=True)
class Order:
    """What all tasks of an executor have in common.

    Args:
        name: of this executor, as no other has it.
        parcel: files that they read.
        versions: where the command runs.
        set_up: gives, in each process, the function that answers tasks.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its process was lost.
        ignores_interrupt: Ctrl-C reaches workers on this machine, and is not for them.
        journals_every: seconds between looks at journals.
    """

    name: str
    parcel: Parcel
    versions: Mapping[str, str]
    set_up: SetUp[Any, Any]
    time_limit: float | None
    retries: int
    ignores_interrupt: bool
    journals_every: float


@dataclass
class _Place:
    """A folder with the files, the process that works there, and its task.

    Args:
        folder: with the files.
        current: where the process works.
        child: the process.
        task: that it computes.
        sent: bytes of each journal that have come back, or were there before.
    """

    folder: Path
    current: Path
    child: ChildProcess[Any, Any]
    task: Any = None
    sent: dict[str, int] = field(default_factory=dict)

    def begin(self, task: Any) -> None:
        self.task = task
        if isinstance(task, Resumable):
            self.sent = {
                name: size_of(self.current / name)
                if name.endswith(LINES)
                else len(task.kept.get(name, b""))
                for name in task.journals
            }

    def new_part(self, name: str) -> tuple[int, bytes]:
        """Where what was added to a journal begins, and the added bytes.

        Raises:
            OSError: it is not there.
        """
        at = self.sent[name]
        with (self.current / name).open("rb") as file:
            file.seek(at)
            content = file.read(min(_PART, _MOST - at))
        if name.endswith(LINES):
            content = content[: content.rfind(b"\n") + 1]
        return at, content


class TaskPlugin(WorkerPlugin):
    """Computes tasks of one executor in a worker of dask.

    Args:
        order: what these have in common.
    """

    def __init__(self, order: Order) -> None:
        self._order = order
        self.name = order.name
        self.problem = ""
        """Why this worker cannot compute for us; empty if it can."""

    def setup(self, worker: Any) -> None:
        """Look whether this worker can compute for us.

        Args:
            worker: of dask.
        """
        order = self._order
        self._worker = worker
        self._folder = Path(worker.local_directory) / order.name
        self._idle: list[_Place] = []
        self._busy: dict[str, _Place] = {}
        self._numbers = count()
        self._lock, self._over, self._stopping = threading.RLock(), threading.Event(), False
        if order.ignores_interrupt and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        ours, installed = order.versions, decisive_versions()
        wrong = [
            f"{n} {installed[n]} (here {ours[n]})" for n in ours if installed.get(n) != ours[n]
        ]
        missing = [name for name in order.parcel.programs if shutil.which(name) is None]
        if wrong:
            self.problem = f"has other versions: {', '.join(wrong)}"
        elif missing:
            self.problem = f"has no program '{missing[0]}'"
        threading.Thread(target=self._send_journals, daemon=True).start()

    def teardown(self, worker: Any) -> None:
        """End all processes, and remove the files.

        Args:
            worker: of dask.
        """
        self._over.set()
        self.stop(at_once=True)
        shutil.rmtree(self._folder, ignore_errors=True)

    def transition(self, key: Any, start: str, finish: str, **kwargs: Any) -> None:
        """End the process of a task that nobody waits for any more.

        Args:
            key: of the task.
            start: state that it leaves.
            finish: state that it takes.
            kwargs: what else dask tells of it.
        """
        if start == "executing" and finish in _DROPPED:
            with self._lock:
                place = self._busy.get(str(key))
                if place is not None:
                    place.child.kill()

    def stop(self, *, at_once: bool) -> None:
        """Begin no more tasks, and let those that run end soon.

        Args:
            at_once: end them now.
        """
        with self._lock:
            self._stopping = True
            for place in self._busy.values():
                if at_once:
                    place.child.kill()
                else:
                    place.child.ask_to_stop()
            if at_once:
                for place in self._idle:
                    place.child.close(0.0)
                self._idle.clear()

    def answer(self, key: str, number: int, task: Any) -> Answered[Any]:
        """Have a task computed, in any thread.

        Args:
            key: of dask.
            number: of the task.
            task: argument of the function.

        Raises:
            WorkerRefused: this worker cannot.
            Exception: what the function raised.
        """
        if self.problem:
            raise WorkerRefused(self.problem)
        with self._lock:
            if self._stopping:
                return Answered(number, None, stopped=True)
            place = self._idle.pop() if self._idle else self._new_place()
            place.begin(task)
            self._busy[key] = place
        try:
            return place.child.answer(number, task)
        finally:
            with self._lock:
                del self._busy[key]
                dropped = place.child.stopped or self._stopping
                if not dropped:
                    self._idle.append(place)
            if dropped:
                place.child.close(0.0)
                shutil.rmtree(place.folder, ignore_errors=True)

    def _new_place(self) -> _Place:
        order = self._order
        try:
            folder = self._folder / str(next(self._numbers))
            unpacked = order.parcel.unpack(folder)
        except OSError as error:
            raise WorkerRefused(f"cannot take the files of the case: {error}") from error
        child: ChildProcess[Any, Any] = ChildProcess(
            pickle.dumps(partial(_set_up_in, str(unpacked), order.set_up)),
            time_limit=order.time_limit,
            retries=order.retries,
            environment=share_of_cores(int(self._worker.state.nthreads)),
        )
        return _Place(folder, unpacked, child)

    def _send_journals(self) -> None:
        """Send what tasks add to their journals, in a thread of its own."""
        while not self._over.wait(self._order.journals_every):
            with self._lock:
                busy = list(self._busy.items())
            for key, place in busy:
                for name in tuple(place.sent):
                    with suppress(OSError):
                        at, content = place.new_part(name)
                        if content:
                            event = {"key": key, "journal": name, "at": at, "content": content}
                            self._worker.log_event(self.name, event)
                            place.sent[name] = at + len(content)


def _set_up_in(folder: str, set_up: SetUp[Any, Any]) -> Callable[[Any], Any]:
    """In a process of its own: work in a folder as if it were that of the command."""
    os.chdir(folder)
    return set_up()


def computed(name: str, number: int, task: Any) -> Answered[Any]:
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
    if not isinstance(plugin, TaskPlugin):
        raise Reschedule
    key = str(worker.get_current_task())
    worker.log_event(name, {"key": key, "begun": f"{worker.address} on {platform.node()}"})
    return plugin.answer(key, number, task)


async def stop_tasks(name: str, dask_worker: Any = None) -> None:
    """Called by dask on each worker: lets the tasks of an executor end.

    It is asynchronous since dask waits for the end of any other function.

    Args:
        name: of the executor.
        dask_worker: the worker, which dask fills in.
    """
    plugin = dask_worker.plugins.get(name)
    if isinstance(plugin, TaskPlugin):
        plugin.stop(at_once=False)


def problem_of(name: str, dask_worker: Any = None) -> str:
    """Called by dask on each worker: why it cannot compute for an executor; empty if it can.

    Args:
        name: of the executor.
        dask_worker: the worker, which dask fills in.
    """
    plugin = dask_worker.plugins.get(name)
    return plugin.problem if isinstance(plugin, TaskPlugin) else ""
