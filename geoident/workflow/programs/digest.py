"""What decides what a run gives: texts and files, as one number."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

from geoident.errors import Fault, InputError, Location
from geoident.io.external.imports import imported_files, words_of
from geoident.model.external import ExternalProgram, ExternalSource


def executable(program: ExternalProgram) -> str | None:
    """Path of the program that a case runs; None where there is none."""
    name = program.command[0]
    if "/" in name or "\\" in name:
        path = Path(program.folder) / name
        return str(path.resolve()) if path.is_file() and os.access(path, os.X_OK) else None
    return shutil.which(name)


def model_files(source: ExternalSource) -> tuple[str, ...]:
    """Paths of all files that decide what runs of a model elsewhere give, its program among them.

    Args:
        source: the model.
    """
    if not isinstance(source, ExternalProgram):
        return source.inputs
    words = [word for argument in source.command[1:] for word in words_of(argument)]
    programs = [shutil.which(word) for word in words if Path(word).name == word]  # mpirun PROGRAM
    if not is_beside(source):
        programs.insert(0, executable(source))
    with_imports = ((path, *imported_files(path)) for path in programs if path is not None)
    return tuple(dict.fromkeys(chain(source.inputs, *with_imports)))


def names_of(source: ExternalSource, folder: Path) -> list[str]:
    """What the files of a model are called: another name may make another model of them.

    Args:
        source: the model.
        folder: from which they are seen; of what lies outside of it only the last part counts.
    """
    names = [Path(os.path.relpath(file, folder)) for file in source.inputs]
    return [name.name if ".." in name.parts else name.as_posix() for name in names]


def is_beside(program: ExternalProgram) -> bool:
    """Whether the program that a case runs is meant from the folder of the case."""
    name = program.command[0]
    return ("/" in name or "\\" in name) and not Path(name).is_absolute()


class ModelFiles:
    """Files that decide what a run gives, as they are now.

    Args:
        files: their paths.

    Raises:
        InputError: one cannot be read.
    """

    def __init__(self, files: Iterable[str]) -> None:
        self._known = {path: (_state(path), _hashed(path)) for path in dict.fromkeys(files)}

    def digest(self, texts: Sequence[str], files: Sequence[str]) -> str:
        """SHA-256 of texts and of the contents of some of the files.

        Args:
            texts: the texts.
            files: paths.
        """
        total = hashlib.sha256()
        for text in texts:
            total.update(hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest())
        for path in files:
            total.update(self._known[path][1])
        return total.hexdigest()

    def require_unchanged(self) -> None:
        """The files are what they were: what was trusted, and what runs are kept for.

        Raises:
            InputError: one is not.
        """
        for path, (state, content) in self._known.items():
            now = _state(path)
            if now == state:
                continue
            if _hashed(path) != content:
                message = "the file of the model has changed since it was looked at"
                hint = (
                    "Begin again: runs of its new state are other runs. What the model writes "
                    "itself belongs in the folder of its run."
                )
                raise InputError([Fault("changed-file", message, hint, Location(path))])
            self._known[path] = now, content


def digest_of(texts: Sequence[str], files: Sequence[str]) -> str:
    """SHA-256 of texts and of the contents of files.

    Args:
        texts: the texts.
        files: paths.

    Raises:
        InputError: a file cannot be read.
    """
    return ModelFiles(files).digest(texts, files)


def _state(path: str) -> tuple[int, ...]:
    """What tells, without reading a file, that it may be another; nothing where there is none."""
    try:
        status = Path(path).stat()
    except OSError:
        return ()
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file as hexadecimal digits; raises OSError."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def known_sha256(path: str | Path) -> str:
    """The same; empty where the file cannot be read."""
    try:
        return file_sha256(path)
    except OSError:
        return ""


def _hashed(path: str) -> bytes:
    try:
        return bytes.fromhex(file_sha256(path))
    except OSError as error:
        message = f"the file of the model cannot be read: {error.strerror or error}"
        raise InputError([Fault("unreadable-file", message, location=Location(path))]) from error
