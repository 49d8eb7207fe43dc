"""How the readings of a program are found in what a run of it leaves: `model.outputs`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

from geoident.errors import InputError
from geoident.io.case.external.function import function_of
from geoident.io.case.external.section import OutputSection
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.external.pest_instructions import DUMMY, OBSERVATIONS, read_instructions
from geoident.io.text.faults import Faults
from geoident.io.text.wording import did_you_mean, shorten
from geoident.model.case import KeyPath
from geoident.model.external import (
    Finding,
    FunctionValue,
    Hdf5Value,
    InstructedValue,
    InstructionLine,
    JsonValue,
    LineValue,
    Output,
    PatternValue,
    TableCell,
)
from geoident.model.gauges import Channel
from geoident.units import DIMENSIONLESS, UnitError, normal_unit, size_in, unit_list, with_article

_AT: KeyPath = ("model",)


def build_outputs(sections: Sequence[OutputSection], around: ModelContext) -> Iterator[Output]:
    """What is found in what a run leaves, reading by reading; what is wrong is noted.

    Args:
        sections: the entries of ``model.outputs``.
        around: of the model.
    """
    rows = {channel.name: n for n, channel in enumerate(around.channels)}
    columns = {name: n for n, name in enumerate(around.stages)}
    by: dict[tuple[int, int], int] = {}
    covered = set[str]()
    for number, section in enumerate(sections):
        path: KeyPath = (*_AT, "outputs", number)
        if section.file is not None:
            around.check_inside(section.file, (*path, "file"))
        how = _finder(section, path, around)
        gauges = _named(section.gauges, rows, (*path, "gauges"), "gauge", around.faults)
        stages = _named(section.stages, columns, (*path, "stages"), "stage", around.faults)
        # one that is misspelt may be any of those that nothing finds
        covered.update(rows if section.gauges and len(gauges) < len(section.gauges) else gauges)
        for gauge in gauges:
            channel = around.channels[rows[gauge]]
            size = _unit(section, channel, path, around.faults)
            if size is None:
                break
            for stage in stages:
                place = rows[gauge], columns[stage]
                if place in by:
                    message = f"'{gauge}' at '{stage}' is found by outputs[{by[place]}] already"
                    hint = "Say by 'gauges' and 'stages' which readings each of them finds."
                    around.faults.add(path, "found-twice", message, hint)
                    break
                by[place] = number
                finding = how(gauge, stage, columns[stage] + 1)
                if finding is None:
                    continue
                file = _named_by(section.file or "", gauge, stage, columns[stage] + 1)
                yield Output(*place, file, finding, size)
    for name in rows:
        if name not in covered:
            message = f"nothing in 'model.outputs' finds the readings of '{name}'"
            hint = "Add an entry for it, or remove the gauge."
            around.faults.add(("gauges", name), "no-output", message, hint, key=True)


_Find = Callable[[str, str, int], Finding | None]
"""Where the number of a reading stands, of its gauge, stage and number of the stage; None where
that cannot be said, which has been noted."""


def _finder(section: OutputSection, path: KeyPath, around: ModelContext) -> _Find:
    """How an entry finds its readings."""
    if section.function is not None:
        code = FunctionValue(*function_of(section.function, (*path, "function"), around))
        return lambda gauge, stage, number: code
    if section.instructions is not None:
        return _instructions(section, section.instructions, path, around)
    return partial(_how, section)


def _instructions(section: OutputSection, file: str, path: KeyPath, around: ModelContext) -> _Find:
    """How an entry with a file of instructions finds its readings; what is wrong in it is noted."""
    faults, before = around.faults, len(around.faults.found)
    key, lines = (*path, "instructions"), tuple[InstructionLine, ...]()
    file_path = around.find(file, key)
    if len(faults.found) == before:
        try:
            lines, wrong = read_instructions(file_path)
            faults.extend(wrong)
        except InputError as error:
            faults.extend(error.faults)
    sound = len(faults.found) == before
    items = [item for line in lines for item in line.items if item.kind in OBSERVATIONS]
    known = [item.text for item in items if item.text != DUMMY]
    taken: dict[str, str] = {}

    def find(gauge: str, stage: str, number: int) -> InstructedValue | None:
        if not sound:
            return None  # nobody misses an observation in a wrong file
        name = _named_by(section.observation or "{gauge}", gauge, stage, number).lower()
        reading = f"'{gauge}' at '{stage}'"
        if name in known and name not in taken:
            taken[name] = reading
            return InstructedValue(file_path, name, lines)
        if name in taken:
            message = f"the observation '{shorten(name)}' is {taken[name]} and {reading}"
            hint = "Tell them apart: 'observation: \"{gauge}_{number}\"'."
        else:
            message = f"the instructions have no observation '{shorten(name)}', which is {reading}"
            hint = did_you_mean(name, known, what="Observations")
            hint += " Say by 'observation' how they are called: {gauge}, {stage}, {number}."
        faults.add(key, "no-observation", message, hint)
        return None

    return find


def _named(
    given: Sequence[str] | None, known: Mapping[str, int], path: KeyPath, kind: str, faults: Faults
) -> list[str]:
    if given is None:
        return list(known)
    for n, name in enumerate(given):
        if name not in known:
            faults.add_unknown((*path, n), kind, name, known)
    return [name for name in dict.fromkeys(given) if name in known]


def _unit(section: OutputSection, channel: Channel, path: KeyPath, faults: Faults) -> float | None:
    """Size of the unit of an output; None, with a fault, where it is none of its channel."""
    dimension = channel.dimension
    if section.unit is None:
        if dimension == DIMENSIONLESS:
            return 1.0
        message = f"no unit is given, and '{channel.name}' reads {with_article(dimension)}"
        faults.add(path, "unit", message, f"Add 'unit: ...'. Its units: {unit_list(dimension)}.")
        return None
    try:
        size = size_in(normal_unit(section.unit, dimension), dimension)
    except UnitError as error:
        faults.add((*path, "unit"), "unit", error.message, error.hint)
        return None
    if size is None:
        message = f"'{section.unit}' is not a unit of {with_article(dimension)}, which "
        message += f"'{channel.name}' reads"
        faults.add((*path, "unit"), "unit", message, f"Its units: {unit_list(dimension)}.")
    return size


def _named_by(text: str, gauge: str, stage: str, number: int) -> str:
    """A text with its reading in place of ``{gauge}``, ``{stage}`` and ``{number}``."""
    for mark, word in (("{gauge}", gauge), ("{stage}", stage), ("{number}", str(number))):
        text = text.replace(mark, word)
    return text


def _how(section: OutputSection, gauge: str, stage: str, number: int) -> Finding:
    """Where the number of a reading stands, if no function finds it."""

    def named(text: str) -> str:
        return _named_by(text, gauge, stage, number)

    def matched(text: str) -> str:
        return _named_by(text, re.escape(gauge), re.escape(stage), number)

    if section.column is not None:
        row = section.row if section.row is not None else -1
        rows = row if isinstance(row, int) else tuple((k, named(v)) for k, v in row.items())
        return TableCell(named(section.column), rows)
    if section.pointer is not None:
        return JsonValue(named(section.pointer))
    if section.dataset is not None:
        return Hdf5Value(named(section.dataset), tuple(section.index or ()))
    if section.line is not None:
        line = section.line if isinstance(section.line, int) else matched(section.line)
        first, last = section.columns or (0, 0)
        return LineValue(line, section.after or 0, section.word or 0, (first, last))
    assert section.find is not None
    return PatternValue(matched(section.find), section.occurrence or 1)
