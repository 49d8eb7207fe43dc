"""How much memory a process may take, asked from the system."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

GROUP_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
"""Where Linux says how much a container may take."""


def memory_limit() -> float:
    """Bytes that this process may take: those of the machine, or fewer where it is held to fewer.

    Limits of containers and of the process (``ulimit -v``) count. What other programs use at the
    moment does not: the same computer then takes the same way in every run. Infinite if the system
    does not say.
    """
    return min(_machine(), _container(), _process())


def _machine() -> float:
    if sys.platform != "win32":
        try:
            return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
        except (ValueError, OSError):
            return float("inf")
    status = _WindowsMemory()
    status.length = ctypes.sizeof(status)
    found = ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    return float(status.total) if found else float("inf")


class _WindowsMemory(ctypes.Structure):
    """MEMORYSTATUSEX of the Windows API."""

    _fields_ = (
        ("length", ctypes.c_uint32),
        ("load", ctypes.c_uint32),
        *((name, ctypes.c_uint64) for name in ("total", "free", "b", "c", "d", "e", "f")),
    )


def _container() -> float:
    found = [float("inf")]
    for name in GROUP_LIMITS:
        try:
            found.append(float(Path(name).read_text(encoding="ascii")))
        except (OSError, ValueError):  # none, or the word "max"
            continue
    return min(found)


def _process() -> float:
    try:
        import resource  # noqa: PLC0415  there is none on Windows
    except ImportError:
        return float("inf")
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return float("inf") if soft == resource.RLIM_INFINITY else float(soft)
