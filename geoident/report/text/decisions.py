"""Decisions that depend on a reading, in words and tables."""

from __future__ import annotations

from dataclasses import replace

from geoident.model.results.decisions import DecisionState, TellingReading
from geoident.model.results.result import GaugeTable, Result
from geoident.report.text.alarms import probable
from geoident.report.text.gauges import predicted_texts, reading_text
from geoident.report.text.layout import TextTable, sentence

NAME = "Decisions"
TELLING = "Readings that would tell"
NOTE = (
    "5 % and 50 % likely: the reading at the earlier stage with which the condition becomes so "
    "probable, if nothing else is read until then; - where no reading within four standard "
    "deviations of what is expected would do that. For each stage the gauge itself and the best "
    "other one."
)
_STATES = {"due": "fulfilled", "not due": "not fulfilled", "unknown": "not predicted"}


def decision_parts(result: Result) -> tuple[str, ...]:
    """For a terminal: all decisions, and for each the readings that would tell."""
    parts = [decision_table(result).folded(1)]
    for condition in dict.fromkeys(one.condition for one in result.telling):
        own = [one for one in result.telling if one.condition == condition]
        table = telling_table(replace(result, telling=tuple(own)))
        rows = [row[1:] for row in table.rows]
        parts.append(f"{TELLING}: {condition}")
        parts.append(TextTable(table.header[1:], rows, right=table.right[1:]).folded(2))
    return (*parts, sentence(NOTE) if result.telling else "")


def decision_table(result: Result) -> TextTable:
    """A row for each decision."""
    rows = [[one.condition, _today(result.gauges, one), one.then] for one in result.decisions]
    return TextTable(("if", "today", "then"), rows)


def _today(gauges: GaugeTable, one: DecisionState) -> str:
    if one.state in ("open", "not read"):
        missed = ", but not read" if one.state == "not read" else ""
        return f"{probable(one.probability)} probable{missed}"
    row = gauges.channels.index(one.gauge)
    read = f", {reading_text(gauges, row, one.measured)} {gauges.shown_units[row]} was read"
    return _STATES[one.state] + ("" if one.state == "unknown" else read)


def telling_table(result: Result) -> TextTable:
    """A row for each earlier reading that would tell of a decision."""
    rows = [_telling_row(result.gauges, one) for one in result.telling]
    header = ("if", "reading of", "at", "unit", "expected", "from", "to", "5 % likely", "50 %")
    return TextTable(header, rows, right="llllrrrrr")


def _telling_row(gauges: GaugeTable, one: TellingReading) -> list[str]:
    row = gauges.channels.index(one.gauge)
    ends = predicted_texts(gauges, row, one.predicted, one.lower95, one.upper95)
    readings = (reading_text(gauges, row, x) for x in (one.at_5, one.at_50))
    return [one.condition, one.gauge, one.stage, gauges.shown_units[row], *ends, *readings]
