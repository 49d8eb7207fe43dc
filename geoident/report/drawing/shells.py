"""What shells bear: colour maps of their forces and moments on their faces, stage by stage.

Faces that go on smoothly into each other make a sheet, whatever shells they belong to: the linings
of the rounds of a tunnel are one, wall and floor of a pit are two. A sheet is drawn flat where that
shows it true: one that lies in a plane, and one whose straight lines are parallel, such as a
tunnel, unrolled from the crown. Others are drawn in space.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from geoident.model.arrays import Floats, Ints
from geoident.model.results.result import Result
from geoident.model.results.shells import ShellForces
from geoident.report.drawing.fields.panels import bands
from geoident.report.drawing.space import add_faces, frame
from geoident.report.drawing.style import MIDDLE, STRESSES, WIDTH, Picture, evenly, short

_MOST_STAGES = 3
_MOST_SHEETS = 6
_KILO = 1e3
_SMOOTH = np.cos(np.radians(40.0))
"""Of the angle between the normals of faces that go on into each other."""

_STRAIGHT = 0.03
"""How far the normals of a sheet may lean along its straight lines, in the mean."""

_NOTHING = 1e-6
"""N per metre over N m per metre: a plate bears no normal force."""

_ANGLES = (24.0, -58.0)
"""Elevation and azimuth of the eye, degrees."""


@dataclass(frozen=True)
class _Sheet:
    """Some faces, and how they are laid flat.

    Args:
        faces: (n,) rows of the table of forces.
        places: (n, 4, 2) corners in the picture, m; of a sheet in space (n, 4, 3).
        labels: what the coordinates of a flat one are.
        words: how it is drawn.
    """

    faces: Ints
    places: Floats
    labels: tuple[str, ...]
    words: str


def shell_pictures(result: Result) -> tuple[Picture, ...]:
    """Normal forces and moments of each sheet of shells, the largest sheets first."""
    forces = result.shells
    if forces is None:
        return ()
    sheets = _sheets(forces)
    left_out = len(sheets) - _MOST_SHEETS
    note = f" {left_out} smaller pieces of shells are not drawn." if left_out > 0 else ""
    pictures = []
    for count, sheet in enumerate(sheets[:_MOST_SHEETS], start=1):
        names = list(dict.fromkeys(forces.structures[k] for k in sheet.faces))
        title = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
        stages = np.flatnonzero(np.isfinite(forces.normal[sheet.faces, 0]).any(axis=0))
        if not len(stages):
            continue
        some = f" Drawn are {_MOST_STAGES} of the {len(stages)} stages with forces."
        pictures.append(
            Picture(
                f"shell-{count}",
                f"Forces in {short(title, 60)}",
                f"{sheet.words} Per metre, means over the faces; n is positive in tension, m with "
                f"tension on the inside."
                f"{some if len(stages) > _MOST_STAGES else ''}{note}",
                partial(_figure, forces, sheet, stages[evenly(len(stages), _MOST_STAGES)]),
            )
        )
    return tuple(pictures)


def _sheets(forces: ShellForces) -> list[_Sheet]:
    """The sheets of all shells, the largest first."""
    keys = forces.corners.round(6)
    at: dict[frozenset[tuple[float, ...]], list[int]] = {}
    for n, own in enumerate(keys.tolist()):
        ring = [tuple(x) for x in own if x[0] == x[0]]
        for pair in zip(ring, ring[1:] + ring[:1], strict=True):
            at.setdefault(frozenset(pair), []).append(n)
    normals = forces.axes[:, 2]
    joined = [
        faces
        for faces in at.values()
        if len(faces) == 2 and normals[faces[0]] @ normals[faces[1]] > _SMOOTH
    ]
    pairs = np.array(joined, dtype=np.int64).reshape(-1, 2)
    n = len(normals)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, piece = connected_components(graph, directed=False)
    order = np.argsort(-np.bincount(piece), kind="stable")
    return [_laid_out(forces, np.flatnonzero(piece == k)) for k in order]


def _laid_out(forces: ShellForces, faces: Ints) -> _Sheet:
    """Some faces in a plane where they can be laid flat, else in space."""
    corners, normals = forces.corners[faces], forces.axes[faces, 2]
    _, spread, directions = np.linalg.svd(normals)
    if len(faces) < 3 or spread[1] < _STRAIGHT * spread[0]:
        along, across = forces.axes[faces[0], :2]
        places = np.stack([corners @ along, corners @ across], axis=2)
        words = "The shell in its plane, axis 1 to the right."
        return _Sheet(faces, places, ("along axis 1 (m)", "along axis 2 (m)"), words)
    if spread[2] > _STRAIGHT * spread[0]:
        return _Sheet(faces, corners, (), "The shell where it is.")
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
    words = f"The shell unrolled: along it, and around it from {start}, to the right as one looks "
    words += "along it."
    return _Sheet(faces, places, ("along (m)", f"around from {start} (m)"), words)


def _figure(forces: ShellForces, sheet: _Sheet, stages: Ints) -> Figure:
    """A row for each force, a column for each stage; a row has one scale."""
    rows = _rows(forces, sheet, stages)
    flat, unrolled = bool(sheet.labels), "along (m)" in sheet.labels
    known = sheet.places[np.isfinite(sheet.places[..., 0])]
    low, high = known.min(axis=0), known.max(axis=0)
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.3, 1.6)) if flat else 0.9
    height = (WIDTH - 1.2) / max(len(stages), 2) * aspect + 0.35
    figure = Figure(figsize=(WIDTH, 0.5 + height * len(rows)))
    grid: Any = figure.subplots(
        len(rows), len(stages), squeeze=False, sharex=flat, sharey=flat,
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
    for axes, stage in zip(grid[0], stages, strict=True):
        axes.set_title(short(forces.stages[stage], 24))
    if flat:
        for axes in grid[-1]:
            axes.set_xlabel(sheet.labels[0])
        figure.supylabel(sheet.labels[1], fontsize=MIDDLE)
    return figure


def _rows(forces: ShellForces, sheet: _Sheet, stages: Ints) -> Mapping[str, Floats]:
    """The forces (n_faces, n_stages) that are drawn, kN/m and kNm/m, by their names."""
    normal, moment = (
        each[sheet.faces][:, :, stages] / _KILO for each in (forces.normal, forces.moment)
    )
    bears = np.nanmax(np.abs(normal)) > _NOTHING * np.nanmax(np.abs(moment))
    rows = {f"n_{part} (kN/m)": normal[:, k] for k, part in enumerate(("11", "22")) if bears}
    return rows | {f"m_{part} (kNm/m)": moment[:, k] for k, part in enumerate(("11", "22"))}
