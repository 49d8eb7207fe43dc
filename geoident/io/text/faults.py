"""Collecting faults of a case, each with the place where it is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.text.wording import did_you_mean
from geoident.io.text.yaml_reader import Document, Node
from geoident.model.case import KeyPath, Source, format_path, path_in_file

OVERRIDES = str(Term.OVERRIDES)
"""Where an override is written, in place of the name of a file."""
_MOST = 100


@dataclass(frozen=True)
class Places:
    """The data of a case, and where its keys are written: in its file, or in an override.

    Args:
        document: the file.
        data: its data, with the overrides.
        overridden: paths that overrides have set.
        made_of: see `path_in_file`.
    """

    document: Document
    data: Node
    overridden: frozenset[KeyPath] = frozenset()
    made_of: Mapping[KeyPath, KeyPath] = field(default_factory=dict)

    def locate(self, path: KeyPath, *, key: bool = False) -> Location:
        """The place of a value (of its key if ``key``), else of what encloses it."""
        path = path_in_file(path, self.made_of)
        if self.is_overridden(path):
            return Location(OVERRIDES)
        for end in range(len(path), -1, -1):
            position = self._position(path[:end], value=end == len(path) and not key)
            if position is not None:
                return Location(self.document.file, *position)
        return Location(self.document.file)

    def is_overridden(self, path: KeyPath) -> bool:
        """Whether an override has set a key or what encloses it."""
        return bool(self.overridden) and any(
            path[:end] in self.overridden for end in range(len(path) + 1)
        )

    def _position(self, path: KeyPath, *, value: bool) -> tuple[int, int] | None:
        if value and path in self.document.values:
            key = self.document.keys.get(path)
            position = self.document.values[path]
            below = key is not None and position[0] > key[0]
            return key if below else position
        return self.document.keys.get(path) if path else self.document.values.get(())

    def source(self) -> Source:
        """Positions of the keys of the file, for later faults."""
        keys = {k: place for k, place in self.document.keys.items() if not self.is_overridden(k)}
        return Source(self.document.file, keys, made_of=self.made_of)


@dataclass
class Faults:
    """The faults found so far.

    Args:
        places: the data, and where the keys are written.
        found: the faults.
    """

    places: Places
    found: list[Fault] = field(default_factory=list)
    _keys: list[KeyPath] = field(default_factory=list)

    def add(
        self, path: KeyPath, code: str, message: str, hint: str = "", *, key: bool = False
    ) -> None:
        """Note a fault at the value of a key, or at the key itself.

        Args:
            path: of the key.
            code: what kind of fault it is, for programs.
            message: what is wrong, half a sentence.
            hint: what would be right.
            key: show where the key is written, not its value.
        """
        location = self.places.locate(path, key=key)
        written = format_path(path_in_file(path, self.places.made_of))
        self.found.append(Fault(code, message, hint, location, written))
        self._keys.append(path)

    def of_keys(self) -> list[KeyPath]:
        """Paths of the keys at which faults were noted; those of files have none."""
        return list(self._keys)

    def add_unknown(
        self, path: KeyPath, kind: str, name: str, known: Iterable[str], *, key: bool = False
    ) -> None:
        """Note a name that refers to nothing.

        Args:
            path: of its key.
            kind: what has names of this kind, such as ``stage``.
            name: the wrong one.
            known: the right ones.
            key: show where the key is written, not its value.
        """
        hint = self.did_you_mean(name, known, what=f"{kind.capitalize()}s")
        self.add(path, f"unknown-{kind}", f"there is no {kind} '{name}'", hint, key=key)

    def did_you_mean(self, word: str, known: Iterable[str], *, what: str = "Known") -> str:
        """A hint as `wording.did_you_mean` gives it, as long as faults are shown at all.

        Args:
            word: the wrong one.
            known: the right ones.
            what: what the known words are, the head of a list of them.
        """
        return "" if len(self.found) > _MOST else did_you_mean(word, known, what=what)

    def extend(self, faults: Iterable[Fault]) -> None:
        """Note faults found elsewhere."""
        self.found.extend(faults)

    def spoils(self, path: KeyPath) -> None:
        """Note a key that is of no use because of faults that were noted elsewhere."""
        self._keys.append(path)

    def raise_any(self) -> None:
        """End the reading if there are faults.

        Raises:
            InputError: with the faults in the order of the file.
        """
        if self.found:
            raise InputError(self.shown())

    def shown(self) -> list[Fault]:
        """The faults in the order of the files, as they are shown: each once, not too many."""
        found = list(dict.fromkeys(sorted(self.found, key=_order)))
        return shortened(said_once(found, self.places.document.file))


_FIRST = 5
"""Rows that are named of a fault that a file of readings has in many."""
_KIND = 10
"""Faults of one kind in a file beside the case that are said in full."""


def said_once(faults: list[Fault], case: str) -> list[Fault]:
    """Faults with those that a file beside the case has row by row said once, with their rows.

    A fault of the same words is one; of one kind in other words the first few are said.

    Args:
        faults: in the order of the files.
        case: path of the case, whose own faults stay as they are.
    """
    place_of = {id(fault): k for k, fault in enumerate(faults)}
    together: dict[tuple[object, ...], list[Fault]] = {}
    for fault in faults:
        beside = _of_rows(fault, case) and not fault.path
        key = (*_kind(fault), fault.message) if beside else (id(fault),)
        together.setdefault(key, []).append(fault)
    kinds: dict[tuple[object, ...], list[list[Fault]]] = {}
    for group in together.values():
        kind = _kind(group[0]) if _of_rows(group[0], case) else (id(group[0]),)
        kinds.setdefault(kind, []).append(group)
    pairs = [pair for kind in kinds.values() for pair in _few(kind)]
    return [fault for _, fault in sorted(pairs, key=lambda pair: place_of[id(pair[0])])]


def _of_rows(fault: Fault, case: str) -> bool:
    """Whether a fault is that of a row of a file beside the case."""
    return fault.location.line > 0 and fault.location.file not in (case, OVERRIDES)


def _kind(fault: Fault) -> tuple[object, ...]:
    return fault.location.file, fault.location.sheet, fault.code


def _few(groups: list[list[Fault]]) -> Iterator[tuple[Fault, Fault]]:
    """The first faults of one kind, and how many more there are, each with where it stands."""
    most = _KIND if len(groups) > _KIND + 1 else len(groups)
    for group in groups[:most]:
        rows = _rows_of(group)
        if "," not in rows:  # several places of one row
            yield from zip(group, group, strict=True)
        else:
            message = f"{group[0].message} (in {len(group)} rows: {rows})"
            yield group[0], replace(group[0], message=message)
    rest = [fault for group in groups[most:] for fault in group]
    if rest:
        first = rest[0]
        message = f"and {len(rest)} more of this kind, in the rows {_rows_of(rest)}"
        yield first, Fault(first.code, message, "", first.location)


def _rows_of(faults: list[Fault]) -> str:
    rows = list(dict.fromkeys(fault.location.line for fault in faults))
    named = ", ".join(map(str, rows[:_FIRST]))
    return f"{named}, ..." if len(rows) > _FIRST else named


def shortened(faults: list[Fault]) -> list[Fault]:
    """The first hundred faults, and how many more there are."""
    rest = len(faults) - _MOST
    if rest <= 0:
        return faults
    return [*faults[:_MOST], Fault("more-faults", f"and {rest} more faults")]


def _order(fault: Fault) -> tuple[str, int, int]:
    return fault.location.file, fault.location.line, fault.location.column
