"""Files by which one process keeps others away while it works."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from geoident.errors import OutputError
from geoident.io.text.atomic import output_error, refuse_link


@contextmanager
def locked_meanwhile(path: Path, busy: str) -> Iterator[None]:
    """Meanwhile no other process has the lock; the file is removed at the end.

    Args:
        path: of the file.
        busy: what is said where another process has locked it.

    Raises:
        OutputError: another process has locked it, or it cannot be written.
    """
    file = locked(path, busy)
    while not _stands(file, path):  # who had the lock has just removed the file
        file.close()
        file = locked(path, busy)
    try:
        yield
    finally:
        with suppress(OSError):  # some systems remove no open file: then it stays
            path.unlink(missing_ok=True)
        file.close()


def _stands(file: IO[str], path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def locked(path: Path, busy: str) -> IO[str]:
    """A file that no other process has locked; the lock ends when it is closed, or the process.

    Args:
        path: of the file.
        busy: what is said where another process has locked it.

    Raises:
        OutputError: another process has locked it, or it cannot be written.
    """
    refuse_link(path)
    try:
        file = path.open("w")
    except OSError as error:
        raise output_error(path, error) from error
    try:
        import fcntl  # noqa: PLC0415 - not on every system
    except ImportError:
        return file
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        file.close()
        raise OutputError(busy) from error
    except OSError:  # a file system without locks
        pass
    return file
