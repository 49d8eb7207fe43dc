"""The cluster that a command, a call or a campaign names in place of processes of this machine."""

# ruff: noqa: PLC0415 - dask is imported when a cluster is asked for

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from geoident.errors import MissingExtra, Term
from geoident.io.cluster.file import read_cluster
from geoident.io.text.text_file import read_bytes
from geoident.model.cluster import QUEUES, Cluster
from geoident.workflow.executing.executor import BegunExecutor, SetUp
from geoident.workflow.executing.parcel import Parcel, packed
from geoident.workflow.programs.trust import Execution, require

T = TypeVar("T")
R = TypeVar("R")

_MOST = 1_000_000
"""Bytes of a certificate or of a key."""


def cluster_given(option: str) -> Cluster:
    """The cluster that somebody names.

    Args:
        option: an address, ``local``, or the path of a cluster file.

    Raises:
        InputError: there is no such thing, its file is wrong, or nobody has said that what this
            names may be run.
        MissingExtra: dask is not installed.
    """
    require_dask()
    return trusted(read_cluster(option))


def trusted(cluster: Cluster) -> Cluster:
    """The same cluster; asks whether what a file gives to schedulers and shells may be run.

    An address that who calls has named is their own word, and this machine's own processes run
    nothing that a file says.

    Args:
        cluster: nothing of it is begun, and nobody reached, before.

    Raises:
        InputError: nobody has said that it may be, or options of jobs are wrong.
    """
    if not cluster.file or cluster.local:
        return cluster
    stated: list[object] = [cluster.address, cluster.queue, dict(cluster.options), cluster.jobs]
    if cluster.keys is not None:
        keys = (cluster.keys.ca_file, cluster.keys.cert, cluster.keys.key)
        stated.append([read_bytes(key, limit=_MOST, what="key").hex() for key in keys])
    digest = hashlib.sha256(json.dumps(stated, sort_keys=True, default=str).encode()).hexdigest()
    if cluster.address:
        words = f"the scheduler at {cluster.address}, which can have any program run here as you"
        execution = Execution(words, digest, does="the file has geoident connect to")
    else:
        require_dask()
        from geoident.workflow.executing.job_queue import job_script

        jobs = f"{cluster.jobs} job{'s' if cluster.jobs > 1 else ''}"
        words = f"{jobs} of this kind to {cluster.queue} ({QUEUES[cluster.queue]})"
        execution = Execution(
            words, digest, does="the file has geoident submit", details=job_script(cluster)
        )
    require(execution, Path(cluster.file).with_suffix(".runs"), cluster.refused, Term.TRUST_FILE)
    return cluster


def require_dask() -> None:
    """Refuse a cluster where dask is not installed.

    Raises:
        MissingExtra: it is not.
    """
    for package in ("distributed", "dask_jobqueue"):
        if find_spec(package) is None:
            hint = "Install it with: python -m pip install 'geoident[cluster]'"
            raise MissingExtra(f"a cluster needs {package}\n    {hint}", name=package)


class OnCluster:
    """Begins executors of one command on a cluster, in place of processes of this machine.

    Args:
        cluster: which one.
        jobs: number of workers, where they are started here; None for the cores there are.
        tell: is told what people should know.

    Attributes:
        used: an executor was begun.
    """

    def __init__(self, cluster: Cluster, jobs: int | None, tell: Callable[[str], None]) -> None:
        self._cluster, self._jobs, self._tell = cluster, jobs, tell
        self.used = False

    def require(self) -> None:
        """Say at once that nobody is there, before anything else is computed.

        Raises:
            InputError: nobody answers at the address.
        """
        from geoident.workflow.executing.connection import require_scheduler

        require_scheduler(self._cluster)

    def begin(
        self,
        set_up: SetUp[T, R],
        parcel: Parcel | None = None,
        *,
        check: Callable[[], None] = lambda: None,
    ) -> BegunExecutor[T, R]:
        """An executor; a context.

        Args:
            set_up: gives, in a process of a worker, the function that answers tasks. It is pickled.
            parcel: files that tasks read; None for none.
            check: is called every moment while somebody waits for an answer; raises to end all.
        """
        from geoident.workflow.executing.cluster import DaskCluster

        self.used = True
        return DaskCluster(
            self._cluster, set_up, packed() if parcel is None else parcel,
            jobs=self._jobs, tell=self._tell, check=check,
        )  # fmt: skip


def on_cluster(
    option: str | None, jobs: int | None, tell: Callable[[str], None]
) -> OnCluster | None:
    """The cluster on which a command computes what it can compute at a time; None for processes.

    Args:
        option: an address, ``local``, or the path of a cluster file; None for none.
        jobs: number of workers, where they are started here; None for the cores there are.
        tell: is told what people should know.

    Raises:
        InputError: there is no such thing, its file is wrong, or it may not be used.
        MissingExtra: dask is not installed.
    """
    return None if option is None else OnCluster(cluster_given(option), jobs, tell)
