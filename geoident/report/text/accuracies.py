"""Accuracies that were estimated from the residuals, as tables and for other programs."""

from __future__ import annotations

import math
from typing import Any

from geoident.model.results.result import AccuracyTable
from geoident.report.text.layout import TextTable, shown_interval
from geoident.units import shown_unit, si_unit

TITLE = "Accuracies estimated from the residuals"
_ROOT = "/sqrt(m)"


def accuracies_table(accuracies: AccuracyTable | None) -> TextTable:
    """One row for each size that was estimated: standard deviation, or factor on what is stated."""
    header = ("errors", "standard deviation", "95 % interval", "unit")
    rows = [] if accuracies is None else [_row(accuracies, k) for k in range(len(accuracies.names))]
    return TextTable(header, rows, right="lrrl")


def _row(accuracies: AccuracyTable, k: int) -> list[str]:
    of = accuracies.units[k], accuracies.dimensions[k]
    size, interval = "not determined", "-"
    if math.isfinite(accuracies.upper95[k]):
        numbers = accuracies.values[k], accuracies.lower95[k], accuracies.upper95[k]
        size, interval = shown_interval(*numbers, *of)
    unit = shown_unit(*of) if accuracies.parts[k] else "times what is stated"
    root = _ROOT if accuracies.parts[k] == "along" else ""
    return [accuracies.names[k], size, interval, f"{unit}{root}"]


def accuracies_list(accuracies: AccuracyTable) -> list[dict[str, Any]]:
    """One object for each size that was estimated; null where it is not determined."""
    entries = []
    for k, name in enumerate(accuracies.names):
        part, known = accuracies.parts[k], math.isfinite(accuracies.upper95[k])
        unit = si_unit(accuracies.dimensions[k]) + (_ROOT if part == "along" else "")
        entries.append(
            {
                "errors": name,
                "part": part or None,
                "sd" if part else "factor": accuracies.values[k] if known else None,
                "lower95": accuracies.lower95[k],
                "upper95": accuracies.upper95[k],
                "unit": unit,
                "determined": known,
            }
        )
    return entries
