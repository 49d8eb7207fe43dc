"""Gauges that a fit left out, and how well it predicts them, as a table."""

from __future__ import annotations

from geoident.model.results.left_out import LeftOutTable
from geoident.report.text.layout import TextTable, decimals

TITLE = "Gauges left out of the fit"


def left_out_table(table: LeftOutTable | None) -> TextTable:
    """A row for each gauge."""
    header = ("gauge", "readings", "inside 95 %", "rms error (sd)", "band by rms", "log score")
    rows = [] if table is None else [
        [
            table.names[k],
            str(table.readings[k]),
            str(table.inside[k]) if table.readings[k] else "-",
            *(decimals(float(x[k]), 2) for x in (table.rms, table.sharpness, table.log_score)),
        ]
        for k in range(len(table))
    ]  # fmt: skip
    return TextTable(header, rows, right="lrrrrr")
