"""Tasks side by side: a pool of threads for calls that leave Python's lock alone."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache

from geoident.fem.solvers.threads import granted_threads


def run_tasks(tasks: Sequence[Callable[[], None]]) -> None:
    """Do all tasks, of which none needs what another makes; together where there are cores.

    Not from within a task: it would wait for the thread that it has itself.

    Raises:
        Exception: what the first of them that failed has raised; none runs any more then.
    """
    threads = granted_threads("OPENBLAS_NUM_THREADS")
    if threads == 1 or len(tasks) < 2:
        for task in tasks:
            task()
        return
    pool = _pool(threads, os.getpid())
    futures = [pool.submit(task) for task in tasks]
    wait(futures)
    for future in futures:
        future.result()


@lru_cache(maxsize=2)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """The threads, of this process: those of its parent are not there after a fork."""
    del process
    return ThreadPoolExecutor(threads, "geoident-solver")
