"""Killing a process with all that it has started.

Programs that a task runs have sessions of their own, and outlive a process that is killed. Its
descendants are known where the system lists them (`/proc`); elsewhere only the process itself ends.
"""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path

_PROC = Path("/proc")


def kill_descendants(pid: int) -> None:
    """Kill all processes that descend from one, which must start no more of them meanwhile."""
    children: dict[int, list[int]] = {}
    with suppress(OSError):
        for entry in _PROC.iterdir():
            if entry.name.isdigit():
                with suppress(OSError, ValueError, IndexError):
                    after_name = (entry / "stat").read_text().rpartition(")")[2].split()
                    children.setdefault(int(after_name[1]), []).append(int(entry.name))
    parents = [pid]
    while parents:
        for child in children.get(parents.pop(), ()):
            parents.append(child)
            with suppress(OSError):
                os.kill(child, signal.SIGKILL)


def kill_with_descendants(pid: int) -> None:
    """Kill a process and all that descend from it."""
    if not hasattr(signal, "SIGSTOP"):
        return
    with suppress(OSError):
        os.kill(pid, signal.SIGSTOP)  # so that it starts no more
        kill_descendants(pid)
        os.kill(pid, signal.SIGKILL)
