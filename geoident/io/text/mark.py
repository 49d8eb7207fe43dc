"""The mark of a file that geoident made: of which cases, and how to see that nobody changed it.

A page or a picture can be made again from the result that it shows, so one that is as geoident made
it may give way to a newer one of the same case. The mark is a comment at the end of the file (in a
PNG a text chunk) with the name of the case, a key that tells cases of the same name apart, and the
SHA-256 of all the rest of the file.
"""

from __future__ import annotations

import hashlib
import os
import re
import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, unquote

from geoident.io.text.text_file import STDIN

_COMMENTS = {
    "html": (b"<!-- ", b" -->\n"),
    "svg": (b"<!-- ", b" -->\n"),
    "pdf": (b"% ", b"\n"),
    "csv": (b"# ", b"\n"),
}
FORMATS = (*_COMMENTS, "png")
"""Formats that can hold a mark; ``csv`` is any text in which a line after ``#`` is a comment."""

_WORDS = re.compile(
    rb"Made by geoident of ([^\s;]+); keys ([0-9a-f+]+); sha256 ([0-9a-f]{64})(.*)", re.DOTALL
)
_KEY = 12  # hexadecimal digits
_PNG_END = struct.pack(">I", 0) + b"IEND" + struct.pack(">I", zlib.crc32(b"IEND"))
_PNG_WORD = b"Source\0"


@dataclass(frozen=True)
class CaseOrigin:
    """What a file was made of.

    Args:
        names: of the cases, for people.
        keys: where the cases stand, seen from the file.
    """

    names: tuple[str, ...]
    keys: frozenset[str]

    def shares(self, other: CaseOrigin) -> bool:
        """Whether both are of the same case, or have one in common."""
        return bool(self.keys & other.keys)


@dataclass(frozen=True)
class Mark:
    """What the mark of a file says.

    Args:
        origin: what the file was made of.
        intact: it is as it was made.
    """

    origin: CaseOrigin
    intact: bool


def origin_of(cases: Iterable[str], file: str | Path) -> CaseOrigin:
    """What says of a file that it was made of some cases.

    The key is that of the way from the file to the case, which stays when both are moved together,
    and says nothing of the machine.

    Args:
        cases: paths of the cases; ``-`` for stdin.
        file: the path of the file.

    >>> origin_of(["site/case.yaml"], "site/case.fit.html").names
    ('case.yaml',)
    """
    folder = Path(os.path.realpath(file)).parent
    ways = {_way(case, folder): Path(case).name if case != STDIN else "stdin" for case in cases}
    keys = frozenset(hashlib.sha256(way.encode()).hexdigest()[:_KEY] for way in ways)
    return CaseOrigin(tuple(sorted(set(ways.values()))), keys)


def _way(case: str, folder: Path) -> str:
    if case == STDIN:
        return STDIN
    path = Path(os.path.realpath(case))
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path.as_posix()


def marked(content: bytes, form: str, origin: CaseOrigin) -> bytes:
    """A file with its mark.

    Args:
        content: of the file, without.
        form: of `FORMATS`.
        origin: what it was made of.
    """
    names = quote(",".join(origin.names), safe=",").replace("--", "-%2D")
    keys = "+".join(sorted(origin.keys))
    words = f"Made by geoident of {names}; keys {keys}; sha256 {_digest(content)}".encode()
    if form != "png":
        before, after = _COMMENTS[form]
        return content + before + words + after
    return content.removesuffix(_PNG_END) + _chunk(b"tEXt", _PNG_WORD + words) + _PNG_END


def read_mark(content: bytes, form: str) -> Mark | None:
    """The mark of a file; None where it has none.

    Args:
        content: of the file.
        form: of `FORMATS`.
    """
    before, after = (_PNG_WORD, b"") if form == "png" else _COMMENTS[form]
    start = content.rfind(before + b"Made by geoident of ")
    match = _WORDS.match(content[start + len(before) :]) if start >= 0 else None
    if match is None:
        return None
    names, keys, digest, rest = match.groups()
    if form == "png":
        intact = rest[4:] == _PNG_END
        bare = content[: start - 8] + _PNG_END  # without the chunk's length and name
    else:
        intact, bare = rest == after, content[:start]
    origin = CaseOrigin(
        tuple(unquote(names.decode()).split(",")), frozenset(keys.decode().split("+"))
    )
    return Mark(origin, intact and _digest(bare) == digest.decode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
