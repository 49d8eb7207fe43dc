"""Markdown pages that are run: the files that a page shows, its commands, what they print.

A page tells its reader to write files and to type commands. Comments, which no reader sees, say
what a fenced block is:

    <!-- file: case.yaml -->      the block below is this file
    <!-- show: Parameters, Readings 6 -->
                                  of what the commands below print, only the paragraphs with these
                                  first words, and of the second only 6 lines; "nothing" for none
    <!-- exit: 4 -->              the exit code of the commands below, 0 if not said
    <!-- run: long -->            the commands below take long, and what later ones print does not
                                  depend on them: only the slow tests run them
    <!-- append: readings.csv -->  the block below is added to the end of this file
    <!-- like: ../tutorials/dam.md -->
                                  the page begins with the files of another page, or of a folder

Blocks of ``console`` hold lines ``$ command``, each followed by its output; left-out parts are
lines ``...``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "geoident" / "docs"
GAP = "..."

_BLOCK = re.compile(
    r"(?P<notes>(?:^<!-- (?:file|append|show|exit|run): .*? -->\n)*)"
    r"^```(?P<language>\w+)\n(?P<body>(?:.*\n)*?)^```$",
    re.MULTILINE,
)
_NOTE = re.compile(r"<!-- (\w+): (.*?) -->")
_PICTURE = re.compile(r"!\[[^\]]*\]\(([^)\s]+)\)")
_LIKE = re.compile(r"^<!-- like: (\S+) -->$", re.MULTILINE)
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_TIMES = re.compile(
    r"\b\d[\d.]*(?= (?:s|min|h|ms|MB|kB)\b)|\b\d{4}-\d\d-\d\d[ T]\d\d:\d\d(?::\d\d)?(?:\+00:00)?"
)
CLOSE = 0.02  # of the numbers that are compared
ROUNDING = 1e-6  # numbers below are what an iteration leaves


@dataclass(frozen=True)
class Command:
    """A command of a page.

    Attributes:
        line: as it is typed.
        output: what the page says that it prints.
        show: which paragraphs of the output, None for all.
        code: its exit code.
        long: only slow tests run it.
    """

    line: str
    output: str
    show: tuple[str, ...] | None
    code: int
    long: bool = False


@dataclass(frozen=True)
class File:
    """A file that a page shows whole, or lines that are added to it."""

    name: str
    text: str
    added: bool = False


@dataclass(frozen=True)
class Page:
    """A Markdown page: its text, and the files and commands in it in their order."""

    path: Path
    text: str

    @property
    def steps(self) -> list[File | Command]:
        """Files and commands."""
        return [step for found in _BLOCK.finditer(self.text) for step in _steps(found)]

    @property
    def files(self) -> dict[str, str]:
        """Names of the files that it shows, each with its last text."""
        texts: dict[str, str] = {}
        for step in self.steps:
            if isinstance(step, File):
                texts[step.name] = (texts[step.name] if step.added else "") + step.text
        return texts

    @property
    def commands(self) -> list[Command]:
        """The commands."""
        return [step for step in self.steps if isinstance(step, Command)]

    @property
    def pictures(self) -> list[Path]:
        """Paths of the pictures that it shows."""
        return [self.path.parent / name for name in _PICTURE.findall(self.text)]

    @property
    def like(self) -> Path | None:
        """The page or the folder whose files it begins with."""
        found = _LIKE.search(self.text)
        return self.path.parent / found[1] if found else None

    @property
    def folder(self) -> Path:
        """Where the files of the page lie, for those who do not want to copy them."""
        return self.path.with_suffix("")

    def with_outputs(self, outputs: Sequence[str]) -> str:
        """The text with other outputs, whole ones; each is cut as its command says.

        Args:
            outputs: of the commands, in their order.
        """
        left = iter(outputs)

        def renewed(found: re.Match[str]) -> str:
            commands = [step for step in _steps(found) if isinstance(step, Command)]
            if not commands:
                return found[0]
            said = [(f"$ {c.line}", cut(next(left), c.show)) for c in commands]
            body = "\n".join(line for pair in said for line in pair if line)
            return f"{found['notes']}```console\n{body}\n```"

        return _BLOCK.sub(renewed, self.text)


def read_page(path: Path) -> Page:
    """The page in a file."""
    return Page(path, path.read_text(encoding="utf-8"))


def pages_that_are_run() -> list[Path]:
    """Paths of the pages with commands."""
    return [p for p in sorted(DOCS.rglob("*.md")) if "```console\n" in p.read_text("utf-8")]


def page_name(path: Path) -> str:
    """The name of a page: ``tutorials/dam``."""
    return path.relative_to(DOCS).with_suffix("").as_posix()


def cut(output: str, show: tuple[str, ...] | None) -> str:
    r"""The paragraphs of an output that are shown.

    >>> print(cut("Head\n\nGroups\na\nb\n\nNotes\nc\n", ("Groups 2",)))
    ...
    Groups
    a
    ...
    """
    output = "\n".join(line.rstrip() for line in output.strip("\n").splitlines())
    if show is None:
        return output
    if show == ("nothing",):
        return ""
    wanted = dict(_paragraph_and_lines(text) for text in show)
    kept: list[str] = []
    for number, paragraph in enumerate(re.split(r"\n{2,}", output)):
        titles = [t for t in wanted if paragraph.startswith(t) or (t == "first" and not number)]
        lines = paragraph.splitlines()
        if not titles:
            kept += [] if kept[-1:] == [GAP] else [GAP]
            continue
        most = wanted[titles[0]]
        kept += ["", *lines[:most]] if kept and kept[-1] != GAP else lines[:most]
        kept += [GAP] if len(lines) > most else []
    return "\n".join(kept)


def _paragraph_and_lines(text: str) -> tuple[str, int]:
    words, _, number = text.rpartition(" ")
    return (words, int(number)) if number.isdecimal() else (text, 10**6)


def difference(expected: str, found: str) -> str:
    """The first thing in which two outputs differ, or nothing.

    Words must be the same; line breaks, columns, times, sizes in memory and numbers below 1e-6 are
    not compared. Other numbers must agree within 2 % or one unit of the last digit that is shown.

    >>> difference("E_rock  9.99 GPa in 3.1 s", "E_rock 10.01 GPa in 12 s")
    ''
    >>> difference("E_rock  9.99 GPa", "E_rock  9.49 GPa")
    "'9.99' has become '9.49' after: E_rock"
    """
    old, new = (_TIMES.sub("TIME", text).split() for text in (expected, found))
    for place, (a, b) in enumerate(zip(old, new, strict=False)):
        if not _alike(a, b):
            return f"{a!r} has become {b!r} after: {' '.join(old[max(0, place - 6) : place])}"
    if len(old) != len(new):
        return f"{len(old)} words have become {len(new)}, from: {' '.join((old + new)[-8:])}"
    return ""


def _alike(a: str, b: str) -> bool:
    if a == b:
        return True
    if _NUMBER.sub("#", a) != _NUMBER.sub("#", b):
        return False
    return all(map(_close, _NUMBER.findall(a), _NUMBER.findall(b)))


def _close(a: str, b: str) -> bool:
    x, y = float(a), float(b)
    if max(abs(x), abs(y)) < ROUNDING:
        return True
    last = 10.0 ** -len(a.partition(".")[2]) if "." in a and "e" not in a else 0.0
    return abs(x - y) <= max(CLOSE * max(abs(x), abs(y)), 1.001 * last)


def _steps(found: re.Match[str]) -> list[File | Command]:
    notes = dict(_NOTE.findall(found["notes"]))
    if "file" in notes:
        return [File(notes["file"], found["body"])]
    if "append" in notes:
        return [File(notes["append"], found["body"], added=True)]
    if found["language"] != "console":
        return []
    show = tuple(re.split(r", ", notes["show"])) if "show" in notes else None
    code = int(notes.get("exit", 0))
    parts = re.split(r"^\$ (.*)\n?", found["body"], flags=re.MULTILINE)
    pairs = zip(parts[1::2], parts[2::2], strict=True)
    long = notes.get("run") == "long"
    return [Command(line, output.rstrip("\n"), show, code, long) for line, output in pairs]
