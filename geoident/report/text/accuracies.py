"""Accuracies that were estimated from the residuals, as tables and for other programs."""

from __future__ import annotations

import math
from typing import Any

from geoident.model.results.result import AccuracyTable
from geoident.report.text.layout import TextTable, with_interval
from geoident.units import DIMENSIONS, in_unit, shown_unit

TITLE = "Accuracies estimated from the residuals"
_ROOT = "/sqrt(m)"


def accuracies_table(found: AccuracyTable | None) -> TextTable:
    """One row for each size that was estimated: standard deviation, or factor on what is stated."""
    header = ("errors", "standard deviation", "95 % interval", "unit")
    rows = [] if found is None else [_row(found, k) for k in range(len(found.names))]
    return TextTable(header, rows, right="lrrl")


def _row(found: AccuracyTable, k: int) -> list[str]:
    low, value, high = (float(column[k]) for column in (found.lower95, found.values, found.upper95))
    if not math.isfinite(high):
        return [found.names[k], "not determined", "-", _unit(found, k)]
    unit = found.units[k], found.dimensions[k]
    size, least, most = with_interval(*(in_unit(x, *unit) for x in (value, low, high)))
    return [found.names[k], size, f"{least} to {most}", _unit(found, k)]


def _unit(found: AccuracyTable, k: int) -> str:
    if not found.parts[k]:
        return "times what is stated"
    unit = shown_unit(found.units[k], found.dimensions[k])
    return f"{unit}{_ROOT}" if found.parts[k] == "along" else unit


def accuracies_list(found: AccuracyTable) -> list[dict[str, Any]]:
    """One object for each size that was estimated; null where it is not determined."""
    return [
        {
            "errors": name,
            "part": found.parts[k] or None,
            "sd" if found.parts[k] else "factor": (
                found.values[k] if math.isfinite(found.upper95[k]) else None
            ),
            "lower95": found.lower95[k],
            "upper95": found.upper95[k],
            "unit": _si_unit(found, k),
            "determined": math.isfinite(found.upper95[k]),
        }
        for k, name in enumerate(found.names)
    ]


def _si_unit(found: AccuracyTable, k: int) -> str:
    unit = DIMENSIONS.get(found.dimensions[k], "")
    return f"{unit}{_ROOT}" if found.parts[k] == "along" else unit
