"""Figures drawn side by side, each in one of several processes: a page has many, and each is slow.

Processes are forked, so that what was read and imported is there at once and figures need not be
sent, only their bytes come back. Where a system cannot fork, or where threads of Python run that a
fork would cut off, figures are drawn one after the other. The bytes are the same.
"""

from __future__ import annotations

import os
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import TypeVar

from geoident import processors

_Item = TypeVar("_Item")
_MOST = 8  # processes; more would wait for the slowest figure
_FEW = 4  # figures below which processes are not worth their start
_drawn: list[Callable[[], bytes]] = []
"""What the processes are to draw; they have it from before the fork."""


def side_by_side(draw: Callable[[_Item], bytes], items: Sequence[_Item]) -> list[bytes]:
    """What a function makes of each of some items, in their order.

    Args:
        draw: makes the file of an item.
        items: what to draw.
    """
    processes = min(processors.processors(), _MOST, len(items))
    if processes < 2 or len(items) < _FEW or not processors.may_fork():
        return [draw(item) for item in items]
    _drawn[:] = [partial(draw, item) for item in items]
    try:
        with warnings.catch_warnings():
            # Threads of libraries of linear algebra, which know how to survive a fork.
            warnings.simplefilter("ignore", DeprecationWarning)
            context = get_context("fork")
            with ProcessPoolExecutor(processes, context, _end_with, (os.getpid(),)) as pool:
                return list(pool.map(_draw, range(len(items))))
    finally:
        _drawn.clear()


def _end_with(parent: int) -> None:
    """End this process soon after its parent, which tells nobody when it is killed.

    Its pipes stay open then, since each process of the pool holds those of the others.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _draw(k: int) -> bytes:
    return _drawn[k]()
