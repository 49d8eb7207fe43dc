"""Python's search for garbage, where it costs more than it finds.

Figures are many small objects that refer to each other, and the search for those that nobody needs
looks through all that was imported as well: together a fifth of the time of a report.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_MUCH = 250_000
"""Objects made and not given back from which on the search is worth its time: those of some
fifteen figures, 150 MB. Most programs that draw a page end before."""


@contextmanager
def collector_paused() -> Iterator[None]:
    """Without the search, for what ends soon and leaves little: imports, a page."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@contextmanager
def garbage_at_the_end() -> Iterator[None]:
    """Without the search until the end, and then only where there is much, among what is new."""
    with collector_paused():
        try:
            yield
        finally:
            if gc.get_count()[0] > _MUCH:
                gc.collect(0)


@contextmanager
def older_left_alone() -> Iterator[None]:
    """Without what there is already in the search: processes that are forked meanwhile share it."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
