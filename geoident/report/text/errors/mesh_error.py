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


def mesh_error_table(found: MeshError) -> TextTable:
    """Readings by the share of their accuracy that is lost to mesh error, the largest first."""
    rows = []
    for i, j in _places(found)[:_MOST]:
        unit = found.units[i], found.dimensions[i]
        numbers = (
            found.computed[i, j],
            found.change[i, j],
            found.error[i, j],
            found.accuracy[i, j],
        )
        shown = [number(in_unit(float(value), *unit)) for value in numbers]
        share = f"{100.0 * found.share[i, j]:.3g} %"
        rows.append([found.channels[i], found.stages[j], *shown, shown_unit(*unit) or "-", share])
    header = ("gauge", "stage", "computed", "change", "error", "accuracy", "unit", "share")
    return TextTable(header, rows, right="llrrrrlr")


def _places(found: MeshError) -> list[tuple[int, int]]:
    """Channel and stage of every reading, the largest share first."""
    share = np.where(np.isfinite(found.share), found.share, -1.0)
    order = np.argsort(-share, axis=None, kind="stable")
    places = zip(*np.unravel_index(order, share.shape), strict=True)
    return [(int(i), int(j)) for i, j in places if share[i, j] >= 0.0]


def mesh_error_text(case: str, found: MeshError, said: str) -> str:
    """The table, the sentence and what else is to be known.

    Args:
        case: path of the case, or of a result.
        found: of its mesh.
        said: what it means for the readings, a sentence.
    """
    count = len(_places(found))
    more = f" (the {_MOST} largest of {count})" if count > _MOST else ""
    return sections(
        f"{case}: {_HOW[found.how].format(*found.elements)}",
        section(f"Error of the computed readings by the mesh{more}", mesh_error_table(found).text),
        section("Findings", bullets([said, *found.notes])),
        f"Cost: {counts_text(found.cost)}, those of the finer mesh among them",
    )


def mesh_error_object(case: str, found: MeshError, said: str) -> dict[str, Any]:
    """The same for programs, SI.

    Args:
        case: path of the case, or of a result.
        found: of its mesh.
        said: what it means for the readings, a sentence.
    """
    return {
        "case": case,
        "how": found.how,
        "elements": found.elements[0],
        "refined_elements": found.elements[1],
        "order": found.order,
        "finding": said,
        "notes": found.notes,
        "counts": asdict(found.cost),
        "readings": [
            {
                "gauge": found.channels[i],
                "stage": found.stages[j],
                "computed": found.computed[i, j],
                "change": found.change[i, j],
                "error": found.error[i, j],
                "accuracy": found.accuracy[i, j],
                "share": found.share[i, j],
                "unit": DIMENSIONS[found.dimensions[i]],
            }
            for i, j in _places(found)
        ],
    }
