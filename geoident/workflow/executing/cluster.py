"""Tasks on a cluster of dask: sent to its scheduler, computed on its workers (`relay`).

Dask distributes the tasks, begins those of lost workers again and brings answers back. What it does
not know is said here: how many workers a task may cost, and what to do when the scheduler is lost.
"""

from __future__ import annotations

import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from distributed import KilledWorker

from geoident.model.cluster import Cluster
from geoident.workflow.executing.connection import Connection
from geoident.workflow.executing.executor import RETRIES, Answered, usable_cores
from geoident.workflow.executing.growth import Resumable, keep
from geoident.workflow.executing.parcel import Parcel
from geoident.workflow.executing.relay import (
    BEGUN,
    GROWN,
    Order,
    SetUpIn,
    WorkerRefused,
    own_versions,
    relayed,
    stop_relay,
)

T = TypeVar("T")
R = TypeVar("R")

_TICK = 0.5
"""Seconds after which the scheduler is looked at, at the latest."""

_AGAIN = 2.0
"""Seconds after which workers are told again to stop, since some may have come in between."""

_GATHER = 30.0
"""Seconds that an answer may take to come."""

_AHEAD = 8
"""Tasks that are sent for each thread of a worker, so that none waits for us to send one."""


@dataclass
class _Sent(Generic[T]):
    """A task that was given out.

    Args:
        number: of the task.
        task: the argument.
        losses: of each worker that was lost over it, why.
        grown: paths of files of it that have come back since it was sent.
        begun: workers that have begun it since it was sent, with the time.
        future: its answer.
        given_up: it is not waited for any more.
    """

    number: int
    task: T
    losses: list[str] = field(default_factory=list)
    grown: set[str] = field(default_factory=set)
    begun: list[tuple[str, float]] = field(default_factory=list)
    future: Any = None
    given_up: bool = False


class DaskCluster(Generic[T, R]):
    """An executor on a cluster of dask; a context, at whose end nothing of ours is left there.

    What tasks write bit by bit (`growth`) is kept under the same paths here while they go on.

    Args:
        cluster: which one.
        set_up: gives, in a process of a worker, the function that answers tasks; it is called with
            the folder of the files. It is pickled.
        parcel: files that tasks read.
        jobs: number of workers, where they are started here.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its process or its worker was lost.
        tell: is told what people should know.
        check: is called every moment while somebody waits for an answer; raises to end all.
    """

    keep_every = 10.0
    """Seconds between looks at files that grow."""

    def __init__(
        self,
        cluster: Cluster,
        set_up: SetUpIn,
        parcel: Parcel,
        *,
        jobs: int | None = None,
        time_limit: float | None = None,
        retries: int = RETRIES,
        tell: Callable[[str], None] = lambda message: None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        name = f"geoident-{uuid.uuid4().hex[:12]}"
        self._order = Order(
            name, parcel, own_versions(), set_up, time_limit, retries,
            deaf=cluster.local, keep_every=self.keep_every,
        )  # fmt: skip
        self._link = Connection(cluster, self._order, jobs or usable_cores(), self._on_event, tell)
        self._check = check
        self._events: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._out: dict[int, _Sent[T]] = {}
        self._stopping = False
        self._stop_sent = -_AGAIN
        self._killing = False

    def __enter__(self) -> Self:
        self._link.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._drop()
        self._link.close()

    @property
    def workers(self) -> int:
        """Number of tasks that are computed at a time."""
        return self._link.threads

    @property
    def begun(self) -> tuple[int, ...]:
        """Numbers of the tasks that are computed now."""
        return tuple(n for n, sent in self._out.items() if sent.begun and not sent.given_up)

    def ask_to_stop(self) -> None:
        """Begin no more tasks, and let those that run end as soon as they can."""
        self._stopping = True
        self._events.put(("stop", None))

    def kill(self) -> None:
        """End all tasks at once."""
        self._stopping = self._killing = True
        self._events.put(("stop", None))

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
        again: deque[_Sent[T]] = deque()
        try:
            while not self._killing:
                if not self._stopping:
                    self._check()
                    self._give_out(coming, again)
                elif time.monotonic() - self._stop_sent > _AGAIN:
                    self._stop_workers()
                if not self._out:
                    break
                yield from self._answers(again)
            for sent in (*self._out.values(), *again):
                seconds = time.monotonic() - sent.begun[-1][1] if sent.begun else 0.0
                yield Answered(sent.number, None, tuple(sent.losses), True, seconds)
        finally:
            self._drop()

    # Tasks

    def _drop(self) -> None:
        """Cancel all that nobody waits for any more."""
        left = [sent.future for sent in self._out.values() if sent.future is not None]
        self._out.clear()
        if left and self._link.alive:
            with suppress(Exception):
                self._link.client.cancel(left, force=True)

    def _give_out(self, coming: Iterator[tuple[int, T]], again: deque[_Sent[T]]) -> None:
        """Send tasks, so that no worker waits for one."""
        most = max(1, _AHEAD * self._link.threads)
        batch: list[_Sent[T]] = []
        while len(self._out) + len(batch) < most:
            if again:
                batch.append(again.popleft())
                continue
            following = next(coming, None)
            if following is None:
                break
            batch.append(_Sent(*following))
        if batch:
            self._send(batch)

    def _send(self, batch: list[_Sent[T]]) -> None:
        name = self._order.name
        numbers = [sent.number for sent in batch]
        for sent in batch:
            sent.task = _resumed(sent.task, sent.grown)
        futures = self._link.client.map(
            relayed, [name] * len(batch), numbers, [sent.task for sent in batch],
            key=[f"{name}-{number}-{uuid.uuid4().hex[:8]}" for number in numbers],
            pure=False, retries=0,
        )  # fmt: skip
        for sent, future in zip(batch, futures, strict=True):
            sent.future, sent.given_up = future, False
            sent.grown.clear()
            sent.begun.clear()
            self._out[sent.number] = sent
            future.add_done_callback(self._on_done)

    def _on_done(self, future: Any) -> None:  # in a thread of dask
        self._events.put(("done", future))

    def _on_event(self, event: tuple[float, Any]) -> None:  # in the thread of the client
        self._events.put(("event", event[1]))

    def _answers(self, again: deque[_Sent[T]]) -> Iterator[Answered[R]]:
        """What has happened: answers, lost workers, a lost scheduler."""
        ended = []
        for word, what in self._happened():
            if word == "event" and GROWN in what:
                self._on_grown(what)
            elif word == "event":
                yield from self._on_begun(what, again)
            elif word == "done":
                ended.append(what)
        if not self._link.alive:
            self._send_again(again)
            return
        self._link.look()
        waited = [sent for future in ended if (sent := self._sent_of(future)) is not None]
        values = self._gathered([sent.future for sent in waited])
        for sent in waited:
            yield from self._ended(sent, again, values.get(sent.number))

    def _gathered(self, futures: list[Any]) -> dict[int, Answered[R]]:
        """Answers of finished futures by their number there, in one go; none if that fails."""
        done = [future for future in futures if future.status == "finished"]
        if not done:
            return {}
        gather = partial(
            self._link.client.gather, done, direct=self._link.direct, asynchronous=True
        )
        with suppress(Exception):  # a worker was lost meanwhile: one after the other, then
            found = self._link.client.sync(gather, callback_timeout=_GATHER)
            return {answer.number: answer for answer in found}
        return {}

    def _happened(self) -> list[tuple[str, Any]]:
        """All events since the last time, or those of the next moment."""
        found = []
        with suppress(Empty):
            found.append(self._events.get(timeout=_TICK))
            while True:
                found.append(self._events.get_nowait())
        return found

    def _sent_of(self, future: Any) -> _Sent[T] | None:
        """The task of a future; None if it is not waited for, or was sent again since."""
        number = int(str(future.key).removeprefix(f"{self._order.name}-").split("-")[0])
        sent = self._out.get(number)
        return sent if sent is not None and sent.future is future else None

    def _task_of(self, number: int, event: Any) -> _Sent[T] | None:
        """The task that an event is of; None if that was sent again since, or is of an earlier run.

        Args:
            number: of the task.
            event: with the key of its future.
        """
        sent = self._out.get(number)
        if sent is None or sent.given_up or str(sent.future.key) != event["key"]:
            return None
        return sent

    def _on_grown(self, event: Any) -> None:
        """A task has added something to a file."""
        sent = self._task_of(event[GROWN], event)
        if sent is not None:
            with suppress(OSError):  # it is lost with its worker, then
                keep(event["file"], event["content"], at=event["at"])
                sent.grown.add(event["file"])

    def _on_begun(self, event: Any, again: deque[_Sent[T]]) -> Iterator[Answered[R]]:
        """A task was begun; if it had been begun before, that worker was lost over it.

        It is sent anew then with what has come back of it, which dask knows nothing of.
        """
        sent = self._task_of(event[BEGUN], event)
        if sent is None:
            return
        if sent.begun:
            sent.losses.append(f"ended with its worker {sent.begun[-1][0]}")
        sent.begun.append((f"{event['worker']} on {event['host']}", time.monotonic()))
        if len(sent.losses) > self._order.retries:
            sent.given_up = True
            self._link.client.cancel([sent.future], force=True)
            del self._out[sent.number]
            yield Answered(sent.number, None, tuple(sent.losses))
        elif sent.grown and len(sent.begun) > 1:
            self._link.client.cancel([sent.future], force=True)
            del self._out[sent.number]
            again.append(sent)

    def _ended(
        self, sent: _Sent[T], again: deque[_Sent[T]], answer: Answered[R] | None
    ) -> Iterator[Answered[R]]:
        future, status = sent.future, sent.future.status
        del self._out[sent.number]
        if status == "finished":
            try:
                answer = answer or future.result(timeout=_GATHER)
            except (OSError, TimeoutError, KilledWorker, CancelledError):
                again.append(sent)  # its worker was lost meanwhile
                return
            assert answer is not None
            yield self._with_losses(answer, sent)
        elif status == "cancelled":
            if self._stopping:
                yield Answered(sent.number, None, tuple(sent.losses), stopped=True)
            else:  # what dask forgets when it is in trouble
                again.append(sent)
        elif status == "error":
            yield from self._failed(sent, again, future.exception(timeout=_GATHER))
        else:  # it was done, and its answer was lost with its worker before it was fetched
            again.append(sent)

    def _failed(
        self, sent: _Sent[T], again: deque[_Sent[T]], error: BaseException | None
    ) -> Iterator[Answered[R]]:
        """A task that dask has given up, or that has raised; without an error it was taken back.

        Raises:
            InputError: a worker cannot compute for us.
        """
        if isinstance(error, WorkerRefused):
            begun = sent.begun[-1][0] if sent.begun else "of the cluster"
            raise self._link.refused(f"the worker {begun} {error}") from error
        if error is None:
            again.append(sent)
            return
        if not isinstance(error, KilledWorker):
            raise error
        if sent.begun:
            sent.losses.append(f"ended with its worker {sent.begun[-1][0]}")
        if len(sent.losses) > self._order.retries:
            yield Answered(sent.number, None, tuple(sent.losses))
        else:  # workers were lost while it only waited there
            again.append(sent)

    def _with_losses(self, answer: Answered[R], sent: _Sent[T]) -> Answered[R]:
        return Answered(
            sent.number, answer.value, (*sent.losses, *answer.losses), answer.stopped,
            answer.seconds, answer.process,
        )  # fmt: skip

    def _stop_workers(self) -> None:
        """Take back what has not begun, and let the rest end soon; told again to new workers."""
        self._stop_sent = time.monotonic()
        with suppress(OSError):  # a worker that is lost is told when it is back
            self._link.client.run(
                stop_relay, self._order.name, False, wait=False, on_error="ignore"
            )
        waiting = [sent.future for sent in self._out.values() if not sent.begun]
        if waiting:
            self._link.client.cancel(waiting)

    def _send_again(self, again: deque[_Sent[T]]) -> None:
        """Wait for a scheduler that was lost, and take what it had for not sent.

        Raises:
            LostCluster: it does not come back.
        """
        for sent in self._out.values():
            sent.begun.clear()
            again.append(sent)
        self._out.clear()
        self._link.come_back(lambda: self._stopping)


def _resumed(task: T, grown: Iterable[str]) -> T:
    """A task with what has come back of it."""
    if not isinstance(task, Resumable):
        return task
    found = {}
    for name in grown:
        with suppress(OSError):
            found[name] = Path(name).read_bytes()
    return task.resumed(found) if found else task
