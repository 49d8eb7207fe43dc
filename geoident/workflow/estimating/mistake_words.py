"""Says which mistake in readings or in a case is likely, and the line to write."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from math import isclose
from pathlib import Path

import numpy as np

from geoident.errors import ModelError
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.mistakes import PARAMETER, Mistake, Suspects
from geoident.io.text.wording import listing
from geoident.model.arrays import Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable, named_channels
from geoident.model.parameter import Scalar
from geoident.model.results.findings import Finding, FindingKind
from geoident.units import in_unit, shown_unit, size_in, units_of
from geoident.workflow.estimating.suspects import channels_of


@dataclass(frozen=True)
class MistakeWords:
    """Says what is wrong with readings.

    Args:
        case: with the places where they are written.
        readings: all of them.
        rows: (g,) those that are used.
        model: what gauges read.
    """

    case: Case
    readings: ReadingTable
    rows: Ints
    model: ObservedModel

    def finding(self, mistake: Mistake) -> Finding:
        """The finding of a mistake, with those that explain the readings as well."""
        others = "".join(
            f" Or {self._what(one)[0].lower()}{self._what(one)[1:]}: the other readings do not "
            "tell which."
            for one in mistake.rivals
        )
        remedies = [self._remedy(mistake)]
        if any(one.suspects.level == PARAMETER for one in (mistake, *mistake.rivals)):
            remedies += [self._remedy(one) for one in mistake.rivals]
            if not any(one.of_all for one in (mistake, *mistake.rivals)):
                check = listing(loading(self.case))
                remedies.append(f"What loads the ground has a like effect: check {check}.")
        sentence = f"{self._what(mistake)}.{others} {self._why(mistake)}. {' '.join(remedies)}"
        subjects = chain.from_iterable(
            self._subject(one.suspects) for one in (mistake, *mistake.rivals)
        )
        numbers = {"before": mistake.before, "after": mistake.after}
        for n, one in enumerate(mistake.rivals, 2):
            numbers[f"factor_{n}"] = one.factor
        if mistake.is_exchange:
            return Finding("exchanged", listed(subjects), sentence, numbers)
        if mistake.is_zero or self._at_zero(mistake):
            read = self.readings.value[self._members(mistake.suspects)]
            offset = float(np.median(mistake.offset if mistake.is_zero else read))
            return Finding("zero", listed(subjects), sentence, {**numbers, "offset": offset})
        numbers["factor"] = mistake.factor
        kind: FindingKind = "opposite-sign" if mistake.factor == -1.0 else "unit"
        return Finding(kind, listed(subjects), sentence, numbers)

    def _why(self, mistake: Mistake) -> str:
        """What speaks for it, a sentence without a full stop."""
        if len(mistake.released):
            names = [self.case.parameters[k].name for k in mistake.released.tolist()]
            leave = "leave their bounds" if len(names) > 1 else "leaves its bound"
            values = [self._estimate(mistake, k) for k in mistake.released.tolist()]
            return f"With that {listing(names)} {leave} ({', '.join(values)})"
        return (
            f"All residuals then are {mistake.after:.2g} instead of {mistake.before:.2g} standard "
            f"deviations (root of the mean square){self._moved(mistake)}"
        )

    def _estimate(self, mistake: Mistake, k: int) -> str:
        parameter = self.case.parameters[k]
        unit = parameter.unit, parameter.dimension
        value = in_unit(float(mistake.values[k]), *unit)
        return f"{parameter.name} is {value:.3g} {shown_unit(*unit)}".rstrip()

    def _members(self, suspects: Suspects) -> list[int]:
        """Rows of the table of all readings."""
        return [int(k) for k in self.rows[suspects.rows]]

    def _at_zero(self, mistake: Mistake) -> bool:
        """The readings are those of their gauges' own zeros, where any number but 0 is wrong."""
        rows = self._members(mistake.suspects)
        channels = channels_of(self.case, [self.readings.channel[k] for k in rows])
        return len(rows) > 0 and all(
            one.is_zeroed and one.zero == self.readings.stage[k]
            for one, k in zip(channels, rows, strict=True)
        )

    def _subject(self, suspects: Suspects) -> list[str]:
        rows = self._members(suspects)
        if suspects.level == PARAMETER:
            return [suspects.name]
        if suspects.level in ("channels", "one row"):
            return list(dict.fromkeys(self.readings.channel[k] for k in rows))
        if suspects.level == "reading":
            return [self.readings.channel[rows[0]], self.readings.stage[rows[0]]]
        if suspects.level == "channel":
            return [suspects.name]
        return list(dict.fromkeys(self.readings.gauge[k] for k in rows))

    def _who(self, suspects: Suspects) -> str:
        rows = self._members(suspects)
        first = rows[0]
        stage = self.readings.stage[first]
        match suspects.level:
            case "reading":
                place = str(self.case.readings[first].location)
                at = f"{place}: " if place else ""
                return (
                    f"The reading {self.readings.channel[first]} at {stage} "
                    f"({at}{self._shown(first, float(self.readings.value[first]))})"
                )
            case "file":
                return f"All readings of the file '{Path(suspects.name).name}'"
            case "stage of a gauge":
                return f"The readings of {suspects.name.partition(chr(10))[0]} at {stage}"
            case "kind" | "stage of a kind":
                names = named_channels([self.readings.gauge[k] for k in rows])
                kind = suspects.name.partition("\n")[0]
                at = f" at {stage}" if suspects.level == "stage of a kind" else ""
                return f"The readings of the gauges of the kind {kind} ({names}){at}"
            case _:
                return f"The readings of {suspects.name}"

    def _what(self, mistake: Mistake) -> str:
        """What is wrong, a sentence without a full stop."""
        one, factor = mistake.suspects, mistake.factor
        if one.level == PARAMETER:
            return self._what_of_parameter(mistake)
        if mistake.is_exchange:
            return self._what_of_exchange(one)
        if mistake.of_all and self.case.elsewhere is None:
            return self._what_of_all(mistake)
        rows = self._members(one)
        alone = one.level == "reading"
        if self._at_zero(mistake):
            are = "is that" if alone else "are those"
            return f"{self._who(one)} {are} of the gauge's own zero, from which it counts"
        verb = "has" if alone else "have"
        would = ""
        if alone:
            value = float(self.readings.value[rows[0]]) * factor
            would = f": {self._shown(rows[0], value)} fits the others"
        if factor == -1.0:
            return f"{self._who(one)} {verb} the wrong sign{would}"
        if mistake.is_zero:
            size = self._shown(rows[0], float(np.abs(np.median(mistake.offset))))
            more = "large" if float(np.median(mistake.offset)) > 0.0 else "small"
            return f"{self._who(one)} lack their zero: all of a channel are {size} too {more}"
        times = factor if factor > 1.0 else 1.0 / factor
        is_, size = ("is" if alone else "are"), "small" if factor > 1.0 else "large"
        mistaken = f" ({cause})" if (cause := self._cause(rows, factor)) and not would else ""
        point = " (a decimal point or a unit)" if alone else ""
        return f"{self._who(one)} {is_} {times:.4g} times too {size}{mistaken}{point}{would}"

    def _what_of_exchange(self, one: Suspects) -> str:
        rows = self._members(one)
        match one.level:
            case "order":
                first = self.readings.channel[rows[0]]
                last = self.readings.channel[int(self.rows[one.source[0]])]
                return (
                    f"The readings of {one.name} are in reverse order: what {first} reads belongs "
                    f"to {last}"
                )
            case "one row":
                at = self.readings.stage[rows[0]]
                return f"The readings of {one.name} at {at} ({self._place(rows)}) are exchanged"
            case _:
                return f"The readings of {one.name} are exchanged"

    def _place(self, rows: Sequence[int]) -> str:
        places = (str(self.case.readings[k].location) for k in rows)
        return ", ".join(place for place in places if place)

    def _what_of_all(self, mistake: Mistake) -> str:
        """A factor of all readings, which may as well be one of what loads the ground."""
        factor = mistake.factor
        if factor == -1.0:
            return (
                f"{self._who(mistake.suspects)} have the wrong sign, or what loads the ground has "
                "it: both move elastic ground alike"
            )
        times = f"{factor if factor > 1.0 else 1.0 / factor:.4g} times too"
        cause = self._cause(self._members(mistake.suspects), factor)
        read, loads = ("small", "large") if factor > 1.0 else ("large", "small")
        who = self._who(mistake.suspects)
        if mistake.of_loads:
            return (
                f"What loads the ground in the case is {times} {loads}, or {who[0].lower()}"
                f"{who[1:]} are {times} {read}{f' ({cause})' if cause else ''}: both move elastic "
                "ground alike, but the readings scatter as their accuracies say"
            )
        return (
            f"{who} are {times} {read}{f' ({cause})' if cause else ''}, or what loads the ground "
            f"in the case is {times} {loads}: both move elastic ground alike"
        )

    def _what_of_parameter(self, mistake: Mistake) -> str:
        k = [one.name for one in self.case.parameters].index(mistake.suspects.name)
        q, factor = self.case.parameters[k], mistake.factor
        times = f"{factor if factor > 1.0 else 1.0 / factor:.4g} times too"
        size = "small" if factor > 1.0 else "large"
        numbers = ["prior"] if q.prior else []
        if not q.lower < mistake.values[k] < q.upper or not numbers:
            numbers = ["start and bounds" if not numbers else "start, bounds", *numbers]
        are = "is" if numbers == ["prior"] else "are"
        return (
            f"The {' and '.join(numbers)} of {q.name} in the case {are} {times} {size}: "
            f"{self._estimate(mistake, k).removeprefix(q.name + ' is ')} fits the readings"
        )

    def _remedy_of_parameter(self, mistake: Mistake) -> str:
        k = [one.name for one in self.case.parameters].index(mistake.suspects.name)
        q, factor = self.case.parameters[k], mistake.factor

        def shown(value: float) -> str:
            number = in_unit(factor * value, q.unit, q.dimension)
            return f"{number:.4g} {shown_unit(q.unit, q.dimension)}".rstrip()

        lines = []
        if q.prior is not None:
            lines.append(f"prior: {{mean: {shown(q.prior.mean)}, sd: {shown(q.prior.sd)}}}")
        if not q.lower < mistake.values[k] < q.upper or not lines:
            bounds = f"bounds: [{shown(q.lower)}, {shown(q.upper)}]"
            lines = [f"start: {shown(q.start)}", bounds, *lines]
        return f"If so, write '{', '.join(lines)}' at the parameter {q.name}."

    def _cause(self, rows: Sequence[int], factor: float) -> str:
        """Which unit was read as which; empty where that is not known."""
        units = {self.case.readings[k].unit for k in rows}
        meant = self._meant(rows, factor)
        if len(units) != 1 or not meant:
            return ""
        return f"{meant} read as {units.pop()}"

    def _meant(self, rows: Sequence[int], factor: float) -> str:
        """The unit in which readings are right; empty where none is known."""
        units = {self.case.readings[k].unit for k in rows}
        if len(units) != 1:
            return ""
        dimension = channels_of(self.case, [self.readings.channel[rows[0]]])[0].dimension
        size = size_in(units.pop(), dimension)
        if size is None:
            return ""
        return next(
            (
                unit
                for unit in units_of(dimension)
                if isclose(size_in(unit, dimension) or 0.0, factor * size, rel_tol=1e-6)
            ),
            "",
        )

    def _moved(self, mistake: Mistake) -> str:
        """By what the parameter that changes most becomes another."""
        shift = np.abs(mistake.shift)
        if not shift.size or shift.max() < 1.0:
            return ""
        return f", and {self._estimate(mistake, int(np.argmax(shift)))}"

    def _remedy(self, mistake: Mistake) -> str:
        """The line to write."""
        one, factor = mistake.suspects, mistake.factor
        if one.level == PARAMETER:
            return self._remedy_of_parameter(mistake)
        rows = self._members(one)
        first = self.case.readings[rows[0]]
        channels = list(dict.fromkeys(self.readings.channel[k] for k in rows))
        if mistake.is_exchange:
            where = self._place(rows[:1])
            return (
                f"Exchange them where they are written{f' ({where})' if where else ''}, or the "
                "points and directions of these gauges in the case, if it is these."
            )
        if mistake.is_zero:
            return self._remedy_of_zero(mistake, channels)
        if self._at_zero(mistake):
            gauge = listed(dict.fromkeys(self.readings.gauge[k] for k in rows))
            return (
                f"If it has counted from an earlier stage, write that stage as 'zero' of {gauge}; "
                "else leave the reading out (column 'bad')."
            )
        if one.level in ("reading", "stage of a gauge", "stage of a kind") or first.key:
            where = f"at {first.location}" if str(first.location) else "there"
            if len(rows) > 1:
                where = f"from {where.removeprefix('at ')} on"
            of_channel = np.array([name in channels for name in self.readings.channel])
            few = np.count_nonzero(of_channel & self.readings.used) <= _FEW
            also = self._points(one) if few else ""
            return f"Correct it {where}, or give the reason in the column 'bad'.{also}"
        key = "sign: -1"
        if factor != -1.0:
            meant = self._meant(rows, factor)
            if not meant:
                check = "Check the unit and the decimal point of these readings, and correct them."
                return self._with_others(check, mistake)
            key = f"unit: {meant}"
        file = Path(first.location.file).name
        each = ", ".join(f"{name}: {{{key}}}" for name in channels[:_LISTED])
        more = ", ..." if len(channels) > _LISTED else ""
        line = f"readings: {{file: {file}, channels: {{{each}{more}}}}}"
        if factor != -1.0:
            write = f"Write {line}, or correct the units in the file."
            return self._with_others(write, mistake)
        write = (
            f"Write {line}, as where a file counts the other way round: distances are positive "
            "where they grow, settlements downwards (page 'Conventions')."
        )
        return self._with_others(write, mistake) if mistake.of_all else write

    def _with_others(self, remedy: str, mistake: Mistake) -> str:
        """What to write, and what else in the case makes readings too large or too small."""
        if not mistake.of_all:
            return f"{remedy}{self._points(mistake.suspects)}"
        if self.case.elsewhere is not None:
            return f"{remedy} A model that is wrong by this factor has the same effect."
        check = f"In the case check {listing(loading(self.case))}."
        return (
            f"{check} If it is the readings: {remedy}" if mistake.of_loads else f"{remedy} {check}"
        )

    def _points(self, one: Suspects) -> str:
        """What else makes readings of one channel or gauge too large, with a space before it."""
        if self.case.elsewhere is not None or one.level in ("kind", "file"):
            return ""
        names = self._subject(one)[:1] if one.level == "reading" else self._subject(one)
        return (
            f" A point in the wrong place has a like effect: check the coordinates of "
            f"{listing(names)} in the case, too."
        )

    def _remedy_of_zero(self, mistake: Mistake, channels: Sequence[str]) -> str:
        lines = []
        offsets = dict(
            zip((self.readings.channel[k] for k in self._members(mistake.suspects)),
                mistake.offset.tolist(), strict=True)
        )  # fmt: skip
        other = self._zeroed_elsewhere(mistake, offsets)
        gauges = list(dict.fromkeys(one.gauge for one in channels_of(self.case, channels)))
        if other:
            lines.append(
                f"That is what the model moves until '{other}': if they were zeroed then, write "
                f"'zero: {other}' at the gauge {listing(gauges)}."
            )
        row = {self.readings.channel[k]: k for k in self._members(mistake.suspects)}
        sizes = [f"{name} {self._shown(row[name], offsets[name])}" for name in channels[:_LISTED]]
        lines.append(
            f"If what was read at the zero was not subtracted, 'rezero: true' at the file does it; "
            f"else write 'offset' at the gauge ({', '.join(sizes)})."
            f"{self._points(mistake.suspects)}"
        )
        return " ".join(lines)

    def _zeroed_elsewhere(self, mistake: Mistake, offsets: dict[str, float]) -> str:
        """The stage at which channels were likely zeroed; empty where none fits."""
        try:
            computed = self.model.computed(mistake.values)
        except ModelError:
            return ""
        names = [channel.name for channel in self.case.channels]
        rows = [names.index(name) for name in offsets]
        size = np.array(list(offsets.values()))
        for j, stage in enumerate(self.case.stages):
            moved = -computed[rows, j]  # until a later zero all readings lack this
            if np.all(np.isfinite(moved)) and np.all(np.abs(moved - size) < 0.15 * np.abs(size)):
                return stage.name
        return ""

    def _shown(self, row: int, value: float) -> str:
        """A value of a reading in the unit of its channel."""
        channel = channels_of(self.case, [self.readings.channel[row]])[0]
        unit = channel.unit, channel.dimension
        return f"{in_unit(value, *unit):.4g} {shown_unit(*unit)}".rstrip()


_FEW = 2
"""Readings of a channel that a wrong place of its points moves alike."""

_LISTED = 4
"""Channels that are listed in a line to write."""


def listed(names: Iterable[str]) -> str:
    """Names joined, each once."""
    return ", ".join(dict.fromkeys(names))


def loading(case: Case) -> list[str]:
    """What loads the ground of a case, in its words.

    Args:
        case: its parameters count by name.
    """
    parts = []
    stresses = [one for one in (case.in_situ, *case.in_situ_of.values()) if one is not None]
    if stresses:
        sizes = [
            f"{entry} {_said(scalar, unit)}"
            for one in stresses
            for entry, unit in (("vertical", "MPa"), ("unit_weight", "kN/m3"))
            if isinstance(scalar := getattr(one, entry, None), Scalar)
        ]
        parts.append(f"in_situ{f' ({listing(dict.fromkeys(sizes))})' if sizes else ''}")
    if case.gravity is None:
        parts.append("gravity (there is none)")
    else:
        weights = {
            name: _said(material.density, "kg/m3")
            for name, material in case.materials.items()
            if material.density.parameter is not None or material.density.factor > 0.0
        }
        each = ", ".join(f"'{name}' {weight}" for name, weight in weights.items())
        parts.append(f"gravity and the densities ({each})" if each else "gravity")
    loads = dict.fromkeys([*case.loads, *chain.from_iterable(s.loads for s in case.stages)])
    if loads:
        parts.append(f"the loads {listing(loads)}")
    return [*parts, "what each stage excavates and builds, and its date"]


def _said(scalar: Scalar, unit: str) -> str:
    """A number of a case in a unit of stress, weight or density."""
    if scalar.parameter is not None:
        return f"${scalar.parameter}"
    size = {"MPa": 1e6, "kN/m3": 1e3, "kg/m3": 1.0}[unit]
    return f"{scalar.factor / size:.4g} {unit}"
