"""The processors that this process may use, and whether it may fork others."""

from __future__ import annotations

import os
import sys
import threading


def processors() -> int:
    """How many processors this process may use, which may be fewer than the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def may_fork() -> bool:
    """Whether a forked process goes on safely: on Linux, from a program of one thread."""
    return sys.platform == "linux" and threading.active_count() == 1
