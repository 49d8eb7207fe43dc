"""Tasks on a cluster of dask: sent to its scheduler, computed on its workers (`dask_worker`).

Dask distributes the tasks, begins those of lost workers again and brings answers back. Added here
are how many workers a task may cost, what has come back of its journals when it is begun again, and
what to do when the scheduler is lost.
"""

from __future__ import annotations

import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from distributed import KilledWorker

from geoident.model.cluster import Cluster
from geoident.workflow.executing.connection import Connection
from geoident.workflow.executing.dask_worker import Order, WorkerRefused, computed, stop_tasks
from geoident.workflow.executing.executor import RETRIES, Answered, SetUp, usable_cores
from geoident.workflow.executing.parcel import Parcel
from geoident.workflow.executing.resumable import Resumable, add_part
from geoident.workflow.executing.versions import decisive_versions

T = TypeVar("T")
R = TypeVar("R")

_TICK = 0.5
"""Seconds after which the scheduler is looked at, at the latest."""

_AGAIN = 2.0
"""Seconds after which workers are asked again to stop, since some may have joined in between."""

_FETCH = 30.0
"""Seconds that an answer may take to come."""

_AHEAD = 8
"""Tasks that are sent for each thread of a worker, so that none waits for us to send one."""


@dataclass
class _Sent(Generic[T]):
    """A task that was sent.

    Args:
        number: of the task.
        task: the argument.
        losses: of each worker that was lost over it, why.
        journals: that have come back since it was sent.
        worker: that has begun it; empty before.
        began: when, s.
        future: its answer.
    """

    number: int
    task: T
    losses: list[str] = field(default_factory=list)
    journals: set[str] = field(default_factory=set)
    worker: str = ""
    began: float = 0.0
    future: Any = None

    def add_loss(self) -> None:
        """Its worker was lost."""
        if self.worker:
            self.losses.append(f"ended with its worker {self.worker}")

    def unanswered(self, *, stopped: bool = False) -> Answered[Any]:
        seconds = time.monotonic() - self.began if stopped and self.worker else 0.0
        return Answered(self.number, None, tuple(self.losses), stopped, seconds)


class DaskCluster(Generic[T, R]):
    """An executor on a cluster of dask; a context, at whose end nothing of ours is left there.

    Journals of tasks (`Resumable`) are kept under the same paths here while the tasks go on.

    Args:
        cluster: which one.
        set_up: gives, in a process of a worker, the function that answers tasks; the process works
            where the files lie, as if it were here. It is pickled.
        parcel: files that tasks read.
        jobs: number of workers, where they are started here.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its process or its worker was lost.
        tell: is told what people should know.
        check: is called every moment while somebody waits for an answer; raises to end all.
    """

    journals_every = 10.0
    """Seconds between looks at journals."""

    def __init__(
        self,
        cluster: Cluster,
        set_up: SetUp[T, R],
        parcel: Parcel,
        *,
        jobs: int | None = None,
        time_limit: float | None = None,
        retries: int = RETRIES,
        tell: Callable[[str], None] = lambda message: None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self._name, self._retries = f"geoident-{uuid.uuid4().hex[:12]}", retries
        order = Order(
            self._name, parcel, decisive_versions(), set_up, time_limit, retries,
            ignores_interrupt=cluster.local, journals_every=self.journals_every,
        )  # fmt: skip
        self._happened: SimpleQueue[Any] = SimpleQueue()
        self._link = Connection(
            cluster, order, jobs or usable_cores(), lambda event: self._happened.put(event[1]), tell
        )
        self._check = check
        self._out: dict[int, _Sent[T]] = {}
        self._again: deque[_Sent[T]] = deque()
        self._stopping = self._killing = False
        self._stop_sent = -_AGAIN

    def __enter__(self) -> Self:
        self._link.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._link.close()

    @property
    def workers(self) -> int:
        """Number of tasks that are computed at a time."""
        return self._link.threads

    def ask_to_stop(self) -> None:
        """Begin no more tasks, and let those that run end as soon as they can."""
        self._stopping = True
        self._happened.put(None)

    def kill(self) -> None:
        """End all tasks at once."""
        self._killing = True
        self.ask_to_stop()

    def run(self, tasks: Iterable[T]) -> Iterator[Answered[R]]:
        """The answers as they come, in any order.

        Args:
            tasks: arguments of the function; taken when there is a worker for them.

        Raises:
            LostCluster: the scheduler has gone and did not come back.
            InputError: a worker cannot compute for us.
            Exception: what the function raised.
        """
        coming = enumerate(tasks)
        try:
            while not self._killing:
                if self._stopping:
                    self._stop_workers()
                else:
                    self._check()
                    self._send(coming)
                if not self._out:
                    break
                futures = []
                for event in self._events():
                    if isinstance(event, dict):
                        yield from self._take(event)
                    elif event is not None:
                        futures.append(event)
                if not self._link.alive:
                    self._again.extend(self._out.values())
                    self._out.clear()
                    self._link.come_back(lambda: self._stopping)
                    continue
                self._link.count_workers()
                for future in futures:
                    yield from self._end(future)
            for sent in (*self._out.values(), *self._again):
                yield sent.unanswered(stopped=True)
        finally:  # nobody waits for the answers that are left
            left = [sent.future for sent in self._out.values()]
            self._out.clear()
            self._again.clear()
            if left and self._link.alive:
                with suppress(Exception):
                    self._link.client.cancel(left, force=True)

    def _send(self, coming: Iterator[tuple[int, T]]) -> None:
        """Send tasks, so that no worker waits for one."""
        batch: list[_Sent[T]] = []
        while len(self._out) + len(batch) < max(1, _AHEAD * self._link.threads):
            if self._again:
                batch.append(self._again.popleft())
            elif (following := next(coming, None)) is not None:
                batch.append(_Sent(*following))
            else:
                break
        if not batch:
            return
        for sent in batch:
            if isinstance(sent.task, Resumable) and sent.journals:
                sent.task = sent.task.resumed(_contents(sent.journals))
            sent.journals, sent.worker = set(), ""
        futures = self._link.client.map(
            computed,
            [self._name] * len(batch),
            [sent.number for sent in batch],
            [sent.task for sent in batch],
            key=[f"{self._name}-{sent.number}-{uuid.uuid4().hex[:8]}" for sent in batch],
            pure=False,
        )
        for sent, future in zip(batch, futures, strict=True):
            sent.future = future
            self._out[sent.number] = sent
            future.add_done_callback(self._happened.put)  # in a thread of dask

    def _events(self) -> list[Any]:
        """All that has happened since the last time, or happens within a moment."""
        events = []
        with suppress(Empty):
            events.append(self._happened.get(timeout=_TICK))
            while True:
                events.append(self._happened.get_nowait())
        return events

    def _sent_by(self, key: str) -> _Sent[T] | None:
        """The task of a key; None if nobody waits for it, as when it was sent again since."""
        sent = self._out.get(int(key.split("-")[2]))
        return sent if sent is not None and sent.future.key == key else None

    def _take(self, event: dict[str, Any]) -> Iterator[Answered[R]]:
        """A task has added to a journal, or was begun; if again, its worker was lost over it.

        It is sent anew then with its journals, which dask knows nothing of.
        """
        sent = self._sent_by(event["key"])
        if sent is None:
            return
        if "journal" in event:
            with suppress(OSError):  # it is lost with its worker, then
                add_part(event["journal"], event["content"], at=event["at"])
                sent.journals.add(event["journal"])
            return
        sent.add_loss()
        begun_again, sent.worker = bool(sent.worker), event["begun"]
        sent.began = time.monotonic()
        set_aside = len(sent.losses) > self._retries
        if set_aside or (begun_again and sent.journals):
            del self._out[sent.number]
            self._link.client.cancel([sent.future], force=True)
        if set_aside:
            yield sent.unanswered()
        elif begun_again and sent.journals:
            self._again.append(sent)

    def _end(self, future: Any) -> Iterator[Answered[R]]:
        """A future is done: its task has an answer, or was lost.

        Raises:
            InputError: a worker cannot compute for us.
            Exception: what the function raised.
        """
        sent = self._sent_by(future.key)
        if sent is None:
            return
        del self._out[sent.number]
        answer: Answered[R] | None = None
        error: BaseException | None = None
        # an answer may be lost with its worker before it is fetched
        with suppress(CancelledError, TimeoutError, OSError, KilledWorker):
            if future.status == "error":
                error = future.exception(timeout=_FETCH)
            elif future.status == "finished":
                answer = future.result(timeout=_FETCH)
        if answer is not None:
            yield replace(answer, losses=(*sent.losses, *answer.losses))
            return
        if isinstance(error, WorkerRefused):
            worker = sent.worker or "of the cluster"
            raise self._link.refused(f"the worker {worker} {error}") from error
        if error is not None and not isinstance(error, KilledWorker):
            raise error
        if error is not None:
            sent.add_loss()
        if len(sent.losses) > self._retries:
            yield sent.unanswered()
        elif self._stopping:
            yield sent.unanswered(stopped=True)
        else:
            self._again.append(sent)

    def _stop_workers(self) -> None:
        """Take back what has not begun, and let the rest end soon."""
        if time.monotonic() - self._stop_sent < _AGAIN or not self._link.alive:
            return
        self._stop_sent = time.monotonic()
        with suppress(OSError):  # a worker that is lost is asked when it is back
            self._link.client.run(stop_tasks, self._name, wait=False, on_error="ignore")
        waiting = [sent.future for sent in self._out.values() if not sent.worker]
        if waiting:
            self._link.client.cancel(waiting)


def _contents(paths: Iterable[str]) -> dict[str, bytes]:
    """Path to content of journals that are here."""
    contents = {}
    for path in paths:
        with suppress(OSError):
            contents[path] = Path(path).read_bytes()
    return contents
