"""Surfaces of solids: the outer faces in perspective, whole, cut open along a section, deformed."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from geoident.fem.faces import face_table, patches
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.report.drawing.fields import bands
from geoident.report.drawing.scene import Scene, box_around, gauge_points
from geoident.report.drawing.sheets import Plane, Sheet, element_centres
from geoident.report.drawing.style import LENGTHS, MEASURED, MM, Picture, box_axes

_VIEW = {0: (22.0, -145.0), 1: (22.0, -60.0), 2: (40.0, -55.0)}
_MOST_FACES = 60_000


def solid_pictures(scene: Scene) -> tuple[Picture, ...]:
    """Surface views; nothing for a plane model."""
    if not scene.solid or not scene.sheets:
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
            "The part in front of the section is removed. Orange: points of the gauges. " + colours,
            lambda: surface_figure(scene, sheet, 0.0),
        ),
        Picture(
            "cut-away-deformed",
            f"The same, displacements {factor:g} times magnified",
            f"Faces moved by the displacement, {factor:g} times magnified. {colours}",
            lambda: surface_figure(scene, sheet, factor),
        ),
    )


def _opening(scene: Scene) -> Sheet:
    """The section along which the model is opened: an upright one, the best of those."""
    upright = [s for s in scene.sheets if s.plane is not None and s.plane.axis != 2]
    sideways = [s for s in upright if s.plane is not None and s.plane.axis == 0]
    return (sideways or upright or list(scene.sheets))[0]


def surface_figure(scene: Scene, opened: Sheet | None, factor: float) -> Figure:
    """The last fitted and the last stage side by side.

    Args:
        scene: what to draw.
        opened: section along which the part around the gauges is opened; None: the whole model.
        factor: magnification of the displacements.
    """
    states = scene.key_states
    figure = Figure(figsize=(5.2 * len(states), 4.9))
    values = [MM * np.linalg.norm(scene.displacement(s), axis=1) for s in states]
    every = np.concatenate(values)
    scale = bands(np.stack([every, np.ones_like(every)]), LENGTHS)
    shown: Any = None
    for k, (state, value) in enumerate(zip(states, values, strict=True)):
        axes: Any = figure.add_subplot(1, len(states), k + 1, projection="3d")
        axes.computed_zorder = False
        shown = _draw_faces(axes, scene, state, _kept(scene, state, opened), value, factor, scale)
        if opened is not None:
            axes.scatter(*gauge_points(scene.result.gauges).T, color=MEASURED, s=5, zorder=5)
        _finish(axes, scene, state, opened)
    bar = figure.colorbar(
        shown, extend=scale["extend"], ax=figure.axes, location="bottom", shrink=0.6, aspect=45
    )
    bar.set_label("displacement (mm)")
    return figure


def _kept(scene: Scene, state: int, opened: Sheet | None) -> Bools:
    """Elements that are shown: the present ones, behind the section and near the gauges."""
    kept = scene.fields.present[state].copy()
    if opened is not None and opened.plane is not None:
        centres = element_centres(scene.fields.mesh)
        low, high = box_around(scene.near, scene.box)
        kept &= ((centres >= low) & (centres <= high)).all(axis=1)
        offset = centres[:, opened.plane.axis] - opened.plane.value
        kept &= _side(scene, opened.plane) * offset > -1e-9
    return np.asarray(kept)


def _side(scene: Scene, plane: Plane) -> float:
    """The side of a section, 1 or -1, on which more of the model lies around the gauges."""
    low, high = box_around(scene.near, scene.box)
    return 1.0 if high[plane.axis] - plane.value >= plane.value - low[plane.axis] else -1.0


def _draw_faces(
    axes: Any,
    scene: Scene,
    state: int,
    kept: Bools,
    value: Floats,
    factor: float,
    scale: dict[str, Any],
) -> Any:
    """Outer faces of the kept elements, far ones first, each in the mean colour of its corners."""
    points = scene.fields.mesh.points + factor * scene.displacement(state)
    polygons: list[Floats] = []
    means: list[Floats] = []
    for nodes in _outer_faces(scene, kept):
        polygons += list(points[nodes])
        means.append(value[nodes].mean(axis=1))
    edges = 0.12 if len(polygons) < _MOST_FACES / 4 else 0.0
    faces = Poly3DCollection(
        polygons,
        cmap=scale["cmap"],
        norm=scale["norm"],
        edgecolors=(0, 0, 0, 0.35),
        linewidths=edges,
        rasterized=True,
        zorder=1,
    )
    faces.set_array(np.concatenate(means))
    axes.add_collection3d(faces)
    return faces


def _outer_faces(scene: Scene, kept: Bools) -> list[Ints]:
    """Corner nodes (n, 3 or 4) of the faces that bound the kept elements."""
    mesh = scene.fields.mesh
    table = face_table(mesh)
    return [
        patch.nodes[:, : CELLS[patch.kind].n_corners]
        for patch in patches(mesh, table, table.free(kept))
    ]


def _finish(axes: Any, scene: Scene, state: int, opened: Sheet | None) -> None:
    low, high = scene.box if opened is None else box_around(scene.near, scene.box)
    box_axes(axes, low, high)
    axes.set_box_aspect(high - low, zoom=0.9)
    axes.set_proj_type("ortho")
    elevation, azimuth = _VIEW[2]
    if opened is not None and opened.plane is not None:
        elevation, azimuth = _VIEW[opened.plane.axis]
        azimuth += 180.0 if _side(scene, opened.plane) < 0 else 0.0
    axes.view_init(elevation, azimuth)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    axes.set_title(scene.title(state), loc="left")
