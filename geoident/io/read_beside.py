"""A case that is read while its command imports what computes: both take a second of a small fit.

Here nothing is imported but what begins that.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

from geoident.forked import WorkBeside

if TYPE_CHECKING:
    from geoident.io.loaded import LoadedCase

_STDIN = "-"


def case_read_beside(
    path: str, overrides: Sequence[str]
) -> AbstractContextManager[WorkBeside[LoadedCase] | None]:
    """Begin to read a case; its faults, and models elsewhere, are left to who asks for it.

    Args:
        path: of the case; what comes on stdin is not read.
        overrides: such as ``parameters.E.start=9 GPa``.
    """

    def read() -> LoadedCase | None:
        from geoident.io.case.file import read_case  # noqa: PLC0415 - in the other process

        found = read_case(path, overrides=tuple(overrides))
        return None if found.case.elsewhere is not None else found

    return nullcontext() if path == _STDIN else WorkBeside(read)
