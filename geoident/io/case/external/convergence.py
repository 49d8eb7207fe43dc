"""From the key ``model`` with a convergence law to the law: distances, ages, constants by gauge."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from geoident.io.case.external.by_gauge import LawConstants
from geoident.io.case.external.section import ConvergenceLawSection, TunnelSectionSection
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.schema.values import CaseNumber
from geoident.io.text.dates import read_date
from geoident.model.arrays import Floats
from geoident.model.case import VIRGIN, KeyPath
from geoident.model.external import ConvergenceLaw, Creep
from geoident.model.gauges import Channel

_AT: KeyPath = ("model",)


def build_law(section: ConvergenceLawSection, around: ModelContext) -> ConvergenceLaw:
    """The law of a case; what is wrong is noted.

    Args:
        section: the key ``model``.
        around: what it refers to.
    """
    constants = LawConstants("convergence law", around)
    limit = constants.like_readings("C_inf", section.C_inf)
    reach = constants.of("X", section.X, least="above")
    creep = None
    if section.m is not None and section.T is not None and section.n is not None:
        creep = Creep(
            constants.of("m", section.m, least="at"),
            constants.of("T", section.T, least="above"),
            constants.of("n", section.n, least="above"),
        )
    distance, age = _places(section, around, in_time=creep is not None)
    return ConvergenceLaw(limit, reach, creep, distance, age)


def _places(
    law: ConvergenceLawSection, around: ModelContext, *, in_time: bool
) -> tuple[Floats, Floats]:
    """Distances to the face and ages (n_stages, n_channels); NaN before the face passed.

    Args:
        law: the key ``model``.
        around: what it refers to.
        in_time: whether ages count.
    """
    face = _face(law.face, around)
    dates = _dates(around) if in_time else np.full(len(face), np.nan)
    shape = len(face), len(around.channels)
    distance, age = np.full(shape, np.nan), np.full(shape, np.nan)
    for name, own in _channels_by_section(law, around).items():
        section = law.sections[name]
        ahead = _direction(face, section.chainage.factor) * (face - section.chainage.factor)
        passed = ahead >= 0.0
        begun = _excavated(name, section, ahead, dates, around) if in_time else np.nan
        for j in own:
            distance[passed, j] = ahead[passed]
            if in_time:
                age[passed, j] = dates[passed] - begun
            _check_zero(
                name, around.channels[j], dict(zip(around.stages, ahead, strict=True)), around
            )
        early = passed & (dates < begun)
        if in_time and early.any():
            stage = around.stages[int(np.argmax(early))]
            message = f"'{name}' is excavated after '{stage}', when the face is past it"
            hint = "Correct this date, the date of the stage, or the face."
            path: KeyPath = (*_AT, "sections", name, "excavated")
            around.faults.add(path, "dates-order", message, hint)
    return distance, age


def _face(given: Mapping[str, CaseNumber], around: ModelContext) -> Floats:
    """(n_stages,) where the face is, m; NaN, with a fault, where that is not said."""
    stages = around.stages
    for name in given:
        if name not in stages:
            around.faults.add_unknown((*_AT, "face", name), "stage", name, stages, key=True)
    missing = [stage for stage in stages if stage not in given]
    if missing:
        message = f"no place of the face at {', '.join(map(repr, missing))}"
        hint = "Add its chainage there; where the face has stopped, the same as before."
        around.faults.add((*_AT, "face"), "missing-stage", message, hint, key=True)
    known = [stage for stage in stages if stage in given]
    way = given[known[-1]].factor - given[known[0]].factor if known else 0.0
    for one, other in pairwise(known):
        if (given[other].factor - given[one].factor) * (way or 1.0) < 0.0:
            message = f"the face at '{other}' ({given[other].text}) is behind "
            message += f"that at '{one}' ({given[one].text})"
            hint = "A face advances or stops: correct one of them."
            around.faults.add((*_AT, "face", other), "face-order", message, hint)
    return np.array([given[s].factor if s in given else np.nan for s in stages])


def _dates(around: ModelContext) -> Floats:
    """(n_stages,) when each was complete, s."""
    missing = [stage for stage in around.stages if stage not in around.dates]
    if missing:
        message = f"the convergence law grows in time, and {', '.join(map(repr, missing))} "
        message += "has no date" if len(missing) == 1 else "have no date"
        hint = f"Add dates: {{{missing[0]}: 2024-03-01, ...}}, or remove m, T and n."
        around.faults.add(("dates",), "missing-dates", message, hint, key=True)
    return np.array([around.dates.get(stage, np.nan) for stage in around.stages])


def _excavated(
    name: str, section: TunnelSectionSection, ahead: Floats, dates: Floats, around: ModelContext
) -> float:
    """When the face passed a section, s: given, or between two places of the face."""
    if section.excavated is not None:
        return read_date(section.excavated)
    after = np.flatnonzero((ahead >= 0.0) & np.isfinite(dates))
    before = np.flatnonzero((ahead < 0.0) & np.isfinite(dates))
    if after.size and ahead[after[0]] == 0.0:
        return float(dates[after[0]])
    if after.size and before.size:
        one, two = before[-1], after[0]
        part = ahead[one] / (ahead[one] - ahead[two])
        return float(dates[one] + part * (dates[two] - dates[one]))
    if np.isfinite(dates).all():
        message = f"it is not known when '{name}' was excavated: no stage is before the face "
        message += "passed it"
        hint = "Add excavated: 2024-03-01, or a stage with the face before the section."
        around.faults.add((*_AT, "sections", name), "missing-dates", message, hint, key=True)
    return float("nan")


def _check_zero(
    section: str, channel: Channel, ahead: Mapping[str, float], around: ModelContext
) -> None:
    """A gauge says its first reading, at which the face has passed its section.

    Args:
        section: name of the section.
        channel: of the gauge.
        ahead: stage to how far the face is past the section then, m; NaN where that is not known.
        around: takes the fault.
    """
    path: KeyPath = ("gauges", channel.name)
    if not channel.is_zeroed:
        message = f"'{channel.name}' shows the convergence since its first reading, and the "
        message += "case does not say when that was"
        hint = f"Add 'zero: STAGE'; 'zero: {VIRGIN}' if all of the convergence is read."
        around.faults.add(path, "no-zero", message, hint, key=True)
    elif ahead.get(channel.zero, 0.0) < 0.0:
        message = f"the face has not reached section '{section}' at '{channel.zero}', the "
        message += f"first reading of '{channel.name}': its distance would be negative"
        hint = "Correct the chainage, the face or the zero."
        around.faults.add((*path, "zero"), "before-face", message, hint)


def _channels_by_section(law: ConvergenceLawSection, around: ModelContext) -> dict[str, list[int]]:
    """Numbers of the channels of each section."""
    names, faults = [channel.name for channel in around.channels], around.faults
    by_section: dict[str, list[int]] = {}
    where: dict[str, str] = {}
    for name, section in law.sections.items():
        path: KeyPath = (*_AT, "sections", name)
        gauges = section.gauges
        if gauges is None:
            gauges = names if len(law.sections) == 1 else []
            if len(law.sections) > 1:
                message = f"the gauges of '{name}' are not named, and there are several sections"
                faults.add(path, "no-gauges", message, "Add gauges: [..].", key=True)
        for n, gauge in enumerate(gauges):
            if gauge not in names:
                faults.add_unknown((*path, "gauges", n), "gauge", gauge, names)
            elif where.setdefault(gauge, name) != name:
                message = f"'{gauge}' is a gauge of section '{where[gauge]}' already"
                faults.add((*path, "gauges", n), "twice", message, "Remove one.")
            else:
                by_section.setdefault(name, []).append(names.index(gauge))
    if all(section.gauges is not None for section in law.sections.values()):
        for gauge in names:
            if gauge not in where:
                message = f"'{gauge}' belongs to no section of 'model.sections'"
                hint = "Add it to the 'gauges' of its section, or remove it."
                faults.add(("gauges", gauge), "no-section", message, hint, key=True)
    return by_section


def _direction(face: Floats, chainage: float) -> float:
    """Whether the tunnel is driven towards larger chainage (1) or smaller (-1).

    Of a face that stands still, away from the section.

    Args:
        face: (n_stages,) where it is, m.
        chainage: of the section, m.
    """
    known = face[np.isfinite(face)]
    if not known.size:
        return 1.0
    way = known[-1] - known[0] or known[-1] - chainage
    return -1.0 if way < 0.0 else 1.0
