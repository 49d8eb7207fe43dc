"""How many threads a solver may take, that libraries take one each, and tasks side by side.

numpy and scipy come with an OpenBLAS each, whose threads wait for work by turning round and round:
beside many small products that takes more time of processors than the products. So whoever computes
long does it within `one_thread`, and what is large is divided into tasks by the program itself
(`run_tasks`).
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ContextDecorator, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import ClassVar

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


@dataclass(frozen=True)
class BlasLibrary:
    """An OpenBLAS that is loaded.

    Args:
        threads: tells how many threads it takes.
        set_threads: has it take so many.
    """

    threads: Callable[[], int]
    set_threads: Callable[[int], None]


class one_thread(ContextDecorator):  # noqa: N801  used as contextlib's own
    """Within, the BLAS of numpy and that of scipy take one thread each, where they can be told so.

    It may be entered again within, and by several threads at a time: the last that leaves
    gives back what was before. Also a decorator of functions.
    """

    _lock = Lock()
    _within = 0
    _before: ClassVar[list[int]] = []

    def __enter__(self) -> None:
        cls = one_thread
        with cls._lock:
            cls._within += 1
            if cls._within == 1:
                cls._before = [library.threads() for library in libraries()]
                for library in libraries():
                    library.set_threads(1)

    def __exit__(self, *error: object) -> None:
        cls = one_thread
        with cls._lock:
            cls._within -= 1
            if not cls._within:
                for library, count in zip(libraries(), cls._before, strict=True):
                    library.set_threads(count)


@lru_cache(maxsize=1)
def libraries() -> tuple[BlasLibrary, ...]:
    """Every OpenBLAS that comes with the wheels of numpy and scipy."""
    opened = []
    for name in ("numpy", "scipy"):
        package = Path(str(import_module(name).__file__)).parent
        places = (package.parent / f"{name}.libs", package / ".dylibs")
        for path in (path for place in places for path in sorted(place.glob("*openblas*"))):
            for ending in ("", "64_"):
                with suppress(OSError, AttributeError):  # another library, or without that name
                    library = ctypes.CDLL(str(path))
                    get = library[f"scipy_openblas_get_num_threads{ending}"]
                    put = library[f"scipy_openblas_set_num_threads{ending}"]
                    get.restype, get.argtypes, put.argtypes = ctypes.c_int, [], [ctypes.c_int]
                    opened.append(BlasLibrary(get, put))
    return tuple(opened)
