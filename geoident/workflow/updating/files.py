"""The files of a case as they are at one moment."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from zipfile import is_zipfile

from geoident.io.text.named_files import files_of_text

FileState = tuple[int, int, int]
"""Size, time of the last change in ns, and number of a file."""


def state_of(case: str) -> Mapping[str, FileState]:
    """Path to state of a case and of the files that its text names, as far as they are there.

    Args:
        case: path of the case.
    """
    states: dict[str, FileState] = {}
    text = ""
    with suppress(OSError, UnicodeDecodeError):
        text = Path(case).read_text(encoding="utf-8")
    for path in (case, *files_of_text(text, case)):
        with suppress(OSError):
            status = Path(path).stat()
            states[path] = status.st_size, status.st_mtime_ns, status.st_ino
    return states


_GROWS = 600.0
"""Seconds for which a text without a line end at its end may still be written."""

_BOOKS = (".xlsx", ".xlsm")


def why_unfinished(states: Mapping[str, FileState], now: float) -> str:
    """Why some files are not to be read yet, as they are being written; empty where they may be.

    A text that ends within a line is half written, unless it has been so for a while: what it lacks
    cannot be told from a number with fewer digits. A workbook that is open is as it was last saved.

    Args:
        states: of the files.
        now: seconds since 1970.
    """
    for path, (size, changed, _) in states.items():
        name = Path(path)
        if name.suffix.lower() in _BOOKS:
            if not _whole_archive(name):
                lock = name.with_name(f"~${name.name}")
                where = f" (open in Excel: {lock.name})" if lock.exists() else ""
                return f"{path} is not written to its end{where}"
        elif size and abs(now - 1e-9 * changed) < _GROWS and _ends_within_line(name):
            return f"{path} ends within a line"
    return ""


def _ends_within_line(path: Path) -> bool:
    """Whether a text has no line end at its end; files of bytes have none to miss."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
            file.seek(-1, 2)
            return b"\0" not in head and file.read(1) not in (b"\n", b"\r")
    except OSError:
        return False


_HEAD = 4096


def _whole_archive(path: Path) -> bool:
    """Whether a workbook has the directory that ends every archive."""
    try:
        return is_zipfile(path)
    except OSError:
        return False
