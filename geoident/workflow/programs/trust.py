"""Nothing that a file names is run, and no scheduler reached, before somebody has said so.

A file may come from anywhere, and with it its folder of runs. So what is remembered there of a
decision is signed with a key of this user on this machine, and holds for these very files only.
"""

from __future__ import annotations

import hmac
import json
import os
import secrets
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from geoident.errors import InputError, Term
from geoident.model.case import Source

_REMEMBERED = "trusted.json"
_KEY_BYTES = 32


@dataclass(frozen=True)
class Execution:
    """What a file has run.

    Args:
        words: it in words, for who decides.
        digest: SHA-256 of all that it consists of, and of where the program is.
        portable: SHA-256 of what is the same on other machines: what the case says, and files.
        does: what the file does with it.
        details: lines of it that are too many for a sentence.
    """

    words: str
    digest: str
    portable: str = ""
    does: str = "the case runs"
    details: str = ""

    @property
    def clause(self) -> str:
        """What the file does, in words that end in no full stop."""
        return _visible(f"{self.does} {self.words}")

    def shown(self, indent: str) -> str:
        """The details, as what it is decided on; empty where the words say all.

        Args:
            indent: of each line.
        """
        return "".join(f"\n{indent}{_visible(line)}" for line in self.details.split("\n") if line)


def _visible(text: str) -> str:
    r"""A text in which nothing hides, as characters that move the cursor of a terminal would.

    >>> _visible(f"harmless{chr(13)}evil")
    'harmless\\revil'
    """
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


Decide = Callable[[Execution], bool]
"""Whether something may be run."""

_decide: ContextVar[Decide] = ContextVar("decide", default=lambda execution: False)
_remembers: ContextVar[bool] = ContextVar("remembers", default=True)


@contextmanager
def decided_by(decide: Decide, *, remembered: bool = True) -> Iterator[None]:
    """Meanwhile this says whether a case may run what it names.

    Args:
        decide: is asked once for each case, unless it is remembered.
        remembered: the answer is written down beside the case.
    """
    token, other = _decide.set(decide), _remembers.set(remembered)
    try:
        yield
    finally:
        _decide.reset(token)
        _remembers.reset(other)


def trusting(*, trust: bool, permitted: Collection[str] = ()) -> Decide:
    """The answer of a flag, and of what was permitted before by whoever asks for the runs.

    Args:
        trust: everything may be run.
        permitted: `Execution.portable` of what may be.
    """
    return lambda execution: trust or execution.portable in permitted


class Permission:
    """Whether what a case names may be run; it is asked for once.

    Args:
        execution: what is run.
        folder: of the runs, where the answer is remembered.
        source: of the case.
        key: under its `model`, that says what is run.
    """

    def __init__(self, execution: Execution, folder: Path, source: Source, key: str) -> None:
        self._execution, self._folder, self._source, self._key = execution, folder, source, key
        self._given = False

    @property
    def is_given(self) -> bool:
        """Whether it is known or remembered that it may; nobody is asked."""
        self._given = self._given or is_remembered(self._execution, self._folder)
        return self._given

    def require(self) -> None:
        """Ask, unless that is known or remembered.

        Raises:
            InputError: it may not.
        """
        if self.is_given:
            return

        def refused(code: str, message: str, hint: str) -> InputError:
            path = ("model", self._key)
            return InputError([self._source.fault(path, code, message, hint)])

        require(self._execution, self._folder, refused, Term.TRUST)
        self._given = True

    @property
    def portable(self) -> str:
        """What it is about, as other machines know it."""
        return self._execution.portable


def require(
    execution: Execution, folder: Path, refused: Callable[[str, str, str], InputError], term: Term
) -> None:
    """Ask whether something may be run, unless that is remembered.

    Args:
        execution: what is run.
        folder: where the answer is remembered.
        refused: makes the error of a code, a message and a hint.
        term: what says that it may.

    Raises:
        InputError: it may not.
    """
    if is_remembered(execution, folder):
        return
    if not _decide.get()(execution):
        message = f"{execution.clause}, and it is not trusted yet"
        hint = f"Look at what it runs. {term} runs it, and is remembered until it changes."
        raise refused("not-trusted", message, hint + execution.shown("        "))
    if _remembers.get():
        remember(execution, folder)


def is_remembered(execution: Execution, folder: Path) -> bool:
    """Whether this user has said here that something may be run.

    Args:
        execution: what is run.
        folder: of the runs.
    """
    key = _key(create=False)
    try:
        mark = json.loads((folder / _REMEMBERED).read_text(encoding="utf-8"))["mark"]
    except (OSError, ValueError, KeyError, TypeError):
        return False
    if key is None or not isinstance(mark, str):
        return False
    return hmac.compare_digest(mark, _mark(key, execution, folder))


def remember(execution: Execution, folder: Path) -> None:
    """Remember it, as far as files can be written."""
    key = _key(create=True)
    if key is None:
        return
    text = json.dumps(
        {"runs": execution.words + execution.shown(""), "mark": _mark(key, execution, folder)},
        indent=2,
    )
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        if (folder / _REMEMBERED).is_symlink():
            return
        (folder / _REMEMBERED).write_text(f"{text}\n", encoding="utf-8")


def _mark(key: bytes, execution: Execution, folder: Path) -> str:
    text = f"{execution.digest} {folder.resolve()}"
    return hmac.new(key, text.encode("utf-8", "surrogateescape"), "sha256").hexdigest()


def _key(*, create: bool) -> bytes | None:
    """The key of this user; None where there is none, or none can be kept."""
    home = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        place = (Path(home) if home else Path.home() / ".local" / "state") / "geoident"
        file = place / "trust.key"
        with suppress(FileNotFoundError):
            key = file.read_bytes()
            return key if len(key) == _KEY_BYTES else None
        if not create:
            return None
        place.mkdir(parents=True, exist_ok=True)
        made = secrets.token_bytes(_KEY_BYTES)
        handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as opened:
            opened.write(made)
    except (OSError, RuntimeError):
        return None
    return made
