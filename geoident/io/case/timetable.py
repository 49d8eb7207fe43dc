"""When the stages of a case begin and end, and its names of their moments.

A stage begins at the end of the stage on which it builds, and ends when it has lasted. Dates and
durations say the same: what one of them lacks follows from the other, and where both are given they
agree.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from geoident.io.case.case import CaseSection
from geoident.io.case.durations import SAME, Timetable, is_date
from geoident.io.case.stages import StageSection
from geoident.io.schema.values import CaseNumber
from geoident.io.text.dates import date_text, read_date
from geoident.io.text.faults import Faults
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.case import VIRGIN, Case, KeyPath
from geoident.model.moments import time_text, with_moments


def timetable_of(section: CaseSection, faults: Faults) -> Timetable:
    """When the stages of a case begin and end.

    Args:
        section: the case.
        faults: is told of dates of no stage, of those earlier than one before, and of durations
            that do not follow or contradict dates.
    """
    stages = stages_of(section)
    dates: dict[str, float] = {}
    for name, text in section.dates.items():
        if name in stages:
            dates[name] = read_date(text)
        else:
            faults.add_unknown(("dates", name), "stage", name, stages, key=True)
    if section.service_stage is not None and section.service_since is not None:
        dates.setdefault(section.service_stage, read_date(section.service_since))
    _require_order(stages, dates, faults)
    if all(stage.lasts is None for stage in section.stages):
        return Timetable(stages, dates=dates)
    bases = bases_of(section.stages)
    lasts = {s.name: s.lasts.factor for s in section.stages if s.lasts is not None}
    _follow(bases, lasts, dates)
    for n, stage in enumerate(section.stages):
        if stage.name not in lasts:
            continue
        begin, end = dates.get(bases[stage.name]), dates.get(stage.name)
        if math.isnan(lasts[stage.name]):
            if begin is None or end is None:
                _refuse_unknown(n, stage.name, bases[stage.name], end, faults)
            elif end < begin and bases[stage.name] in section.dates:
                continue  # `_require_order` has said it
            elif end < begin:
                message = f"'{stage.name}' ends before it begins, at the end of "
                message += f"'{bases[stage.name]}' ({date_text(begin)})"
                faults.add(("dates", stage.name), "dates-order", message, "Correct one of them.")
            else:
                lasts[stage.name] = end - begin
                _follow(bases, lasts, dates)
                _require_room(n, stage, end - begin, faults)
        elif begin is not None and end is not None:
            _require_agreement(n, stage.name, lasts[stage.name], begin, end, section, faults)
    return Timetable(stages, bases, lasts, dates)


def stages_of(section: CaseSection) -> tuple[str, ...]:
    """Names of the stages of a case, the virgin state first; each once."""
    return tuple(dict.fromkeys((VIRGIN, *(stage.name for stage in section.stages))))


def bases_of(stages: Sequence[StageSection]) -> dict[str, str]:
    """Stage to that on which it builds."""
    bases, trunk = {}, VIRGIN
    for stage in stages:
        bases[stage.name] = stage.base or trunk
        trunk = trunk if stage.independent else stage.name
    return bases


def _require_order(stages: Sequence[str], dates: Mapping[str, float], faults: Faults) -> None:
    """Dates increase with the stages."""
    before: str | None = None
    for name in (stage for stage in stages if stage in dates):
        if before is not None and dates[name] < dates[before]:
            message = f"'{name}' ends before '{before}' ({date_text(dates[before])})"
            faults.add(("dates", name), "dates-order", message, "Correct one of the dates.")
        before = name


def _follow(bases: Mapping[str, str], lasts: Mapping[str, float], dates: dict[str, float]) -> None:
    """Add the dates that follow from others and durations."""
    known = -1
    while known < len(dates):
        known = len(dates)
        for name, time in lasts.items():
            if math.isnan(time):
                continue
            if bases[name] in dates:
                dates.setdefault(name, dates[bases[name]] + time)
            elif name in dates:
                dates[bases[name]] = dates[name] - time


def _refuse_unknown(n: int, stage: str, base: str, end: float | None, faults: Faults) -> None:
    """A duration that should follow from dates, of which one is not known."""
    place: KeyPath = ("stages", n, "lasts")
    if end is None:
        message = f"'{stage}' has no date, so that its duration follows from none"
        hint = f"Add it: dates: {{{stage}: 2024-03-01}}; or write how long it lasts, such as 12 d."
    elif base == VIRGIN:
        message = f"it is not said when '{stage}' begins"
        hint = f"Write how long it lasts, such as 12 d, or its beginning: dates: {{{VIRGIN}: "
        hint += "2024-03-01}."
    else:
        message = f"'{stage}' begins at the end of '{base}', which has no date"
        hint = f"Add it: dates: {{{base}: 2024-03-01}}; or write how long it lasts, such as 12 d."
    faults.add(place, "missing-dates", message, hint)


def _require_agreement(
    n: int,
    stage: str,
    lasts: float,
    begin: float,
    end: float,
    section: CaseSection,
    faults: Faults,
) -> None:
    """The date of the end of a stage is that of its beginning and its duration."""
    if abs(begin + lasts - end) <= SAME:
        return
    message = f"'{stage}' lasts {time_text(lasts)} from {date_text(begin)} on, so it ends on "
    message += f"{date_text(begin + lasts)}, but 'dates' says {date_text(end)}"
    hint = "Correct one of them; 'lasts: dates' takes the duration from the dates."
    place: KeyPath = ("dates", stage) if stage in section.dates else ("stages", n, "lasts")
    faults.add(place, "contradiction", message, hint)


def _require_room(n: int, stage: StageSection, lasts: float, faults: Faults) -> None:
    """A duration that follows from dates is long enough for what the stage says of its time."""
    given: list[tuple[KeyPath, CaseNumber]] = []
    if stage.over is not None:
        given.append((("over",), stage.over))
    given += [(("moments", k), time) for k, time in enumerate(stage.moments or ())]
    for path, time in given:
        if time.factor > lasts:
            by_dates = f"{time_text(lasts)} by its dates"
            message = f"'{time.text}' is longer than the stage lasts, {by_dates}"
            place = ("stages", n, *path)
            faults.add(place, "after-stage", message, "Correct it, or the date.")


def check_durations(section: CaseSection, faults: Faults) -> None:
    """Stages that last have ground that geoident computes, and moments within them."""
    for n, stage in enumerate(section.stages):
        if stage.lasts is None:
            if stage.moments is not None:
                message = f"'{stage.name}' has no duration, so it has no moments"
                hint = "Say how long it lasts, such as 'lasts: 12 d', or remove it."
                faults.add(("stages", n, "moments"), "no-duration", message, hint)
        elif section.service is not None:
            message = "a structure in service has its own time, that of its loads"
            faults.add(("stages", n, "lasts"), "in-service", message, "Remove it.")


def with_moment_names(section: CaseSection, times: Timetable, faults: Faults) -> CaseSection:
    """The case in which moments of stages have the names that results give them.

    Args:
        section: the case.
        times: of its stages.
        faults: takes moments that there are not.
    """

    def canonical(name: str, *path: str | int) -> str:
        try:
            return times.canonical(name)
        except Refusal as error:
            faults.add(path, error.code, error.message, error.hint)
            return name

    gauges = {
        name: _with_zero(gauge, ("gauges", name), canonical)
        for name, gauge in section.gauges.items()
    }
    fit = section.fit
    if fit.stages:
        named = [canonical(name, "fit", "stages", n) for n, name in enumerate(fit.stages)]
        fit = fit.model_copy(update={"stages": named})
    bad = [
        entry.model_copy(update={"stage": canonical(entry.stage, "bad", n, "stage")})
        if entry.stage
        else entry
        for n, entry in enumerate(section.bad)
    ]
    return section.model_copy(update={"gauges": gauges, "fit": fit, "bad": bad})


def _with_zero(part: Any, path: KeyPath, canonical: Any) -> Any:
    """A gauge, or one of its probes, whose zero has the name of results."""
    changed: dict[str, Any] = {}
    zero, probe = getattr(part, "zero", None), getattr(part, "distortions", None)
    if isinstance(zero, str) and canonical(zero, *path, "zero") != zero:
        changed["zero"] = canonical(zero)
    if probe is not None:
        changed["distortions"] = _with_zero(probe, (*path, "distortions"), canonical)
    return part.model_copy(update=changed) if changed else part


def until_of(section: CaseSection, times: Timetable, faults: Faults) -> tuple[str, float] | None:
    """Stage and time, s since it began, of a `fit.until` that is no date; None for another.

    The time is NaN for the end of a stage that does not last.
    """
    text, place = section.fit.until, ("fit", "until")
    if text is None:
        return None
    if is_date(text):
        if times.lasts and not times.dates:
            message = f"'{text}' is a date, and the stages have none"
            hint = (
                f"Write dates: {{{VIRGIN}: 2024-03-01}}, when the first stage begins; or a stage "
            )
            hint += f"and a time, such as {times.stages[-1]} + 12 d."
            faults.add(place, "missing-dates", message, hint)
        return None
    try:
        moment = times.moment(text)
    except Refusal as error:
        faults.add(place, error.code, error.message, error.hint)
        return None
    if moment is not None:
        return moment
    if text in times.stages:
        if not times.lasts and text not in times.dates:
            message = (
                f"'{text}' has neither date nor duration, so readings are not after it in time"
            )
            hint = "Name the stages whose readings are used instead: fit: {stages: [...]}."
            faults.add(place, "missing-dates", message, hint)
        return text, times.lasts.get(text, math.nan)
    hint = did_you_mean(text, times.stages[1:], what="Stages")
    hint = hint if hint.startswith("Did") else f"{hint} Write 2024-03-01, a stage, or STAGE + 12 d."
    message = f"'{shorten(text)}' is neither a date nor a stage"
    faults.add(place, "unknown-stage", message, hint)
    return None


def moments_by_stage(names: Iterable[str], times: Timetable) -> dict[str, list[float]]:
    """Stage to the times, s since its beginning, of moments with names as results have them."""
    found: dict[str, list[float]] = {}
    for name in names:
        with suppress(Refusal):  # those that there are not have been refused
            moment = times.moment(name)
            if moment is not None:
                found.setdefault(moment[0], []).append(moment[1])
    return found


def in_moments(
    case: Case,
    times: Timetable,
    moments: Mapping[str, Sequence[float]],
    until: tuple[str, float] | None,
) -> Case:
    """A case with its durations and moments, and the time up to which its readings are used.

    Args:
        case: as built, with its readings and dates.
        times: of its stages.
        moments: stage to its moments, s since its beginning.
        until: as `until_of` says.
    """
    if times.lasts:
        lasting = tuple(replace(s, lasts=times.lasts.get(s.name)) for s in case.stages)
        case = with_moments(replace(case, stages=lasting), moments)
    if until is None:
        return case
    stage, time = until
    end = case.times.get(stage, math.nan) + (0.0 if math.isnan(time) else time - times.lasts[stage])
    return replace(case, fit=replace(case.fit, until=end))
