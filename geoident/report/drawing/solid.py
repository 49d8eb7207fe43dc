"""Surfaces of solids: the outside in perspective, whole, cut open along a section, deformed.

What is opened is cut through elements by planes: along the section and where the part around the
gauges ends. The cuts are flat, whatever the mesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from geoident.fem.faces import patches
from geoident.model.arrays import Bools, Floats
from geoident.model.cells import CELLS
from geoident.report.drawing.fields.panels import bands
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.polygons import Polygons
from geoident.report.drawing.scene import Scene, box_around
from geoident.report.drawing.sheets import Plane, Sheet, Trace
from geoident.report.drawing.space import Box, add_faces, add_lines, frame, hidden, towards
from geoident.report.drawing.style import GAUGE, LENGTHS, MM, WIDTH, Picture, short

_VIEW = {0: (22.0, -145.0), 1: (22.0, -60.0), 2: (40.0, -55.0)}
_PLACE, _MOTION, _VALUE = slice(0, 3), slice(3, 6), 6
"""Columns of polygons: m, m, mm."""
_MOST_NAMES = 30
_SHADOW = 0.1  # darkness of what faces along x
_SIDE = 0.1  # free on both sides of a view, of its width


def solid_pictures(scene: Scene) -> tuple[Picture, ...]:
    """Surface views; nothing for a plane model."""
    if not scene.solid or not scene.views:
        return ()
    sheet = _opening(scene)
    low, high = box_around(scene.near, scene.box)
    factor = scene.magnification(float((high - low).max()))
    colours = f"Colours: size of the displacement {scene.since}."
    return (
        Picture(
            "surface",
            "Surface of the model",
            f"The whole model. {colours}",
            lambda: surface_figure(scene, None, 0.0),
        ),
        Picture(
            "cut-away",
            f"The model around the gauges, opened along {sheet.plane}",
            "The part in front of the section is removed. Black: gauges that can be seen. "
            + colours,
            lambda: surface_figure(scene, sheet, 0.0),
        ),
        Picture(
            "cut-away-deformed",
            f"The same, displacements {factor:g} times magnified",
            f"Moved by the displacement, {factor:g} times magnified. {colours}",
            lambda: surface_figure(scene, sheet, factor),
        ),
    )


def _opening(scene: Scene) -> Sheet:
    """The section along which the model is opened: an upright one, the best of those."""
    sheets = [view.sheet for view in scene.views]
    return min(sheets, key=lambda sheet: sheet.plane.axis if sheet.plane is not None else 2)


def surface_figure(scene: Scene, opened: Sheet | None, factor: float) -> Figure:
    """The outside of the model, or of its part behind a section, at the key states.

    Args:
        scene: what is drawn.
        opened: the section; None for the whole model.
        factor: by which the displacement moves it; 0 for none.
    """
    states = scene.key_states
    figure = Figure(figsize=(WIDTH if len(states) > 1 else 0.7 * WIDTH, 4.4))
    figure.set_layout_engine("none")
    view = _View(scene, opened)
    drawn = [view.polygons(state) for state in states]
    values = np.concatenate([_means(polygons) for polygons in drawn], axis=1)
    scale = bands(values, LENGTHS)
    for k, (state, polygons) in enumerate(zip(states, drawn, strict=True)):
        part = 1.0 / len(states)  # names of axes in space take part in no layout
        place = (part * (k + _SIDE), 0.25, part * (1.0 - 2.0 * _SIDE), 0.67)
        axes: Any = figure.add_axes(place, projection="3d", computed_zorder=False)
        _draw_bands(axes, polygons, factor, scale)
        _draw_lines(axes, view, state, factor)
        if opened is not None and factor == 0.0:
            _draw_gauges(axes, view, polygons)
        frame(axes, view.box, view.angles, zoom=0.82)
        axes.set_title(scene.title(state), loc="left")
    below = figure.add_axes((0.2, 0.12, 0.6, 0.022))
    bar = figure.colorbar(
        ScalarMappable(scale["norm"], scale["cmap"]), cax=below, orientation="horizontal"
    )
    bar.set_label("displacement (mm)")
    return figure


class _View:
    """What is seen of a model, and from where.

    Args:
        scene: what is drawn.
        opened: along which section it is opened; None for the whole model.
    """

    def __init__(self, scene: Scene, opened: Sheet | None) -> None:
        self.scene = scene
        self.box = scene.box if opened is None else _opened_box(scene, opened)
        self.angles = _VIEW[2]
        self.cuts: list[Sheet] = []
        if opened is not None and opened.plane is not None:
            elevation, azimuth = _VIEW[opened.plane.axis]
            azimuth += 180.0 if _side(scene, opened.plane) < 0 else 0.0
            self.angles = elevation, azimuth
            self.cuts = self._visible_cuts()

    def _visible_cuts(self) -> list[Sheet]:
        """Cuts along the sides of the box that are turned to the eye and lie in the ground."""
        sections = []
        size = self.scene.box[1] - self.scene.box[0]
        for axis in range(3):
            value = self.box[1 if towards(self.angles)[axis] > 0 else 0][axis]
            room = min(value - self.scene.box[0][axis], self.scene.box[1][axis] - value)
            if room > 1e-7 * size[axis]:
                sections.append(self.scene.section(Plane(axis, float(value))))
        return sections

    def polygons(self, state: int) -> Polygons:
        """The surface in a state, with its motion and the size of that."""
        moved = self.scene.displacement(state)
        table = np.hstack(
            [self.scene.fields.mesh.points, moved, MM * np.linalg.norm(moved, axis=1)[:, None]]
        )
        parts = self._faces(state, table)
        for sheet in self.cuts:
            shown = sheet.triangles[self.scene.fields.present[state][sheet.element]]
            values = sheet.of_nodes(table)
            values[:, _VALUE] = MM * np.linalg.norm(values[:, _MOTION], axis=1)
            parts.append(values[shown])
        polygons = Polygons.of([part for part in parts if len(part)])
        size = float((self.scene.box[1] - self.scene.box[0]).max())
        for axis in range(3):
            for bound, above in ((self.box[0][axis], True), (self.box[1][axis], False)):
                rim = -1e-9 * size if above else 1e-9 * size
                polygons = polygons.clipped(axis, float(bound) + rim, above=above)
        return polygons

    def _faces(self, state: int, table: Floats) -> list[Floats]:
        """Outer faces of the ground, kind by kind."""
        mesh, faces = self.scene.fields.mesh, self.scene.views[0].sheet.faces
        return [
            table[patch.nodes[:, : CELLS[patch.kind].n_corners]]
            for patch in patches(mesh, faces, faces.free(self.scene.fields.present[state]))
        ]


def _opened_box(scene: Scene, opened: Sheet) -> Box:
    """The box around the gauges behind a section."""
    low, high = box_around(scene.near, scene.box)
    plane = opened.plane
    assert plane is not None
    low, high = low.copy(), high.copy()
    (low if _side(scene, plane) > 0 else high)[plane.axis] = plane.value
    return low, high


def _side(scene: Scene, plane: Plane) -> float:
    """The side of a section, 1 or -1, on which more of the model lies around the gauges."""
    low, high = box_around(scene.near, scene.box)
    return 1.0 if high[plane.axis] - plane.value >= plane.value - low[plane.axis] else -1.0


def _means(polygons: Polygons) -> Floats:
    """(2, n) mean value and area of polygons."""
    area = 0.5 * np.linalg.norm(polygons.normals, axis=2).sum(axis=1)
    value = (polygons.points[:, :, _VALUE] * polygons.filled).sum(axis=1) / polygons.count
    return np.stack([value, area])


def _draw_bands(axes: Any, polygons: Polygons, factor: float, scale: dict[str, Any]) -> None:
    """Polygons in the colours of the bands in which their values lie; far ones are drawn first."""
    levels = np.asarray(scale["levels"])
    corners: list[Floats] = []
    colours = []
    for k, part in polygons.in_bands(_VALUE, levels):
        middle = (levels[max(k, 0)] + levels[min(k + 1, len(levels) - 1)]) / 2
        value = levels[0] - 1.0 if k < 0 else levels[-1] + 1.0 if k + 1 == len(levels) else middle
        colour = scale["cmap"](scale["norm"](value))
        moved = part.points[:, :, _PLACE] + factor * part.points[:, :, _MOTION]
        shade = part.brightness(_SHADOW)
        corners += Polygons(moved, part.count).corners()
        colours.append(np.c_[np.array(colour[:3])[None] * shade[:, None], np.ones(len(part))])
    rgba = np.concatenate(colours)
    add_faces(axes, corners, rgba, edgecolors=rgba, linewidths=0.15)


def _draw_lines(axes: Any, view: _View, state: int, factor: float) -> None:
    """Where the ground ends in the cuts, and faintly where groups meet there."""
    scene = view.scene
    for sheet in view.cuts:
        borders = sheet.borders(scene.borders_label(state))
        outline = sheet.outline(scene.fields.present[state])
        for trace, colour, width in ((borders, "white", 0.4), (outline, "black", 0.9)):
            add_lines(axes, _inside(trace, scene, state, factor, view.box), colour, width)


def _inside(trace: Trace, scene: Scene, state: int, factor: float, box: Box) -> Floats:
    """Those lines (k, 2, 3) of a trace that lie in a box, moved."""
    ends = trace.at(scene.fields.mesh.points)
    room = 1e-6 * float((scene.box[1] - scene.box[0]).max())
    kept = ((ends >= box[0] - room) & (ends <= box[1] + room)).all(axis=(1, 2))
    return np.asarray((ends + factor * trace.at(scene.displacement(state)))[kept])


def _draw_gauges(axes: Any, view: _View, polygons: Polygons) -> None:
    """Gauges that are not hidden, with their names if they are few."""
    table = view.scene.result.gauges
    every = np.stack([table.first, table.second], axis=1)
    known: Bools = np.asarray(np.isfinite(every).all(axis=2))
    behind = np.zeros(known.shape, dtype=bool)
    eye, surface = towards(view.angles), polygons.triangles[:, :, _PLACE]
    behind[known] = hidden(every[known] + 1e-6 * eye, surface, eye)
    names: dict[str, list[Floats]] = {}
    lines = []
    for k in np.flatnonzero(known.any(axis=1) & ~behind.any(axis=1)):
        ends = every[k, known[k]]
        axes.plot(*ends.T, "-o", color=GAUGE, lw=0.8, ms=2.0, zorder=5)
        lines.append(ends)
        names.setdefault(table.gauges[k], []).append(ends[-1])
    if len(names) <= _MOST_NAMES:
        place_labels(axes, [np.array(ends) for ends in names.values()],
                     [short(name, 20) for name in names], avoid=lines, colour=GAUGE)  # fmt: skip
