"""Maps of values on faces in space, laid flat where that shows them true.

Faces that go on smoothly into each other make a sheet: the linings of the rounds of a tunnel are
one, wall and floor of a pit are two. A sheet is drawn flat if it lies in a plane, and if its
straight lines are parallel, such as a tunnel, unrolled from the crown. Others are drawn in space.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geoident.model.arrays import Floats, Ints
from geoident.report.drawing.fields.panels import bands
from geoident.report.drawing.space import add_faces, frame
from geoident.report.drawing.style import MIDDLE, STRESSES, WIDTH, short

MOST_SHEET_STAGES = 3
MOST_SHEETS = 6
"""Stages, and sheets, that are drawn."""

_SMOOTH = np.cos(np.radians(40.0))
"""Of the angle between the normals of faces that go on into each other."""

_STRAIGHT = 0.03
"""How far the normals of a sheet may lean along its straight lines, in the mean."""

_ANGLES = (24.0, -58.0)
"""Elevation and azimuth of the eye, degrees."""


@dataclass(frozen=True)
class Sheet:
    """Some faces, and how they are laid flat.

    Args:
        faces: (n,) numbers of the faces.
        places: (n, 4, 2) corners in the picture, m; of a sheet in space (n, 4, 3).
        labels: what the coordinates of a flat one are.
        words: how it is drawn.
    """

    faces: Ints
    places: Floats
    labels: tuple[str, ...]
    words: str


def sheets(
    corners: Floats,
    axes: Floats,
    what: str,
    sides: Sequence[str] = (),
    *,
    either_way: bool = False,
) -> list[Sheet]:
    """The sheets of some faces, the largest first.

    Args:
        corners: (n, 4, 3) of the faces, m; NaN for the fourth of a triangle.
        axes: (n, 3, 3) of each face two directions in it and its normal.
        what: they are, for a sentence.
        sides: of each face, where faces on several sides of something lie at the same place.
        either_way: whether normals of neighbours may be opposite.
    """
    keys = corners.round(6)
    at: dict[frozenset[tuple[float, ...]], list[int]] = {}
    for n, own in enumerate(keys.tolist()):
        ring = [tuple(x) for x in own if x[0] == x[0]]
        for pair in zip(ring, ring[1:] + ring[:1], strict=True):
            at.setdefault(frozenset(pair), []).append(n)
    normals = axes[:, 2]
    joined = [
        pair
        for faces in at.values()
        for pair in combinations(faces, 2)
        if _bend(*normals[list(pair)], either_way=either_way) > _SMOOTH
        and (not sides or sides[pair[0]] == sides[pair[1]])
    ]
    pairs = np.array(joined, dtype=np.int64).reshape(-1, 2)
    n = len(normals)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, piece = connected_components(graph, directed=False)
    order = np.argsort(-np.bincount(piece), kind="stable")
    return [_laid_out(corners, axes, np.flatnonzero(piece == k), what) for k in order]


def _bend(one: Floats, other: Floats, *, either_way: bool) -> float:
    """Cosine of the angle between two normals."""
    return float(abs(one @ other) if either_way else one @ other)


def _laid_out(corners: Floats, axes: Floats, faces: Ints, what: str) -> Sheet:
    """Some faces in a plane where they can be laid flat, else in space."""
    corners, normals = corners[faces], axes[faces, 2]
    _, spread, directions = np.linalg.svd(normals)
    if len(faces) < 3 or spread[1] < _STRAIGHT * spread[0]:
        along, across = axes[faces[0], :2]
        places = np.stack([corners @ along, corners @ across], axis=2)
        words = f"The {what} in its plane, axis 1 to the right."
        return Sheet(faces, places, ("along axis 1 (m)", "along axis 2 (m)"), words)
    if spread[2] > _STRAIGHT * spread[0]:
        return Sheet(faces, corners, (), f"The {what} where it is.")
    lines = directions[2] * np.sign(directions[2][np.argmax(np.abs(directions[2]))])
    upwards = np.eye(3)[2 if abs(lines[2]) < 1.0 / np.sqrt(2.0) else 0]
    up = upwards - (upwards @ lines) * lines
    up /= np.linalg.norm(up)
    section = np.stack([corners @ np.cross(lines, up), corners @ up], axis=2)
    known = section[np.isfinite(section[..., 0])]
    fitted = np.linalg.lstsq(np.c_[2.0 * known, np.ones(len(known))], (known**2).sum(axis=1))[0]
    radius = float(np.sqrt(fitted[2] + fitted[:2] @ fitted[:2]))
    x, y = np.moveaxis(section - fitted[:2], 2, 0)
    angle = np.arctan2(x, y)
    angle += 2.0 * np.pi * np.round((angle[:, :1] - angle) / (2.0 * np.pi))  # no face is cut
    places = np.stack([corners @ lines, radius * angle], axis=2)
    start = "the crown" if upwards[2] else "x"
    words = f"The {what} unrolled: along it, and around it from {start}, to the right as one looks "
    words += "along it."
    return Sheet(faces, places, ("along (m)", f"around from {start} (m)"), words)


def sheet_figure(sheet: Sheet, rows: Mapping[str, Floats], titles: Sequence[str]) -> Figure:
    """A row for each quantity, a column for each stage; a row has one scale.

    Args:
        sheet: the faces.
        rows: name to values (n_faces, n_stages), NaN where there is none.
        titles: of the stages.
    """
    flat, unrolled = bool(sheet.labels), "along (m)" in sheet.labels
    known = sheet.places[np.isfinite(sheet.places[..., 0])]
    low, high = known.min(axis=0), known.max(axis=0)
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.3, 1.6)) if flat else 0.9
    height = (WIDTH - 1.2) / max(len(titles), 2) * aspect + 0.35
    figure = Figure(figsize=(WIDTH, 0.5 + height * len(rows)))
    grid: Any = figure.subplots(
        len(rows), len(titles), squeeze=False, sharex=flat, sharey=flat,
        subplot_kw={} if flat else {"projection": "3d", "computed_zorder": False},
    )  # fmt: skip
    for (name, values), row in zip(rows.items(), grid, strict=True):
        shown = values[np.isfinite(values)]
        scale = bands(np.stack([shown, np.ones(len(shown))]), STRESSES)
        colours = ScalarMappable(scale["norm"], scale["cmap"])
        for axes, one in zip(row, values.T, strict=True):
            there = np.flatnonzero(np.isfinite(one))
            polygons = [p[np.isfinite(p[:, 0])] for p in sheet.places[there]]
            shades = np.asarray(colours.to_rgba(one[there]))
            if flat:
                style: dict[str, Any] = {"edgecolors": "face", "linewidths": 0.2}
                axes.add_collection(PolyCollection(polygons, facecolors=shades, **style))
                axes.set_xlim(low[0], high[0])
                axes.set_ylim(*((high[1], low[1]) if unrolled else (low[1], high[1])))
                axes.set_aspect("equal")
            else:
                add_faces(axes, polygons, shades, edgecolors="#606060", linewidths=0.2)
                frame(axes, (low, high), _ANGLES)
        figure.colorbar(colours, ax=row.tolist(), label=name, shrink=0.9)
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(short(title, 24))
    if flat:
        for axes in grid[-1]:
            axes.set_xlabel(sheet.labels[0])
        figure.supylabel(sheet.labels[1], fontsize=MIDDLE)
    return figure
