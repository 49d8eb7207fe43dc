"""Candidates file: gauges as a case has them, each with its cost and the stages it is read at."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from geoident.errors import Fault, InputError
from geoident.io.schema.values import kind_of
from geoident.io.text.faults import Faults, Places
from geoident.io.text.kinds import refuse_other_kind
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.io.text.yaml_reader import MAX_BYTES, Node, parse_yaml
from geoident.model.case import KeyPath, format_path

FORMAT = "geoident-candidates/1"
_KEYS = ("format", "gauges")
_OF_COLUMN = re.compile(r"\s*[@\[]")
"""What follows the name of a gauge in that of its column."""


@dataclass(frozen=True)
class Candidate:
    """A gauge that may be chosen.

    Args:
        name: of the gauge.
        cost: in the unit of the budget.
        stages: names of those at which it would be read; None for all.
    """

    name: str
    cost: float
    stages: tuple[str, ...] | None


@dataclass(frozen=True)
class Candidates:
    """What a candidates file says.

    Args:
        text: of the file.
        each: the candidates.
        gauges: name to what a case would say of the gauge.
        places: where the keys are written.
    """

    text: str
    each: tuple[Candidate, ...]
    gauges: Mapping[str, Node]
    places: Places

    def overrides(self, case: Mapping[str, Any], names: Sequence[str]) -> list[str]:
        """What adds some of them to the gauges of a case.

        Their columns in a table of runs, which the case ignores for want of a gauge, count then.

        Args:
            case: as it is written.
            names: of the candidates.
        """
        gauges = (case.get("gauges") or {}) | {name: self.gauges[name] for name in names}
        changes = [f"gauges={json.dumps(gauges, ensure_ascii=False)}"]
        model = case.get("model")
        if isinstance(model, dict) and isinstance(ignored := model.get("ignore"), list):
            kept = [column for column in ignored if _OF_COLUMN.split(str(column))[0] not in names]
            changes.append(f"model.ignore={json.dumps(kept, ensure_ascii=False)}")
        return changes

    @contextmanager
    def located(self) -> Iterator[None]:
        """Faults of candidates in a case stand where the file of candidates has them."""
        try:
            yield
        except InputError as error:
            placed = [self._placed(fault) for fault in error.faults]
            ours = [one for one in placed if one.location.file == self.places.document.file]
            raise InputError(ours or placed) from error  # others follow from these

    def _placed(self, fault: Fault) -> Fault:
        document = self.places.document
        keys = {*document.keys, *document.values}
        within = [k for k in keys if len(k) > 1 and _begins(fault.path, format_path(k))]
        if not within:
            return fault
        path = max(within, key=len)
        return replace(fault, location=self.places.locate(path, key=len(path) == 2))

    def refuse(self, name: str, code: str, message: str, hint: str) -> Fault:
        """A fault of a candidate as a whole."""
        path: KeyPath = ("gauges", name)
        location = self.places.locate(path, key=True)
        return Fault(code, message, hint, location, format_path(path))


def _begins(path: str, with_: str) -> bool:
    return path == with_ or path.startswith((f"{with_}.", f"{with_}["))


def read_candidates(path: str, taken: Sequence[str], stages: Sequence[str]) -> Candidates:
    """Read a candidates file; what the gauges say is judged with the case.

    Args:
        path: of the file.
        taken: names of gauges that the case has.
        stages: names of the stages of the case.

    Raises:
        InputError: with all faults of its own keys.
    """
    text = decode(read_bytes(path, limit=MAX_BYTES, what="candidates"), path)
    document = parse_yaml(text, path)
    refuse_other_kind(document, "candidates")
    data, faults = document.data, Faults(Places(document, document.data))
    if not isinstance(data, dict):
        hint = "Write 'gauges:', and below it gauges as in a case."
        faults.add((), "wrong-kind", f"found {kind_of(data)}; expected a mapping", hint)
        faults.raise_any()
    assert isinstance(data, dict)
    for key in data.keys() - {*_KEYS}:
        hint = faults.did_you_mean(key, _KEYS, what="Keys")
        faults.add((key,), "unknown-key", f"'{shorten(key)}' is no key here", hint, key=True)
    if data.get("format", FORMAT) != FORMAT:
        message = f"found {kind_of(data['format'])}; expected '{FORMAT}'"
        faults.add(("format",), "not-listed", message, f"Write 'format: {FORMAT}'.")
    gauges = data.get("gauges")
    if not isinstance(gauges, dict) or not gauges:
        hint = "Write 'gauges:', and below it gauges as in a case."
        faults.add(("gauges",), "missing-key", "there are no gauges", hint)
        faults.raise_any()
    assert isinstance(gauges, dict)
    each, plain = list[Candidate](), dict[str, Node]()
    for name, gauge in gauges.items():
        at: KeyPath = ("gauges", name)
        if name in taken:
            message = f"the case has a gauge '{shorten(name)}', too"
            faults.add(at, "same-name", message, "Rename the candidate.", key=True)
        own = dict(gauge) if isinstance(gauge, dict) else {}
        cost = _cost(own.pop("cost", "1"), (*at, "cost"), faults)
        read = _stages(own.pop("stages", None), stages, (*at, "stages"), faults)
        each.append(Candidate(name, cost, read))
        plain[name] = own if isinstance(gauge, dict) else gauge
    faults.raise_any()
    return Candidates(text, tuple(each), plain, faults.places)


def _cost(given: Node, at: KeyPath, faults: Faults) -> float:
    try:
        cost = float(str(given))
    except ValueError:
        cost = float("nan")
    if not 0.0 < cost < float("inf"):
        hint = "A number without unit, in that of the budget, such as 2.5."
        faults.add(at, "bad-cost", f"found {kind_of(given)}; expected a positive number", hint)
        return 1.0
    return cost


def _stages(
    given: Node, known: Sequence[str], at: KeyPath, faults: Faults
) -> tuple[str, ...] | None:
    if given is None:
        return None
    names = given if isinstance(given, list) else [given]
    for n, name in enumerate(names):
        if name not in known:
            where = (*at, n) if isinstance(given, list) else at
            faults.add_unknown(where, "stage", str(name), known)
    return tuple(map(str, names))
