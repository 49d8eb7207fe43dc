"""Tasks side by side: a pool of threads for calls that leave Python's lock alone."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

from geoident.fem.solvers.threads import granted_threads

Work = Callable[[], None]


def run_tasks(tasks: Sequence[Work]) -> None:
    """Do all tasks, of which none needs what another makes; together where there are cores."""
    threads = granted_threads("OPENBLAS_NUM_THREADS")
    if threads == 1 or len(tasks) < 2:
        for task in tasks:
            task()
        return
    for _ in _pool(threads, os.getpid()).map(_do, tasks):
        pass


def _do(task: Work) -> None:
    task()


@lru_cache(maxsize=2)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """The threads, of this process: those of its parent are not there after a fork."""
    del process
    return ThreadPoolExecutor(threads, "geoident-solver")
