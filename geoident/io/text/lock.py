"""Files by which one process keeps others away while it works."""

from __future__ import annotations

from pathlib import Path
from typing import IO

from geoident.errors import OutputError
from geoident.io.text.atomic import output_error, refuse_link


def locked(path: Path, busy: str) -> IO[str]:
    """A file that no other process has locked; the lock ends when it is closed, or the process.

    The file itself stays, since to remove it would let two processes lock two of its name.

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
