"""From the key ``model`` with a convergence law to the law: distances, ages, constants by gauge."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from geoident.io.case.external.section import (
    Constant,
    ConvergenceLawSection,
    TunnelSectionSection,
)
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.schema.values import CaseNumber
from geoident.io.text.dates import read_date
from geoident.model.arrays import Bools, Floats
from geoident.model.case import VIRGIN, KeyPath
from geoident.model.external import ConvergenceLaw, Creep
from geoident.model.gauges import Channel
from geoident.model.parameter import Scalar
from geoident.units import in_unit, shown_unit, with_article

_AT: KeyPath = ("model",)


def build_law(section: ConvergenceLawSection, around: ModelContext) -> ConvergenceLaw:
    """The law of a case; what is wrong is noted.

    Args:
        section: the key ``model``.
        around: what it refers to.
    """
    build = _Build(section, around)
    limit = build.constant("C_inf", section.C_inf)
    reach = build.constant("X", section.X, least="above")
    creep = None
    if section.m is not None and section.T is not None and section.n is not None:
        creep = Creep(
            build.constant("m", section.m, least="at"),
            build.constant("T", section.T, least="above"),
            build.constant("n", section.n, least="above"),
        )
    build.check_limits(limit)
    distance, age = build.places(in_time=creep is not None)
    return ConvergenceLaw(limit, reach, creep, distance, age)


class _Build:
    """The parts of a law, as far as the case says them rightly.

    Args:
        section: the key ``model``.
        around: what it refers to.
    """

    def __init__(self, section: ConvergenceLawSection, around: ModelContext) -> None:
        self._section, self._around, self._faults = section, around, around.faults
        self._names = [channel.name for channel in around.channels]

    def constant(self, key: str, given: Constant, *, least: str = "") -> tuple[Scalar, ...]:
        """One number for each channel.

        Args:
            key: of the constant.
            given: what is written there.
            least: ``above`` where it must be positive, ``at`` where it may be 0.
        """
        path: KeyPath = (*_AT, key)
        if isinstance(given, CaseNumber):
            self._require(path, given, least)
            return (given.scalar,) * len(self._names)
        for name in given:
            if name not in self._names:
                self._faults.add_unknown((*path, name), "gauge", name, self._names, key=True)
            self._require((*path, name), given[name], least)
        missing = [name for name in self._names if name not in given]
        if missing:
            message = f"no {key} for {', '.join(map(repr, missing))}"
            hint = "Add it, or write one number for all gauges."
            self._faults.add(path, "missing-gauge", message, hint, key=True)
        return tuple(given[name].scalar if name in given else Scalar(1.0) for name in self._names)

    def _require(self, path: KeyPath, given: CaseNumber, least: str) -> None:
        """A constant is positive at all values that its parameter may have."""
        if not least:
            return
        words = "positive" if least == "above" else "0 or more"

        def wrong(value: float) -> bool:
            return value <= 0.0 if least == "above" else value < 0.0

        parameter = self._around.parameters.get(given.parameter or "")
        if wrong(given.factor):
            message = f"'{given.text}': {path[1]} must be {words}"
            self._faults.add(path, "out-of-range", message, "Correct the number.")
        elif parameter is not None and wrong(parameter.lower):
            unit = parameter.unit, parameter.dimension
            bound = f"{in_unit(parameter.lower, *unit):.6g} {shown_unit(*unit)}".rstrip()
            message = f"the bound {bound} lets {path[1]} of the convergence law be "
            message += "0 or negative" if least == "above" else "negative"
            hint = f"Raise it: {path[1]} must be {words}."
            place: KeyPath = ("parameters", parameter.name, "bounds", 0)
            self._faults.add(place, "out-of-range", message, hint)

    def check_limits(self, limit: tuple[Scalar, ...]) -> None:
        """C_inf is of what the gauge reads."""
        given = self._section.C_inf
        for channel, number in zip(self._around.channels, limit, strict=True):
            path: KeyPath = (*_AT, "C_inf")
            own: CaseNumber | None = (
                given if isinstance(given, CaseNumber) else given.get(channel.name)
            )
            if own is None:
                continue
            path = path if isinstance(given, CaseNumber) else (*path, channel.name)
            dimension = own.dimension
            if number.parameter is not None:
                parameter = self._around.parameters.get(number.parameter)
                dimension = channel.dimension if parameter is None else parameter.dimension
            if dimension != channel.dimension:
                message = f"'{own.text}' is {with_article(dimension)}; '{channel.name}' reads "
                message += with_article(channel.dimension)
                hint = "Correct its unit, or the accuracy of the gauge, which says what is read."
                self._faults.add(path, "unit", message, hint)

    def places(self, *, in_time: bool) -> tuple[Floats, Floats]:
        """Distances to the face and ages (n_stages, n_channels); NaN before the face passed.

        Args:
            in_time: whether ages count.
        """
        face = self._face()
        dates = self._dates() if in_time else np.full(len(face), np.nan)
        shape = len(face), len(self._names)
        distance, age = np.full(shape, np.nan), np.full(shape, np.nan)
        for name, own in self._channels_by_section().items():
            section = self._section.sections[name]
            ahead = _direction(face, section.chainage.factor) * (face - section.chainage.factor)
            passed = ahead >= 0.0
            begun = self._excavated(name, section, ahead, dates) if in_time else np.nan
            for j in own:
                distance[passed, j] = ahead[passed]
                if in_time:
                    age[passed, j] = dates[passed] - begun
                self._check_zero(name, self._around.channels[j], passed)
            early = passed & (dates < begun)
            if in_time and early.any():
                stage = self._around.stages[int(np.argmax(early))]
                message = f"'{name}' is excavated after '{stage}', when the face is past it"
                hint = "Correct this date, the date of the stage, or the face."
                path: KeyPath = (*_AT, "sections", name, "excavated")
                self._faults.add(path, "dates-order", message, hint)
        return distance, age

    def _face(self) -> Floats:
        """(n_stages,) where the face is."""
        given, stages = self._section.face, self._around.stages
        for name in given:
            if name not in stages:
                self._faults.add_unknown((*_AT, "face", name), "stage", name, stages, key=True)
        missing = [stage for stage in stages if stage not in given]
        if missing:
            message = f"no place of the face at {', '.join(map(repr, missing))}"
            hint = "Add its chainage there; where the face has stopped, the same as before."
            self._faults.add((*_AT, "face"), "missing-stage", message, hint, key=True)
        chainages = np.array([given[s].factor if s in given else np.nan for s in stages])
        known: list[int] = np.flatnonzero(np.isfinite(chainages)).tolist()
        way = np.sign(chainages[known[-1]] - chainages[known[0]]) if known else 0.0
        for one, other in pairwise(known):
            if (chainages[other] - chainages[one]) * (way or 1.0) < 0.0:
                message = f"the face at '{stages[other]}' ({given[stages[other]].text}) is behind "
                message += f"that at '{stages[one]}' ({given[stages[one]].text})"
                path: KeyPath = (*_AT, "face", stages[other])
                hint = "A face advances or stops: correct one of them."
                self._faults.add(path, "face-order", message, hint)
        return chainages

    def _dates(self) -> Floats:
        """(n_stages,) when each was complete, s."""
        around = self._around
        missing = [stage for stage in around.stages if stage not in around.dates]
        if missing:
            message = f"the convergence law grows in time, and {', '.join(map(repr, missing))} "
            message += "has no date" if len(missing) == 1 else "have no date"
            hint = f"Add dates: {{{missing[0]}: 2024-03-01, ...}}, or remove m, T and n."
            self._faults.add(("dates",), "missing-dates", message, hint, key=True)
        return np.array([around.dates.get(stage, np.nan) for stage in around.stages])

    def _excavated(
        self, name: str, section: TunnelSectionSection, ahead: Floats, dates: Floats
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
            path: KeyPath = (*_AT, "sections", name)
            self._faults.add(path, "missing-dates", message, hint, key=True)
        return float("nan")

    def _check_zero(self, name: str, channel: Channel, passed: Bools) -> None:
        """A gauge says its first reading, at which the face has passed its section."""
        path: KeyPath = ("gauges", channel.name)
        if not channel.is_zeroed:
            message = f"'{channel.name}' shows the convergence since its first reading, and the "
            message += "case does not say when that was"
            hint = f"Add 'zero: STAGE'; 'zero: {VIRGIN}' if all of the convergence is read."
            self._faults.add(path, "no-zero", message, hint, key=True)
        elif channel.zero in self._around.stages:
            stage = list(self._around.stages).index(channel.zero)
            if channel.zero in self._section.face and not passed[stage]:
                message = f"the face has not reached section '{name}' at '{channel.zero}', the "
                message += f"first reading of '{channel.name}': its distance would be negative"
                hint = "Correct the chainage, the face or the zero."
                self._faults.add((*path, "zero"), "before-face", message, hint)

    def _channels_by_section(self) -> Mapping[str, list[int]]:
        """Numbers of the channels of each section."""
        by_section: dict[str, list[int]] = {}
        where: dict[str, str] = {}
        sections = self._section.sections
        for name, section in sections.items():
            path: KeyPath = (*_AT, "sections", name)
            if section.gauges is None and len(sections) > 1:
                message = f"the gauges of '{name}' are not named, and there are several sections"
                self._faults.add(path, "no-gauges", message, "Add gauges: [..].", key=True)
            gauges = self._names if section.gauges is None else section.gauges
            for n, gauge in enumerate(gauges if section.gauges or len(sections) == 1 else ()):
                if gauge not in self._names:
                    place: KeyPath = (*path, "gauges", n)
                    self._faults.add_unknown(place, "gauge", gauge, self._names)
                elif where.setdefault(gauge, name) != name:
                    message = f"'{gauge}' is a gauge of section '{where[gauge]}' already"
                    self._faults.add((*path, "gauges", n), "twice", message, "Remove one.")
                else:
                    by_section.setdefault(name, []).append(self._names.index(gauge))
        if all(section.gauges is not None for section in sections.values()):
            for gauge in self._names:
                if gauge not in where:
                    message = f"'{gauge}' belongs to no section of 'model.sections'"
                    hint = "Add it to the 'gauges' of its section, or remove it."
                    self._faults.add(("gauges", gauge), "no-section", message, hint, key=True)
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
