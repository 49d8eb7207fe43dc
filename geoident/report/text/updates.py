"""The history of a fit over its updates, in words and tables."""

from __future__ import annotations

import math

from geoident.model.results.columns import ROW
from geoident.model.results.result import Result
from geoident.model.results.updates import PastParameter, UpdateStep
from geoident.report.text.gauges import predicted_texts, reading_text
from geoident.report.text.layout import TextTable, decimals, shown_interval
from geoident.report.text.parameters import AS_PRIOR, NOT_DETERMINED
from geoident.report.text.rows import objects
from geoident.units import shown_unit

TITLE = "Updates"
JUDGED_TITLE = "New readings of the last update"
PARAMETERS_TITLE = "Parameters over the updates"
NOTE = (
    "p: how often chance makes readings that belong to the model at least as far from its "
    "predictions: of all new readings together, and of the gauge that is farthest off. They do not "
    "belong where chance does so once in a hundred updates."
)
_MOST = 12
"""Updates that a terminal shows: the first and the last ones."""


def update_sentence(result: Result) -> str:
    """What the last update has judged; empty where there was none."""
    if result.updates is None or not result.updates.last:
        return ""
    step = result.updates.steps[-1]
    new = f"{step.new} new reading{'s' * (step.new != 1)}"
    words = f"Update {result.updates.last} of {step.made[:16].replace('T', ' ')}"
    if not step.new:
        return f"{words}: no new readings."
    if not step.judged:
        return f"{words}: {new}, of which the fit before could predict none."
    some = "" if step.judged == step.new else f", {step.judged} of them judged"
    verb = ("do", "does")[step.new == 1]
    belong = "" if step.belong else f"{verb} not "
    verb = ("belong", "belongs")[step.new == 1 and step.belong]
    return f"{words}: {new}{some}: {belong}{verb} to the model that predicted them ({_p(step)})."


def _p(step: UpdateStep) -> str:
    return f"p = {_chance(step.p_value)}, of single gauges at least {_chance(step.least)}"


def _chance(p: float) -> str:
    return "-" if math.isnan(p) else f"{p:.2f}" if p >= 0.01 else f"{p:.1g}"


def updates_table(result: Result) -> TextTable:
    """A row for each update."""
    history = result.updates
    header = ("update", "made", "readings", "new", "changed", "gone", "p", "least p", "", "status")
    rows = []
    for number_, step in enumerate(() if history is None else history.steps):
        said = "alarm" if step.alarm else "" if not step.judged else "belong"
        rows.append(
            [
                str(number_), step.made[:16].replace("T", " "), str(step.readings), str(step.new),
                str(step.changed or "-"), str(step.removed or "-"), _chance(step.p_value),
                _chance(step.least), said if step.belong else "do not belong", step.status,
            ]
        )  # fmt: skip
    return TextTable(header, rows, right="rlrrrrrrll").filled if rows else TextTable(header, ())


def parameters_table(result: Result) -> TextTable:
    """The parameters, and after each update their values with the 95 % intervals."""
    history = result.updates
    if history is None:
        return TextTable(("parameter",), ())
    known = {(row.parameter, row.update): row for row in history.parameters}
    units = {row.parameter: (row.unit, row.dimension) for row in history.parameters}
    names = list(units)
    header = ("update", *(f"{name} {shown_unit(*units[name])}".rstrip() for name in names))
    rows = [
        [str(k), *(_cell(known.get((name, k))) for name in names)]
        for k in range(len(history.steps))
    ]
    return TextTable(header, rows, right="r" * len(header)) if names else TextTable(header, ())


def _cell(row: PastParameter | None) -> str:
    if row is None:
        return "-"
    if not row.determined:
        return AS_PRIOR if math.isfinite(row.sd) else NOT_DETERMINED
    numbers = row.value, row.lower95, row.upper95
    value, interval = shown_interval(*numbers, row.unit, row.dimension, between=" .. ")
    return f"{value} ({interval})" if interval else value


def judged_table(result: Result) -> TextTable:
    """The readings of the last update beside what the fit before had predicted of them."""
    history, gauges = result.updates, result.gauges
    header = ("channel", "stage", "read", "predicted", "95 % band", "error (sd)", "")
    rows = []
    judged = () if history is None else history.readings
    for row in judged:
        if row.update != judged[-1].update or row.channel not in gauges.channels:
            continue
        i = gauges.channels.index(row.channel)
        mean, low, high = predicted_texts(gauges, i, row.predicted, row.lower95, row.upper95)
        known = math.isfinite(row.sd)
        rows.append(
            [
                row.channel, row.stage,
                f"{reading_text(gauges, i, row.value)} {gauges.shown_units[i]}".rstrip(),
                mean if known else "not determined",
                f"{low} to {high}" if known else "-",
                decimals((row.value - row.predicted) / row.sd, 1) if known else "-",
                "outside" if known and row.outside else "",
            ]
        )  # fmt: skip
    return TextTable(header, rows, right="llrrrrl")


def parts(result: Result) -> tuple[str, ...]:
    """For a terminal: the updates, and the parameters over them, of many the last ones."""
    shown = (updates_table(result), parameters_table(result))
    some = [
        TextTable(table.header, table.rows[-_MOST:], table.right) for table in shown if table.rows
    ]
    more = max((len(table.rows) for table in shown), default=0) - _MOST
    words = f"{more} earlier updates: `geoident show --csv` has all." if more > 0 else ""
    return (*(table.folded() for table in some), words)


def updates_object(result: Result) -> dict[str, object] | None:
    """The history for programs, SI; None where there is none."""
    history = result.updates
    if history is None:
        return None
    return {
        name: objects(getattr(history, name), ROW)
        for name in ("steps", "gauges", "readings", "parameters", "predictions")
    }
