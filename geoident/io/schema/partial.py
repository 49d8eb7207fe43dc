"""What can still be said of a case of which some entries are wrong by themselves.

A case is judged entry by entry first: whether its keys and values are what the schema asks for.
What takes several entries (names that refer to each other, the sequence of stages, readings) is
judged afterwards. So that both come in one round, the wrong entries are left out of a copy, and of
what is found in the rest only that is kept which does not depend on them.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from geoident.errors import Fault
from geoident.io.text.faults import Places
from geoident.io.text.wording import nearest
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath

_NAMED = ("parameters", "materials", "groups", "supports", "loads", "structures", "gauges", "dates")
"""Keys whose entries have names, of which a wrong one can be left out."""
_KEPT = {"format": ("geoident-case/1",), "analysis": ("plane-strain", "axisymmetric", "solid")}
"""Keys that a case cannot do without, and what they may say."""
_IN_SEQUENCE = ("groups", "loads", "structures", "stages")
ZERO = "gauges: zero"
"""In place of a key of the first level: the zero of a gauge is left out, the gauge stays."""
_ASKS_FOR = {
    "no-mesh": {"mesh", "fit"},
    "no-gravity": {"gravity"},
    "missing-dates": {"dates"},
    "no-face": {"face"},
    "no-distance": {"stages"},
    "dates-order": {"dates"},
    "group-coverage": {"groups", "stages"},
    "gauge-in-absent-ground": {ZERO},
    "zero-before-structure": {ZERO},
    "unreadable-gauge": {ZERO},
}
"""Code of a fault to the keys among whose wrong entries may be what it misses."""
_ANY: dict[str, Node] = {
    "elastic": "isotropic",
    "E": "1 GPa",
    "nu": "0.25",
    "density": "2000 kg/m3",
    "expansion": "1e-5 1/K",
}
"""In place of a wrong material, so that who refers to it is right."""
_STAND_IN = "(any)"
"""Name of the one material or group where all of them are wrong; a case must have one."""
_NAMES = {
    "unknown-stage": "stages",
    "before-zero": "stages",
    "unknown-gauge": "gauges",
    "unknown-group": "groups",
    "missing-group": "groups",
    "unknown-material": "materials",
    "unknown-structure": "structures",
    "unknown-load": "loads",
    "unused-parameter": "materials",
}
"""Code of a fault to the key of which something must be left for it to be known."""
_MODEL_NEEDS = {"kind", "function", "file", "face", "sections", "C_inf", "X", "m", "T", "n"}
"""Keys of `model` without which nothing can be said of it."""
_REFERENCE = re.compile(r"\$\{?([A-Za-z_]\w*)")


@dataclass(frozen=True)
class ValidPart:
    """A case without its wrong entries.

    Args:
        places: where its keys are written; its data lack the wrong entries.
        keys: of the first level, in which something is left out.
        names: of the entries that are left out, and all words in them.
        used: parameters that these refer to.
        empty: one of them holds none of what it should.
        whole: keys of the first level of which nothing is left.
        stand_ins: how messages and paths name entries of a model elsewhere that are left out, or in
            whose place something else stands.
    """

    places: Places
    keys: frozenset[str] = frozenset()
    names: frozenset[str] = frozenset()
    used: frozenset[str] = frozenset()
    empty: bool = False
    whole: frozenset[str] = frozenset()
    stand_ins: frozenset[str] = frozenset()

    @classmethod
    def all_of(cls, places: Places) -> ValidPart:
        """A case of which nothing is left out yet.

        Args:
            places: of the case, which is a mapping.
        """
        return cls(places)

    @property
    def sequence_is_known(self) -> bool:
        """Whether it can be said which ground is there at which stage."""
        return not self.keys & {"groups", "stages"}

    def without(self, faults: Iterable[KeyPath]) -> ValidPart | None:
        """The case without the entries in which something is wrong; None if too little is left.

        Args:
            faults: paths of what is wrong.
        """
        data = copy.deepcopy(self.places.data)
        if not isinstance(data, dict):
            return None
        keys, names, stand_ins = set(self.keys), set(self.names), set(self.stand_ins)
        gone: list[Node] = []
        for path in sorted(set(faults), key=len, reverse=True):
            if not path:
                return None
            of_model = path[0] == "model"
            taken = (
                _take_of_model(data, path, stand_ins)
                if of_model
                else _take(data, path, names, gone)
            )
            if not taken:
                return None
            keys.add(ZERO if _is_zero(path) else str(path[0]))
        whole = {key for key in keys if not data.get(key)}
        if "model" not in data:  # which has no ground
            if not data.get("materials"):
                data["materials"] = {_STAND_IN: dict(_ANY)}
            if not data.get("groups"):
                data["groups"] = {_STAND_IN: next(_names_in(data["materials"]), _STAND_IN)}
        if whole & {"materials", "groups"}:
            names.add(_STAND_IN)
        names.update(_words(gone))
        return ValidPart(
            replace(self.places, data=data),
            frozenset(keys),
            frozenset(names),
            self.used | frozenset(_REFERENCE.findall(str(gone))),
            self.empty or any(not isinstance(node, dict | list) for node in gone),
            self.whole | whole,
            frozenset(stand_ins),
        )

    def independent(self, faults: Iterable[Fault]) -> list[Fault]:
        """The faults that would be there with the entries put right, too.

        Args:
            faults: of what is left.
        """
        return [fault for fault in faults if self._stands(fault)]

    def _stands(self, fault: Fault) -> bool:
        names = (f"'{name}{end}" for name in self.names | self.used for end in ("'", "."))
        if any(name in fault.message for name in names):
            return False
        if fault.code == "unused-parameter" and (self.empty or "model.inputs" in self.stand_ins):
            return False
        if any(fault.path.startswith(path) or path in fault.message for path in self.stand_ins):
            return False
        if self.keys & _ASKS_FOR.get(fault.code, set()):
            return False
        if self.whole & {_NAMES.get(fault.code)}:
            return False
        in_stage = fault.path.startswith("stages") and not fault.code.startswith("duplicate-")
        return not (in_stage and self.keys & {*_IN_SEQUENCE})


def _take(data: dict[str, Node], path: KeyPath, names: set[str], gone: list[Node]) -> bool:
    """Take the entry that holds a fault out of the data; whether that can be done."""
    key = str(path[0])
    holder = data.get(key)
    if key == "materials" and len(path) > 1 and isinstance(holder, dict):
        gone.append(holder.get(str(path[1])))
        holder[str(path[1])] = dict(_ANY)
        return True
    if key in _NAMED and len(path) > 1 and isinstance(holder, dict):
        _take_named(holder, path, names, gone)
        return True
    if key == "stages" and len(path) > 1 and isinstance(holder, list):
        return _blank_stage(holder, path[1], gone)
    if key not in _KEPT:
        gone.append(data.pop(key, None))  # optional, or not known at all
        return True
    data[key] = nearest(str(holder), _KEPT[key])
    return bool(data[key])


def _take_of_model(data: dict[str, Node], path: KeyPath, stand_ins: set[str]) -> bool:
    """Take the entry of a model elsewhere that holds a fault; whether the rest can be judged."""
    model = data.get("model")
    if not isinstance(model, dict) or len(path) < 2 or path[1] in _MODEL_NEEDS:
        return False
    key, held = str(path[1]), model.get(str(path[1]))
    if key == "command":
        model[key] = [_STAND_IN]
    elif key == "outputs":
        if len(path) < 3 or not isinstance(held, list) or not isinstance(path[2], int):
            return False
        held[path[2]] = _any_output(held[path[2]], path)
        stand_ins.add(f"outputs[{path[2]}]")
        stand_ins.add(f"model.outputs[{path[2]}]")
    elif key == "inputs":
        if len(path) < 3 or not isinstance(held, dict) or len(held) < 2:
            return False
        held.pop(str(path[2]), None)
        stand_ins.add("model.inputs")  # it may be what has the field of a parameter
    else:
        model.pop(key, None)
    return True


def _any_output(entry: Node, path: KeyPath) -> Node:
    """In place of a wrong entry of outputs: it finds the same readings, whatever it does."""
    found: dict[str, Node] = {"file": _STAND_IN, "column": _STAND_IN, "unit": "1"}
    for key in ("gauges", "stages"):
        if isinstance(entry, dict) and key in entry and path[3:4] != (key,):
            found[key] = entry[key]
    return found


def _take_named(holder: dict[str, Node], path: KeyPath, names: set[str], gone: list[Node]) -> None:
    """Take an entry that has a name; of a gauge with a wrong zero the zero alone."""
    entry = holder.get(str(path[1]))
    if _is_zero(path) and isinstance(entry, dict):
        entry.pop("zero", None)
    else:
        gone.append(holder.pop(str(path[1]), None))
        names.add(str(path[1]))


def _is_zero(path: KeyPath) -> bool:
    """Whether a path is that of the zero of a gauge."""
    return len(path) == 3 and path[0] == "gauges" and path[2] == "zero"


def _names_in(node: Node) -> Iterator[str]:
    """The keys of a mapping; nothing of anything else."""
    return iter(node if isinstance(node, dict) else ())


def _words(node: Node) -> Iterator[str]:
    """All keys and texts of a part of a case."""
    if isinstance(node, dict):
        yield from node
        for key, part in node.items():
            yield from _words(part) if key != "zero" else ()  # a stage that others may name
    elif isinstance(node, list):
        for part in node:
            yield from _words(part)
    elif node is not None:
        yield node


def _blank_stage(stages: list[Node], number: str | int, gone: list[Node]) -> bool:
    """Leave of a stage its name alone: others may refer to it, and are counted from it."""
    stage = stages[int(number)] if isinstance(number, int) and number < len(stages) else None
    if not isinstance(stage, dict) or not isinstance(stage.get("name"), str):
        return False
    gone.append({key: value for key, value in stage.items() if key != "name"})
    stages[int(number)] = {"name": stage["name"]}
    return True
