"""What the mesh does to the readings, as text and JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from geoident.model.results.mesh_error import MeshError
from geoident.report.text.layout import TextTable, bullets, number, section, sections
from geoident.report.text.result import counts_text
from geoident.units import DIMENSIONS, in_unit, shown_unit

_MOST = 40
"""Rows of the table, those of the largest share."""

_HOW = {
    "refinement": "Every edge halved: {0:,} elements became {1:,}",
    "order": "A node on every edge: {0:,} elements became {1:,} of second order",
    "recovery": "From the jumps of the stress between {0:,} elements",
}


def mesh_error_table(error: MeshError) -> TextTable:
    """Readings by the share of their accuracy that is lost to mesh error, the largest first."""
    rows = []
    for i, j in _places(error)[:_MOST]:
        unit = error.units[i], error.dimensions[i]
        numbers = (
            error.computed[i, j],
            error.change[i, j],
            error.error[i, j],
            error.accuracy[i, j],
        )
        shown = [number(in_unit(float(value), *unit)) for value in numbers]
        share = f"{100.0 * error.share[i, j]:.3g} %"
        rows.append([error.channels[i], error.stages[j], *shown, shown_unit(*unit) or "-", share])
    header = ("gauge", "stage", "computed", "change", "error", "accuracy", "unit", "share")
    return TextTable(header, rows, right="llrrrrlr")


def _places(error: MeshError) -> list[tuple[int, int]]:
    """Channel and stage of every reading, the largest share first."""
    share = np.where(np.isfinite(error.share), error.share, -1.0)
    order = np.argsort(-share, axis=None, kind="stable")
    places = zip(*np.unravel_index(order, share.shape), strict=True)
    return [(int(i), int(j)) for i, j in places if share[i, j] >= 0.0]


def mesh_error_text(case: str, error: MeshError, sentence: str) -> str:
    """The table, the sentence and what else is to be known.

    Args:
        case: path of the case, or of a result.
        error: of its mesh.
        sentence: what it means for the readings, a sentence.
    """
    count = len(_places(error))
    more = f" (the {_MOST} largest of {count})" if count > _MOST else ""
    return sections(
        f"{case}: {_HOW[error.how].format(*error.elements)}",
        section(f"Error of the computed readings by the mesh{more}", mesh_error_table(error).text),
        section("Findings", bullets([sentence, *error.notes])),
        f"Cost: {counts_text(error.cost)}, those of the finer mesh among them",
    )


def mesh_error_object(case: str, error: MeshError, sentence: str) -> dict[str, Any]:
    """The same for programs, SI.

    Args:
        case: path of the case, or of a result.
        error: of its mesh.
        sentence: what it means for the readings, a sentence.
    """
    return {
        "case": case,
        "how": error.how,
        "elements": error.elements[0],
        "refined_elements": error.elements[1],
        "order": error.order,
        "finding": sentence,
        "notes": error.notes,
        "counts": asdict(error.cost),
        "readings": [
            {
                "gauge": error.channels[i],
                "stage": error.stages[j],
                "computed": error.computed[i, j],
                "change": error.change[i, j],
                "error": error.error[i, j],
                "accuracy": error.accuracy[i, j],
                "share": error.share[i, j],
                "unit": DIMENSIONS[error.dimensions[i]],
            }
            for i, j in _places(error)
        ],
    }
