"""A campaign in words and tables: how its runs ended, their parameters, what failed and why."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from geoident.model.results.campaign import CampaignTable, RunParameter, RunReading, RunRecord
from geoident.report.text.csv_tables import CsvCell, CsvRow, CsvTable, csv_text
from geoident.report.text.layout import TextTable, number, section, sections, sentence
from geoident.report.text.layout import with_interval as interval_texts
from geoident.units import in_unit, shown_unit

_MOST_ROWS = 200
"""Rows of a table for people; ``runs.csv`` has all."""

_SLOWEST = 3


def campaign_text(table: CampaignTable, *, title: str) -> str:
    """A campaign for a terminal.

    Args:
        table: its runs.
        title: above it.
    """
    return sections(
        title,
        "\n".join(sentence(text) for text in outcome_sentences(table)),
        section("Failed runs", failed_table(table).folded()),
        section("Runs", runs_table(table).folded()),
    )


def outcome_sentences(table: CampaignTable) -> list[str]:
    """How the runs ended, in a few sentences."""
    done = sum(run.finished for run in table.runs)
    said = [f"{done} of {table.total} runs done ({statuses_text(table.runs)})."]
    left = table.total - len(table.runs)
    if left:
        said.append(f"{left} runs have not ended; the same command goes on with them.")
    if table.failed:
        named = ", ".join(run.name for run in table.failed[:5])
        more = f" and {len(table.failed) - 5} more" if len(table.failed) > 5 else ""
        said.append(f"Failed: {named}{more}.")
    best = best_run(table)
    if best is not None:
        said.append(f"The least misfit, {number(best.objective)}, has the run {best.name}.")
    took = [run for run in table.runs if math.isfinite(run.seconds)]
    if took:
        slow = sorted(took, key=lambda run: -run.seconds)[:_SLOWEST]
        words = ", ".join(f"{run.name} ({seconds_text(run.seconds)})" for run in slow)
        spent = seconds_text(sum(run.seconds for run in took))
        said.append(f"Computed in {spent} of process time; slowest: {words}.")
    return said


def statuses_text(runs: Sequence[RunRecord]) -> str:
    """How many runs ended how.

    >>> statuses_text([])
    'none has ended'
    """
    counted = Counter(run.status for run in runs)
    return ", ".join(f"{count} {status}" for status, count in counted.most_common()) or (
        "none has ended"
    )


def seconds_text(seconds: float) -> str:
    """A time for people.

    >>> seconds_text(0.0214), seconds_text(75), seconds_text(7300)
    ('0.02 s', '75 s', '122 min')
    """
    if seconds < 10.0:
        return f"{seconds:.2f} s"
    return f"{seconds:.0f} s" if seconds < 600.0 else f"{seconds / 60:.0f} min"


def best_run(table: CampaignTable) -> RunRecord | None:
    """The run with the least misfit; None where none has one."""
    known = [run for run in table.runs if run.finished and math.isfinite(run.objective)]
    return min(known, key=lambda run: run.objective, default=None)


def runs_table(table: CampaignTable) -> TextTable:
    """The runs with what varies and what came out."""
    names = table.parameter_names if table.command in ("fit", "scan") else ()
    units = {p.name: shown_unit(p.unit, p.dimension) for r in table.runs for p in r.parameters}
    heads = [f"{name} ({units[name]})" if units[name] else name for name in names]
    misfit = any(math.isfinite(run.objective) for run in table.runs)
    header = ["run", *table.paths, "status", *(["misfit"] if misfit else []), *heads]
    rows = []
    for run in table.runs[:_MOST_ROWS]:
        own = {p.name: p for p in run.parameters}
        row = [run.name, *(dict(run.settings).get(path) or "-" for path in table.paths)]
        row += [run.status, *([number(run.objective)] if misfit else [])]
        rows.append([*row, *(_value_text(own.get(name)) for name in names)])
    right = "l" * (len(table.paths) + 2) + "r" * (len(header) - len(table.paths) - 2)
    return TextTable(header, rows, right=right)


def runs_left_out(table: CampaignTable) -> str:
    """That the table shows only the first runs; empty where it shows all."""
    if len(table.runs) <= _MOST_ROWS:
        return ""
    return f"The first {_MOST_ROWS} of {len(table.runs)} runs; runs.csv has all."


def _value_text(found: RunParameter | None) -> str:
    if found is None:
        return "-"
    unit = found.unit, found.dimension
    value, low, high = (in_unit(x, *unit) for x in (found.value, found.lower95, found.upper95))
    if not (math.isfinite(low) and math.isfinite(high)):
        return number(value)
    texts = interval_texts(value, low, high)
    return f"{texts[0]} ({texts[1]} to {texts[2]})"


def failed_table(table: CampaignTable) -> TextTable:
    """Runs without a result, and why."""
    rows = [
        [run.name, run.status, " ".join(run.reason.split())] for run in table.failed[:_MOST_ROWS]
    ]
    return TextTable(["run", "status", "why"], rows)


def runs_csv(table: CampaignTable) -> str:
    """All runs as CSV: one row a run, values in the units of the case, readings not among them."""
    names = table.parameter_names
    known = {p.name: p for run in table.runs for p in run.parameters}
    places = _places(table)
    header = ["run", *table.paths, "status", "exit_code", "misfit"]
    for name in names:
        unit = shown_unit(known[name].unit, known[name].dimension)
        label = f"{name} [{unit}]" if unit else name
        header += [label, f"{label} lower95", f"{label} upper95"]
    for (gauge, stage), reading in places.items():
        label = f"{gauge} at {stage} [{shown_unit(reading.unit, reading.dimension)}]"
        bands = [f"{label} lower95", f"{label} upper95"] if table.command == "predict" else []
        header += [label, *bands]
    header += ["evaluations", "factorizations", "solves", "seconds", "host", "processes_lost"]
    header += ["file", "reason"]
    rows = tuple(_csv_row(table, run, names, tuple(places)) for run in table.runs)
    return csv_text(CsvTable(tuple(header), rows))


def _places(table: CampaignTable) -> dict[tuple[str, str], RunReading]:
    """Channels and stages that runs simulate or predict, with the first reading of each."""
    found: dict[tuple[str, str], RunReading] = {}
    for run in table.runs:
        for reading in run.readings:
            found.setdefault((reading.gauge, reading.stage), reading)
    return found


def _csv_row(
    table: CampaignTable,
    run: RunRecord,
    names: Sequence[str],
    places: Sequence[tuple[str, str]],
) -> CsvRow:
    given, own = dict(run.settings), {p.name: p for p in run.parameters}
    cells: list[CsvCell] = [run.name, *(given.get(path, "") for path in table.paths)]
    cells += [run.status, run.exit_code, run.objective]
    for name in names:
        cells += _shown(own.get(name), bands=True)
    readings = {(r.gauge, r.stage): r for r in run.readings}
    for place in places:
        cells += _shown(readings.get(place), bands=table.command == "predict")
    cells += [run.counts.evaluations, run.counts.factorizations, run.counts.solves]
    return (
        *cells, run.seconds, run.host, len(run.losses), run.file, " ".join(run.reason.split()),
    )  # fmt: skip


def _shown(found: RunParameter | RunReading | None, *, bands: bool) -> list[float]:
    """A value and its interval in the unit in which people see it."""
    if found is None:
        return [math.nan] * (3 if bands else 1)
    values = (found.value, found.lower95, found.upper95) if bands else (found.value,)
    return [in_unit(value, found.unit, found.dimension) for value in values]
