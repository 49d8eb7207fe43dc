"""The whole model in one figure: `check --picture` and the first figure of a report.

Colour says material and nothing else; stages are numbers and outlines. Every gauge has its name at
its place.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import partial

from matplotlib.figure import Figure

from geoident.model.case import Case
from geoident.model.mesh import Mesh
from geoident.model.results.result import ParameterTable, Result
from geoident.report.drawing.model.drawn import DrawnModel
from geoident.report.drawing.model.plane import plane_figure
from geoident.report.drawing.model.solid import solid_figure
from geoident.report.drawing.scene import case_of
from geoident.report.drawing.style import Picture, image


def case_picture(case: Case, mesh: Mesh, suffix: str) -> bytes:
    """The picture as a file, ``svg``, ``png`` or ``pdf``; the same case gives the same bytes.

    Args:
        case: the case.
        mesh: its mesh.
        suffix: of the file.
    """
    return image(model_picture(case, mesh), suffix)


def model_picture(case: Case, mesh: Mesh) -> Picture:
    """The picture of a case, not drawn yet."""
    return Picture("case", case.title, "", partial(model_figure, case, mesh))


def model_pictures(result: Result) -> tuple[Picture, ...]:
    """The model of a result with the values that were found; none without a mesh."""
    case = case_of(result)
    if case is None or result.fields is None:
        return ()
    mesh = result.fields.mesh
    caption = (
        "Colours: materials. Pale with an outline: excavated in the stage of the number; with a "
        "number only: placed in that stage."
    )
    if result.parameters.names:
        caption += " Constants that were identified have their values."
    marked: tuple[str, ...] = ()
    if result.plan is not None:
        marked = tuple(one.gauge for one in result.plan.chosen)
        caption += " Orange: the gauges to take."
    draw = partial(model_figure, case, mesh, result.parameters, marked)
    return (Picture("model", "The model: materials, construction, gauges", caption, draw),)


def model_figure(
    case: Case, mesh: Mesh, identified: ParameterTable | None = None, marked: Collection[str] = ()
) -> Figure:
    """The model with all that is in it.

    Args:
        case: the case.
        mesh: its mesh.
        identified: identified values, None before a fit.
        marked: names of gauges in another colour.
    """
    model = DrawnModel(case, mesh, identified, marked)
    if mesh.dim == 3:
        return solid_figure(model)
    return plane_figure(model)
