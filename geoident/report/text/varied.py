"""Constants that vary from place to place: in a table, in words for programs, and as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from geoident.model.results.varied import FieldEstimate
from geoident.report.text.layout import TextTable, number, sentence
from geoident.units import in_unit, shown_unit, si_unit

TITLE = "Fields"

SEEN = 0.5
"""Variance reduction from which on a place counts as seen by the readings."""


def varied_table(estimates: Sequence[FieldEstimate]) -> TextTable:
    """What is known of each field: its values, and where the readings see it.

    Args:
        estimates: the fields.
    """
    rows = [_row(field) for field in estimates]
    header = ["field", "unit", "median", "least", "largest", "modes", "best seen", "there", "seen"]
    return TextTable(header, rows) if rows else TextTable([], [])


def _row(field: FieldEstimate) -> list[str]:
    shown = [number(in_unit(float(x), field.unit, field.dimension)) for x in _values(field)]
    if not field.modes:  # it grows by a law: there is nothing that readings see here or there
        return [field.name, shown_unit(field.unit, field.dimension), *shown, "0", "-", "-", "-"]
    best = int(np.argmax(field.reduction))
    where = f"({', '.join(f'{x:.3g}' for x in field.centres[best])}) m"
    seen = int(np.count_nonzero(field.reduction >= SEEN))
    return [
        field.name,
        shown_unit(field.unit, field.dimension),
        *shown,
        str(field.modes),
        where if field.reduction[best] > 0 else "nowhere",
        f"{100 * field.reduction[best]:.0f} %",
        f"{seen} of {len(field.values)}",
    ]


def _values(field: FieldEstimate) -> tuple[float, float, float]:
    """Median, least and largest value of the elements, SI."""
    values = field.values
    return float(np.median(values)), float(values.min()), float(values.max())


def varied_text(estimates: Sequence[FieldEstimate]) -> str:
    """The table, and what its columns say; empty without fields."""
    if not estimates:
        return ""
    note = (
        "median, least and largest of the elements' values; best seen: where the readings reduce "
        "the variance most, and by how much there; seen: elements where they take half of it away"
    )
    if not all(field.modes for field in estimates):
        note += "; without modes: it grows by a law, and its numbers are parameters"
    return f"{varied_table(estimates).text}\n{sentence(note)}"


def varied_list(estimates: Sequence[FieldEstimate]) -> list[dict[str, Any]]:
    """The fields for programs, SI; ``sd`` and ``prior_sd`` are of the logarithm."""
    return [_object(field) for field in estimates]


def _object(field: FieldEstimate) -> dict[str, Any]:
    median, least, largest = _values(field)
    best = int(np.argmax(field.reduction))
    return {
        "name": field.name,
        "material": field.material,
        "constant": field.constant,
        "unit": si_unit(field.dimension),
        "median": median,
        "least": least,
        "largest": largest,
        "modes": field.modes,
        "explained": field.explained,
        "measured": field.tests,
        "best_seen": None
        if not field.modes
        else {"at": field.centres[best], "reduction": float(field.reduction[best])},
        "elements": len(field.values),
        "seen": int(np.count_nonzero(field.reduction >= SEEN)),
    }
