"""A cluster of dask that is reached or started: its scheduler, its workers and what they need."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from distributed import Client, LocalCluster, Security, rpc
from distributed.comm.addressing import get_address_host_port
from distributed.versions import VersionMismatchWarning

from geoident.errors import LostCluster
from geoident.model.cluster import Cluster
from geoident.workflow.executing.job_queue import job_queue
from geoident.workflow.executing.processes import (
    cores_shared,
    nothing_from_here,
    safe_children,
)
from geoident.workflow.executing.relay import Order, Relay, differences, problem_of

_REACH = 8.0
"""Seconds within which a scheduler has to answer."""

_GREETING = 1.0
"""Seconds that somebody who is there is given to say who it is, at least."""

_LOOK = 2.0
"""Seconds between counts of the workers."""

_FAREWELL = 5.0
"""Seconds that a cluster is given to end what we leave there."""

_NEAR = 2.0
"""Seconds within which a worker answers to whom its network lets through."""

_PAUSE = 0.5
"""Seconds between attempts to reach a scheduler that was lost."""


class Connection:
    """A client of a cluster, whose workers have what an executor needs.

    Args:
        where: the cluster.
        order: what is to be done there.
        jobs: number of workers, where they are started here.
        on_event: is told, in another thread, what workers say.
        tell: is told what people should know.
    """

    def __init__(
        self,
        where: Cluster,
        order: Order,
        jobs: int,
        on_event: Callable[[tuple[float, Any]], None],
        tell: Callable[[str], None],
    ) -> None:
        self._where, self._order, self._jobs = where, order, jobs
        self._on_event, self._tell = on_event, tell
        self._own: Any = None
        self.client: Any = None
        self.threads = jobs if where.local else 0
        self.direct: bool | None = None
        self._looked = 0.0
        self._waiting = False
        self._held = ExitStack()

    @property
    def alive(self) -> bool:
        """The scheduler is there."""
        return self.client is not None and self.client.status == "running"

    def open(self) -> None:
        """Reach the cluster, or start it.

        Raises:
            InputError: nobody answers there, or workers cannot compute for us.
        """
        self._held.enter_context(_quiet_logs())
        if self._where.local:
            self._held.enter_context(safe_children())  # a worker may be begun again at any time
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    def _start(self) -> None:
        where = self._where
        if where.local:
            with cores_shared(self._jobs), nothing_from_here():  # which the workers inherit
                self._own = LocalCluster(
                    n_workers=self._jobs, threads_per_worker=1, processes=True,
                    dashboard_address=":0", memory_limit=0, silence_logs=logging.CRITICAL,
                )  # fmt: skip
        elif where.queue:
            self._own = job_queue(where)
        self._connect(_REACH)
        if not self.threads:
            self._say_waiting()

    def _connect(self, seconds: float) -> None:
        """Reach the scheduler, and bring its workers what they need.

        Raises:
            InputError: nobody answers there, or workers cannot compute for us.
        """
        where = self._where
        security = _security(where)
        try:
            if where.address:
                _ask(where.address, security, seconds)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", VersionMismatchWarning)  # it is refused below
                self.client = Client(
                    self._own or where.address, timeout=seconds, security=security,
                    set_as_default=False, name="geoident",
                )  # fmt: skip
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise _unreachable(where, error) from error
        self._require_same_versions()
        try:
            self.client.register_plugin(Relay(self._order))
        except (ImportError, AttributeError) as error:
            raise self.refused(f"its workers have no geoident like this one: {error}") from error
        self.client.subscribe_topic(self._order.name, self._on_event)
        found = self.client.run(problem_of, self._order.name)
        for worker, problem in found.items():
            if problem:
                raise self.refused(f"the worker {worker} {problem}")
        self.look()

    def _require_same_versions(self) -> None:
        """Compare versions before anything is sent that other versions may not read.

        Raises:
            InputError: a worker has others.
        """
        ours = self._order.versions
        found = self.client.get_versions(packages=[n for n in ours if n != "python"])
        for worker, theirs in found["workers"].items():
            python = ".".join(theirs["host"]["python"].split(".")[:3])
            installed = found["client"]["packages"]
            mine = {name: installed.get(name, "") for name in ours} | {"python": ours["python"]}
            wrong = differences(mine, theirs["packages"] | {"python": python})
            if wrong:
                raise self.refused(f"the worker {worker} has other versions: {wrong}")

    def refused(self, message: str) -> Exception:
        """An error that says why workers cannot be used.

        Args:
            message: what was found.
        """
        hint = "Start its workers from an environment with the same versions as here."
        if "has no program" in message:
            hint = "Install it there, or put it on the search path (PATH) of the workers."
        return self._where.refused("unlike-workers", message, hint)

    def _say_waiting(self) -> None:
        if self._where.queue:
            self._tell(f"Waiting for the jobs of {self._where.queue} to start.")
        else:
            self._tell(
                f"The scheduler at {self.client.scheduler.address} has no workers yet; waiting. "
                "Start some there with `dask worker`."
            )
        self._waiting = True

    def look(self) -> None:
        """Count the threads of all workers, now and then."""
        if time.monotonic() - self._looked < _LOOK:
            return
        self._looked = time.monotonic()
        with suppress(OSError, ValueError):
            found = self.client.nthreads()
            self.threads = sum(found.values())
            if found and self.direct is None:
                self.direct = _answers(next(iter(found)), _security(self._where))
        if self.threads and self._waiting:
            self._tell("Workers have come.")
            self._waiting = False

    def close(self) -> None:
        """Take everything away that is ours; a cluster that does not answer is left as it is."""
        try:
            self._leave()
        finally:
            self._held.close()

    def _leave(self) -> None:
        client, own, self.client, self._own = self.client, self._own, None, None
        if client is not None:
            if client.status == "running":
                with suppress(Exception):
                    client.unregister_worker_plugin(self._order.name)
            with suppress(Exception):
                client.close(timeout=_FAREWELL)
        if own is not None:
            with suppress(Exception):
                own.close(timeout=_FAREWELL)

    def _let_go(self) -> None:
        """Forget a client whose scheduler is lost."""
        client, self.client = self.client, None
        if client is not None:
            with suppress(Exception):
                client.close(timeout=_FAREWELL)

    def come_back(self, stopping: Callable[[], bool]) -> None:
        """Wait for a scheduler that was lost.

        Args:
            stopping: whether nobody wants it back any more.

        Raises:
            LostCluster: it does not come back.
        """
        self._let_go()
        if stopping():
            return
        where = self._where
        if not where.address:
            raise LostCluster("the scheduler of this command has ended", where.patience)
        self._tell(f"The scheduler at {where.address} is lost; waiting for it.")
        over = time.monotonic() + where.patience
        while not stopping():
            try:
                self._connect(min(_REACH, max(1.0, over - time.monotonic())))
            except Exception as error:
                self._let_go()
                if time.monotonic() > over:
                    raise LostCluster(where.address, where.patience) from error
                time.sleep(_PAUSE)
            else:
                self._tell("It is back; what was running there is begun again.")
                if not self.threads:
                    self._say_waiting()
                return


def _security(where: Cluster) -> Any:
    """Keys for encryption as dask takes them; None without.

    Raises:
        InputError: the address asks for them, and there are none.
    """
    keys = where.keys
    if keys is None:
        if not where.address.startswith("tls://"):
            return None
        told: Any = Security(
            require_encryption=True
        )  # of files that dask is told of in its own way
        if told.tls_ca_file and told.tls_client_cert:
            return told
        hint = (
            "Name them in a cluster file (security: {ca_file: .., cert: .., key: ..}), or in the "
            "environment: DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT, DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY."
        )
        message = f"{where.address} needs certificates, and none are given"
        raise where.refused("no-certificates", message, hint)
    return Security(
        tls_ca_file=keys.ca_file,
        tls_client_cert=keys.cert,
        tls_client_key=keys.key,
        require_encryption=True,
    )


def require_scheduler(where: Cluster) -> None:
    """Say at once that no scheduler answers at an address; one that is started here will.

    Args:
        where: the cluster.

    Raises:
        InputError: none does.
    """
    if not where.address:
        return
    try:
        _ask(where.address, _security(where), _REACH)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise _unreachable(where, error) from error


def _answers(worker: str, security: Any) -> bool:
    """Whether a worker can be reached from here: its answers then need not pass the scheduler."""
    try:
        _ask(worker, security, _NEAR, "Worker")
    except (OSError, ValueError):
        return False
    return True


def _ask(address: str, security: Any, seconds: float, expected: str = "Scheduler") -> None:
    """Ask whoever is there who it is, as soon as somebody is there.

    Dask is asked last, and then given time: a connection of tornado that is given up in the moment
    in which it comes about is never closed.

    Raises:
        OSError: nobody is there.
        ValueError: it is something else.
    """
    over = time.monotonic() + seconds
    place = get_address_host_port(address)
    while True:
        left = over - time.monotonic()
        try:
            socket.create_connection(place, timeout=max(left, 0.1)).close()
            break
        except OSError:
            if left < _PAUSE:
                raise
            time.sleep(0.1)
    asyncio.run(asyncio.wait_for(_greet(address, security, expected), max(seconds, _GREETING)))


async def _greet(address: str, security: Any, expected: str) -> None:
    """Ask whoever is there who it is: dask waits for ever for somebody else who says nothing.

    Raises:
        OSError: nobody is there.
        ValueError: it is something else.
    """
    arguments = security.get_connection_args("client") if security else {}
    async with rpc(address, connection_args=arguments) as there:
        kind = (await there.identity())["type"]
    if kind != expected:
        raise ValueError(f"a {kind.lower()} is there")


def _unreachable(where: Cluster, error: Exception) -> Exception:
    said = str(error).splitlines()[0] if str(error) else type(error).__name__
    name = where.address or where.queue or "of this machine"
    message = f"no scheduler of dask answers at {name} within {_REACH:g} s ({said})"
    hint = "Start one there with `dask scheduler`, or correct the address."
    return where.refused("no-cluster", message, hint)


@contextmanager
def _quiet_logs() -> Iterator[None]:
    """Keep dask from writing on the terminal meanwhile; what people need to know is told."""
    names = tuple(logging.root.manager.loggerDict)
    of_dask = [name for name in names if name.split(".")[0] in ("distributed", "tornado")]
    loggers = [logging.getLogger(name) for name in (*of_dask, "asyncio")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
