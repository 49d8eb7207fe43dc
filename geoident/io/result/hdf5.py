"""HDF5 in plain shapes: tables with named dimensions, texts, and errors that say what is missing.

Written so that xarray, MATLAB and h5dump read it: float64, int64, int8 and UTF-8 datasets,
contiguous and uncompressed, in the oldest layout, without time stamps (equal input gives equal
bytes). Every axis of a table is an HDF5 dimension scale.

HDF5 does not survive a full disk: a write that fails while a file is closed leaves the library with
an open file in pieces, and the process ends with a segmentation fault. So `hdf5_output` puts a file
of our own under the library, which hides the failure from it and raises it afterwards; what is
small it has write into memory first. A signal (Ctrl-C) must not raise inside the library either,
and is held back until the file is closed.

Campaigns write a file of seventy small datasets every few milliseconds, so these are made with the
library's own calls, without the questions that h5py asks for each of them: half the time.
"""

from __future__ import annotations

import io
import os
import re
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
import numpy.typing as npt

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.text.head import said_format
from geoident.model.arrays import Bools, Floats, Ints

_READ_ERRORS = (
    OSError, LookupError, RuntimeError, ArithmeticError, ValueError, TypeError, AttributeError,
    MemoryError,
)  # fmt: skip
"""What h5py raises of damaged files, and what parts of a wrong shape or kind lead to."""

_T = TypeVar("_T", str, float)
_NUMPY_KINDS = {"float": "f", "int": "iu", "bool": "iu", "text": "O"}
_AGAIN = "run the command that wrote it again"


class _Sink(io.RawIOBase):
    """A file for HDF5 to write to that remembers the first failure instead of raising it."""

    def __init__(self, file: io.FileIO) -> None:
        super().__init__()
        self.trouble: OSError | None = None
        self._file = file
        self._position = 0
        self._end = 0

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._end}[whence]
        self._position = base + offset
        return self._position

    def tell(self) -> int:
        return self._position

    def readinto(self, buffer: Any, /) -> int:
        view = memoryview(buffer).cast("B")
        self._file.seek(self._position)
        view[:] = self._file.read(len(view)).ljust(len(view), b"\0")
        self._position += len(view)
        return len(view)

    def write(self, data: Any, /) -> int:
        view = memoryview(data).cast("B")
        if self.trouble is None:
            self._store(view)
        self._position += len(view)
        self._end = max(self._end, self._position)
        return len(view)

    def truncate(self, size: int | None = None, /) -> int:
        self._end = self._position if size is None else size
        try:
            self._file.truncate(self._end)
        except OSError as error:
            self.trouble = self.trouble or error
        return self._end

    def write_all(self, data: Any) -> None:
        """Write a whole file.

        Args:
            data: bytes of it.

        Raises:
            OSError: it cannot be written.
        """
        self.write(data)
        if self.trouble is not None:
            raise self.trouble

    def _store(self, view: memoryview) -> None:
        done = 0
        try:
            self._file.seek(self._position)
            while done < len(view):
                done += self._file.write(view[done:])
        except OSError as error:
            self.trouble = error


class _Memory(io.BytesIO):
    """A file for HDF5 in memory."""

    def readinto(self, buffer: Any, /) -> int:
        view = memoryview(buffer).cast("B")
        count = super().readinto(view)
        view[count:] = bytes(len(view) - count)
        return len(view)

    def truncate(self, size: int | None = None, /) -> int:
        end = super().truncate(size)
        missing = end - self.seek(0, os.SEEK_END)
        if missing > 0:
            self.write(bytes(missing))
        return end


_VERSIONS = ("earliest", "v110")


@contextmanager
def hdf5_output(path: str | Path, *, small: bool = False) -> Iterator[h5py.File]:
    """Opens an existing file for writing from its beginning.

    Args:
        path: of the file.
        small: it is put together in memory, and written in one piece.

    Raises:
        OSError: it cannot be written (disk full, ...); the library's state stays sound.
    """
    with _signals_held(), io.FileIO(path, "w+") as raw:
        if small:
            memory = _Memory()
            with h5py.File(memory, "w", libver=_VERSIONS) as file:
                yield file
            _Sink(raw).write_all(memory.getbuffer())
            return
        sink = _Sink(raw)
        try:
            with h5py.File(sink, "w", libver=_VERSIONS) as file:
                yield file
        except Exception:
            if sink.trouble is None:
                raise
        if sink.trouble is not None:
            raise sink.trouble


@contextmanager
def _signals_held() -> Iterator[None]:
    """Lets the interrupts that arrive in the block act when it ends."""
    arrived: list[int] = []
    handlers: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for held in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(held) is not None:
                handlers[held] = signal.signal(held, lambda got, _: arrived.append(got))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in arrived:
            signal.raise_signal(number)


def refusal(path: str | Path, code: str, message: str, hint: str = _AGAIN) -> InputError:
    """An input error on a file as a whole.

    Args:
        path: of the file.
        code: what kind of fault it is, for programs.
        message: what is wrong.
        hint: what to do about it.
    """
    return InputError([Fault(code, message, hint, Location(str(path)))])


@contextmanager
def hdf5_input(path: str | Path) -> Iterator[h5py.File]:
    """Opens a file for reading, and says of every failure inside the block what it means.

    Raises:
        InputError: there is no such file, it is not HDF5, it is truncated or damaged.
    """
    try:
        with _open(path) as file:
            yield file
    except _READ_ERRORS as error:
        raise refusal(path, "damaged-result", f"damaged: {_first_line(error)}") from error


def _open(path: str | Path) -> h5py.File:
    if not Path(path).exists():
        raise refusal(path, "no-result", "there is no such file", "check the path")
    if not Path(path).is_file():
        raise refusal(path, "not-a-result", "not a file", "give the path of a result file")
    try:
        _refuse_other_length(path)
        return h5py.File(path, "r", locking=False)
    except PermissionError as error:
        raise refusal(path, "no-result", "no permission to read it", "") from error
    except OSError as error:
        raise _unreadable(path, str(error)) from error


_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_END_AT = {0: 40, 1: 44, 2: 28, 3: 28}
"""Version of an HDF5 file to where it says its length, with addresses of 8 bytes."""


def _refuse_other_length(path: str | Path) -> None:
    """Refuse an HDF5 file that is longer than it says: something was put in on its way here.

    HDF5 itself refuses shorter ones, and may search a longer one without end.
    """
    with Path(path).open("rb") as file:
        head = file.read(64)
        length = file.seek(0, io.SEEK_END)
    at = _END_AT.get(head[8]) if head.startswith(_SIGNATURE) and len(head) == 64 else None
    if at is not None and length > int.from_bytes(head[at : at + 8], "little"):
        raise refusal(path, "damaged-result", "damaged: it is longer than it was written")


_COMPUTED = {"geoident-case": "a case", "geoident-project": "a project of several sections"}
"""Format of files that have a result beside them, to what they are."""


def _unreadable(path: str | Path, reason: str) -> InputError:
    if "truncated" in reason:
        return refusal(path, "damaged-result", "truncated: its end is missing")
    if "signature" in reason:
        kind = _COMPUTED.get(said_format(path).partition("/")[0])
        if kind is not None:
            result = Path(path).with_suffix(".fit.h5")
            hint = f"give its result: {result}"
            if not result.exists():
                hint = f"give its result, which {Term.FIT} writes: {result}"
            message = f"this file is {kind}; a result is expected"
            return refusal(path, "not-a-result", message, hint)
        return refusal(
            path,
            "not-a-result",
            "not an HDF5 file, or its beginning is damaged",
            "give the path of a result file, such as CASE.fit.h5",
        )
    return refusal(path, "damaged-result", f"damaged: {reason.splitlines()[0]}")


def _first_line(error: BaseException) -> str:
    text = str(error.args[0]) if error.args else type(error).__name__
    return (text.splitlines() or [type(error).__name__])[0]


def plain_text(text: str) -> str:
    r"""Text as HDF5 can hold it: valid UTF-8 without NUL; what is not is written as an escape.

    >>> print(plain_text("a\0b"))
    a\x00b
    """
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")


_HIDDEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")


def visible(text: str) -> str:
    r"""A text that was read, with an escape in place of what a terminal would obey.

    >>> print(visible("\x1b[2Jgone"))
    \x1b[2Jgone
    """
    return _HIDDEN.sub(lambda match: f"\\x{ord(match[0]):02x}", text)


def texts(values: Sequence[str]) -> npt.NDArray[np.object_]:
    """(k,) array of variable-length UTF-8, also for k = 0."""
    return np.array([plain_text(value) for value in values], dtype=h5py.string_dtype())


_TEXTS = h5py.string_dtype()
"""UTF-8 of any length."""

_TEXT = h5py.h5t.py_create(_TEXTS, logical=True)
_ONE = h5py.h5s.create_simple(())

_PLAIN = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
_PLAIN.set_obj_track_times(False)


def text_attribute(owner: Any, name: str, text: str) -> None:
    """Writes a new attribute that is a text.

    Args:
        owner: identifier of what has it.
        name: of the attribute.
        text: as `plain_text` gives it.
    """
    written = h5py.h5a.create(owner, name.encode(), _TEXT, _ONE)
    written.write(np.array(text, dtype=_TEXTS))


class TableWriter:
    """Writes one group as a table: datasets whose axes are named by dimension scales.

    Args:
        parent: where the group is made.
        name: name of the group; empty for the parent itself.
        axes: name of every dimension to its coordinates (k,), texts or numbers.
    """

    def __init__(
        self, parent: h5py.Group, name: str, axes: Mapping[str, Sequence[str] | Floats | Ints]
    ) -> None:
        self.group = parent.create_group(name) if name else parent
        self._scales: dict[str, Any] = {}
        for axis, values in axes.items():
            data = values if isinstance(values, np.ndarray) else texts(values)
            self._scales[axis] = self._dataset(axis, data)
            h5py.h5ds.set_scale(self._scales[axis], axis.encode())

    def add(
        self, name: str, data: npt.NDArray[Any] | Sequence[str], *dims: str, unit: str = ""
    ) -> None:
        """Writes one dataset with one dimension name for each of its axes.

        Truth values are written as int8.

        Args:
            name: of the dataset.
            data: (...) numbers, truth values or texts.
            *dims: names of its axes.
            unit: of the numbers, an attribute; empty for none.
        """
        array = data if isinstance(data, np.ndarray) else texts(data)
        if array.dtype == np.bool_:
            array = array.astype(np.int8)
        dataset = self._dataset(name, array)
        for number, dim in enumerate(dims):
            h5py.h5ds.attach_scale(dataset, self._scales[dim], number)
        if unit:
            text_attribute(dataset, "unit", unit)

    def _dataset(self, name: str, data: npt.NDArray[Any]) -> Any:
        """A contiguous dataset (...), as `h5py.Group.create_dataset` makes it."""
        kind = _TEXT if data.dtype.kind == "O" else h5py.h5t.py_create(data.dtype, logical=True)
        space = h5py.h5s.create_simple(data.shape)
        dataset = h5py.h5d.create(self.group.id, name.encode(), kind, space, _PLAIN)
        dataset.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(data))
        return dataset


def _is_here(group: h5py.Group, name: str) -> bool:
    """Whether a member of a group lies in its file: a file of a stranger may name any other."""
    return isinstance(group.get(name, getlink=True), h5py.HardLink | None)


class TableReader:
    """Reads one group of a result, and says which piece of it is missing.

    Args:
        parent: of the group.
        name: of the group; empty for the parent itself.

    Raises:
        InputError: the group or one of its datasets is missing, or has another shape or type.
    """

    def __init__(self, parent: h5py.Group, name: str) -> None:
        self._path = parent.file.filename
        self.name = f"{parent.name.rstrip('/')}/{name}"
        if name and not (_is_here(parent, name) and isinstance(parent.get(name), h5py.Group)):
            raise self._damage(self.name, "is missing")
        self.group = parent[name] if name else parent
        self._sizes: dict[str, int] = {}

    def __contains__(self, name: str) -> bool:
        return name in self.group

    def array(self, name: str, kinds: str) -> npt.NDArray[Any]:
        """A dataset (...) whose numpy type is of one of these kinds, such as ``f`` or ``iu``.

        Raises:
            InputError: it is missing, or of another type.
        """
        dataset = self.group.get(name)
        if not isinstance(dataset, h5py.Dataset):
            raise self._damage(f"{self.name}/{name}", "is missing")
        if not _is_here(self.group, name) or dataset.external or dataset.is_virtual:
            raise self._damage(f"{self.name}/{name}", "lies in another file")
        if dataset.dtype.kind not in kinds:
            raise self._damage(f"{self.name}/{name}", f"holds {dataset.dtype}")
        return np.asarray(dataset[()])

    def column(self, name: str, kind: str, shape: tuple[int, ...]) -> Any:
        """An array of the given shape; texts as a tuple.

        Args:
            name: of the dataset.
            kind: ``float``, ``int``, ``bool`` or ``text``.
            shape: that it must have.
        """
        array = self.array(name, _NUMPY_KINDS[kind])
        if array.shape != shape:
            raise self._damage(f"{self.name}/{name}", f"has the shape {array.shape}, not {shape}")
        match kind:
            case "float":
                return array.astype(np.float64, copy=False)
            case "int":
                return array.astype(np.int64, copy=False)
            case "bool":
                return np.asarray(array != 0)
        return tuple(visible(value.decode()) for value in array)

    def size(self, axis: str) -> int:
        """How many entries stand along an axis."""
        if axis not in self._sizes:  # each column of a table asks
            self._sizes[axis] = len(self.array(axis, "fiuO"))
        return self._sizes[axis]

    def floats(self, name: str, *shape: int) -> Floats:
        """Numbers (...) of the given shape."""
        values: Floats = self.column(name, "float", shape)
        return values

    def ints(self, name: str, *shape: int) -> Ints:
        """Whole numbers (...) of the given shape."""
        values: Ints = self.column(name, "int", shape)
        return values

    def bools(self, name: str, *shape: int) -> Bools:
        """Truth values (...) of the given shape."""
        values: Bools = self.column(name, "bool", shape)
        return values

    def texts(self, name: str, *shape: int) -> tuple[str, ...]:
        """A list of texts; without a shape, of any length."""
        values: tuple[str, ...] = self.column(name, "text", shape or (self.size(name),))
        return values

    def text(self, name: str) -> str:
        """A single text."""
        return visible(bytes(self.array(name, "O").item()).decode())

    def attribute(self, name: str, kind: type[_T]) -> _T:
        """An attribute of the group, as a text or a number.

        Raises:
            InputError: it is missing, or no such value.
        """
        try:
            value = kind(self.group.attrs[name])
            return visible(value) if isinstance(value, str) else value
        except (KeyError, TypeError, ValueError):
            if self.name == "/" and name not in self.group.attrs:
                raise self._damage("the attribute", f"{name!r} is missing") from None
            raise self._damage(
                f"{self.name}, attribute {name},", "is missing or no value"
            ) from None

    def attribute_texts(self, name: str) -> tuple[str, ...]:
        """An attribute of the group that is a list of texts; none if it is not there."""
        return tuple(visible(str(text)) for text in self.group.attrs.get(name, ()))

    def _damage(self, name: str, what: str) -> InputError:
        hint = f"an earlier version of geoident may not have had it: {_AGAIN}"
        hint = hint if what == "is missing" else _AGAIN
        return refusal(self._path, "damaged-result", f"{name} {what}", hint)
