"""The cluster that a command or a call is given in place of processes of this machine."""

# ruff: noqa: PLC0415 - dask is imported when a cluster is asked for

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from geoident.errors import MissingExtra
from geoident.io.cluster.file import read_cluster
from geoident.model.cluster import Cluster
from geoident.workflow.executing.executor import Workplace


def cluster_given(given: str) -> Cluster:
    """The cluster that somebody names.

    Args:
        given: an address, ``local``, or the path of a cluster file.

    Raises:
        InputError: there is no such thing, or its file is wrong.
        MissingExtra: dask is not installed.
    """
    require_dask()
    return read_cluster(given)


def require_dask() -> None:
    """Refuse a cluster where dask is not installed.

    Raises:
        MissingExtra: it is not.
    """
    for package in ("distributed", "dask_jobqueue"):
        if find_spec(package) is None:
            hint = "Install it with: python -m pip install 'geoident[cluster]'"
            raise MissingExtra(f"a cluster needs {package}\n    {hint}", name=package)


def workplace(given: str | None, jobs: int | None, tell: Callable[[str], None]) -> Workplace | None:
    """Where a command has computed what it can compute at a time; None for processes here.

    Args:
        given: an address, ``local``, or the path of a cluster file; None for none.
        jobs: number of workers, where they are started here; None for the cores there are.
        tell: is told what people should know.

    Raises:
        InputError: there is no such thing, or its file is wrong.
        MissingExtra: dask is not installed.
    """
    if given is None:
        return None
    cluster = cluster_given(given)
    from geoident.workflow.executing.on_cluster import OnCluster

    return OnCluster(cluster, jobs, tell)
