"""The stages of a settlement law: the days of reading, those of zeros, and those to be predicted.

The law is a curve in time, so that nothing but their dates is to be said of the days. They stand in
the readings, which are read once for them and then once more as those of any case.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from geoident.io.case.case import CaseSection
from geoident.io.case.external.settlement import listed
from geoident.io.case.external.settlement_section import LiftSection, SettlementLawSection
from geoident.io.case.gauges.kinds import build_channels
from geoident.io.case.readings import ReadingSection
from geoident.io.case.readings_by_stage import rows_of
from geoident.io.case.site_files.file import ReadingsFileSection
from geoident.io.case.stages import StageSection
from geoident.io.schema.section import Context
from geoident.io.text.dates import DateError, date_text, read_date
from geoident.io.text.faults import Faults
from geoident.model.case import VIRGIN, Analysis, KeyPath
from geoident.model.gauges import DAY


class FindFile(Protocol):
    """Path of a file that the case names at a key; notes a fault if it is not there."""

    def __call__(self, name: str, key: KeyPath, *, faults: Faults) -> str: ...


def with_days(
    section: CaseSection, law: SettlementLawSection, find: FindFile, faults: Faults
) -> CaseSection:
    """The case with a stage for each day on which the law applies.

    Args:
        section: the case.
        law: its model.
        find: finds the files that it names.
        faults: is told where the law applies to no reading.
    """
    since = None if law.since is None else read_date(law.since) // DAY * DAY
    read = set(_read_days(section, find, faults))
    days = {day for day in read if since is None or day >= since}
    if since is not None and read and not any(day > since for day in days):
        message = f"no reading is after '{law.since}': the last one is of {date_text(max(read))}"
        hint = "Correct the date: that of the end of loading, with readings after it."
        faults.add(("model", "since"), "no-readings", message, hint)
    days |= {read_date(text) // DAY * DAY for text in listed(law.forecast)}
    for name, gauge in section.gauges.items():
        day = _day_of(getattr(gauge, "zero", VIRGIN))
        if day is None:
            continue
        if since is not None and day < since:
            message = f"the law applies from '{law.since}' on, and the gauge is zeroed before"
            hint = "Remove it, and write 'offset: $NAME': what the gauge shows until then."
            faults.add(("gauges", name, "zero"), "before-law", message, hint)
        days.add(day)
    if not days:
        message = "there are no readings, and no day is to be predicted"
        hint = "Add readings, or 'forecast: [2030-01-01]'."
        faults.add(("model",), "no-stages", message, hint, key=True)
    dates = {date_text(day): date_text(day) for day in sorted(days)}
    begin = min([*days, *_begin(law)], default=0.0)
    fit = section.fit
    if fit.until is not None and fit.stages is None:
        until = read_date(fit.until)
        used = [date_text(day) for day in sorted(days & read) if day <= until]
        if read and not used:
            message = f"no reading that the law describes is before '{fit.until}'"
            faults.add(("fit", "until"), "no-readings", message, "Correct the date.")
        fit = fit.model_copy(update={"stages": used or None})
    return section.model_copy(
        update={
            "stages": [StageSection(name=name) for name in dates],
            "dates": {VIRGIN: date_text(begin), **dates},
            "fit": fit,
        }
    )


def _begin(law: SettlementLawSection) -> Iterator[float]:
    """When the law begins, seconds since 1970; nothing where its fill is in a file."""
    if law.since is not None:
        yield read_date(law.since)
    fills = law.fill.values() if isinstance(law.fill, dict) else [law.fill]
    for fill in fills:
        for lift in fill if isinstance(fill, list) else []:
            if isinstance(lift, LiftSection):
                yield read_date(lift.date)


def _day_of(stage: object) -> float | None:
    """The day that the name of a stage is; None where it is no date."""
    try:
        return read_date(str(stage)) // DAY * DAY
    except DateError:
        return None


def _read_days(section: CaseSection, find: FindFile, faults: Faults) -> Iterator[float]:
    """Days on which something was read; what is wrong in the readings is noted later."""
    aside = Faults(faults.places)
    context = Context(("gauges",), Analysis(section.analysis), aside)
    dimensions = {c.name: c.dimension for c in build_channels(section.gauges, {}, context)}
    given = section.readings
    for entry in given if isinstance(given, list) else [given]:
        if isinstance(entry, ReadingSection):
            day = _day_of(entry.stage)
            if day is not None:
                yield day
        elif entry is not None:
            described = entry
            if isinstance(described, str):
                described = ReadingsFileSection.model_construct(file=described)
            before = len(aside.found)
            paths = [find(name, ("readings",), faults=aside) for name in described.paths]
            if len(aside.found) > before:
                continue
            for row in rows_of(paths, described.described(dimensions, None), aside, []):
                day = _day_of(row.stage) if row.time is None else row.time // DAY * DAY
                if day is not None and row.value is not None:
                    yield day
