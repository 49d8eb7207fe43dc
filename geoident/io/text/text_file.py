"""Text from files that may be anything: bounded, of a known encoding, no control characters."""

from __future__ import annotations

import codecs
import os
import re
import stat
import sys
from pathlib import Path

from geoident.errors import Fault, InputError, Location

STDIN = "-"
_CONTROL = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_NO_TEXT = frozenset(
    {"idna", "punycode", "unicode-escape", "raw-unicode-escape", "undefined", "utf-7", "charmap"}
)
"""Codecs of Python that are no encodings of files."""
_SAVE = "Save the file as plain text in UTF-8."


def seen_from(folder: Path, path: Path | str) -> str:
    """A path as a file in a folder names it; absolute where no relative one leads there."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return str(Path(path).absolute())


def require_file(path: str | Path, what: str) -> None:
    """Refuse what is no file of a disk: a pipe or a device, of which reading may never end.

    What is not there at all, and a folder, are left to whoever opens it.

    Args:
        path: the file.
        what: name of the kind of file in messages.

    Raises:
        InputError: it is none.
    """
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        return
    kind = "a pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"
    message = f"the {what} is {kind}, not a file"
    hint = "Save what comes out of it as a file, and name that."
    raise InputError([Fault("not-a-file", message, hint, Location(str(path)))])


def read_bytes(path: str, *, limit: int, what: str) -> bytes:
    """The bytes of a file, of stdin for ``-``.

    Args:
        path: the file.
        limit: size in bytes from which on it is refused.
        what: name of the kind of file in messages.

    Raises:
        InputError: it cannot be read, is no file, or is larger than the limit.
    """
    try:
        if path == STDIN:
            data = sys.stdin.buffer.read(limit + 1)
        else:
            require_file(path, what)
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


def decode(data: bytes, file: str, *, encoding: str = "", hint: str = "") -> str:
    """Text of a file without its byte order mark.

    Args:
        data: of the file.
        file: its path, for messages.
        encoding: a codec that `encoding_problem` has nothing against; empty for UTF-8.
        hint: the remedy where an encoding may be declared; a byte order mark of UTF-16 then counts
            as declared.

    Raises:
        InputError: not text of this encoding, or with control characters.
    """
    if data.startswith(_UTF16):
        if not hint:
            raise _fault(file, "the file is UTF-16 text; expected UTF-8", 1, 1, _SAVE)
        encoding = "utf-16"
    codec = encoding or "utf-8-sig"
    if encoding and codecs.lookup(encoding).name == "utf-8":
        codec = "utf-8-sig"
    try:
        text = data.decode(codec)
    except UnicodeDecodeError as error:
        before = data[: error.start].decode(codec, "replace")
        message = f"byte 0x{data[error.start]:02x} is not {encoding or 'UTF-8'} text"
        raise _fault(file, message, *position(before, len(before)), hint or _SAVE) from error
    wrong = _CONTROL.search(text)
    if wrong:
        message = f"character U+{ord(wrong[0]):04X} is not text; is this a binary file?"
        raise _fault(file, message, *position(text, wrong.start()), hint or _SAVE)
    return text


def encoding_problem(name: str) -> str | None:
    """Why a name is none of an encoding of text, or None if it is one.

    >>> encoding_problem("Windows-1252")
    >>> encoding_problem("base64")
    'it does not make text'
    """
    try:
        codec = codecs.lookup(name)
        b"aaaa".decode(codec.name, "replace")
    except (LookupError, ValueError) as error:
        known = isinstance(error, LookupError) and "not a text" in str(error)
        return "it does not make text" if known else "there is none of this name"
    except UnicodeError:
        return "it does not make text"
    return "it does not make text" if codec.name in _NO_TEXT else None


def position(text: str, index: int) -> tuple[int, int]:
    """Line and column, from 1, of a character of a text."""
    return text.count("\n", 0, index) + 1, index - text.rfind("\n", 0, index)


def _fault(file: str, message: str, line: int, column: int, hint: str) -> InputError:
    return InputError([Fault("not-text", message, hint, Location(file, line, column))])
