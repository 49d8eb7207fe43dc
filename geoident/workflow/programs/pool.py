"""Several runs at a time, which can be ended together."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TypeVar

Piece = TypeVar("Piece")
Found = TypeVar("Found")

_MOMENT = 0.2
"""Seconds between two looks whether the runs are still wanted."""


def cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


def all_of(
    work: Callable[[Piece], Found],
    items: Sequence[Piece],
    at_once: int | None,
    *,
    check: Callable[[], None],
    end: Callable[[], None],
) -> list[Found]:
    """Do something with all items, several at a time; a thread waits for each.

    Args:
        work: makes a run.
        items: of which each is one.
        at_once: how many; None for one on each core.
        check: is called every moment; raises to end all.
        end: ends what is running.
    """
    check()
    with ThreadPoolExecutor(min(at_once or cores(), max(len(items), 1))) as pool:
        futures = [pool.submit(work, item) for item in items]
        left = set(futures)
        try:
            while left:
                done, left = wait(left, timeout=_MOMENT, return_when=FIRST_EXCEPTION)
                for future in done:
                    future.result()
                check()
        except BaseException:
            for future in futures:
                future.cancel()
            end()
            raise
        return [future.result() for future in futures]
