"""Instruction files of PEST: a first line ``pif ~``, then how numbers are found in an output.

    pif ~
    ~DISPLACEMENTS~              the next line that has this text
    l3 w !roof! [side]21:32      three lines further; a number after the next blank; fixed columns

As in the manuals of PEST and PEST++: a line begins with a marker (the next line that has it),
``lN`` (N lines further) or ``&`` (the line before goes on); then from left to right markers, ``w``
(behind the next blanks), ``tN`` (column N), and observations ``!name!`` (the next word, up to a
marker that follows), ``[name]N:M`` (these columns) and ``(name)N:M`` (the word that reaches into
them). ``dum`` is nobody's. As in PEST++ a comma is a blank. Small letters and capitals are the
same.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from geoident.errors import Fault, Location
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.model.external import Instruction, InstructionLine

MAX_BYTES = 50 * 10**6
DUMMY = "dum"
"""Observation that is read past."""
OBSERVATIONS = ("free", "fixed", "semi")
"""Kinds of instructions that read one."""

_HEAD = re.compile(r"\s*[pj]if\s+(\S)\s*", re.IGNORECASE)
_ITEM = re.compile(
    r"(?P<advance>l\s*(?P<lines>[1-9][0-9]*))|(?P<blank>w)|(?P<tab>t(?P<column>[1-9][0-9]*))"
    r"|!(?P<free>[^!\s]+)!"
    r"|\[(?P<fixed>[^\]\s]+)\](?P<a>[1-9][0-9]*):(?P<b>[1-9][0-9]*)"
    r"|\((?P<semi>[^)\s]+)\)(?P<c>[1-9][0-9]*):(?P<d>[1-9][0-9]*)",
    re.IGNORECASE,
)
_BLANK = " \t,"
_KNOWN = "l3, ~text~, w, t20, !name!, [name]5:12 or (name)5:12"


class CannotFollow(ValueError):
    """An output is not as instructions say."""


def read_instructions(path: str) -> tuple[tuple[InstructionLine, ...], list[Fault]]:
    """The lines of a file of instructions, and what is wrong in it.

    Args:
        path: of the file.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    text = decode(read_bytes(path, limit=MAX_BYTES, what="file of instructions"), path)
    lines = text.splitlines()
    head = _HEAD.fullmatch(lines[0]) if lines else None
    if head is None:
        message = "the first line of a file of instructions is 'pif ~', with the mark of its texts"
        return (), [Fault("bad-instruction", message, "", Location(path, 1, 1))]
    reader = _InstructionReader(path, head[1].lower())
    for number, line in enumerate(lines[1:], 2):
        if line.strip():
            reader.add(number, line)
    if not reader.faults and not reader.seen:
        message = "the instructions read no observation"
        hint = "Write !name! where a number stands."
        reader.faults.append(Fault("bad-instruction", message, hint, Location(path)))
    return tuple(InstructionLine(n, tuple(items)) for n, items in reader.lines), reader.faults


class _InstructionReader:
    def __init__(self, path: str, mark: str) -> None:
        self.path, self.mark, self.faults = path, mark, list[Fault]()
        self.lines: list[tuple[int, list[Instruction]]] = []
        self.seen: dict[str, int] = {}

    def add(self, number: int, line: str) -> None:
        """Take a line that is not empty."""
        if line.lower().count(self.mark) % 2:
            column = line.lower().rfind(self.mark) + 1
            message = f"the text that begins here has no second '{self.mark}'"
            self._refuse(number, column, message, f"Write {self.mark}text{self.mark}.")
            return
        items = list(self._items(number, line))
        if line.lstrip().startswith("&"):
            if self.lines:
                self.lines[-1][1].extend(items)
            else:
                self._refuse(number, 1, "there is no line before that could go on", "")
            return
        if items and items[0].kind not in ("marker", "advance"):
            hint = f"Write l1 before it, or a text between {self.mark}."
            self._refuse(number, 1, "the line does not say which line of the output it is of", hint)
        if items and items[0].kind == "marker":
            items[0] = Instruction("primary", items[0].text)
        self.lines.append((number, items))

    def _refuse(self, number: int, column: int, message: str, hint: str) -> None:
        place = Location(self.path, number, column)
        self.faults.append(Fault("bad-instruction", message, hint, place))

    def _items(self, number: int, line: str) -> Iterator[Instruction]:
        column = 1
        for n, part in enumerate(line.lower().split(self.mark)):
            if n % 2:
                if not part:
                    self._refuse(number, column - 1, "the text between the marks is empty", "")
                yield Instruction("marker", part)
            else:
                first = column == 1
                for word in re.finditer(r"\S+", part):
                    if first and word[0] == "&":
                        continue
                    item = self._item(number, column + word.start(), word[0])
                    if item is not None:
                        yield item
            column += len(part) + 1

    def _item(self, number: int, column: int, word: str) -> Instruction | None:
        match = _ITEM.fullmatch(word)
        if match is None:
            message = f"'{shorten(word)}' is not an instruction"
            self._refuse(number, column, message, f"Known: {_KNOWN}.")
            return None
        if match["advance"]:
            return Instruction("advance", first=int(match["lines"]))
        if match["blank"]:
            return Instruction("blank")
        if match["tab"]:
            return Instruction("tab", first=int(match["column"]))
        name = match["free"] or match["fixed"] or match["semi"]
        if name != DUMMY and name in self.seen:
            message = f"the observation '{shorten(name)}' is read in line {self.seen[name]} already"
            self._refuse(number, column, message, "Give each its own name.")
        self.seen.setdefault(name, number)
        if match["free"]:
            return Instruction("free", name)
        first, last = (int(match[x] or match[y]) for x, y in (("a", "c"), ("b", "d")))
        if first > last:
            message = f"column {first} does not come before {last}"
            self._refuse(number, column, message, "Write the first one first.")
        return Instruction("fixed" if match["fixed"] else "semi", name, first, last)


def observed(lines: Sequence[InstructionLine], text: str) -> dict[str, str]:
    """What instructions find in an output: observations to what stands there.

    Args:
        lines: of the file of instructions.
        text: of the output.

    Raises:
        CannotFollow: the output is not as they say.
    """
    observations: dict[str, str] = {}
    output = text.lower().splitlines()
    at = -1  # just above the first line
    for line in lines:
        at = _follow(line, output, at, observations)
    return observations


def _follow(
    line: InstructionLine, output: Sequence[str], at: int, observations: dict[str, str]
) -> int:
    """Follow one line of instructions from a line of the output on; the line where it ends."""
    first, *rest = line.items
    markers = 0
    while markers < len(rest) and rest[markers].kind == "marker":
        markers += 1
    if first.kind == "primary":
        at, cursor = _marked(line, [first.text, *(one.text for one in rest[:markers])], output, at)
        rest = rest[markers:]
    else:
        at, cursor = at + first.first, 0
        if at >= len(output):
            raise CannotFollow(f"{_of(line)} leads beyond its last line, {len(output)}")
    for n, item in enumerate(rest):
        after = rest[n + 1].text if n + 1 < len(rest) and rest[n + 1].kind == "marker" else ""
        try:
            word, cursor = _step(item, after, output[at], cursor)
        except CannotFollow as error:
            raise CannotFollow(f"line {at + 1} {error} ({_of(line)})") from None
        if word is not None and item.text != DUMMY:
            observations[item.text] = word
    return at


def _of(line: InstructionLine) -> str:
    return f"line {line.number} of the instructions"


def _marked(
    line: InstructionLine, texts: Sequence[str], output: Sequence[str], at: int
) -> tuple[int, int]:
    """The next line that has texts one after the other, and where the last one ends."""
    for number in range(at + 1, len(output)):
        cursor = 0
        for text in texts:
            place = output[number].find(text, cursor)
            if place < 0:
                break
            cursor = place + len(text)
        else:
            return number, cursor
    words = " and then ".join(f"'{shorten(text)}'" for text in texts)
    raise CannotFollow(f"from line {at + 2} on no line has {words} ({_of(line)})")


def _step(item: Instruction, after: str, line: str, at: int) -> tuple[str | None, int]:
    """What an instruction finds in a line from a place on, and where it ends.

    Args:
        item: the instruction.
        after: text of the marker that follows; empty where none does.
        line: of the output.
        at: the place.
    """
    if item.kind in OBSERVATIONS:
        return _observation(item, after, line, at)
    if item.kind == "tab":
        if len(line) < item.first:
            raise CannotFollow(f"ends before column {item.first}")
        return None, item.first
    if item.kind == "blank":
        begin = _filled(line, _end(line, at))
        if begin >= len(line):
            raise CannotFollow("ends before the next word")
        return None, begin
    place = line.find(item.text, at)
    if place < 0:
        raise CannotFollow(f"has no '{shorten(item.text)}' from column {at + 1} on")
    return None, place + len(item.text)


def _observation(item: Instruction, after: str, line: str, at: int) -> tuple[str, int]:
    """The same of an observation."""
    first, last = item.first - 1, item.last
    if item.kind == "free":
        first = _filled(line, at)
        place = line.find(after, first) if after else -1
        last = _end(line, first) if place < 0 else min(_end(line, first), place)
    elif (first if item.kind == "fixed" else last - 1) < at:
        message = f"has been read up to column {at}, and '{item.text}' stands before"
        raise CannotFollow(message)
    if item.kind == "semi":
        begin = _filled(line, first)
        if begin >= min(last, len(line)):
            raise CannotFollow(f"has nothing in the columns {item.first} to {item.last}")
        while begin > 0 and line[begin - 1] not in _BLANK:
            begin -= 1
        first, last = begin, _end(line, begin)
    word = line[first:last].strip(_BLANK)
    if not word:
        raise CannotFollow(f"has nothing where '{item.text}' is looked for")
    return word, min(last, len(line))


def _filled(line: str, at: int) -> int:
    """The next place that is not blank; the length of the line where there is none."""
    while at < len(line) and line[at] in _BLANK:
        at += 1
    return at


def _end(line: str, at: int) -> int:
    """The next place that is blank."""
    while at < len(line) and line[at] not in _BLANK:
        at += 1
    return at
