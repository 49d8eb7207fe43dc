"""All runs of a campaign for spreadsheets: ``runs.csv``."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geoident.model.results.many.campaign import CampaignTable, RunParameter, RunReading, RunRecord
from geoident.report.text.csv_tables import csv_text
from geoident.report.text.rows import CsvCell, CsvRow, CsvTable, headed
from geoident.units import in_unit, shown_unit


def runs_csv(table: CampaignTable) -> str:
    """All runs as CSV: one row a run, values in the units of the case."""
    return csv_text(runs_columns(table))


def runs_columns(table: CampaignTable) -> CsvTable:
    """The same as a table."""
    names = table.parameter_names
    known = {p.name: p for run in table.runs for p in run.parameters}
    places = _places(table)
    header = ["run", *table.paths, "status", "exit_code", "misfit"]
    for name in names:
        label = headed(name, known[name].unit, known[name].dimension)
        header += [label, f"{label} lower95", f"{label} upper95"]
    for (gauge, stage), reading in places.items():
        label = f"{gauge} at {stage} [{shown_unit(reading.unit, reading.dimension)}]"
        bands = [f"{label} lower95", f"{label} upper95"] if table.command == "predict" else []
        header += [label, *bands]
    header += ["evaluations", "factorizations", "solves", "seconds", "host", "processes_lost"]
    header += ["file", "reason"]
    rows = tuple(_csv_row(table, run, names, tuple(places)) for run in table.runs)
    return CsvTable(tuple(header), rows)


def _places(table: CampaignTable) -> dict[tuple[str, str], RunReading]:
    """Channels and stages that runs simulate or predict, with the first reading of each."""
    readings: dict[tuple[str, str], RunReading] = {}
    for run in table.runs:
        for reading in run.readings:
            readings.setdefault((reading.gauge, reading.stage), reading)
    return readings


def _csv_row(
    table: CampaignTable, run: RunRecord, names: Sequence[str], places: Sequence[tuple[str, str]]
) -> CsvRow:
    settings, own = dict(run.settings), {p.name: p for p in run.parameters}
    cells: list[CsvCell] = [run.name, *(settings.get(path, "") for path in table.paths)]
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


def _shown(entry: RunParameter | RunReading | None, *, bands: bool) -> list[float]:
    """A value and its interval in the unit in which people see it."""
    if entry is None:
        return [math.nan] * (3 if bands else 1)
    values = (entry.value, entry.lower95, entry.upper95) if bands else (entry.value,)
    return [in_unit(value, entry.unit, entry.dimension) for value in values]
