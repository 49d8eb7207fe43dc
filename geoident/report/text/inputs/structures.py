"""Structures and supports of a case."""

from __future__ import annotations

from collections.abc import Mapping

from geoident.report.text.inputs.numbers import CaseTexts, SaidNumbers, entries, listed
from geoident.report.text.layout import TextTable

_KINDS = {"beam": "wall or lining", "bolt": "bolts", "strut": "struts", "anchor": "anchors"}
_STIFFNESS = ("E", "nu", "thickness", "diameter", "area", "EA", "EI", "density", "weight")


def structures_table(case: CaseTexts, numbers: SaidNumbers) -> TextTable:
    """Walls, linings, bolts, struts and anchors: section, stiffness, when they stand.

    Args:
        case: as texts.
        numbers: how its numbers are said.
    """
    rows = [
        [
            name,
            _KINDS.get(str(structure.get("kind")), str(structure.get("kind"))),
            _place(structure, numbers),
            "; ".join(f"{k} = {numbers.text(structure[k])}" for k in _STIFFNESS if k in structure),
            _details(structure, numbers),
            _stages_of(case, name),
        ]
        for name, structure in entries(case, "structures").items()
        if isinstance(structure, Mapping)
    ]
    header = ("structure", "kind", "place", "section and stiffness", "details", "stands")
    return TextTable(header, rows)


def _place(structure: CaseTexts, numbers: SaidNumbers) -> str:
    """The lines on which it lies, or where its bars run."""
    if structure.get("on"):
        return f"on {structure['on']}"
    bars = structure.get("ends")
    bars = bars if isinstance(bars, list) else []
    if len(bars) == 1 and isinstance(bars[0], list):
        return " to ".join(f"({numbers.text(point)})" for point in bars[0])
    return f"{len(bars)} bars"


def _details(structure: CaseTexts, numbers: SaidNumbers) -> str:
    said = [
        f"{key} {numbers.text(structure[key])}"
        for key in ("spacing", "number", "grouted", "prestress")
        if key in structure
    ]
    end = structure.get("second_end")
    said += [f"second end {end}"] if end and end != "joined" else []
    clamped = listed(structure.get("clamped_on"))
    said += [f"clamped on {', '.join(clamped)}"] if clamped else []
    hinges = structure.get("hinges")
    said += [f"hinges at {numbers.text(hinges)}"] if hinges else []
    return "; ".join(said)


def _stages_of(case: CaseTexts, name: str) -> str:
    """Stages that build and remove it."""
    said = []
    for key, word in (("build", "from"), ("dismantle", "until")):
        said += [
            f"{word} {stage.get('name')}"
            for stage in case.get("stages", ())
            if isinstance(stage, Mapping) and name in listed(stage.get(key))
        ]
    return ", ".join(said) or "never built"


def supports_table(case: CaseTexts) -> TextTable:
    """Groups that are held, in which directions, and how they move."""
    rows = [[group, _held(case, held)] for group, held in entries(case, "supports").items()]
    for stage in case.get("stages") or ():
        if isinstance(stage, Mapping):
            since = f"from {stage.get('name')}"
            for group, held in entries(stage, "supports").items():
                rows.append([group, f"{since}: {_held(case, held)}"])
    return TextTable(("support", "held along"), rows)


def _held(case: CaseTexts, held: object) -> str:
    """What is said of a support, in words."""
    if isinstance(held, Mapping):
        parts = [
            f"{axis} fixed" if held[axis] == "fixed" else f"{axis} moved by {held[axis]}"
            for axis in "xyz"
            if axis in held
        ]
        if "contraction" in held:
            parts.append(f"contracted by {held['contraction']}")
        parts += ["moved as measured"] * ("measured" in held)
        return ", ".join(parts)
    if held == "fixed":
        return "x, y, z" if case.get("analysis") == "solid" else "x, y"
    return ", ".join(listed(held)) or str(held)
