"""The processors and the memory that this process may use."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

GROUP_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
"""Where Linux says how much a container may take."""


def processors() -> int:
    """How many processors this process may use, which may be fewer than the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def memory_limit() -> float:
    """Bytes that this process may take: those of the machine, or fewer where it is held to fewer.

    Limits of containers and of the process (``ulimit -v``) count, not what other programs use at
    the moment. Infinite if the system does not say, as on Windows.
    """
    limits = [float("inf")]
    with suppress(AttributeError, ValueError, OSError):
        limits.append(float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE")))
    for name in GROUP_LIMITS:
        with suppress(OSError, ValueError):  # no such file, or the word "max"
            limits.append(float(Path(name).read_text(encoding="ascii")))
    with suppress(ImportError):  # there is no such module on Windows
        import resource  # noqa: PLC0415

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft != resource.RLIM_INFINITY:
            limits.append(float(soft))
    return min(limits)
