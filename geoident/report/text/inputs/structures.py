"""Structures, interfaces and supports of a case."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.report.text.inputs.numbers import CaseTexts, ShownNumbers, entries, listed
from geoident.report.text.layout import TextTable, number

_KINDS = {
    "beam": "wall or lining", "bolt": "bolts", "strut": "struts", "anchor": "anchors",
    "pile": "piles",
    "ring": "ring", "ribs": "ribs", "bolting": "bolts", "support-line": "support line",
}  # fmt: skip
_ALL_ROUND = ("ring", "ribs", "bolting", "support-line")
_STIFFNESS = (
    "E", "nu", "thickness", "diameter", "length", "area", "EA", "EI", "stiffness", "head_stiffness",
    "density", "weight", "k_grout", "k_shaft", "k_base", "k_lateral",
)  # fmt: skip
_LIMITS = "cohesion", "friction", "dilation", "tensile_strength"
_SPRINGS = "k_n", "k_s"
_DETAILS = (
    "spacing", "rows", "number", "grouted", "prestress", "strength", "capacity", "hardening_time",
    "hardening_distance", "bond", "skin_friction", "base_capacity", "lateral_resistance",
    "free", "head",
)  # fmt: skip


def structures_table(case: CaseTexts, numbers: ShownNumbers) -> TextTable:
    """Walls, linings, bolts, struts and anchors: section, stiffness, when they stand.

    Args:
        case: as texts.
        numbers: how its numbers are shown.
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


def _place(structure: CaseTexts, numbers: ShownNumbers) -> str:
    """The lines on which it lies, or where its bars run."""
    if structure.get("on"):
        return f"on {structure['on']}"
    if structure.get("kind") in _ALL_ROUND:
        return "all round"
    bars = structure.get("ends")
    bars = bars if isinstance(bars, list) else []
    if len(bars) == 1 and isinstance(bars[0], list):
        return " to ".join(f"({numbers.text(point)})" for point in bars[0])
    return f"{len(bars)} bars"


def _details(structure: CaseTexts, numbers: ShownNumbers) -> str:
    details = [f"{key} {numbers.text(structure[key])}" for key in _DETAILS if key in structure]
    end = structure.get("second_end")
    details += [f"second end {end}"] if end and end != "joined" else []
    details += ["only compression"] if structure.get("compression_only") == "true" else []
    clamped = listed(structure.get("clamped_on"))
    details += [f"clamped on {', '.join(clamped)}"] if clamped else []
    hinges = structure.get("hinges")
    details += [f"hinges at {numbers.text(hinges)}"] if hinges else []
    return "; ".join(details)


def _stages_of(case: CaseTexts, name: str) -> str:
    """Stages that build and remove it."""
    stages = []
    for key, word in (("build", "from"), ("dismantle", "until")):
        stages += [
            f"{word} {stage.get('name')}"
            for stage in case.get("stages", ())
            if isinstance(stage, Mapping) and name in listed(stage.get(key))
        ]
    return ", ".join(stages) or "never built"


def interfaces_table(
    case: CaseTexts,
    numbers: ShownNumbers,
    at_start: Mapping[str, tuple[float, float]] | None = None,
) -> TextTable:
    """Along which faces interfaces run, their stiffness and their limits.

    Args:
        case: as texts.
        numbers: how its numbers are shown.
        at_start: cohesion (Pa) and friction angle (rad) at the start values, by the name of an
            interface that has a part of the strength of a material.
    """
    materials, rows = entries(case, "materials").values(), []
    flows = any(isinstance(material, Mapping) and "hydraulic" in material for material in materials)
    on = {str(one["on"]): name for name, one in entries(case, "structures").items() if "on" in one}
    for name, given in entries(case, "interfaces").items():
        if isinstance(given, Mapping):
            limits = [f"{k} = {numbers.text(given[k])}" for k in _LIMITS if k in given]
            if "of" in given:
                part = f"R_inter = {numbers.text(given['R_inter'])} of {given['of']}"
                if at_start and name in at_start:
                    cohesion, friction = at_start[name]
                    part += f": cohesion {number(cohesion / 1e3, 3)} kPa, "
                    part += f"friction {number(np.degrees(friction), 3)} deg at the start"
                limits.insert(0, part)
            along, stiff = (
                str(given["along"]),
                [f"{k} = {numbers.text(given[k])}" for k in _SPRINGS],
            )
            divided = on.get(along) or on.get(along.partition(" in ")[0])
            place = f"{along}, on both sides of {divided}" if divided else along
            limit = "; ".join(limits) or "none, elastic"
            limit += "; holds water back" if flows and given.get("permeable") == "false" else ""
            rows.append([name, place, "; ".join(stiff), limit])
    return TextTable(("interface", "along", "stiffness", "limits"), rows)


def supports_table(case: CaseTexts, numbers: ShownNumbers) -> TextTable:
    """Groups that are held or moved, from the beginning or from a stage on.

    Args:
        case: as texts.
        numbers: how its numbers are shown.
    """
    solid = case.get("analysis") == "solid"
    supports_of = [("", entries(case, "supports"))]
    supports_of += [
        (str(stage.get("name")), entries(stage, "supports"))
        for stage in case.get("stages") or ()
        if isinstance(stage, Mapping)
    ]
    rows = [
        [name, stage, support_text(held, numbers, solid=solid)]
        for stage, supports in supports_of
        for name, held in supports.items()
    ]
    return TextTable(("support", "from stage", "is"), rows)


def support_text(held: object, numbers: ShownNumbers, *, solid: bool) -> str:
    """What is said of a support, in words.

    Args:
        held: what the case says.
        numbers: how its numbers are shown.
        solid: whether there is a z.

    >>> support_text({"x": "fixed", "y": "2 mm"}, ShownNumbers({}), solid=False)
    'held along x, moved by 2 mm along y'
    >>> [support_text(held, ShownNumbers({}), solid=True) for held in ("fixed", "free")]
    ['held along x, y, z', 'let go']
    """
    if held == "free":
        return "let go"
    if not isinstance(held, Mapping):
        axes = ["x", "y", *"z" * solid] if held == "fixed" else listed(held) or [str(held)]
        return f"held along {', '.join(axes)}"
    parts = [
        f"held along {axis}"
        if held[axis] == "fixed"
        else f"moved by {numbers.text(held[axis])} along {axis}"
        for axis in "xyz"
        if axis in held
    ]
    if "contraction" in held:
        parts.append(f"contracted by {numbers.text(held['contraction'])} of the area within")
    measured = held.get("measured")
    if isinstance(measured, Mapping):
        times = f" times {numbers.text(measured['factor'])}" if "factor" in measured else ""
        parts.append(f"moved as measured ({measured.get('file')}){times}")
    if "at" in held:
        parts.append(f"at ({numbers.text(held['at'])})")
    return ", ".join(parts)
