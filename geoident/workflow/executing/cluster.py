"""Tasks on a cluster of dask: sent to its scheduler, computed on its workers (`relay`).

Dask distributes the tasks, begins those of lost workers again and brings answers back. What it does
not know is said here: how many workers a task may cost, and what to do when the scheduler is lost.
"""

from __future__ import annotations

import logging
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from distributed import Client, KilledWorker, LocalCluster, Security

from geoident.errors import LostCluster
from geoident.model.cluster import Cluster
from geoident.workflow.executing.executor import RETRIES, Answered, usable_cores
from geoident.workflow.executing.job_queue import job_queue
from geoident.workflow.executing.parcel import Parcel
from geoident.workflow.executing.processes import cores_shared
from geoident.workflow.executing.relay import (
    BEGUN,
    Order,
    Relay,
    SetUpIn,
    WorkerRefused,
    differences,
    own_versions,
    problem_of,
    relayed,
    stop_relay,
)

T = TypeVar("T")
R = TypeVar("R")

_REACH = 8.0
"""Seconds within which a scheduler has to answer."""

_TICK = 0.5
"""Seconds after which the scheduler is looked at, at the latest."""

_LOOK = 2.0
"""Seconds between counts of the workers."""

_GATHER = 30.0
"""Seconds that an answer may take to come."""

_AHEAD = 2
"""Tasks that are sent for each thread of a worker: one that runs, and one that waits."""

_FAREWELL = 5.0
"""Seconds that a cluster is given to end what we leave there."""


@dataclass
class _Sent(Generic[T]):
    """A task that was given out.

    Args:
        number: of the task.
        task: the argument.
        losses: of each worker that was lost over it, why.
        begun: workers that have begun it since it was sent, with the time.
        future: its answer.
        given_up: it is not waited for any more.
    """

    number: int
    task: T
    losses: list[str] = field(default_factory=list)
    begun: list[tuple[str, float]] = field(default_factory=list)
    future: Any = None
    given_up: bool = False


class DaskCluster(Generic[T, R]):
    """An executor on a cluster of dask; a context, at whose end nothing of ours is left there.

    Args:
        cluster: which one.
        set_up: gives, in a process of a worker, the function that answers tasks; it is called with
            the folder of the files. It is pickled.
        parcel: files that tasks read.
        jobs: number of workers, where they are started here.
        time_limit: seconds that a task may take, or None.
        retries: times that a task is begun again after its process or its worker was lost.
        tell: is told what people should know.
    """

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
    ) -> None:
        self._where = cluster
        name = f"geoident-{uuid.uuid4().hex[:12]}"
        self._order = Order(name, parcel, own_versions(), set_up, time_limit, retries)
        self._jobs = jobs or usable_cores()
        self._tell = tell
        self._own: Any = None
        self._client: Any = None
        self._events: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._out: dict[int, _Sent[T]] = {}
        self._threads = 0
        self._looked = 0.0
        self._waiting = False
        self._stopping = False
        self._told_to_stop = False
        self._killing = False
        self._quiet = _quiet_logs()

    def __enter__(self) -> Self:
        self._quiet.__enter__()
        try:
            self._start()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._leave()
        finally:
            self._quiet.__exit__(None, None, None)

    @property
    def workers(self) -> int:
        """Number of tasks that are computed at a time."""
        return self._threads

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
                    self._give_out(coming, again)
                elif not self._told_to_stop:
                    self._stop_workers()
                if not self._out:
                    break
                yield from self._answers(again)
            for sent in (*self._out.values(), *again):
                seconds = time.monotonic() - sent.begun[-1][1] if sent.begun else 0.0
                yield Answered(sent.number, None, tuple(sent.losses), True, seconds)
        finally:
            self._drop()

    # The cluster

    def _start(self) -> None:
        where = self._where
        if where.local:
            with cores_shared(self._jobs):  # which the workers inherit
                self._own = LocalCluster(
                    n_workers=self._jobs, threads_per_worker=1, processes=True,
                    dashboard_address=None, memory_limit=0, silence_logs=logging.CRITICAL,
                )  # fmt: skip
        elif where.queue:
            self._own = job_queue(where)
        self._connect(_REACH)
        if not self._threads:
            self._say_waiting()

    def _connect(self, seconds: float) -> None:
        """Reach the scheduler, and bring its workers what they need.

        Raises:
            InputError: nobody answers there, or workers cannot compute for us.
        """
        where, keys = self._where, self._where.keys
        security = keys and Security(
            tls_ca_file=keys.ca_file, tls_client_cert=keys.cert, tls_client_key=keys.key,
            require_encryption=True,
        )  # fmt: skip
        try:
            self._client = Client(
                self._own or where.address, timeout=seconds, security=security,
                set_as_default=False, name="geoident",
            )  # fmt: skip
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise _unreachable(where, error) from error
        self._require_same_versions()
        try:
            self._client.register_plugin(Relay(self._order))
        except (ImportError, AttributeError) as error:
            raise self._refused(f"its workers have no geoident like this one: {error}") from error
        self._client.subscribe_topic(self._order.name, self._on_event)
        found = self._client.run(problem_of, self._order.name)
        for worker, problem in found.items():
            if problem:
                raise self._refused(f"the worker {worker} {problem}")
        self._look()

    def _require_same_versions(self) -> None:
        """Compare versions before anything is sent that other versions may not read.

        Raises:
            InputError: a worker has others.
        """
        ours = self._order.versions
        found = self._client.get_versions(packages=[n for n in ours if n != "python"])
        for worker, theirs in found["workers"].items():
            python = ".".join(theirs["host"]["python"].split(".")[:3])
            wrong = differences(
                found["client"]["packages"] | {"python": ours["python"]},
                theirs["packages"] | {"python": python},
            )
            if wrong:
                raise self._refused(f"the worker {worker} has other versions: {wrong}")

    def _refused(self, message: str) -> Exception:
        hint = "Start its workers from an environment with the same versions as here."
        return self._where.refused("unlike-workers", message, hint)

    def _say_waiting(self) -> None:
        if self._where.queue:
            self._tell(f"Waiting for the jobs of {self._where.queue} to start.")
        else:
            self._tell(
                f"The scheduler at {self._client.scheduler.address} has no workers yet; waiting. "
                "Start some with `dask worker ADDRESS --nthreads 1`."
            )
        self._waiting = True

    def _look(self) -> None:
        """Count the threads of all workers, now and then."""
        if time.monotonic() - self._looked < _LOOK:
            return
        self._looked = time.monotonic()
        with suppress(OSError, ValueError):
            self._threads = sum(self._client.nthreads().values())
        if self._threads and self._waiting:
            self._tell("Workers have come.")
            self._waiting = False

    def _leave(self) -> None:
        """Take everything away that is ours; a cluster that does not answer is left as it is."""
        self._drop()
        client, own, self._client, self._own = self._client, self._own, None, None
        if client is not None:
            if client.status == "running":
                with suppress(Exception):
                    client.sync(
                        client._unregister_worker_plugin, self._order.name,
                        callback_timeout=_FAREWELL,
                    )  # fmt: skip
            with suppress(Exception):
                client.close(timeout=_FAREWELL)
        if own is not None:
            with suppress(Exception):
                own.close(timeout=_FAREWELL)

    def _drop(self) -> None:
        """Cancel all that nobody waits for any more."""
        left = [sent.future for sent in self._out.values() if sent.future is not None]
        self._out.clear()
        if left and self._client is not None and self._client.status == "running":
            with suppress(Exception):
                self._client.cancel(left, force=True)

    # Tasks

    def _give_out(self, coming: Iterator[tuple[int, T]], again: deque[_Sent[T]]) -> None:
        """Send tasks, so that no worker waits for one."""
        most = max(1, _AHEAD * max(self._threads, self._planned()))
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

    def _planned(self) -> int:
        return self._jobs if self._where.local else 0

    def _send(self, batch: list[_Sent[T]]) -> None:
        name = self._order.name
        numbers = [sent.number for sent in batch]
        futures = self._client.map(
            relayed, [name] * len(batch), numbers, [sent.task for sent in batch],
            key=[f"{name}-{number}-{uuid.uuid4().hex[:8]}" for number in numbers],
            pure=False, retries=0,
        )  # fmt: skip
        for sent, future in zip(batch, futures, strict=True):
            sent.future, sent.given_up = future, False
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
            if word == "event":
                yield from self._on_begun(what)
            elif word == "done":
                ended.append(what)
        if self._client.status != "running":
            self._come_back(again)
            return
        self._look()
        for future in ended:
            sent = self._sent_of(future)
            if sent is not None:
                yield from self._ended(sent, again)

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

    def _on_begun(self, event: Any) -> Iterator[Answered[R]]:
        """A task was begun; if it had been begun before, that worker was lost over it."""
        sent = self._out.get(event[BEGUN])
        if sent is None or sent.given_up:
            return
        if sent.begun:
            sent.losses.append(f"ended with its worker {sent.begun[-1][0]}")
        sent.begun.append((f"{event['worker']} on {event['host']}", time.monotonic()))
        if len(sent.losses) > self._order.retries:
            sent.given_up = True
            self._client.cancel([sent.future], force=True)
            del self._out[sent.number]
            yield Answered(sent.number, None, tuple(sent.losses))

    def _ended(self, sent: _Sent[T], again: deque[_Sent[T]]) -> Iterator[Answered[R]]:
        future, status = sent.future, sent.future.status
        del self._out[sent.number]
        if status == "finished":
            try:
                answer: Answered[R] = future.result(timeout=_GATHER)
            except (OSError, TimeoutError, KilledWorker):  # its worker was lost meanwhile
                again.append(sent)
                return
            yield self._with_losses(answer, sent)
        elif status == "cancelled":
            if self._stopping:
                yield Answered(sent.number, None, tuple(sent.losses), stopped=True)
            else:  # what dask forgets when it is in trouble
                again.append(sent)
        else:
            yield from self._failed(sent, again, future.exception(timeout=_GATHER))

    def _failed(
        self, sent: _Sent[T], again: deque[_Sent[T]], error: BaseException
    ) -> Iterator[Answered[R]]:
        """A task that dask has given up, or that has raised.

        Raises:
            InputError: a worker cannot compute for us.
        """
        if isinstance(error, WorkerRefused):
            begun = sent.begun[-1][0] if sent.begun else "of the cluster"
            raise self._refused(f"the worker {begun} {error}") from error
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
        """Take back what has not begun, and let the rest end soon."""
        self._told_to_stop = True
        self._client.run(stop_relay, self._order.name, False, wait=False)
        waiting = [sent.future for sent in self._out.values() if not sent.begun]
        if waiting:
            self._client.cancel(waiting)

    def _come_back(self, again: deque[_Sent[T]]) -> None:
        """Wait for a scheduler that was lost, and send it again what had been sent.

        Raises:
            LostCluster: it does not come back.
        """
        lost, self._client = self._client, None
        with suppress(Exception):
            lost.close(timeout=_FAREWELL)
        for sent in self._out.values():
            sent.begun.clear()
            again.append(sent)
        self._out.clear()
        if self._stopping:
            return
        where = self._where
        if not where.address:
            raise LostCluster("the scheduler of this command has ended", where.patience)
        self._tell(f"The scheduler at {where.address} is lost; waiting for it.")
        over = time.monotonic() + where.patience
        while not self._stopping:
            try:
                self._connect(min(_REACH, max(1.0, over - time.monotonic())))
            except Exception as error:
                self._client = None
                if time.monotonic() > over:
                    raise LostCluster(where.address, where.patience) from error
                time.sleep(_TICK)
            else:
                self._tell("It is back; what was running there is begun again.")
                return


def _unreachable(where: Cluster, error: Exception) -> Exception:
    said = str(error).splitlines()[0] if str(error) else type(error).__name__
    name = where.address or where.queue or "of this machine"
    message = f"no scheduler of dask answers at {name} within {_REACH:g} s ({said})"
    hint = "Start one there with `dask scheduler`, or correct the address."
    return where.refused("no-cluster", message, hint)


@contextmanager
def _quiet_logs() -> Iterator[None]:
    """Keep dask from writing on the terminal meanwhile; what people need to know is told."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio", "dask")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
