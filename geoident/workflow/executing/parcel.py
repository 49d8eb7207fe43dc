"""Files that travel to other machines, and lie there as they lie here."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

_READ_ONLY = 0o444
_PROGRAM = 0o555


@dataclass(frozen=True)
class Parcel:
    """Files with their contents.

    Args:
        files: path of each, relative to a folder that holds them all, to its content.
        executable: which of them may be executed.
        here: where paths in tasks are meant from, as seen from the folder of the files.
        programs: that must be there already, as commands name them.
    """

    files: Mapping[str, bytes]
    executable: frozenset[str] = frozenset()
    here: str = "."
    programs: tuple[str, ...] = ()

    def unpack(self, folder: Path) -> Path:
        """Lay the files out under a folder; the folder from which paths in tasks are meant.

        Args:
            folder: which is made.

        Raises:
            OSError: they cannot be written.
        """
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            path.chmod(_PROGRAM if name in self.executable else _READ_ONLY)
        place = folder / self.here
        place.mkdir(parents=True, exist_ok=True)
        return place


def packed(files: Mapping[str, Path], *, here: str = ".", programs: tuple[str, ...] = ()) -> Parcel:
    """Files as they are now.

    Args:
        files: relative path of each to where it is.
        here: where paths in tasks are meant from, as seen from the folder of the files.
        programs: that must be there already.

    Raises:
        OSError: one cannot be read.
    """
    executable = frozenset(name for name, path in files.items() if os.access(path, os.X_OK))
    contents = {name: path.read_bytes() for name, path in files.items()}
    return Parcel(contents, executable, here, programs)


@dataclass(frozen=True)
class FileLayout:
    """Where files are in relation to each other, so that it is the same on another machine.

    Args:
        root: a folder that holds all that is read and written.
        here: where paths are meant from, as seen from there.
    """

    root: Path
    here: str

    def name(self, path: str | Path) -> str:
        """A path as seen from the root."""
        return Path(os.path.relpath(path, self.root)).as_posix()


def layout_of(paths: Iterable[str | Path]) -> FileLayout:
    """The layout of files and folders, and of where the command runs.

    Args:
        paths: of all that is read or written.

    Raises:
        ValueError: they are on different drives.
    """
    here = os.path.abspath(os.curdir)  # noqa: PTH100 - links stay links
    every = [here, *(os.path.abspath(path) for path in paths)]  # noqa: PTH100
    root = Path(os.path.commonpath(every))
    return FileLayout(root, Path(os.path.relpath(here, root)).as_posix())


def relative(path: str) -> str:
    """A path as seen from where the command runs; one that is relative stays as it is.

    >>> relative("cases/../case.yaml")
    'cases/../case.yaml'
    """
    return os.path.relpath(path) if Path(path).is_absolute() else path
