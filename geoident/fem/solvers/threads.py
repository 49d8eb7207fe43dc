"""How many threads a solver may take, that libraries take one each, and tasks side by side.

numpy and scipy come with an OpenBLAS each, whose threads wait for work by turning round and round:
beside many small products that takes more time of processors than the products. So whoever computes
long does it within `one_thread`, and what is large is divided into tasks by the program itself
(`run_tasks`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ContextDecorator
from threading import Lock
from typing import Any, ClassVar

import scipy.linalg  # noqa: F401 - with it both libraries of linear algebra are loaded
from threadpoolctl import ThreadpoolController

from geoident.processors import processors


def granted_threads(variable: str) -> int:
    """Threads that the environment grants: by a variable, by ``OMP_NUM_THREADS``, or all cores.

    Args:
        variable: of the library, which goes before that of all libraries.
    """
    for name in (variable, "OMP_NUM_THREADS"):
        if os.environ.get(name, "").isdecimal():
            return max(1, int(os.environ[name]))
    return processors()


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
    with ThreadPoolExecutor(threads, "geoident-solver") as pool:
        futures = [pool.submit(task) for task in tasks]
        wait(futures)
    for future in futures:
        future.result()


class one_thread(ContextDecorator):  # noqa: N801  used as contextlib's own
    """Within, the libraries of linear algebra take one thread each.

    It may be entered again within, and by several threads at a time: the last that leaves
    gives back what was before, which threadpoolctl's own limits do not. Also a decorator of
    functions.
    """

    _lock = Lock()
    _within = 0
    _limit: ClassVar[Any] = None

    def __enter__(self) -> None:
        cls = one_thread
        with cls._lock:
            cls._within += 1
            if cls._within == 1:
                libraries = ThreadpoolController().select(user_api="blas")
                cls._limit = libraries.limit(limits=1)

    def __exit__(self, *error: object) -> None:
        cls = one_thread
        with cls._lock:
            cls._within -= 1
            if not cls._within:
                cls._limit.restore_original_limits()
