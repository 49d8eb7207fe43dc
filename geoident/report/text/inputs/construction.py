"""Construction of a case: what happens at which stage, when."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from geoident.report.text.inputs.numbers import CaseTexts, ShownNumbers, entries, listed, ranged
from geoident.report.text.inputs.structures import support_text
from geoident.report.text.layout import TextTable

INITIAL = "initial state"


def construction_table(case: CaseTexts, numbers: ShownNumbers) -> TextTable:
    """A row for every stage, the initial state first; columns in which nothing stands are left out.

    Args:
        case: as texts.
        numbers: how its numbers are shown.
    """
    solid = case.get("analysis") == "solid"
    columns: dict[str, Callable[[CaseTexts], str]] = {
        "excavated": lambda s: ranged(listed(s.get("excavate"))),
        "placed": lambda s: _by_material(entries(s, "install")),
        "changed": lambda s: _by_material(entries(s, "change"), "to"),
        "face ahead by": lambda s: numbers.text(s["distance"]) if s.get("distance") else "",
        "released so far": lambda s: _shares(s, numbers),
        "built": lambda s: ranged(listed(s.get("build"))),
        "removed": lambda s: ", ".join([*listed(s.get("dismantle")), *listed(s.get("remove"))]),
        "loads": lambda s: "; ".join(load_texts(entries(s, "loads"), numbers)),
        "stressed": lambda s: _pairs(entries(s, "prestress"), numbers),
        "water": lambda s: numbers.text(s["water"]) if s.get("water") else "",
        "drained": lambda s: drained_text(entries(s, "drained"), numbers),
        "heat": lambda s: heat_text(entries(s, "heat"), numbers),
        "placed at": lambda s: _pairs(entries(s, "placed_at"), numbers),
        "comes over": lambda s: numbers.text(s["over"]) if s.get("over") else "",
        "temperature": lambda s: _pairs(entries(s, "temperature"), numbers),
        "supports": lambda s: _supports(s, numbers, solid=solid),
        "lasts": lambda s: str(s.get("lasts", "")),
        "follows": _base,
    }
    if entries(case, "model").get("kind") in ("seasonal", "settlement-law"):
        return TextTable((), ())  # nothing is built
    stages = [stage for stage in case.get("stages", ()) if isinstance(stage, Mapping)]
    dates = entries(case, "dates")
    first: CaseTexts = {key: case.get(key) for key in ("loads", "water", "drained", "heat")}
    rows = [["0", INITIAL, str(dates.get("virgin", "")), *(of(first) for of in columns.values())]]
    for number, stage in enumerate(stages, start=1):
        name = str(stage.get("name", ""))
        happens = [of(stage) for of in columns.values()]
        rows.append([str(number), name, str(dates.get(name, "")), *happens])
    return _filled(TextTable(("no.", "stage", "date", *columns), rows, right="r"), always=2)


def _filled(table: TextTable, *, always: int) -> TextTable:
    """Without columns that are empty, but with some of the first."""
    taken = [k for k in range(len(table.header)) if k < always or any(row[k] for row in table.rows)]
    return TextTable(
        [table.header[k] for k in taken],
        [[row[k] for k in taken] for row in table.rows],
        right="".join(table.sides[k] for k in taken),
    )


def _by_material(groups: CaseTexts, word: str = "of") -> str:
    """Groups of one material together."""
    groups_of: dict[str, list[str]] = {}
    for group, material in groups.items():
        groups_of.setdefault(str(material), []).append(str(group))
    return "; ".join(f"{ranged(names)} {word} {material}" for material, names in groups_of.items())


def _pairs(entry: CaseTexts, numbers: ShownNumbers) -> str:
    return ", ".join(f"{name} {numbers.text(value)}" for name, value in entry.items())


def drained_text(faces: CaseTexts, numbers: ShownNumbers) -> str:
    """Faces at which water leaves, with a head where one is given, or no longer leaves."""
    words = []
    for name, how in faces.items():
        head = how.get("head") if isinstance(how, Mapping) else None
        closed = " closed" if isinstance(how, str) else ""
        words.append(f"{name}{closed}" if head is None else f"{name} at {numbers.text(head)}")
    return ", ".join(words)


def heat_text(faces: CaseTexts, numbers: ShownNumbers) -> str:
    """Faces and nodes with their temperature, or what they exchange heat with."""
    words = []
    for name, how in faces.items():
        if not isinstance(how, Mapping):
            words.append(f"{name} adiabatic")
            continue
        film = f" by {numbers.text(how['film'])}" if how.get("film") else ""
        words.append(f"{name} {numbers.text(how.get('temperature'))}{film}")
    return "; ".join(words)


def _supports(stage: CaseTexts, numbers: ShownNumbers, *, solid: bool) -> str:
    """Supports that begin to hold, move or let go."""
    return "; ".join(
        f"{name} {support_text(held, numbers, solid=solid)}"
        for name, held in entries(stage, "supports").items()
    )


def _shares(stage: CaseTexts, numbers: ShownNumbers) -> str:
    """How much of the stress of groups is released."""
    return ", ".join(
        f"{share_text(value, numbers)} of {group}"
        for group, value in entries(stage, "release").items()
    )


def share_text(value: object, numbers: ShownNumbers) -> str:
    """A part of a whole in words: per cent where it is a number.

    >>> share_text("0.6", ShownNumbers({})), share_text("$ahead", ShownNumbers({}))
    ('60 %', 'ahead')
    """
    try:
        return f"{100.0 * float(str(value)):.4g} %"
    except ValueError:
        return numbers.text(value)


def load_texts(loads: CaseTexts, numbers: ShownNumbers) -> list[str]:
    """Loads with their kinds, sizes and places.

    Args:
        loads: as a case gives them, by name.
        numbers: how its numbers are shown.
    """
    return [_load(name, load, numbers) for name, load in loads.items() if isinstance(load, Mapping)]


def _load(name: str, load: CaseTexts, numbers: ShownNumbers) -> str:
    if load.get("file"):
        return f"{name} over time: {load['file']}"
    kinds = [
        f"{str(key).replace('_', ' ')} {numbers.text(value)}"
        for key, value in load.items()
        if key not in ("on", "at")
    ]
    on = f" on {load['on']}" if load.get("on") else ""
    at = f" at ({numbers.text(load['at'])})" if load.get("at") else ""
    return f"{name}: {', '.join(kinds)}{on}{at}"


def _base(stage: CaseTexts) -> str:
    """What a stage builds on, where that is not the one before."""
    base = f"builds on {stage['base']}" if stage.get("base") else ""
    alone = "a load case by itself" if stage.get("independent") == "true" else ""
    return ", ".join(words for words in (base, alone) if words)
