"""Runs of models elsewhere on another machine: what is known goes there, what is made comes back.

A run is never made twice: so the log of the runs of a case goes where they are made, and what was
added to it there comes back, with the folders of runs that are kept. There these have names that no
other process gives.
"""

from __future__ import annotations

import platform
import uuid
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

from geoident.errors import OutputError
from geoident.workflow.executing.executor import SetUp
from geoident.workflow.executing.growth import Resumable, add_lines
from geoident.workflow.programs.run_folders import begin_names
from geoident.workflow.programs.run_log import FILE

T = TypeVar("T")
R = TypeVar("R")

_MOST = 16_000_000
"""Bytes of a folder of a run that come back; of the files of one that has more the small ones."""

_LEFT_OUT = "left-out.txt"
"""File with the names of files that did not come back."""


@dataclass(frozen=True)
class RunsMade:
    """Runs that were made on another machine.

    Args:
        lines: that they have added to the log.
        files: path of a file, as seen from the folder of the runs, to its content.
    """

    lines: bytes = b""
    files: Mapping[str, bytes] | None = None


def log_of(folder: Path) -> Path:
    """The log of all runs in a folder."""
    return folder / FILE


def known_lines(folder: Path) -> bytes:
    """What the log of runs holds here; nothing where there is none."""
    with suppress(OSError):
        return log_of(folder).read_bytes()
    return b""


def begin_there(logs: Mapping[str, bytes]) -> None:
    """Begin with the runs that are known, and with names of folders that tell where they are made.

    Args:
        logs: path of the log of a case to its lines.
    """
    for path, lines in logs.items():
        add_lines(Path(path), lines)
    host = "".join(c if c.isalnum() else "-" for c in platform.node())
    begin_names(f"{host or 'elsewhere'}-{uuid.uuid4().hex[:6]}-")


class RunsThere:
    """The runs of one folder that a task makes there; a context, after which `made` has them.

    Args:
        folder: of the runs; None for a case that runs nothing.
        lines: that are known of it elsewhere.
    """

    def __init__(self, folder: Path | None, lines: Iterable[bytes]) -> None:
        self._folder, self._lines = folder, lines
        self._before = b""
        self._there: set[str] = set()
        self.made = RunsMade()

    def __enter__(self) -> RunsThere:
        if self._folder is None:
            return self
        for lines in self._lines:
            add_lines(log_of(self._folder), lines)
        self._before = known_lines(self._folder)
        self._there = _folders(self._folder)
        return self

    def __exit__(self, *_: object) -> None:
        if self._folder is None:
            return
        lines = known_lines(self._folder).removeprefix(self._before)
        files: dict[str, bytes] = {}
        for name in sorted(_folders(self._folder) - self._there):
            files |= {f"{name}/{file}": content for file, content in
                      _content(self._folder / name).items()}  # fmt: skip
        self.made = RunsMade(lines, files)


@dataclass(frozen=True)
class TravellingTask(Resumable):
    """A task that computes a case: it goes on from its checkpoint, and from the runs of its model.

    Args:
        kept: path to content of the files with which it goes on.
        runs: folder of the runs of its model; empty where that runs nothing.
    """

    runs: str

    @property
    @abstractmethod
    def checkpoint(self) -> str:
        """Path of its evaluations."""

    @property
    def growing(self) -> tuple[str, ...]:
        """Its checkpoint, and the log of the runs of its model."""
        return (self.checkpoint, *([str(log_of(Path(self.runs)))] if self.runs else []))

    def going_on(self) -> Self:
        """The same with the evaluations that an interrupted command has left here."""
        with suppress(OSError):
            return self.resumed({self.checkpoint: Path(self.checkpoint).read_bytes()})
        return self

    def begin(self) -> RunsThere:
        """Lay out what it goes on from, where it is computed; a context for its runs."""
        lines = []
        for name, content in self.kept.items():
            if name == self.checkpoint:
                Path(name).write_bytes(content)
            else:
                lines.append(content)
        return RunsThere(Path(self.runs) if self.runs else None, lines)


def begun_with(logs: Mapping[str, bytes], set_up: SetUp[T, R]) -> Callable[[T], R]:
    """In a process far away: what answers tasks there, which knows the runs that are known here.

    Args:
        logs: path of the log of a case to its lines.
        set_up: gives it.
    """
    begin_there(logs)
    return set_up()


def keep_runs(made: RunsMade, folder: Path) -> None:
    """Add runs that were made on another machine to those that are here.

    Args:
        made: they.
        folder: of the runs here.

    Raises:
        OutputError: they cannot be written.
    """
    try:
        for name, content in (made.files or {}).items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        if made.lines:
            add_lines(log_of(folder), made.lines)
    except OSError as error:
        message = f"{folder}: runs cannot be kept: {error.strerror or error}"
        raise OutputError(message) from error


def _folders(folder: Path) -> set[str]:
    if not folder.is_dir():
        return set()
    return {path.name for path in folder.iterdir() if path.is_dir()}


def _content(folder: Path) -> dict[str, bytes]:
    """The files of a run, the small ones first, as many as come back."""
    found: dict[str, bytes] = {}
    left, size = [], 0
    files = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    for path in sorted(files, key=lambda path: path.stat().st_size):
        name = path.relative_to(folder).as_posix()
        size += path.stat().st_size
        if size > _MOST:
            left.append(name)
        else:
            found[name] = path.read_bytes()
    if left:
        found[_LEFT_OUT] = "".join(f"{name}\n" for name in left).encode()
    return found
