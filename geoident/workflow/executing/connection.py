"""A cluster of dask that is reached or started: its scheduler and its workers."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import dask
from distributed import Client, LocalCluster, Security, rpc
from distributed.comm.addressing import get_address_host_port
from distributed.versions import VersionMismatchWarning

from geoident.errors import LostCluster
from geoident.model.cluster import Cluster
from geoident.workflow.executing.dask_worker import Order, TaskPlugin, problem_of
from geoident.workflow.executing.environment import SAFE_PATH, safe_path, share_of_cores
from geoident.workflow.executing.job_queue import job_queue

REACH = 8.0
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
        cluster: which one.
        order: what is to be done there.
        jobs: number of workers, where they are started here.
        on_event: is called, in another thread, with time and content of what workers send.
        tell: is told what people should know.
    """

    def __init__(
        self,
        cluster: Cluster,
        order: Order,
        jobs: int,
        on_event: Callable[[tuple[float, Any]], None],
        tell: Callable[[str], None],
    ) -> None:
        self._cluster, self._order, self._jobs = cluster, order, jobs
        self._on_event, self._tell = on_event, tell
        self._own: Any = None
        self.client: Any = None
        self.threads = jobs if cluster.local else 0
        """Threads of all workers, as counted last."""
        self._counted = 0.0
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
        try:
            if self._cluster.local:
                inherited = {**share_of_cores(self._jobs), **SAFE_PATH}
                settings = {"distributed.nanny.pre-spawn-environ": inherited}
                with safe_path(), dask.config.set(settings):
                    self._own = LocalCluster(
                        n_workers=self._jobs, threads_per_worker=1, processes=True,
                        dashboard_address=":0", memory_limit=0, silence_logs=logging.CRITICAL,
                    )  # fmt: skip
            elif self._cluster.queue:
                self._own = job_queue(self._cluster)
            self._connect(REACH)
        except BaseException:
            self.close()
            raise
        if not self.threads:
            self._say_waiting()

    def _connect(self, seconds: float) -> None:
        """Reach the scheduler, and bring its workers what they need.

        Raises:
            InputError: nobody answers there, or workers cannot compute for us.
        """
        cluster, name = self._cluster, self._order.name
        security = _security(cluster)
        try:
            direct = bool(cluster.address) and _answers(cluster.address, security, seconds)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", VersionMismatchWarning)  # it is refused below
                self.client = Client(
                    self._own or cluster.address, timeout=seconds, security=security,
                    set_as_default=False, name="geoident", direct_to_workers=direct or None,
                )  # fmt: skip
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise _unreachable(cluster, error) from error
        try:
            self.client.register_plugin(TaskPlugin(self._order))
        except (ImportError, AttributeError) as error:
            raise self.refused(f"its workers have no geoident like this one: {error}") from error
        self.client.subscribe_topic(name, self._on_event)
        for worker, problem in self.client.run(problem_of, name).items():
            if problem:
                raise self.refused(f"the worker {worker} {problem}")
        self.count_workers()

    def refused(self, message: str) -> Exception:
        """An error that says why workers cannot be used.

        Args:
            message: what is wrong with them.
        """
        hint = "Start its workers from an environment with the same versions as here."
        if "has no program" in message:
            hint = "Install it there, or put it on the search path (PATH) of the workers."
        return self._cluster.refused("unlike-workers", message, hint)

    def _say_waiting(self) -> None:
        if self._cluster.queue:
            self._tell(f"Waiting for the jobs of {self._cluster.queue} to start.")
        else:
            self._tell(
                f"The scheduler at {self.client.scheduler.address} has no workers yet; waiting. "
                "Start some there with `dask worker`."
            )
        self._waiting = True

    def count_workers(self) -> None:
        """Count the threads of all workers, now and then."""
        if time.monotonic() - self._counted < _LOOK:
            return
        self._counted = time.monotonic()
        with suppress(OSError, ValueError):
            self.threads = sum(self.client.nthreads().values())
        if self.threads and self._waiting:
            self._tell("Workers have come.")
            self._waiting = False

    def close(self) -> None:
        """Take everything away that is ours; a cluster that does not answer is left as it is."""
        own, self._own = self._own, None
        if self.alive:
            with suppress(Exception):
                self.client.unregister_worker_plugin(self._order.name)
        self._drop_client()
        if own is not None:
            with suppress(Exception):
                own.close(timeout=_FAREWELL)
        self._held.close()

    def _drop_client(self) -> None:
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
        self._drop_client()
        if stopping():
            return
        cluster = self._cluster
        if not cluster.address:
            raise LostCluster("the scheduler of this command has ended", cluster.patience)
        self._tell(f"The scheduler at {cluster.address} is lost; waiting for it.")
        over = time.monotonic() + cluster.patience
        while not stopping():
            try:
                self._connect(min(REACH, max(1.0, over - time.monotonic())))
            except Exception as error:
                self._drop_client()
                if time.monotonic() > over:
                    raise LostCluster(cluster.address, cluster.patience) from error
                time.sleep(_PAUSE)
            else:
                self._tell("It is back; what was running there is restarted.")
                if not self.threads:
                    self._say_waiting()
                return


def require_scheduler(cluster: Cluster) -> None:
    """Say at once that no scheduler answers at an address; one that is started here will.

    Args:
        cluster: which one.

    Raises:
        InputError: none does.
    """
    if cluster.address:
        try:
            _answers(cluster.address, _security(cluster), REACH)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise _unreachable(cluster, error) from error


def _security(cluster: Cluster) -> Any:
    """Keys for encryption as dask takes them; None without.

    Raises:
        InputError: the address asks for them, and there are none.
    """
    keys = cluster.keys
    if keys is not None:
        return Security(
            tls_ca_file=keys.ca_file,
            tls_client_cert=keys.cert,
            tls_client_key=keys.key,
            require_encryption=True,
        )
    if not cluster.address.startswith("tls://"):
        return None
    configured: Any = Security(require_encryption=True)  # by the configuration of dask
    if configured.tls_ca_file and configured.tls_client_cert:
        return configured
    hint = (
        "Name them in a cluster file (security: {ca_file: .., cert: .., key: ..}), or in the "
        "environment: DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
        "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT, DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY."
    )
    message = f"{cluster.address} needs certificates, and none are given"
    raise cluster.refused("no-certificates", message, hint)


def _answers(address: str, security: Any, seconds: float) -> bool:
    """Wait until a scheduler answers; whether its workers can be reached from here, too.

    Dask itself waits for ever for a server that says nothing. It is asked once a server is there:
    a connection of tornado that is given up in the moment in which it comes about is never closed.

    Raises:
        OSError: nobody is there, or says nothing.
        ValueError: it is something else.
    """
    over = time.monotonic() + seconds
    while True:
        left = over - time.monotonic()
        try:
            _reach(address, max(left, 0.1))
            break
        except OSError:
            if left < _PAUSE:
                raise
            time.sleep(0.1)

    async def identity() -> dict[str, Any]:
        arguments = security.get_connection_args("client") if security else {}
        async with rpc(address, connection_args=arguments) as server:
            return dict(await server.identity())

    identity_of_server = asyncio.run(asyncio.wait_for(identity(), max(seconds, _GREETING)))
    if identity_of_server["type"] != "Scheduler":
        raise ValueError(f"a {identity_of_server['type'].lower()} is there")
    try:
        _reach(next(iter(identity_of_server["workers"])), _NEAR)
    except (OSError, StopIteration):
        return False  # answers pass the scheduler, then
    return True


def _reach(address: str, seconds: float) -> None:
    """Raises OSError where nobody takes a connection."""
    socket.create_connection(get_address_host_port(address), timeout=seconds).close()


def _unreachable(cluster: Cluster, error: Exception) -> Exception:
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    name = cluster.address or cluster.queue or "of this machine"
    message = f"no scheduler of dask answers at {name} within {REACH:g} s ({reason})"
    hint = "Start one there with `dask scheduler`, or correct the address."
    return cluster.refused("no-cluster", message, hint)


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
