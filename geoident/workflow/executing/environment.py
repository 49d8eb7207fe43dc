"""What processes of ours inherit: a share of the cores, and where Python looks for modules."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from geoident.workflow.executing.executor import CORES, usable_cores

SAFE_PATH = {"PYTHONSAFEPATH": "geoident"}
"""Variable that keeps Python from looking for modules in the current folder, and our value of it.

Python looks there first where it is begun by ``-c``, as workers of dask are on this machine."""

_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def share_of_cores(jobs: int) -> dict[str, str]:
    """Variables of the environment that give a process its share of the cores.

    What the environment says of OMP_NUM_THREADS holds for all libraries of which it says nothing:
    their own variables go before it.

    Args:
        jobs: among how many processes the cores are shared.
    """
    share = str(max(1, usable_cores() // jobs))
    threads = os.environ.get("OMP_NUM_THREADS") or share
    return {name: os.environ.get(name) or threads for name in _THREADS} | {CORES: share}


@contextmanager
def safe_path() -> Generator[None, None, None]:
    """Within it processes that a library starts get `SAFE_PATH`, also its helpers.

    multiprocessing starts one that tracks resources, in our own environment and by ``-c``.
    """
    added = {name: value for name, value in SAFE_PATH.items() if not os.environ.get(name)}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def environment_of_children() -> dict[str, str]:
    """The environment of this process without `SAFE_PATH`: programs may import from beside them."""
    return {
        name: value for name, value in os.environ.items() if (name, value) not in SAFE_PATH.items()
    }


def path_without_here() -> list[str]:
    """Where a process of ours looks for modules: as this one, but not in the current folder.

    That is kept only where geoident itself lies in it.
    """
    current, own = Path.cwd(), Path(__file__).parents[3]
    folders = [Path(folder).resolve() for folder in sys.path]
    return [entry for entry, folder in zip(sys.path, folders, strict=True)
            if folder != current or folder == own]  # fmt: skip
