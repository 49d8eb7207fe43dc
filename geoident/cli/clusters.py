"""The cluster that a command is given."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import click

from geoident.errors import MissingExtra

if TYPE_CHECKING:
    from collections.abc import Callable

    from geoident.model.cluster import Cluster

cluster_option: Callable[[Any], Any] = click.option(
    "--cluster",
    metavar="ADDRESS|FILE|local",
    help="Compute on a cluster of dask: address of its scheduler, a cluster file, or local.",
)


def cluster_given(given: str) -> Cluster:
    """The cluster that ``--cluster`` names.

    Args:
        given: what was written.

    Raises:
        InputError: there is no such thing, or its file is wrong.
        MissingExtra: dask is not installed.
    """
    from geoident.io.cluster.file import read_cluster

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


def refuse_cluster(given: str | None) -> None:
    """Refuse a cluster for a single case, whose search is computed where the command runs.

    Args:
        given: what was written.

    Raises:
        click.UsageError: there is one.
    """
    if given is not None:
        message = "--cluster is for several cases, or for the runs of `geoident batch`."
        raise click.UsageError(message)
