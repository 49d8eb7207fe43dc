"""Accuracies that were estimated from the residuals, as tables and for other programs."""

from __future__ import annotations

import math
from typing import Any

from geoident.model.results.result import AccuracyTable
from geoident.report.text.layout import TextTable, with_interval
from geoident.units import DIMENSIONS, in_unit, shown_unit

TITLE = "Accuracies estimated from the residuals"
_ROOT = "/sqrt(m)"


def accuracies_table(accuracies: AccuracyTable | None) -> TextTable:
    """One row for each size that was estimated: standard deviation, or factor on what is stated."""
    header = ("errors", "standard deviation", "95 % interval", "unit")
    rows = [] if accuracies is None else [_row(accuracies, k) for k in range(len(accuracies.names))]
    return TextTable(header, rows, right="lrrl")


def _row(accuracies: AccuracyTable, k: int) -> list[str]:
    low, value, high = (
        float(column[k]) for column in (accuracies.lower95, accuracies.values, accuracies.upper95)
    )
    if not math.isfinite(high):
        return [accuracies.names[k], "not determined", "-", _unit(accuracies, k)]
    unit = accuracies.units[k], accuracies.dimensions[k]
    size, least, most = with_interval(*(in_unit(x, *unit) for x in (value, low, high)))
    return [accuracies.names[k], size, f"{least} to {most}", _unit(accuracies, k)]


def _unit(accuracies: AccuracyTable, k: int) -> str:
    if not accuracies.parts[k]:
        return "times what is stated"
    unit = shown_unit(accuracies.units[k], accuracies.dimensions[k])
    return f"{unit}{_ROOT}" if accuracies.parts[k] == "along" else unit


def accuracies_list(accuracies: AccuracyTable) -> list[dict[str, Any]]:
    """One object for each size that was estimated; null where it is not determined."""
    return [
        {
            "errors": name,
            "part": accuracies.parts[k] or None,
            "sd" if accuracies.parts[k] else "factor": (
                accuracies.values[k] if math.isfinite(accuracies.upper95[k]) else None
            ),
            "lower95": accuracies.lower95[k],
            "upper95": accuracies.upper95[k],
            "unit": _si_unit(accuracies, k),
            "determined": math.isfinite(accuracies.upper95[k]),
        }
        for k, name in enumerate(accuracies.names)
    ]


def _si_unit(accuracies: AccuracyTable, k: int) -> str:
    unit = DIMENSIONS.get(accuracies.dimensions[k], "")
    return f"{unit}{_ROOT}" if accuracies.parts[k] == "along" else unit
