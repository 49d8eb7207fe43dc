"""Tasks that are gone on with where a worker was lost over them.

A fit adds every evaluation to its checkpoint, and an external model every run to its log. On
another machine these journals are lost with the worker. So what is added to them comes back while
the task goes on, and the task is sent again with it.
"""

from __future__ import annotations

import errno
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

LINES = ".jsonl"
"""Ending of journals of lines, whose order does not count and of which each counts once."""


@dataclass(frozen=True)
class Resumable(ABC):
    """A task with journals.

    Args:
        kept: path, as seen from where its process works, to what a journal has already.
    """

    kept: Mapping[str, bytes]

    @property
    @abstractmethod
    def journals(self) -> tuple[str, ...]:
        """Paths, as seen from where its process works, of the files that it adds to."""

    def resumed(self, kept: Mapping[str, bytes]) -> Self:
        """The same task with more in its journals.

        Args:
            kept: path to content.
        """
        return replace(self, kept={**self.kept, **kept})


def add_part(file: str | Path, content: bytes, *, at: int) -> None:
    """Add what has come back to a journal here; a part that does not follow its end is dropped.

    Args:
        file: where.
        content: what was added; of a journal of lines, those that it has not.
        at: bytes that were there before.

    Raises:
        OSError: it cannot be written.
    """
    path = Path(file)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if path.name.endswith(LINES):
        add_lines(path, content)
    elif at <= size_of(path):
        with path.open("r+b" if path.exists() else "wb") as opened:
            opened.truncate(at)
            opened.seek(at)
            opened.write(content)


def add_lines(path: Path, content: bytes) -> None:
    """Add the lines that a file has not.

    Args:
        path: of the file.
        content: lines.

    Raises:
        OSError: it cannot be written.
    """
    known: set[bytes] = set()
    with suppress(FileNotFoundError):
        known = set(path.read_bytes().splitlines())
    new = [line for line in dict.fromkeys(content.splitlines()) if line and line not in known]
    if new:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab") as file:
            file.write(b"".join(line + b"\n" for line in new))
            file.flush()
            os.fsync(file.fileno())


def size_of(path: Path) -> int:
    """Bytes of a file; 0 where there is none."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
