"""A structure in service: how large the effects on each gauge are, and its later readings."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby

import numpy as np

from geoident.io.text.dates import date_text
from geoident.model.in_service import DAY
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.columns import ROW, Record, column
from geoident.model.results.in_service import ChangeRow, ParameterChangeRow
from geoident.model.results.result import Result
from geoident.report.text.gauges import predicted_texts, reading_text
from geoident.report.text.layout import TextTable, decimals, moment_text, section, sentence
from geoident.report.text.rows import CsvTable, beside, objects, sheet
from geoident.units import in_unit, shown_unit, size_in

TITLE = "Effects on the gauges"

_EFFECTS = ("level", "season", "air", "temperature", "creep", "irreversible")

WHAT = (
    "Level, season, air, temperature: range of the readings that they cause, with its 95 % "
    "interval; creep, irreversible: motion from the first reading to the last. Scatter: standard "
    "deviation of a reading about what is explained; of it 'lasting' fades within the time shown. "
    "Drift: a slow motion that no effect explains, as far as the readings leave it possible; "
    "standard deviation of a year."
)

POWER_TITLE = "Changes that would be seen"

GREEN, AMBER, RED = "green", "amber", "red"


def later_title(result: Result) -> str:
    """What the table of judged readings shows."""
    return "New readings" if result.kind == "control" else "Readings after the fit"


def parts(result: Result) -> tuple[str, ...]:
    """The sections of a terminal."""
    return (
        section(TITLE, effects_table(result).text, sentence(WHAT)) if result.seasonal else "",
        section(later_title(result), judged_table(result).text),
        section(POWER_TITLE, power_table(result).text, sentence(power_note(result))),
        section("What to do next", *next_steps(result)),
    )


def outcome_sentences(result: Result) -> list[str]:
    """What was fitted to which readings, or what new readings say."""
    if result.kind == "control":
        return [f"{result.status.capitalize()}. {result.reason}"]
    readings, fit = result.gauges.readings, result.seasonal
    times = readings.time[readings.used]
    gauges = 0 if fit is None else int(np.isfinite(fit.white).sum())
    first, last = (_day(float(t)) for t in (times.min(), times.max()))
    return [
        f"Coefficients and noise of {gauges} {'gauge' if gauges == 1 else 'gauges'} follow from "
        f"{len(times)} readings, {first} to {last}, by {result.method}."
    ]


def effects_table(result: Result) -> TextTable:
    """A row for each gauge that was fitted: its effects, and what they leave."""
    fit, gauges = result.seasonal, result.gauges
    header = (
        "gauge", "readings", *_EFFECTS, "unit", "scatter", "lasting", "fades in",
        "drift a year", "explained",
    )  # fmt: skip
    rows = []
    for i in range(0 if fit is None else len(gauges.channels)):
        assert fit is not None
        if np.isnan(fit.white[i]):
            continue
        size = size_in(gauges.shown_units[i], gauges.dimensions[i]) or 1.0
        digits = max(0, 1 - int(np.floor(np.log10(fit.scatter[i] / size))))
        sizes = [(getattr(fit, name), getattr(fit, f"{name}_sd")) for name in _EFFECTS]
        effects = [
            "" if value is None else _with_interval(value[i], sd[i], size, digits)
            for value, sd in sizes
        ]
        lasts = bool(fit.lasting[i])
        rows.append(
            [
                gauges.channels[i], str(fit.number[i]), *effects, gauges.shown_units[i],
                decimals(fit.scatter[i] / size, digits),
                decimals(fit.lasting[i] / size, digits) if lasts else "",
                f"{fit.fades[i] / DAY:.0f} d" if lasts else "",
                decimals(fit.drift[i] / size, digits),
                f"{100.0 * fit.explained[i]:.0f} %",
            ]
        )  # fmt: skip
    return TextTable(header, rows, right="lrrrrrrrlrrrrr").filled


def _with_interval(value: float, sd: float, size: float, digits: int) -> str:
    """A number with half of its interval; nothing where there is none."""
    if np.isnan(value):
        return ""
    return f"{value / size:.{digits}f} ± {NORMAL_95 * sd / size:.{digits}f}"


def judged_table(result: Result) -> TextTable:
    """A row for each gauge with later readings: how they compare with what was expected."""
    header = ("gauge", "state", "readings", "inside 95 %", "mean (sd)", "rms (sd)", "largest (sd)")
    judged, channels = result.judged, np.array(result.gauges.readings.channel)
    rows, states = [], gauge_states(result)
    for name in result.gauges.channels if judged is not None else ():
        assert judged is not None
        e = judged.innovation[channels == name]
        e = e[np.isfinite(e)]
        if e.size:
            inside = int(np.count_nonzero(np.abs(e) <= NORMAL_95))
            numbers = (e.mean(), np.sqrt(np.mean(e**2)), e[np.argmax(np.abs(e))])
            rows.append(
                [name, states.get(name, ("", ""))[0], str(e.size),
                 f"{inside} ({100 * inside / e.size:.0f} %)"]
                + [f"{x:+z.1f}" if k != 1 else f"{x:.1f}" for k, x in enumerate(numbers)]
            )  # fmt: skip
    return TextTable(header, rows, right="llrrrrr").filled


def gauge_states(result: Result) -> Mapping[str, tuple[str, str]]:
    """Gauge with new readings to its state and to what led there; nothing but of a control.

    A gauge is red whose last readings show a change of several or of a parameter, or that has
    reached an alarm value, amber with a change of its own, or with a value named amber that it has
    reached, or another one that it will more probably reach within a year than not.
    """
    if result.kind != "control" or result.judged is None:
        return {}
    judged = np.isfinite(result.judged.innovation)
    named = {result.gauges.readings.channel[k] for k in np.flatnonzero(judged)}
    several = {rows[0].change for rows in changes(result) if len(rows) > 1}
    parameters = [rows[0] for rows in parameter_changes(result) if rows[0].lasts]
    states = {}
    for name in result.gauges.channels:
        if name not in named:
            continue
        own = [row for row in result.changes if row.gauge == name]
        alarms = [a for a in result.alarms if a.gauge == name and a.state]
        reached = [
            f"alarm value '{a.level}' reached" if a.reached else
            f"alarm value '{a.level}' is reached next year with {a.probability:.0%}"
            for a in alarms
        ]  # fmt: skip
        lasting = [row for row in own if row.lasts]
        wrong = sum(row.kind == "reading" for row in own)
        of_structure = [row for row in parameters if name in row.gauges.split(", ")]
        why = [
            *reached,
            *(f"{row.parameter} {row.text} since {_day(row.since)}" for row in of_structure),
            *(f"{row.kind}{' of several' * (row.change in several)} since {_day(row.since)}"
              for row in lasting),
            *([f"{wrong} wrong {'reading' if wrong == 1 else 'readings'}"] if wrong else []),
        ]  # fmt: skip
        own_states = {a.state for a in alarms} | {AMBER for _ in lasting}
        is_red = RED in own_states or any(row.change in several for row in lasting)
        is_red |= bool(of_structure)
        state = RED if is_red else AMBER if AMBER in own_states else GREEN
        states[name] = state, "; ".join(why)
    return states


def changes(result: Result) -> list[list[ChangeRow]]:
    """Steps and drifts, each with a row for every gauge that shows it."""
    rows = [row for row in result.changes if row.kind != "reading"]
    return [list(own) for _, own in groupby(rows, key=lambda row: row.change)]


def parameter_changes(result: Result) -> list[list[ParameterChangeRow]]:
    """Changes of parameters, each with a row for every parameter that it may be."""
    rows = result.parameter_changes
    return [list(own) for _, own in groupby(rows, key=lambda row: row.change)]


def parameter_changes_table(result: Result) -> TextTable:
    """A row for each parameter that has changed, or that may have as well."""
    header = (
        "no.", "parameter", "probability", "change", "before", "since then", "unit", "began on",
        "95 % interval", "seen since", "gauges", "now",
    )  # fmt: skip
    rows = []
    for row in result.parameter_changes:
        values = (in_unit(x, row.unit, row.dimension) for x in (row.before, row.after))
        rows.append(
            [str(row.change), row.parameter, f"{row.odds:.0%}", row.text,
             *(f"{x:.3g}" for x in values), shown_unit(row.unit, row.dimension), _day(row.since),
             f"{_day(row.earliest)} to {_day(row.latest)}", _day(row.shown), row.gauges,
             "still there" if row.lasts else "no longer"]
        )  # fmt: skip
    return TextTable(header, rows, right="rlrlrrlrrrll").filled


def changes_table(result: Result) -> TextTable:
    """A row for each gauge of each step and drift."""
    header = ("no.", "what", "gauge", "size", "began on", "95 % interval", "seen since", "now")
    rows = []
    for own in changes(result):
        for row in own:
            since = _day(row.earliest), _day(row.latest)
            rows.append(
                [str(row.change), f"{row.kind}{' of several' * (len(own) > 1)}", row.gauge,
                 row.text, _day(row.since),
                 f"{since[0]} to {since[1]}" if row.latest > row.earliest else "",
                 _day(row.shown), "still there" if row.lasts else "no longer"]
            )  # fmt: skip
    return TextTable(header, rows, right="rllrrrrl")


def power_table(result: Result) -> TextTable:
    """A row for each change that may happen: whether it would be seen, and how late."""
    header = ("change", "gauges", "probability", "half seen after", "90 % seen after")
    rows = []
    for row in result.power:
        percent = f"{100.0 * row.probability:.0f} %"
        delays = ["-" if np.isnan(t) else f"{t / DAY:.0f} d" for t in (row.median, row.late)]
        rows.append([row.change, row.gauges, percent, *delays])
    return TextTable(header, rows, right="llrrr")


def power_note(result: Result) -> str:
    """What the table holds for; empty without it."""
    if not result.power:
        return ""
    days = result.power[0].horizon / DAY
    return (
        f"Probability: of being seen within {days:.0f} days, if these gauges are read as often as "
        "in the last years, by simulation of their noise. After: from the beginning of the change."
    )


def wrong_table(result: Result) -> TextTable:
    """Single readings that are far off."""
    rows = [
        [row.gauge, date_text(row.since), row.text, f"{row.size / row.sd:+.1f}"]
        for row in result.changes
        if row.kind == "reading"
    ]
    return TextTable(("gauge", "read on", "off by", "in sd"), rows, right="lllr")


def latest_table(result: Result) -> TextTable:
    """A row for each gauge with later readings: its state, and the last of them."""
    header = (
        "gauge", "state", "why", "readings", "inside 95 %", "last on", "unit", "read", "expected",
        "95 % band", "off (sd)",
    )  # fmt: skip
    judged, gauges, rows = result.judged, result.gauges, []
    table = gauges.readings
    if judged is None:
        return TextTable(header, ())
    channels, states = np.array(table.channel), gauge_states(result)
    for i, name in enumerate(gauges.channels):
        own = np.flatnonzero((channels == name) & np.isfinite(judged.innovation))
        if not own.size:
            continue
        last = int(own[np.argmax(table.time[own])])
        half = NORMAL_95 * judged.predicted_sd[last]
        mean = float(judged.predicted[last])
        expected, low, high = predicted_texts(gauges, i, mean, mean - half, mean + half)
        inside = int(np.count_nonzero(np.abs(judged.innovation[own]) <= NORMAL_95))
        rows.append(
            [
                name, *states.get(name, ("", "")), str(own.size),
                f"{inside} ({100 * inside / own.size:.0f} %)", _day(float(table.time[last])),
                gauges.shown_units[i], reading_text(gauges, i, float(table.value[last])), expected,
                f"{low} to {high}", f"{judged.innovation[last]:+z.1f}",
            ]
        )  # fmt: skip
    order = {RED: 0, AMBER: 1, GREEN: 2, "": 3}
    rows.sort(key=lambda row: order[row[1]])
    return TextTable(header, rows, right="lllrrrlrrrr").filled


def next_steps(result: Result) -> list[str]:
    """What whoever watches the structure does next; nothing but after a control."""
    if result.kind != "control":
        return []
    reached = [f"'{a.level}' of {a.gauge}" for a in result.alarms if a.reached]
    several = [rows for rows in changes(result) if len(rows) > 1]
    single = [rows[0].gauge for rows in changes(result) if len(rows) == 1]
    wrong = list(dict.fromkeys(row.gauge for row in result.changes if row.kind == "reading"))
    steps = []
    if reached:
        steps.append(f"Do what the plan of alarms says for {', '.join(reached)}.")
    if near := [f"'{a.level}' of {a.gauge}" for a in result.alarms if a.state and not a.reached]:
        steps.append(
            f"The next year more probably reaches {', '.join(near)} than not: decide now what is "
            "to be done then, and whether the level can be kept lower."
        )
    parameters = [rows[0] for rows in parameter_changes(result)]
    if several or parameters:
        named = [row.gauge for rows in several for row in rows]
        named += [name for row in parameters for name in row.gauges.split(", ")]
        first = min([row.earliest for row in parameters] + [rows[0].earliest for rows in several])
        steps.append(
            f"Read {', '.join(dict.fromkeys(named))} again by hand, look at the structure there, "
            f"and at what acts on it since {_day(first)}: works, level, frost, seepage. Tell "
            "whoever is responsible for its safety."
        )
    if single:
        steps.append(
            f"Check the instruments {', '.join(dict.fromkeys(single))}: cable, head, zero, and "
            "who worked at them. A gauge that was set anew or replaced gets a new name from that "
            "date on, and readings between are marked as bad."
        )
    if wrong:
        steps.append(
            f"Repeat the wrong readings of {', '.join(wrong)} where that is possible, or mark "
            "them as bad."
        )
    if not steps and result.judged is not None and not np.isfinite(result.judged.predicted).any():
        return []
    if not steps:
        return ["Nothing. Go on reading, and control the next readings in the same way."]
    return [*steps, "Then control again. Where a change is explained and stays, fit anew with it."]


def states_sentence(result: Result) -> str:
    """How many gauges are in which state."""
    states = [state for state, _ in gauge_states(result).values()]
    counts = [f"{states.count(s)} {s}" for s in (RED, AMBER, GREEN) if s in states]
    return f"{len(states)} gauges with new readings: {', '.join(counts)}." if counts else ""


def seasonal_sheet(result: Result) -> CsvTable:
    """The effects on each gauge, its coefficients and its noise, in its unit."""
    fit = result.seasonal
    if fit is None:
        return CsvTable()
    last = [moment_text(float(time)) or "" for time in fit.last]
    names = tuple(zip(result.gauges.channels, result.gauges.shown_units, last, strict=True))
    return beside(
        CsvTable(("gauge", "unit", "last"), names),
        sheet(fit, "gauge", quantities=result.quantities, labels={"term": fit.terms}),
    )


def seasonal_object(result: Result) -> dict[str, object] | None:
    """The same for programs, SI."""
    fit = result.seasonal
    if fit is None:
        return None
    rows = objects(fit, "gauge", quantities=result.quantities)
    for row, last, b in zip(rows, fit.last, fit.coefficients.tolist(), strict=True):
        row["last"] = moment_text(float(last))
        row["coefficients"] = dict(zip(fit.terms, b, strict=True))
    return {
        "terms": fit.terms,
        "effects": fit.effects,
        "level_low": fit.level_low,
        "level_high": fit.level_high,
        "air_mean": fit.air_mean,
        "gauges": dict(zip(result.gauges.channels, rows, strict=True)),
    }


class JudgedReading(Record):
    """A reading that was held against what was expected; SI.

    Args:
        gauge: name of the channel.
        time: when it was taken (ISO 8601).
        value: what was read.
        predicted: what was expected.
        sd: standard deviation of a reading about that.
        lower95: lower end of the 95 % band.
        upper95: upper end.
        innovation: value less predicted, by sd.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    time: str | None = column()
    value: float = column(dimension=ROW)
    predicted: float = column(dimension=ROW)
    sd: float = column(dimension=ROW)
    lower95: float = column(dimension=ROW)
    upper95: float = column(dimension=ROW)
    innovation: float
    unit: str = column(dimension=ROW)
    dimension: str = column(hidden=("csv", "json"))


def judged_readings(result: Result) -> list[JudgedReading]:
    """Every reading that was judged, in the order of the files."""
    judged, gauges = result.judged, result.gauges
    if judged is None:
        return []
    table = gauges.readings
    units = dict(
        zip(gauges.channels, zip(gauges.units, gauges.dimensions, strict=True), strict=True)
    )
    readings = []
    for k in np.flatnonzero(np.isfinite(judged.innovation)).tolist():
        mean, sd = float(judged.predicted[k]), float(judged.predicted_sd[k])
        readings.append(
            JudgedReading(
                table.channel[k], moment_text(float(table.time[k])), float(table.value[k]), mean,
                sd, mean - NORMAL_95 * sd, mean + NORMAL_95 * sd, float(judged.innovation[k]),
                *units[table.channel[k]],
            )
        )  # fmt: skip
    return readings


def outside_table(result: Result) -> TextTable:
    """Later readings outside of their 95 % bands, in the order of time."""
    gauges = result.gauges
    outside = [one for one in judged_readings(result) if abs(one.innovation) > NORMAL_95]
    rows = []
    for one in sorted(outside, key=lambda one: one.time or ""):
        i = gauges.channels.index(one.gauge)
        expected, low, high = predicted_texts(gauges, i, one.predicted, one.lower95, one.upper95)
        rows.append(
            [one.gauge, (one.time or "").removesuffix("T00:00:00").replace("T", " "),
             gauges.shown_units[i], reading_text(gauges, i, one.value), expected,
             f"{low} to {high}", f"{one.innovation:+.1f}"]
        )  # fmt: skip
    header = ("gauge", "read on", "unit", "read", "expected", "95 % band", "off (sd)")
    return TextTable(header, rows, right="lllrrrr")


def _day(seconds: float) -> str:
    return date_text(seconds)[:10]
