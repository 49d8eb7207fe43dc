"""``geoident show``: results that were written before."""

from __future__ import annotations

from geoident.io.result.file import read_result
from geoident.model.result import Result


def show(path: str) -> Result:
    """Read a result.

    Raises:
        InputError: there is none at the path, or it is damaged.
    """
    return read_result(path)
