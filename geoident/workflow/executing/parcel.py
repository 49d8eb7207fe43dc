"""Files that travel to other machines by their content, and lie there as they lie here."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

_READ_ONLY = 0o444
_PROGRAM = 0o555


@dataclass(frozen=True)
class Parcel:
    """Files by their content.

    Args:
        names: path of each, relative to a folder that holds them all, to the SHA-256 of its
            content.
        contents: SHA-256 to bytes; what several files have in common travels once.
        executable: which of the names may be executed.
        here: where paths in tasks are meant from, as seen from the folder of the files.
        programs: that must be there already, as commands name them.
    """

    names: Mapping[str, str]
    contents: Mapping[str, bytes]
    executable: frozenset[str] = frozenset()
    here: str = "."
    programs: tuple[str, ...] = ()

    @property
    def digest(self) -> str:
        """SHA-256 of names and contents."""
        said = [sorted(self.names.items()), sorted(self.executable)]
        return hashlib.sha256(json.dumps(said).encode()).hexdigest()

    @property
    def size(self) -> int:
        """Bytes that travel."""
        return sum(len(content) for content in self.contents.values())

    def unpack(self, folder: Path) -> None:
        """Lay the files out under a folder, where no half of it is ever seen.

        Args:
            folder: which is made; if it is there, it holds them already.

        Raises:
            OSError: they cannot be written.
            ValueError: a content is not what was sent.
        """
        if folder.is_dir():
            return
        half = folder.with_name(f"{folder.name}.{os.getpid()}.part")
        shutil.rmtree(half, ignore_errors=True)
        try:
            half.mkdir(parents=True)
            for name, digest in self.names.items():
                content = self.contents[digest]
                if hashlib.sha256(content).hexdigest() != digest:
                    raise ValueError(f"{name} was garbled on its way")
                path = half / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
                path.chmod(_PROGRAM if name in self.executable else _READ_ONLY)
            half.rename(folder)
        finally:
            shutil.rmtree(half, ignore_errors=True)


def packed(files: Mapping[str, Path], *, here: str = ".", programs: tuple[str, ...] = ()) -> Parcel:
    """Files as they are now.

    Args:
        files: relative path of each to where it is.
        here: where paths in tasks are meant from, as seen from the folder of the files.
        programs: that must be there already.

    Raises:
        OSError: one cannot be read.
    """
    names: dict[str, str] = {}
    executable = frozenset(name for name, path in files.items() if os.access(path, os.X_OK))
    contents: dict[str, bytes] = {}
    for name, path in files.items():
        content = path.read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        names[name] = digest
        contents.setdefault(digest, content)
    return Parcel(names, contents, executable, here, programs)


@dataclass(frozen=True)
class FileLayout:
    """Where things are in relation to each other, so that it is the same on another machine.

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


def folder_of_process(unpacked: Path, process: int) -> Path:
    """The folder that only one process writes to.

    Args:
        unpacked: folder of the files.
        process: number of the process.
    """
    return unpacked.with_name(f"{unpacked.name}.of.{process}")


def own_copy(unpacked: Path, layout_here: str) -> None:
    """Make this process work in a copy of unpacked files, in a folder that only it writes to.

    The files are links to the unpacked ones where the file system has them.

    Args:
        unpacked: folder of the files.
        layout_here: where paths are meant from, as seen from it.

    Raises:
        OSError: it cannot be made.
    """
    mine = folder_of_process(unpacked, os.getpid())
    shutil.rmtree(mine, ignore_errors=True)
    shutil.copytree(unpacked, mine, copy_function=_link)
    here = mine / layout_here
    here.mkdir(parents=True, exist_ok=True)
    os.chdir(here)


def _link(source: str, target: str) -> None:
    try:
        Path(target).hardlink_to(source)
    except (OSError, NotImplementedError):
        shutil.copyfile(source, target)
