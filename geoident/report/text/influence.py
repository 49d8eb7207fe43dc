"""Which readings bear most on a fit, as a table for people and objects for programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from geoident.model.arrays import Ints
from geoident.model.result import Diagnostics, Result
from geoident.report.text.layout import decimals, number, table

WORST = 5
HEADER = ("gauge", "stage", "in sd", "leverage", "weight", "changes most", "by sd")
SIDES = "llrrrlr"


def influence_text(result: Result) -> str:
    """The readings whose removal would change the answer most, and how far off they are."""
    found = result.diagnostics
    if found is None:
        return ""
    return table(HEADER, influence_rows(result), right=SIDES)


def influence_rows(result: Result) -> list[list[str]]:
    """The cells of that table, under `HEADER`."""
    found = wide_diagnostics(result)
    if found is None:
        return []
    return [_row(result, found, i, j) for i, j in by_distance(found)[:WORST]]


def wide_diagnostics(result: Result) -> Diagnostics | None:
    """The diagnostics by channel and stage: several readings in one place in one row."""
    return None if result.diagnostics is None else result.diagnostics.wide(result.gauges)


def _row(result: Result, found: Diagnostics, i: int, j: int) -> list[str]:
    change = found.influence[i, j]
    k = int(np.argmax(np.abs(change))) if change.size else -1
    return [
        result.gauges.channels[i],
        result.gauges.stages[j],
        decimals(float(found.studentized[i, j]), 1),
        decimals(float(found.leverage[i, j]), 2),
        decimals(float(found.weight[i, j]), 2),
        result.parameters.names[k] if change.size else "",
        _sd(float(change[k])) if change.size else "",
    ]


def _sd(change: float) -> str:
    return "all" if np.isinf(change) else f"{change:+.2f}"


def influence_title(result: Result) -> str:
    """What the table shows; with a robust loss also the plain weighted squares."""
    found = result.diagnostics
    if found is None:
        return ""
    title = f"Readings that bear most on the answer (scatter {number(found.scale, 2)} accuracies)"
    if found.loss != "squared":
        title += f"\nLoss {found.loss}; plain weighted squares {number(found.squares)}"
    return title


def diagnostics_object(result: Result) -> dict[str, Any]:
    """The loss, the plain weighted squares, and one object for every used reading, worst first."""
    found = wide_diagnostics(result)
    if found is None:
        return {}
    return {
        "loss": found.loss,
        "weighted_squares": found.squares,
        "scale": found.scale,
        "readings": [_reading(result, found, i, j) for i, j in by_distance(found)],
    }


def _reading(result: Result, found: Diagnostics, i: int, j: int) -> dict[str, Any]:
    return {
        "gauge": result.gauges.channels[i],
        "stage": result.gauges.stages[j],
        "standardized": found.standardized[i, j],
        "studentized": found.studentized[i, j],
        "weight": found.weight[i, j],
        "leverage": found.leverage[i, j],
        "distance": found.distance[i, j],
        "influence": dict(zip(result.parameters.names, found.influence[i, j], strict=True)),
    }


def by_distance(found: Diagnostics) -> Ints:
    """(m, 2) places of the used readings, the one that bears most first."""
    places = np.argwhere(np.isfinite(found.standardized))
    distance = found.distance[places[:, 0], places[:, 1]]
    return np.asarray(places[np.argsort(-distance, kind="stable")], dtype=np.int64)
