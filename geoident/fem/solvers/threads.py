"""How many threads a solver may take."""

from __future__ import annotations

import os


def granted_threads(variable: str) -> int:
    """Threads that the environment grants: by a variable, by ``OMP_NUM_THREADS``, or all cores.

    Args:
        variable: of the library, which goes before that of all libraries.
    """
    for name in (variable, "OMP_NUM_THREADS"):
        if os.environ.get(name, "").isdecimal():
            return max(1, int(os.environ[name]))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
