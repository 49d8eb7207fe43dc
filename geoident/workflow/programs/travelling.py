"""Cases that are computed on another machine: what is known goes there, what is made comes back.

A run of an external model is never made twice: so the log of the runs of a case goes where it is
computed, and what was added to it there comes back, with the folders of runs that are kept. There
these have names that no other process gives.
"""

from __future__ import annotations

import platform
import uuid
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, Self, TypeVar

from geoident.errors import OutputError
from geoident.workflow.executing.executor import SetUp
from geoident.workflow.executing.resumable import Resumable, add_lines, size_of
from geoident.workflow.programs.run_log import FILE, set_folder_prefix

T = TypeVar("T")
R = TypeVar("R")

_MOST = 16_000_000
"""Bytes of a folder of a run that come back; of the files of one that has more the small ones."""

_LEFT_OUT = "left-out.txt"
"""File with the names of files that did not come back."""


@dataclass
class RunsMade:
    """Runs that were made on another machine.

    Args:
        lines: that they have added to the log.
        files: path of a file, as seen from the folder of the runs, to its content.
    """

    lines: bytes = b""
    files: dict[str, bytes] = field(default_factory=dict)


def known_logs(folders: Iterable[Path]) -> dict[str, bytes]:
    """Path of the log of each folder of runs to its lines; nothing where there is none.

    Args:
        folders: of the runs of cases.
    """
    return {str(folder / FILE): _lines(folder) for folder in folders}


def _lines(folder: Path) -> bytes:
    with suppress(OSError):
        return (folder / FILE).read_bytes()
    return b""


def begin_there(logs: Mapping[str, bytes]) -> None:
    """Begin with the runs that are known, and with names of folders that tell where they are made.

    Args:
        logs: those of `known_logs`.
    """
    for path, lines in logs.items():
        add_lines(Path(path), lines)
    host = "".join(c if c.isalnum() else "-" for c in platform.node())
    set_folder_prefix(f"{host or 'elsewhere'}-{uuid.uuid4().hex[:6]}-")


def begun_with(logs: Mapping[str, bytes], set_up: SetUp[T, R]) -> Callable[[T], R]:
    """In a process far away: what answers tasks there, which knows the runs that are known here.

    Args:
        logs: those of `known_logs`.
        set_up: gives it.
    """
    begin_there(logs)
    return set_up()


@contextmanager
def runs_there(folder: Path | None) -> Iterator[RunsMade]:
    """The runs that are made in a folder meanwhile; they are there at the end.

    Args:
        folder: of the runs; None for a case that runs nothing.
    """
    made = RunsMade()
    if folder is None:
        yield made
        return
    lines, folders = _lines(folder), _folders(folder)
    yield made
    made.lines = _lines(folder).removeprefix(lines)
    for name in sorted(_folders(folder) - folders):
        content = _content(folder / name)
        made.files |= {f"{name}/{file}": content[file] for file in content}


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
    def journals(self) -> tuple[str, ...]:
        """Its checkpoint, and the log of the runs of its model."""
        return (self.checkpoint, *([str(Path(self.runs) / FILE)] if self.runs else []))

    def going_on(self) -> Self:
        """The same with the evaluations that an interrupted command has left here."""
        with suppress(OSError):
            return self.resumed({self.checkpoint: Path(self.checkpoint).read_bytes()})
        return self

    @contextmanager
    def begun(self) -> Iterator[RunsMade]:
        """Lay out what it goes on from, where it is computed; its runs are there at the end.

        A process that was lost over it there may have left a longer checkpoint.
        """
        for name, content in self.kept.items():
            if name != self.checkpoint:
                add_lines(Path(name), content)
            elif size_of(Path(name)) < len(content):
                Path(name).write_bytes(content)
        with runs_there(Path(self.runs) if self.runs else None) as made:
            yield made


@dataclass(frozen=True)
class TravellingAnswer(Generic[R]):
    """What has come of a task that computes a case.

    Args:
        end: how it ended.
        files: path to content of what it has written.
        runs: folder of the runs of its model; empty where that runs nothing.
        made: runs of its model.
    """

    end: R
    files: Mapping[str, bytes]
    runs: str
    made: RunsMade

    def keep_runs(self) -> None:
        """Add the runs that were made there to those that are here.

        Raises:
            OutputError: they cannot be written.
        """
        if self.runs:
            keep_runs(self.made, Path(self.runs))


def keep_runs(made: RunsMade, folder: Path) -> None:
    """Add runs that were made on another machine to those that are here.

    Args:
        made: they.
        folder: of the runs here.

    Raises:
        OutputError: they cannot be written.
    """
    try:
        for name, content in made.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        if made.lines:
            add_lines(folder / FILE, made.lines)
    except OSError as error:
        message = f"{folder}: runs cannot be kept: {error.strerror or error}"
        raise OutputError(message) from error


def _folders(folder: Path) -> set[str]:
    if not folder.is_dir():
        return set()
    return {path.name for path in folder.iterdir() if path.is_dir()}


def _content(folder: Path) -> dict[str, bytes]:
    """The files of a run, the small ones first, as many as come back."""
    contents: dict[str, bytes] = {}
    left, size = [], 0
    files = [path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()]
    for path in sorted(files, key=lambda path: path.stat().st_size):
        name = path.relative_to(folder).as_posix()
        size += path.stat().st_size
        if size > _MOST:
            left.append(name)
        else:
            contents[name] = path.read_bytes()
    if left:
        contents[_LEFT_OUT] = "".join(f"{name}\n" for name in left).encode()
    return contents
