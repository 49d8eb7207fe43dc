"""matplotlib without the help texts that it writes while it is imported.

For every class of things that can be drawn it looks through all methods and writes how to ``set``
them: a quarter of the time of its import. A program that draws a page and ends shows none of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from matplotlib.artist import Artist

_WRITES = "_update_set_signature_and_docstring"


@contextmanager
def without_help_texts() -> Iterator[None]:
    """Meanwhile no class gets a text; figures are the same."""
    before = vars(Artist).get(_WRITES)
    if before is None:  # a version that writes them in another way
        yield
        return
    setattr(Artist, _WRITES, classmethod(lambda cls: None))
    try:
        yield
    finally:
        setattr(Artist, _WRITES, before)
