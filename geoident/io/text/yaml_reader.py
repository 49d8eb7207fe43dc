"""YAML as plain text with positions: mappings, lists and texts, nothing else.

Scalars stay the text that was written: what they mean is decided by the key under which they stand,
so ``1e9`` is a number where one is expected and ``no`` a name where a name is. The tree is built
from the events of the parser, which bounds depth and size before anything is built, and refuses
duplicate keys, aliases and tags.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import yaml

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.text.dates import from_strftime
from geoident.io.text.wording import shorten
from geoident.model.case import KeyPath, format_path

Position = tuple[int, int]
Node: TypeAlias = "dict[str, Node] | list[Node] | str | None"

MAX_BYTES = 25_000_000
_MAX_DEPTH = 32
_TOO_DEEP = "the file is nested too deeply for a case"
_MAX_NODES = 1_500_000
_MOST_FAULTS = 100
_LARGE = (
    f"A file holds at most {_MAX_NODES} keys and values: 100 000 gauges, about. Take a part of the "
    "points, or means of neighbouring ones."
)
_NULLS = {"", "~", "null", "Null", "NULL"}
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_KEY_AND_VALUE = re.compile(r"([ ]*)([^\s#:]+): +(\{\}|\[\]|\w+)(?:\s*|\s+#.*)")
_UNQUOTED = re.compile(r"([\w-]+):\s+([%@][^,}\]#]*)")
"""A key and its value that begins as no plain text of YAML may."""
_HINTS = {
    "tab character": "Indent with spaces, not tabs.",
    "cannot start any token": "Indent with spaces, not tabs; quote texts that begin with @ or %.",
    "mapping values are not allowed": "Quote texts that hold ': ', and check the indentation.",
    "did not find expected": "Check the indentation, and that every bracket and quote is closed.",
    "could not find expected ':'": "Every key of a mapping is followed by a colon and a space.",
    "expected ',' or": "Close the bracket, or separate the entries by commas.",
}


@dataclass(frozen=True)
class Document:
    """A YAML document.

    Args:
        file: its name, for messages.
        data: mappings, lists and texts; None where nothing (or ``null``) is written.
        keys: path of a key or a list entry to the line and column where it begins.
        values: path to the line and column where its value begins.
    """

    file: str
    data: Node
    keys: Mapping[KeyPath, Position]
    values: Mapping[KeyPath, Position]


def parse_yaml(text: str, file: str) -> Document:
    """Read one YAML document from text.

    Raises:
        InputError: the text is empty, or no YAML as it is read here, with every fault found.
    """
    builder = _Builder(file)
    try:
        events = _events(text, builder)
        data = builder.node(next(events), events, ())
        for _ in events:
            pass
    except StopIteration as error:
        hint = f"Begin with 'format: geoident-case/1'; {Term.KEYS} lists what may follow."
        raise InputError([Fault("empty", "the file is empty", hint, Location(file))]) from error
    except yaml.MarkedYAMLError as error:
        raise InputError([*builder.faults, _syntax_fault(error, file, text)]) from error
    except yaml.YAMLError as error:
        fault = Fault("yaml-syntax", shorten(error, width=200), location=Location(file))
        raise InputError([*builder.faults, fault]) from error
    if builder.faults:
        raise InputError(builder.faults)
    return Document(file, data, builder.keys, builder.values)


def _events(text: str, builder: _Builder) -> Iterator[yaml.Event]:
    """The events of one document; more documents are a fault."""
    documents = 0
    for event in yaml.parse(text, Loader=_LOADER):
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                builder.refuse(event, (), "several-documents", "a second document begins here", "")
                return
        elif isinstance(event, yaml.NodeEvent | yaml.CollectionEndEvent):
            yield event


def _syntax_fault(error: yaml.MarkedYAMLError, file: str, text: str) -> Fault:
    problem = " ".join(filter(None, (error.context, error.problem)))
    mark = error.problem_mark or error.context_mark
    location = Location(file, mark.line + 1, mark.column + 1) if mark else Location(file)
    if "maximum nesting depth" in problem:  # libyaml refuses it before its events show it
        return Fault("too-deep", _TOO_DEEP, location=location)
    hint = next((hint for part, hint in _HINTS.items() if part in problem), "")
    if mark and "cannot start any token" in problem:
        hint = _unquoted(text.splitlines()[mark.line]) or hint
    key = _filled_twice(text, mark.line) if mark else None
    if key:
        name, value = key
        hint = f"Delete '{value}' after '{name}:': what belongs to it stands in the lines below."
    return Fault("yaml-syntax", f"this is not YAML: {problem}", hint, location)


def _unquoted(line: str) -> str:
    """The remedy for a line with a value that begins with % or @; empty for another one."""
    match = _UNQUOTED.search(line)
    if match is None:
        return ""
    key, value = match[1], match[2].strip()
    written = from_strftime(value)
    return f"Write '{key}: {written}'." if written else f'Quote it: {key}: "{value}".'


def _filled_twice(text: str, at: int) -> tuple[str, str] | None:
    """The key above a line, and its value, where both the value and lines below fill it.

    Args:
        text: of the document.
        at: the line at which the parser stopped, from 0.
    """
    lines = [x for x in text.splitlines()[: at + 1] if x.strip() and x.lstrip()[0] != "#"]
    if len(lines) < 2:
        return None
    above, here = lines[-2:]
    match = _KEY_AND_VALUE.fullmatch(above)
    if not match or len(here) - len(here.lstrip()) <= len(match[1]):
        return None
    return match[2], match[3]


@dataclass
class _Builder:
    """Builds the tree from events and keeps positions and faults."""

    file: str
    keys: dict[KeyPath, Position] = field(default_factory=dict)
    values: dict[KeyPath, Position] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)

    def node(self, event: yaml.Event, events: Iterator[yaml.Event], path: KeyPath) -> Node:
        """The node that an event begins.

        Args:
            event: its first event.
            events: those that follow, of which those of the node are taken.
            path: keys that lead to it.
        """
        self.values[path] = _position(event)
        self._check_limits(event, path)
        if isinstance(event, yaml.ScalarEvent):
            return None if event.implicit[0] and event.value in _NULLS else str(event.value)
        if isinstance(event, yaml.SequenceStartEvent):
            return self._sequence(events, path)
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(events, path)
        self._refuse_alias(event, path)
        return None

    def _sequence(self, events: Iterator[yaml.Event], path: KeyPath) -> Node:
        entries: list[Node] = []
        for event in events:
            if isinstance(event, yaml.SequenceEndEvent):
                break
            place = (*path, len(entries))
            self.keys[place] = _position(event)
            entries.append(self.node(event, events, place))
        return entries

    def _mapping(self, events: Iterator[yaml.Event], path: KeyPath) -> Node:
        entries: dict[str, Node] = {}
        for event in events:
            if isinstance(event, yaml.MappingEndEvent):
                break
            key = self._key(event, events, path)
            place = (*path, key)
            duplicate = key in entries
            if duplicate:
                self._refuse_duplicate(event, place)
            else:
                self.keys[place] = _position(event)
            value = self.node(next(events), events, place)
            if not duplicate:
                entries[key] = value
        return entries

    def _key(self, event: yaml.Event, events: Iterator[yaml.Event], path: KeyPath) -> str:
        if isinstance(event, yaml.ScalarEvent) and event.value:
            self._check_limits(event, path)
            return str(event.value)
        message = "a key must be a text on one line"
        hint = "Quote it if it is one."
        self.refuse(event, path, "bad-key", message, hint)
        if not isinstance(event, yaml.ScalarEvent):
            self.node(event, events, (*path, "?"))
        return "?"

    def _refuse_duplicate(self, event: yaml.Event, place: KeyPath) -> None:
        line = self.keys[place][0]
        message = f"the key '{shorten(place[-1])}' is written twice, first in line {line}"
        self.refuse(event, place, "duplicate-key", message, "Remove or rename one of them.")

    def _refuse_alias(self, event: yaml.Event, path: KeyPath) -> None:
        """Refuse the first anchor or alias of the file; the others say nothing new."""
        if not any(fault.code == "alias" for fault in self.faults):
            message = "anchors and aliases (& and *) are not part of case files"
            self.refuse(event, path, "alias", message, "Write each value out where it is used.")

    def _check_limits(self, event: yaml.Event, path: KeyPath) -> None:
        tag = getattr(event, "tag", None)
        if tag is not None and tag != "!":
            message = f"the tag '{shorten(tag)}' is not allowed"
            self.refuse(event, path, "tag", message, "Remove it.")
        if getattr(event, "anchor", None) and not isinstance(event, yaml.AliasEvent):
            self._refuse_alias(event, path)
        if len(path) > _MAX_DEPTH or len(self.values) > _MAX_NODES:
            deep = len(path) > _MAX_DEPTH
            message = _TOO_DEEP if deep else "the file is too large for a case"
            self.refuse(event, path[:3], "too-deep", message, "" if deep else _LARGE)
            raise InputError(self.faults)

    def refuse(self, event: yaml.Event, path: KeyPath, code: str, message: str, hint: str) -> None:
        """Note a fault at an event.

        Args:
            event: where it is.
            path: keys that lead there.
            code: short stable name of the kind of fault.
            message: what was found and what is expected.
            hint: the likely remedy.

        Raises:
            InputError: there are too many faults to go on.
        """
        location = Location(self.file, *_position(event))
        self.faults.append(Fault(code, message, hint, location, format_path(path)))
        if len(self.faults) > _MOST_FAULTS:
            last = Fault("more-faults", "there are more faults after this one", location=location)
            raise InputError([*self.faults, last])


def _position(event: yaml.Event) -> Position:
    mark = event.start_mark
    return (mark.line + 1, mark.column + 1) if mark else (0, 0)
