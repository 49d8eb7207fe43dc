"""Ending a process with all that it has started.

Programs that a task runs have sessions of their own, and outlive a process that is killed. The
processes that descend from one are known where the system tells them (`/proc`); elsewhere only the
process itself is ended.
"""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path

_PROC = Path("/proc")


def descendants(pid: int) -> list[int]:
    """Numbers of all processes that descend from one, parents first.

    Args:
        pid: number of the process.
    """
    children: dict[int, list[int]] = {}
    with suppress(OSError):
        for entry in _PROC.iterdir():
            if entry.name.isdigit():
                with suppress(OSError, ValueError, IndexError):
                    after_name = (entry / "stat").read_text().rpartition(")")[2].split()
                    children.setdefault(int(after_name[1]), []).append(int(entry.name))
    found: list[int] = []
    left = [pid]
    while left:
        born = children.get(left.pop(), [])
        found += born
        left += born
    return found


def end_descendants(pid: int) -> None:
    """Kill all processes that descend from one.

    Args:
        pid: number of the process, which is to start no more of them meanwhile.
    """
    for child in descendants(pid):
        with suppress(OSError):
            os.kill(child, signal.SIGKILL)


def end_family(pid: int | None) -> None:
    """Kill a process and all that descend from it.

    Args:
        pid: number of the process; None for one that was never there.
    """
    if pid is None or not hasattr(signal, "SIGSTOP"):
        return
    with suppress(OSError):
        os.kill(pid, signal.SIGSTOP)  # so that it starts no more
        end_descendants(pid)
        os.kill(pid, signal.SIGKILL)
