"""Files that a task writes piece by piece: what is there comes back while the task goes on.

A fit adds every evaluation to its checkpoint, and a model elsewhere every run to its log. On
another machine these are lost with the worker. So the worker tells of what was added, it is kept
where the command runs, and whoever begins the task again is given it.
"""

from __future__ import annotations

import errno
import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

_MOST = 64_000_000
"""Bytes of a file that come back while its task goes on."""

_PIECE = 4_000_000
"""Bytes that come back at a time."""

_LINES = ".jsonl"
"""Ending of files of lines, whose order does not count and of which each counts once."""


@dataclass(frozen=True)
class Resumable(ABC):
    """A task that goes on where another process was lost over it.

    Args:
        kept: path, as seen from where its process works, to content of files that have grown.
    """

    kept: Mapping[str, bytes]

    @property
    @abstractmethod
    def growing(self) -> tuple[str, ...]:
        """Paths, as seen from where its process works, of the files that it writes bit by bit."""

    def resumed(self, kept: Mapping[str, bytes]) -> Self:
        """The same task with more that is known.

        Args:
            kept: path to content.
        """
        return replace(self, kept={**self.kept, **kept})


@dataclass(frozen=True)
class AddedPart:
    """What was added to a file.

    Args:
        number: of the task.
        file: its path, as seen from where the process of the task works.
        at: bytes that were there before.
        content: what was added.
    """

    number: int
    file: str
    at: int
    content: bytes


class GrowthWatch:
    """Tells of what the processes of a task add to its files; a context.

    Args:
        number: of the task.
        task: it.
        processes: numbers of the processes that may have it.
        place: number of a process to where it works.
        tell: is told of what was added, in another thread.
        every: seconds between looks.
    """

    def __init__(
        self,
        number: int,
        task: Any,
        processes: Callable[[], Iterable[int]],
        place: Callable[[int], Path],
        tell: Callable[[AddedPart], None],
        every: float,
    ) -> None:
        self._number, self._processes, self._place = number, processes, place
        self._tell, self._every = tell, every
        self._task = task if isinstance(task, Resumable) else None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._sizes: dict[tuple[int, str], int] = {}

    def __enter__(self) -> Self:
        if self._task is not None:
            for process in self._processes():  # what earlier tasks have added there
                for name in self._task.growing:
                    if name.endswith(_LINES):
                        self._sizes[process, name] = _size(self._place(process) / name)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._task is not None:
            self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(self._every):
            for process in tuple(self._processes()):
                for name in self._task.growing if self._task is not None else ():
                    with suppress(OSError):
                        self._look(process, name)

    def _look(self, process: int, name: str) -> None:
        """Tell of what a file has more than it had.

        Raises:
            OSError: it is not there, or nobody can be told.
        """
        known = (
            () if name.endswith(_LINES) or self._task is None else self._task.kept.get(name, b"")
        )
        at = self._sizes.get((process, name), len(known))
        with (self._place(process) / name).open("rb") as file:
            file.seek(at)
            content = file.read(_PIECE)
        if name.endswith(_LINES):
            content = content[: content.rfind(b"\n") + 1]
        if content and at + len(content) <= _MOST:
            self._tell(AddedPart(self._number, name, at, content))
            self._sizes[process, name] = at + len(content)


def found_in(task: Resumable, place: Path) -> dict[str, bytes]:
    """What the files of a task hold.

    Args:
        task: it.
        place: where its process has worked, or works.
    """
    found = {}
    for name in task.growing:
        with suppress(OSError):
            found[name] = (place / name).read_bytes()
    return found


def keep(file: str | Path, content: bytes, *, at: int = 0) -> None:
    """Add what has grown to a file here; pieces that do not go on where it ends are dropped.

    Args:
        file: where.
        content: what was added; of a file of lines, those that it has not.
        at: bytes that were there before.

    Raises:
        OSError: it cannot be written.
    """
    path = Path(file)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if path.name.endswith(_LINES):
        add_lines(path, content)
        return
    if at > _size(path):
        return
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


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
