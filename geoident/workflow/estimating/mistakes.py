"""Readings with a wrong sign, unit, decimal point or zero, by name and with the line to write.

A number in another unit or with another sign cannot be fitted; parameters, a model error or worse
accuracies would take it up without a word. `identify.assessment.mistakes` compares what each
reading, channel, instrument, kind and file would have to be with all that remains.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from math import isclose
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from geoident.errors import InputError, ModelError, TimeIsUp
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.mistakes import Mistake, Suspects, find_mistakes
from geoident.identify.problem.methods import descend
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.io.text.wording import listing
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, ReadingTable, named_channels
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions, MethodOptions
from geoident.model.parameter import Parameter
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.findings import Finding, FindingKind
from geoident.units import in_unit, shown_unit, size_in, units_of
from geoident.workflow.running.cached_response import substituting
from geoident.workflow.running.readings import errors_of_used

_MODEL = 0.1
"""Part of a reading by which any model is off, beside the accuracy of the gauge."""
_OF_CHANNEL = 0.2
"""The same of all readings of a channel alike."""
_SMALL = 0.05
"""Part of the usual reading of its kind by which a model is off where it says next to nothing."""
_STEPS = 15
"""Most steps of a search with readings that are changed."""
_CLOSE = 1e-4
"""Estimate of the relative error in energy up to which the reduced model answers that search."""
_SERIES = 3
"""Readings of a channel that can show a missed zero."""


@dataclass(frozen=True)
class MistakenReadings:
    """What is wrong with the readings of a fit.

    Args:
        findings: one for each mistake, what explains most first.
        explained: (k,) the readings that these explain, of all.
        poor: the estimate is far from what it would be without them.
    """

    findings: tuple[Finding, ...]
    explained: Bools
    poor: bool

    def __bool__(self) -> bool:
        return bool(self.findings)


def mistaken_readings(
    case: Case,
    readings: ReadingTable,
    problem: Problem,
    places: Sequence[Floats],
    model: ObservedModel,
    methods: Sequence[MethodOptions],
) -> MistakenReadings:
    """The mistakes in the readings of a case that the others show.

    Args:
        case: with the accuracies as it states them, and the places where readings are written.
        readings: all k of them.
        problem: those that are used, and the model.
        places: (n,) the estimate, SI; then others that were evaluated.
        model: is asked what gauges read at other stages, where a zero is wrong.
        methods: of the fit.
    """
    last = methods[-1]
    steps = (
        last
        if isinstance(last, ComplementarityOptions)
        else GaussNewtonOptions(tolerance=1e-5, max_iterations=_STEPS, starts=1)
    )

    def refit(changed: Problem) -> Floats | None:
        try:
            return descend(changed, steps, lambda _: None).values
        except (ModelError, InputError):
            return None

    mistakes: tuple[Mistake, ...] = ()
    with suppress(TimeIsUp, ModelError), substituting(problem.response, _CLOSE):
        mistakes = find_mistakes(
            replace(problem, parameters=case.parameters),
            partial(_errors, case, readings),
            places,
            suspects(case, readings),
            refit,
        )
    rows = np.flatnonzero(readings.used)
    explained = np.zeros(len(readings), dtype=np.bool_)
    for mistake in mistakes:
        for one in (mistake, *mistake.rivals):
            explained[rows[one.suspects.rows]] = True
    words = _Words(case, readings, rows, problem.parameters, model)
    return MistakenReadings(
        tuple(words.finding(mistake) for mistake in mistakes),
        explained,
        any(np.abs(mistake.shift).max(initial=0.0) > NORMAL_95 for mistake in mistakes),
    )


def _errors(
    case: Case, readings: ReadingTable, measured: Floats, computed: Floats
) -> tuple[Floats, SharedErrors]:
    """The errors of the used readings as stated, with what any model is off by.

    Estimated accuracies and model errors have grown with the mistake that is looked for.
    """
    both = np.minimum(np.abs(measured), np.abs(computed))
    usual = np.zeros_like(both)
    for rows in _groups(_kinds(case, readings)).values():
        usual[rows] = float(np.median(both[rows]))
    sd, shared = errors_of_used(case, readings.used).stated
    sd = np.hypot(sd, np.maximum(_MODEL * both, _SMALL * usual))
    channels = _groups([readings.channel[k] for k in np.flatnonzero(readings.used)])
    column = np.zeros(len(both), dtype=np.int64)
    for n, rows in enumerate(channels.values()):
        column[rows] = n
    size = _OF_CHANNEL * np.copysign(both, computed)
    model = sp.csr_array((size, (np.arange(len(both)), column)), (len(both), len(channels)))
    columns = model if shared is None else sp.csr_array(sp.hstack([shared.columns, model]))
    return sd, SharedErrors(columns)


# What may be wrong together ---------------------------------------------------------------------


def suspects(case: Case, readings: ReadingTable) -> tuple[Suspects, ...]:
    """The used readings that one mistake may have changed together.

    Each by itself, those of a channel, a gauge, a kind of gauges and a file, and of a gauge or kind
    those of one stage. Equal sets count once, as the smallest of these.

    Args:
        case: of the readings.
        readings: all of them.
    """
    rows = np.flatnonzero(readings.used)
    channel = [readings.channel[k] for k in rows]
    gauge = [readings.gauge[k] for k in rows]
    stage = [readings.stage[k] for k in rows]
    kind = _kinds(case, readings)
    file = [case.readings[k].location.file if not case.readings[k].key else "" for k in rows]
    number = {name: n for n, name in enumerate(dict.fromkeys(channel))}
    of_channel = np.array([number[name] for name in channel], dtype=np.int64)
    series = np.bincount(of_channel, minlength=len(number)) >= _SERIES
    zeroed = np.array([series[n] for n in of_channel], dtype=np.bool_) & np.array(
        [one.is_zeroed for one in _channels_of(case, channel)], dtype=np.bool_
    )
    levels: list[tuple[str, Sequence[str]]] = [
        ("reading", [str(n) for n in range(len(rows))]),
        ("channel", channel),
        ("gauge", gauge),
        ("stage of a gauge", [f"{a}\n{b}" for a, b in zip(gauge, stage, strict=True)]),
        ("kind", kind),
        ("stage of a kind", [f"{a}\n{b}" for a, b in zip(kind, stage, strict=True)]),
        ("file", file),
    ]
    distinct: dict[bytes, Suspects] = {}
    for level, owners in levels:
        for name, members in _groups(owners).items():
            if name:
                whole = level in ("channel", "gauge", "kind") and bool(zeroed[members].all())
                free = whole or level == "reading"
                channels = of_channel[members] if free else of_channel[:0]
                distinct.setdefault(members.tobytes(), Suspects(members, level, name, channels))
    return tuple(distinct.values())


def _channels_of(case: Case, names: Sequence[str]) -> list[Channel]:
    of = {channel.name: channel for channel in case.channels}
    return [of[name] for name in names]


def _kinds(case: Case, readings: ReadingTable) -> list[str]:
    """Kind of the gauge of each used reading, with the dimension of what it reads."""
    used = [readings.channel[k] for k in np.flatnonzero(readings.used)]
    return [f"{one.kind}\n{one.dimension}" for one in _channels_of(case, used)]


def _groups(owners: Sequence[str]) -> dict[str, Ints]:
    """Owner to the numbers of what it owns."""
    members: dict[str, list[int]] = {}
    for n, owner in enumerate(owners):
        members.setdefault(owner, []).append(n)
    return {owner: np.array(each, dtype=np.int64) for owner, each in members.items()}


# Words ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Words:
    """Says what is wrong with readings.

    Args:
        case: with the places where they are written.
        readings: all of them.
        rows: (g,) those that are used.
        parameters: the unknowns.
        model: what gauges read.
    """

    case: Case
    readings: ReadingTable
    rows: Ints
    parameters: tuple[Parameter, ...]
    model: ObservedModel

    def finding(self, mistake: Mistake) -> Finding:
        """The finding of a mistake, with those that explain the readings as well."""
        others = "".join(
            f" Or {self._what(one)[0].lower()}{self._what(one)[1:]}: the other readings do not "
            "tell which."
            for one in mistake.rivals
        )
        sentence = (
            f"{self._what(mistake)}.{others} All residuals then are {mistake.after:.2g} instead of "
            f"{mistake.before:.2g} standard deviations (root of the mean square)"
            f"{self._moved(mistake)}. {self._remedy(mistake)}"
        )
        subjects = chain.from_iterable(
            self._subject(one.suspects) for one in (mistake, *mistake.rivals)
        )
        numbers = {"before": mistake.before, "after": mistake.after}
        for n, one in enumerate(mistake.rivals, 2):
            numbers[f"factor_{n}"] = one.factor
        if mistake.is_zero or self._at_zero(mistake):
            read = self.readings.value[self._members(mistake.suspects)]
            offset = float(np.median(mistake.offset if mistake.is_zero else read))
            return Finding("zero", listed(subjects), sentence, {**numbers, "offset": offset})
        numbers["factor"] = mistake.factor
        kind: FindingKind = "opposite-sign" if mistake.factor == -1.0 else "unit"
        return Finding(kind, listed(subjects), sentence, numbers)

    def _members(self, suspects: Suspects) -> list[int]:
        """Rows of the table of all readings."""
        return [int(k) for k in self.rows[suspects.rows]]

    def _at_zero(self, mistake: Mistake) -> bool:
        """The readings are those of their gauges' own zeros, where any number but 0 is wrong."""
        rows = self._members(mistake.suspects)
        channels = _channels_of(self.case, [self.readings.channel[k] for k in rows])
        return all(
            one.is_zeroed and one.zero == self.readings.stage[k]
            for one, k in zip(channels, rows, strict=True)
        )

    def _subject(self, suspects: Suspects) -> list[str]:
        rows = self._members(suspects)
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
        dimension = _channels_of(self.case, [self.readings.channel[rows[0]]])[0].dimension
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
        k = int(np.argmax(shift))
        parameter = self.parameters[k]
        unit = parameter.unit, parameter.dimension
        value = f"{in_unit(float(mistake.values[k]), *unit):.3g} {shown_unit(*unit)}".rstrip()
        return f", and {parameter.name} is {value}"

    def _remedy(self, mistake: Mistake) -> str:
        """The line to write."""
        one, factor = mistake.suspects, mistake.factor
        rows = self._members(one)
        first = self.case.readings[rows[0]]
        channels = list(dict.fromkeys(self.readings.channel[k] for k in rows))
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
            return f"Correct it {where}, or give the reason in the column 'bad'."
        key = "sign: -1"
        if factor != -1.0:
            meant = self._meant(rows, factor)
            if not meant:
                check = "Check the unit and the decimal point of these readings, and correct them."
                if len(rows) < np.count_nonzero(self.readings.used):
                    return check
                return (
                    f"{check} A stress, density, load or date of the case that is wrong has the "
                    "same effect: check these, too."
                )
            key = f"unit: {meant}"
        file = Path(first.location.file).name
        each = ", ".join(f"{name}: {{{key}}}" for name in channels[:_LISTED])
        more = ", ..." if len(channels) > _LISTED else ""
        line = f"readings: {{file: {file}, channels: {{{each}{more}}}}}"
        if factor == -1.0:
            return (
                f"Write {line}, as where a file counts the other way round: distances are positive "
                "where they grow, settlements downwards (page 'Conventions')."
            )
        return f"Write {line}, or correct the units in the file."

    def _remedy_of_zero(self, mistake: Mistake, channels: Sequence[str]) -> str:
        lines = []
        offsets = dict(
            zip((self.readings.channel[k] for k in self._members(mistake.suspects)),
                mistake.offset.tolist(), strict=True)
        )  # fmt: skip
        other = self._zeroed_elsewhere(mistake, offsets)
        gauges = list(dict.fromkeys(one.gauge for one in _channels_of(self.case, channels)))
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
        channel = _channels_of(self.case, [self.readings.channel[row]])[0]
        unit = channel.unit, channel.dimension
        return f"{in_unit(value, *unit):.4g} {shown_unit(*unit)}".rstrip()


_LISTED = 4
"""Channels that are listed in a line to write."""


def listed(names: Iterable[str]) -> str:
    """Names joined, each once."""
    return ", ".join(dict.fromkeys(names))
