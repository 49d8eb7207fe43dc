"""The option that names a cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

cluster_option: Callable[[Any], Any] = click.option(
    "--cluster",
    metavar="ADDRESS|FILE|local",
    help="Compute on a cluster of dask: address of its scheduler, which can run any program here "
    "as you, a cluster file, or local.",
)
