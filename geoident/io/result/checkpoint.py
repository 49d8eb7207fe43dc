"""Model evaluations kept on disk, so that an interrupted run goes on by replaying them.

An identifier that is deterministic asks for the same parameter vectors again; those that the
log holds are answered without computing. The file is a header and records, appended one by one::

    magic | record(identity) | record(evaluation) | record(evaluation) | ...
    record = length (8 bytes), CRC-32 of the payload (4 bytes), payload

The payload of an evaluation is an npz archive. So is that of a solution of equations that took
long, which is kept because the evaluation that it belongs to may be cut short. A record counts when
its length and checksum are right; on opening, the first that is not (a run died while writing it)
and all after are cut off.

What is appended outlives the process at once. The disk itself is asked for at most once a second: a
machine that loses its power loses evaluations that took less than that, and a model that answers in
milliseconds does not wait for the disk at each.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
import struct
import sys
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from geoident.io.text.atomic import sync
from geoident.model.arrays import Floats

if sys.platform != "win32":
    import fcntl

Array = npt.NDArray[Any]
_MAGIC = b"geoident-evaluations/1\n"
_FRAME = struct.Struct("<QI")
_SYNC_EVERY = 1.0
"""Seconds from one time that the disk is waited for to the next, at least."""

ROOM = 2e9
"""Bytes of the disk that solutions leave free."""

MANY = 20
"""Solutions for which there must be room, for one to be kept."""

_SOLUTION = "solution "
"""Begins the kind of a record that is one."""

_NOWHERE = np.zeros(0)
"""Solutions are found by what is solved, not by parameters."""

_LOCKED = (errno.EAGAIN, errno.EACCES)
_KIND, _POINT, _ARRAY = "kind", "p", "array."


class EvaluationLog:
    """An append-only store of model evaluations. Make one with `EvaluationLog.open`.

    A log that cannot be read or written never ends a run: it turns itself off.

    Attributes:
        trouble: why the log has turned itself off, a sentence, or None while it works.
    """

    def __init__(self, path: Path) -> None:
        self.trouble: str | None = None
        self._path = path
        self._file: io.FileIO | None = None
        self._own = False
        self._end = 0
        self._synced = -np.inf
        self._places: dict[tuple[str, bytes], tuple[int, int]] = {}

    @classmethod
    def open(cls, path: str | Path, identity: str) -> EvaluationLog:
        """Opens the log of a run, or makes it.

        Args:
            path: the file. One of another identity, or whose beginning is damaged, is replaced.
            identity: hash of everything that an evaluation depends on beside p.

        Returns:
            The log; if it cannot work, ``trouble`` says why.
        """
        log = cls(Path(path))
        try:
            log._open(identity)
        except OSError as error:
            log._turn_off(error)
        return log

    def __len__(self) -> int:
        """Number of evaluations."""
        return sum(not kind.startswith(_SOLUTION) for kind, _ in self._places)

    @property
    def solutions(self) -> int:
        """Number of solutions of equations."""
        return len(self._places) - len(self)

    def __enter__(self) -> EvaluationLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def find(self, kind: str, p: Floats) -> dict[str, Array] | None:
        """The arrays stored for exactly this kind and p (n,), bit by bit, or None."""
        place = self._places.get(_key(kind, p))
        if place is None or self._file is None:
            return None
        try:
            return _unpack(_read(self._file, *place))[2]
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):  # changed on disk meanwhile
            return None

    def add(self, kind: str, p: Floats, arrays: Mapping[str, Array]) -> None:
        """Stores an evaluation; when this returns it outlives the process (or ``trouble`` is set).

        Args:
            kind: what was computed, such as ``readings`` or ``jacobian``.
            p: (n,) parameters.
            arrays: name to array of numbers.
        """
        if self._file is None:
            return
        payload = _pack(kind, p, arrays)
        place = self._end + _FRAME.size
        try:
            self._append(self._file, payload)
        except OSError as error:
            self._turn_off(error)
            return
        self._places[_key(kind, p)] = (place, len(payload))

    def find_solution(self, name: str) -> dict[str, Array] | None:
        """What was kept of a solution of this name, bit by bit, or None."""
        return self.find(_SOLUTION + name, _NOWHERE)

    def add_solution(self, name: str, arrays: Mapping[str, Array]) -> None:
        """Stores a solution where there is room for many more of its size.

        Args:
            name: what is solved.
            arrays: name to array of numbers.
        """
        size = sum(array.nbytes for array in arrays.values())
        with suppress(OSError):
            if shutil.disk_usage(self._path.parent).free > ROOM + MANY * size:
                self.add(_SOLUTION + name, _NOWHERE, arrays)

    def close(self) -> None:
        """Closes the file and leaves it for a later run."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
        self._file = None

    def remove(self) -> None:
        """Closes the file and deletes it: the run is complete.

        The file of another run, which the log could not have, stays.
        """
        self.close()
        if self._own:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)

    def _open(self, identity: str) -> None:
        no_link = getattr(os, "O_NOFOLLOW", 0)  # where it leads is nothing of ours
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | no_link, 0o666)
        self._file = io.FileIO(descriptor, "r+")
        _lock(self._file)
        self._own = True
        header = _MAGIC + _framed(identity.encode())
        if _read(self._file, 0, len(header)) == header:
            self._load(self._file, len(header))
        else:
            self._begin(self._file, header)

    def _begin(self, file: io.FileIO, header: bytes) -> None:
        file.truncate(0)
        _write(file, 0, header)
        self._end = len(header)
        with suppress(OSError):
            sync(self._path.parent, os.O_RDONLY)

    def _load(self, file: io.FileIO, start: int) -> None:
        """Indexes the sound records from ``start`` on and cuts off what follows them."""
        self._end = start
        for place, payload in _records(file, start):
            try:
                kind, p, _ = _unpack(payload)
            except (ValueError, KeyError, zipfile.BadZipFile):
                break
            self._places[_key(kind, p)] = (place, len(payload))
            self._end = place + len(payload)
        file.truncate(self._end)

    def _append(self, file: io.FileIO, payload: bytes) -> None:
        """Appends a record, or leaves the file as it was."""
        record = _framed(payload)
        try:
            _write(file, self._end, record)
            if time.monotonic() - self._synced >= _SYNC_EVERY:
                os.fsync(file.fileno())
                self._synced = time.monotonic()
        except OSError:
            with suppress(OSError):
                file.truncate(self._end)
            raise
        self._end += len(record)

    def _turn_off(self, error: OSError) -> None:
        reason = os.strerror(error.errno) if error.errno else str(error)
        if error.errno in _LOCKED and self._file is not None:
            reason = "another run is using it"
        if error.errno == errno.ELOOP:
            reason = "it is a symbolic link; remove it"
        self.trouble = f"{self._path}: no checkpoint is kept: {reason}"
        self.close()


def _key(kind: str, p: Floats) -> tuple[str, bytes]:
    return kind, np.ascontiguousarray(p, dtype=np.float64).tobytes()


def _pack(kind: str, p: Floats, arrays: Mapping[str, Array]) -> bytes:
    named: dict[str, Any] = {_KIND: np.array(kind), _POINT: np.asarray(p, dtype=np.float64)}
    named |= {_ARRAY + name: array for name, array in arrays.items()}
    buffer = io.BytesIO()
    np.savez(buffer, **named)
    return buffer.getvalue()


def _unpack(payload: bytes) -> tuple[str, Floats, dict[str, Array]]:
    with np.load(io.BytesIO(payload), allow_pickle=False) as archive:
        arrays = {
            name.removeprefix(_ARRAY): archive[name]
            for name in archive.files
            if name.startswith(_ARRAY)
        }
        return str(archive[_KIND]), archive[_POINT], arrays


def _framed(payload: bytes) -> bytes:
    return _FRAME.pack(len(payload), zlib.crc32(payload)) + payload


def _records(file: io.FileIO, start: int) -> Iterator[tuple[int, bytes]]:
    """Place and payload of each record, up to the first that is not whole."""
    size = file.seek(0, os.SEEK_END)
    while start + _FRAME.size <= size:
        length, checksum = _FRAME.unpack(_read(file, start, _FRAME.size))
        place = start + _FRAME.size
        if length > size - place:
            return
        payload = _read(file, place, length)
        if zlib.crc32(payload) != checksum:
            return
        yield place, payload
        start = place + length


def _read(file: io.FileIO, place: int, length: int) -> bytes:
    file.seek(place)
    return file.read(length)


def _write(file: io.FileIO, place: int, data: bytes) -> None:
    """Writes all of it."""
    file.seek(place)
    view, done = memoryview(data), 0
    while done < len(view):
        done += file.write(view[done:])


def _lock(file: io.FileIO) -> None:
    """Refuses a second run on the same log; where locks do not exist, does nothing."""
    if sys.platform == "win32":
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _LOCKED:
            raise
