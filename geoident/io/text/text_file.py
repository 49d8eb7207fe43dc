"""Text from files that may be anything: bounded in size, UTF-8, without control characters."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

from geoident.errors import Fault, InputError, Location

STDIN = "-"
_CONTROL = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_SAVE = "Save the file as plain text in UTF-8."


def seen_from(folder: Path, path: Path | str) -> str:
    """A path as a file in a folder names it; absolute where no relative one leads there."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return str(Path(path).absolute())


def read_bytes(path: str, *, limit: int, what: str) -> bytes:
    """The bytes of a file, of stdin for ``-``.

    Args:
        path: the file.
        limit: size in bytes from which on it is refused.
        what: name of the kind of file in messages.

    Raises:
        InputError: it cannot be read, or is larger than the limit.
    """
    try:
        if path == STDIN:
            data = sys.stdin.buffer.read(limit + 1)
        else:
            with Path(path).open("rb") as file:
                data = file.read(limit + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        message = f"the {what} cannot be read: {reason}"
        hint = "Check the path and the permission to read it."
        raise InputError([Fault("unreadable-file", message, hint, Location(path))]) from error
    if len(data) > limit:
        message = f"the {what} is larger than {limit // 10**6} MB"
        raise InputError([Fault("too-large", message, location=Location(path))])
    return data


def decode(data: bytes, file: str) -> str:
    """Text of a file without its byte order mark.

    Raises:
        InputError: not UTF-8, or with control characters.
    """
    if data.startswith(_UTF16):
        raise _fault(file, "the file is UTF-16 text; UTF-8 is expected", 1, 1)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8", "replace")
        message = f"byte 0x{data[error.start]:02x} is not UTF-8 text"
        raise _fault(file, message, *position(before, len(before))) from error
    wrong = _CONTROL.search(text)
    if wrong:
        message = f"character U+{ord(wrong[0]):04X} is not text; is this a binary file?"
        raise _fault(file, message, *position(text, wrong.start()))
    return text


def position(text: str, index: int) -> tuple[int, int]:
    """Line and column, from 1, of a character of a text."""
    return text.count("\n", 0, index) + 1, index - text.rfind("\n", 0, index)


def _fault(file: str, message: str, line: int, column: int) -> InputError:
    return InputError([Fault("not-text", message, _SAVE, Location(file, line, column))])
