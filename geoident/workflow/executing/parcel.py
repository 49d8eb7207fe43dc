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
        current: where paths in tasks are meant from, as seen from the folder of the files.
        programs: that must be there already, as commands name them.
    """

    files: Mapping[str, bytes]
    executable: frozenset[str] = frozenset()
    current: str = "."
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
        place = folder / self.current
        place.mkdir(parents=True, exist_ok=True)
        return place


def packed(
    files: Iterable[str | Path] = (),
    *,
    beside: Iterable[str | Path] = (),
    programs: tuple[str, ...] = (),
) -> Parcel:
    """Files as they are now, laid out as they lie around the folder where the command runs.

    Args:
        files: their paths.
        beside: paths that tasks write to.
        programs: that must be there already.

    Raises:
        OSError: a file cannot be read.
        ValueError: they are on different drives.
    """
    current = os.path.abspath(os.curdir)  # noqa: PTH100 - links stay links
    paths = [os.path.abspath(path) for path in files]  # noqa: PTH100
    others = [os.path.abspath(path) for path in beside]  # noqa: PTH100
    root = os.path.commonpath([current, *paths, *others])

    def name(path: str) -> str:
        return Path(os.path.relpath(path, root)).as_posix()

    contents = {name(path): Path(path).read_bytes() for path in paths}
    executable = frozenset(name(path) for path in paths if os.access(path, os.X_OK))
    return Parcel(contents, executable, name(current), programs)


def relative(path: str) -> str:
    """A path as seen from where the command runs; one that is relative stays as it is.

    >>> relative("cases/../case.yaml")
    'cases/../case.yaml'
    """
    return os.path.relpath(path) if Path(path).is_absolute() else path
