"""Folders of runs, each of which only one run has."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from geoident.errors import OutputError

_FIRST = [""]
"""What names of folders of runs begin with in this process."""


def begin_names(first: str) -> None:
    """Let names of folders of runs begin with something that no other process has.

    Folders of several machines then lie beside each other in one.

    Args:
        first: beginning of the names.
    """
    _FIRST[0] = first


def new_folder(folder: Path) -> Path:
    """A folder that no other run has, below that of all runs: 00001, 00002, ...

    Raises:
        OutputError: it cannot be made.
    """
    first = _FIRST[0]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = [path.name.removeprefix(first) for path in folder.iterdir()]
        number = max((int(name) for name in names if name.isdigit()), default=0) + 1
        while True:
            with suppress(FileExistsError):
                place = folder / f"{first}{number:05d}"
                place.mkdir()
                return place
            number += 1
    except OSError as error:
        message = f"{folder}: a folder for a run cannot be made: {error.strerror or error}"
        raise OutputError(message) from error
