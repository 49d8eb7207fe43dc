"""From the key ``model`` with a settlement law to the law: lifts, drains, constants by gauge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from geoident.errors import Fault, InputError, Location
from geoident.io.case.external.by_gauge import LawConstants
from geoident.io.case.external.settlement_section import (
    DrainsSection,
    FillFileSection,
    LiftSection,
    SettlementLawSection,
)
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.readings.file import read_readings
from geoident.io.text.dates import date_text, read_date
from geoident.model.case import KeyPath
from geoident.model.drains import AROUND
from geoident.model.parameter import Scalar
from geoident.model.settlement import Consolidation, Drains, Fill, SettlementLaw
from geoident.units import DIMENSIONS, size_in, unit_list, with_article

_AT: KeyPath = ("model",)


def build_settlement(section: SettlementLawSection, around: ModelContext) -> SettlementLaw:
    """The law of a case; what is wrong is noted.

    Args:
        section: the key ``model``.
        around: what it refers to.
    """
    constants = LawConstants("settlement law", around)
    consolidation = None
    since = -np.inf if section.since is None else read_date(section.since)
    if section.law == "consolidation":
        consolidation = _consolidation(section, constants)
        since = min((float(fill.begin[0]) for fill in consolidation.fills), default=since)
        _check_readings(since, around)
    law = SettlementLaw(
        curve=section.law,
        since=since,
        final=constants.like_readings("S", section.S),
        time=() if section.T is None else constants.of("T", section.T, least="above"),
        shape=() if section.m is None else constants.of("m", section.m, least="at"),
        times=np.array([around.dates.get(stage, np.nan) for stage in around.stages]),
        consolidation=consolidation,
        until=np.inf if section.until is None else read_date(section.until),
        degrees=tuple(one.factor for one in listed(section.degree)),
        after=tuple(read_date(text) for text in listed(section.remaining_after)),
    )
    _check_asked(section, law, around)
    return law


def _check_readings(since: float, around: ModelContext) -> None:
    """There is a day after the fill has begun."""
    if around.dates and not any(
        around.dates[s] > since for s in around.stages if s in around.dates
    ):
        message = f"all readings are before the first lift, {date_text(since)}"
        hint = "Correct the dates of the fill or of the readings."
        around.faults.add((*_AT, "fill"), "no-readings", message, hint)


def _check_asked(section: SettlementLawSection, law: SettlementLaw, around: ModelContext) -> None:
    """What is asked for comes after the law begins, and before it ends."""
    if law.until <= law.since:
        message = f"'{section.until}' is not after the beginning of the law, "
        message += date_text(law.since)
        around.faults.add((*_AT, "until"), "dates-order", message, "Correct the date.")
        return
    for key in ("forecast", "remaining_after"):
        given = getattr(section, key)
        for n, text in enumerate(listed(given)):
            place: KeyPath = (*_AT, key, n) if isinstance(given, list) else (*_AT, key)
            if read_date(text) < law.since:
                message = f"'{text}' is before the law begins, {date_text(law.since)}"
                around.faults.add(place, "dates-order", message, "Correct the date.")
            elif key == "remaining_after" and read_date(text) >= law.until:
                message = f"nothing remains after '{text}': settlement is final at "
                message += date_text(law.until)
                around.faults.add(place, "dates-order", message, "Correct it, or 'until'.")


def listed(given: object) -> list[Any]:
    """What is given: nothing, one or several."""
    if given is None:
        return []
    return list(given) if isinstance(given, list) else [given]


def _consolidation(section: SettlementLawSection, constants: LawConstants) -> Consolidation:
    """What consolidates under which load."""

    def of(key: str, least: Literal["at", "above"] = "above") -> tuple[Scalar, ...]:
        given = getattr(section, key)
        return () if given is None else constants.of(key, given, least=least)

    return Consolidation(
        fills=_fills(section, constants.around),
        c_v=of("c_v"),
        path=of("path"),
        drains=None if section.drains is None else _drains(section.drains, constants),
        stress=of("stress"),
        creep=of("creep", "at"),
        creep_time=of("creep_time"),
    )


def _drains(section: DrainsSection, constants: LawConstants) -> Drains:
    diameter = section.diameter.factor
    ratio = section.smear_ratio
    return Drains(
        c_h=constants.of("drains.c_h", section.c_h, least="above"),
        influence=AROUND[section.pattern] * section.spacing.factor,
        diameter=diameter,
        smear=diameter if section.smear is None else section.smear.factor,
        smear_ratio=(Scalar(1.0),) * len(constants.around.channels)
        if ratio is None
        else constants.of("drains.smear_ratio", ratio, least="above"),
        installed=-np.inf if section.installed is None else read_date(section.installed),
    )


def _fills(section: SettlementLawSection, around: ModelContext) -> tuple[Fill, ...]:
    """The fill at each channel."""
    names, given = [channel.name for channel in around.channels], section.fill
    path: KeyPath = (*_AT, "fill")
    if not isinstance(given, Mapping):
        return (_fill(given, section, path, around),) * len(names) if given is not None else ()
    fills = {}
    for name, own in given.items():
        if name not in names:
            around.faults.add_unknown((*path, name), "gauge", name, names, key=True)
        fills[name] = _fill(own, section, (*path, name), around)
    missing = [name for name in names if name not in fills]
    if missing:
        message = f"no fill for {', '.join(map(repr, missing))}"
        around.faults.add(path, "missing-gauge", message, "Add it, or one for all.", key=True)
    return tuple(fills.get(name, _NO_FILL) for name in names)


_NO_FILL = Fill(np.zeros(1), np.zeros(1), np.array([0.0, 1.0]))
"""Stands for one that could not be read."""


@dataclass(frozen=True)
class _Lift:
    """A lift as it is given.

    Args:
        begin: seconds since 1970.
        lasts: s.
        value: height or load of the whole fill after it, SI.
        text: that as people read it.
        place: keys that lead to it, or where it stands in a file.
    """

    begin: float
    lasts: float
    value: float
    text: str
    place: KeyPath | Location


def _fill(
    given: list[LiftSection] | FillFileSection,
    section: SettlementLawSection,
    path: KeyPath,
    around: ModelContext,
) -> Fill:
    """The lifts of a fill; one that cannot be used is noted."""

    def refuse(lift: _Lift, code: str, message: str, hint: str) -> None:
        if isinstance(lift.place, Location):
            around.faults.extend([Fault(code, message, hint, lift.place)])
        else:
            around.faults.add(lift.place, code, message, hint)

    if isinstance(given, FillFileSection):
        lifts, by_height = _lifts_of(given, path, around), given.height is not None
    else:
        lifts, by_height = [_lift(one, (*path, n)) for n, one in enumerate(given)], False
        heights = [one.height is not None for one in given]
        by_height = heights[0]
        for lift, height in zip(lifts, heights, strict=True):
            if height != by_height:
                message = f"'{lift.text}' is a {'height' if height else 'load'}, the first lift "
                message += f"has a {'height' if by_height else 'load'}"
                refuse(lift, "contradiction", message, "Give all lifts in the same way.")
                return _NO_FILL
    found = len(around.faults.found)
    before: _Lift | None = None
    for lift in lifts:
        if before is None and lift.value <= 0.0:
            message = f"the first lift has nothing: '{lift.text}'"
            refuse(lift, "out-of-range", message, "Begin with the first lift that loads the clay.")
        elif before is not None and lift.begin < before.begin + before.lasts:
            end = date_text(before.begin + before.lasts)
            message = f"the lift begins before the one before it is placed, {end}"
            refuse(lift, "dates-order", message, "Give lifts in their order, one after another.")
        elif before is not None and lift.value < before.value:
            message = f"the fill falls from {before.text} to {lift.text}"
            hint = "The law knows no unloading: clay swells far less than it has settled. Leave "
            hint += "small differences of the measurement out. After a surcharge is removed, fit "
            hint += "'asaoka' or 'hyperbola' since then."
            refuse(lift, "unloading", message, hint)
        before = lift
    if section.stress is not None and by_height and section.unit_weight is None:
        message = "the fill is given by height, and 'stress' needs its load"
        around.faults.add(path, "missing-key", message, "Add 'unit_weight: 19 kN/m3' to 'model'.")
    elif section.unit_weight is not None and not (by_height and section.stress is not None):
        message = "nothing depends on it: parts of lifts go by " + (
            "height" if by_height else "load"
        )
        around.faults.add((*_AT, "unit_weight"), "unused-key", message, "Remove it.")
    if len(around.faults.found) > found or not lifts:
        return _NO_FILL
    begin = np.array([lift.begin for lift in lifts])
    weight = 1.0 if section.unit_weight is None else section.unit_weight.factor
    return Fill(
        begin,
        begin + np.array([lift.lasts for lift in lifts]),
        weight * np.array([0.0, *(lift.value for lift in lifts)]),
    )


def _lift(section: LiftSection, place: KeyPath) -> _Lift:
    given = section.height or section.load
    assert given is not None
    lasts = 0.0 if section.lasts is None else section.lasts.factor
    return _Lift(read_date(section.date), lasts, given.factor, given.text, place)


def _lifts_of(section: FillFileSection, path: KeyPath, around: ModelContext) -> list[_Lift]:
    """The lifts of a file; none, with faults, where it is of no use."""
    column, dimension = section.height or section.load, "length"
    if section.height is None:
        dimension = "pressure"
    assert column is not None
    if section.unit is not None and size_in(section.unit, dimension) is None:
        message = f"'{section.unit}' is not a unit of {with_article(dimension)}"
        hint = f"Its units: {unit_list(dimension)}."
        around.faults.add((*path, "unit"), "unit", message, hint)
        return []
    found = len(around.faults.found)
    file = around.find(section.file, (*path, "file"))
    if len(around.faults.found) > found:
        return []
    try:
        rows = read_readings(file, section.layout_of(column, dimension, "model.fill"))
    except InputError as error:
        around.faults.extend(error.faults)
        return []
    lifts = []
    for row in rows:
        if row.value is not None and not row.bad:
            text = f"{row.value:.6g} {DIMENSIONS[dimension]}"
            lifts.append(_Lift(row.time or 0.0, 0.0, row.value, text, row.location))
    if not lifts:
        message = "the file has no lift"
        around.faults.add((*path, "file"), "too-few", message, "Give a row for each.")
    return lifts
