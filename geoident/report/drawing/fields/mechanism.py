"""The mechanism of a collapse: bands of shear in colours, velocities as arrows."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import element_centres
from geoident.model.results.yielded import Mechanism
from geoident.report.drawing.sheets import Plane, Sheet, SheetMaker
from geoident.report.drawing.style import COMPUTED, Picture, short

_MOVES = 0.05
"""Part of the largest velocity from which on ground is shown."""

_ROOM = 0.25
_ACROSS = 26  # arrows
_LONGEST = 1.4  # of an arrow, in distances between arrows
_WIDTH = 7.0
_COLOURS = "YlOrRd"
_FEWEST_COLOURS = 0.02


def mechanism_picture(
    mechanism: Mechanism, axis_names: tuple[str, ...], factor: float | None = None
) -> Picture:
    """The picture of a mechanism.

    Args:
        mechanism: the mechanism.
        axis_names: names of the axes.
        factor: by which strength is divided; None where the ground fails with its own strength.
    """
    carried, what = "", "for the loads of this stage"
    if factor is not None:
        what += f" with strength divided by {factor:.3g}"
    if np.isfinite(mechanism.fraction):
        carried = f" {100.0 * mechanism.fraction:.3g} % of its change of load is in equilibrium."
    words = (
        f"No equilibrium was found {what}. Arrows: velocities with which the "
        "ground moves then, in proportion to each other. Colours: rate of shear in parts of the "
        f"largest; bands of it part what slides from what stays.{carried}"
    )
    draw = partial(mechanism_figure, mechanism, axis_names)
    return Picture("mechanism", f"Mechanism at stage {mechanism.stage}", words, draw)


def mechanism_figure(mechanism: Mechanism, axis_names: tuple[str, ...]) -> Figure:
    """Rates of shear in colours and velocities as arrows, where the ground moves.

    Of a solid the cut through the place of the strongest shear that shows most of the motion.

    Args:
        mechanism: the mechanism.
        axis_names: names of the axes.
    """
    sheet = _sheet(mechanism)
    xy, across = sheet.xy, list(sheet.axes)
    here = mechanism.present[sheet.element]
    moved = sheet.of_nodes(mechanism.velocity)[:, across]
    low, high = _window(xy, moved, sheet.triangles[here])
    width, height = high - low
    figure = Figure(figsize=(_WIDTH, max(2.6, 0.85 * _WIDTH * height / width) + 0.9),
                    layout="compressed")  # fmt: skip
    axes = figure.subplots()
    shown = Triangulation(xy[:, 0], xy[:, 1], sheet.triangles[here])
    rate = np.maximum(mechanism.shear[sheet.element[here]], _FEWEST_COLOURS)
    shading = axes.tripcolor(
        shown, facecolors=rate, cmap=_COLOURS, vmin=0.0, vmax=1.0, rasterized=True, zorder=0
    )
    outline = sheet.outline(mechanism.present).at(mechanism.mesh.points)[:, :, across]
    axes.add_collection(LineCollection(list(outline), colors="black", linewidths=0.8))
    _arrows(axes, xy, moved, np.unique(sheet.triangles[here]), (low, high))
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel(f"{axis_names[across[0]]} (m)")
    axes.set_ylabel(f"{axis_names[across[1]]} (m)")
    where = "" if sheet.plane is None else f", section {sheet.plane}"
    axes.set_title(f"Mechanism at stage {short(mechanism.stage, 24)}{where}{_carried(mechanism)}")
    bar = figure.colorbar(shading, ax=axes, location="bottom", shrink=0.6, aspect=45)
    bar.set_label("rate of shear, of the largest")
    return figure


def _carried(mechanism: Mechanism) -> str:
    """What is carried, for a title; empty where that is not known."""
    known = np.isfinite(mechanism.fraction)
    return f": {100.0 * mechanism.fraction:.3g} % of its load in equilibrium" if known else ""


def _sheet(mechanism: Mechanism) -> Sheet:
    """The plane of the mesh; of a solid a cut, upright, through the place of the largest shear."""
    maker = SheetMaker(mechanism.mesh)
    if mechanism.mesh.dim == 2:
        return maker.flat()
    place = element_centres(mechanism.mesh)[int(np.argmax(mechanism.shear))]
    size = np.abs(mechanism.velocity[:, :2]).sum(axis=0)
    axis = int(np.argmin(size))  # across the direction in which less moves
    return maker.cut(Plane(axis, float(place[axis])))


def _window(xy: Floats, moved: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    """Corners (2,) of what moves, with room around it."""
    used = np.unique(triangles)
    speed = np.linalg.norm(moved[used], axis=1)
    moving = xy[used[speed > _MOVES * speed.max(initial=0.0)]]
    if not len(moving):
        moving = xy[used]
    low, high = moving.min(axis=0), moving.max(axis=0)
    room = _ROOM * float((high - low).max() or 1.0)
    return (
        np.maximum(low - room, xy[used].min(axis=0)),
        np.minimum(high + room, xy[used].max(axis=0)),
    )


def _arrows(
    axes: Axes, xy: Floats, moved: Floats, used: Ints, window: tuple[Floats, Floats]
) -> None:
    """Velocities at nodes about evenly apart."""
    low, high = window
    apart = float((high - low).max()) / _ACROSS
    places = xy[used]
    inside = np.all((places >= low) & (places <= high), axis=1)
    cell = np.floor((places - low) / apart).astype(np.int64)
    off = np.linalg.norm((places - low) / apart - cell - 0.5, axis=1)
    order = np.lexsort((off, cell[:, 1], cell[:, 0]))
    order = order[inside[order]]
    _, first = np.unique(cell[order], axis=0, return_index=True)
    chosen = used[order[first]]
    speed = np.linalg.norm(moved[chosen], axis=1)
    largest = float(speed.max(initial=0.0)) or 1.0
    chosen = chosen[speed > 0.02 * largest]
    tips = _LONGEST * apart / largest * moved[chosen]
    axes.quiver(*xy[chosen].T, *tips.T, angles="xy", scale_units="xy", scale=1.0, color=COMPUTED,
                units="inches", width=0.014, zorder=4)  # fmt: skip
