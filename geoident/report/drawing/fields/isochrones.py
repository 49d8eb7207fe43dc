"""Isochrones: pressure of water in excess of that at rest over the depth, at moments of the stages.

Along upright lines through the piezometers; without any, through the largest pressure.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.arrays import Floats
from geoident.report.drawing.scene import Scene, SheetView
from geoident.report.drawing.style import (
    FAINT,
    Picture,
    evenly,
    key,
    panel_grid,
    short,
    stress_unit,
)
from geoident.report.text.case import gauge_entry

_MOST_LINES = 6
"""Panels, evenly spread over the lines."""

_MOST_STATES = 9
_PLACES = 121
_MARGIN = 0.15
"""Of the height of the ground that holds water, above and below it."""

_NEAR = 0.02
"""Lines that are closer than this part of the width are one."""

_CAPTION = (
    "Pressure of the pore water in excess of that at rest, over the height y or z, at some moments "
    "of the stages that last; dashed: after the last reading of the fit. Dots: piezometers on the "
    "line, read at these moments, less the pressure at rest."
)


def isochrone_pictures(scene: Scene) -> tuple[Picture, ...]:
    """One figure, where water takes time to leave in a plane model; of a solid its main section."""
    if scene.fields.excess is None or not scene.views:
        return ()
    return (
        Picture(
            "isochrones",
            "Isochrones of excess pore pressure",
            _CAPTION,
            partial(isochrone_figure, scene.views[0]),
        ),
    )


def isochrone_figure(view: SheetView) -> Figure:
    """A panel for each upright line."""
    excess, at = _excess(view), _lines(view)
    states = _states(view, excess)
    under = view.scene.fields.mesh.points[excess.any(axis=0), view.across[1]]
    margin = _MARGIN * float(np.ptp(under))
    low, high = under.min() - margin, under.max() + margin
    unit, size = stress_unit(float(np.abs(excess[states]).max()))
    figure, panels = panel_grid(len(at), height=3.2, extra=0.9)
    colours = colormaps["viridis"](np.linspace(0.0, 0.92, len(states)))
    name, upright = (view.scene.axis_names[axis] for axis in view.across)
    for axes, x in zip(panels, at, strict=True):
        for state, paint in zip(states, colours, strict=True):
            y, values = _along(view, state, x, excess[state])
            later = state > view.scene.last_fitted
            axes.plot(values / size, y, color=paint, lw=1.2, ls="--" if later else "-")
            _dots(axes, view, state, x, size, paint)
        axes.set_ylim(low, high)
        axes.axvline(0.0, color=FAINT, lw=0.6)
        axes.set_title(f"{name} = {x:.4g} m")
        axes.set_xlabel(f"excess pressure ({unit})")
    panels[0].set_ylabel(f"{upright} (m)")
    handles = [
        key(short(view.scene.stage(state), 26), color=paint, lw=1.2,
            ls="--" if state > view.scene.last_fitted else "-")
        for state, paint in zip(states, colours, strict=True)
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _excess(view: SheetView) -> Floats:
    """(n_states, n_nodes) Pa."""
    excess = view.scene.fields.excess
    assert excess is not None
    return excess


def _piezometers(view: SheetView) -> list[int]:
    """Numbers of the channels on the sheet that read the pressure of the water."""
    result = view.scene.result
    table = result.gauges
    return [
        n
        for n, (gauge, point) in enumerate(zip(table.gauges, table.second, strict=True))
        if gauge_entry(result, gauge).get("kind") == "piezometer" and view.holds(point[None])[0]
    ]


def _lines(view: SheetView) -> list[float]:
    """Where the upright lines are, m."""
    across, points = view.across[0], view.scene.fields.mesh.points
    at = sorted(view.scene.result.gauges.second[_piezometers(view), across].tolist())
    if not at:
        return [float(points[np.abs(_excess(view)).max(axis=0).argmax(), across])]
    near = _NEAR * float(np.ptp(points[:, across]))
    apart = [x for n, x in enumerate(at) if not n or x - at[n - 1] > near]
    return [apart[k] for k in evenly(len(apart), _MOST_LINES)]


def _states(view: SheetView, excess: Floats) -> list[int]:
    """States with pressures, so many; those that piezometers were read at rather than others."""
    gauges = view.scene.result.gauges
    there = [n for n in view.scene.reached.tolist() if np.any(excess[n])]
    read = np.asarray(np.isfinite(gauges.measured[_piezometers(view)]).any(axis=0))
    told = [n for n in there if read[n - 1]]
    chosen = told if len(told) > 1 else there
    return [chosen[k] for k in evenly(len(chosen), _MOST_STATES)]


def _along(view: SheetView, state: int, x: float, excess: Floats) -> tuple[Floats, Floats]:
    """Heights (k,), m, and pressures (k,), Pa, along a line; NaN outside the ground."""
    points = view.scene.fields.mesh.points
    low, high = points[:, view.across[1]].min(), points[:, view.across[1]].max()
    y = np.linspace(low, high, _PLACES)
    sites = view.sites(state, np.column_stack([np.full(_PLACES, x), y]))
    values = [np.nan if site is None else site.shapes @ excess[site.nodes] for site in sites]
    return y, np.array(values)


def _dots(axes: Axes, view: SheetView, state: int, x: float, size: float, paint: Any) -> None:
    """What piezometers on a line read at a state, less the pressure at rest."""
    gauges, excess = view.scene.result.gauges, _excess(view)[state]
    across, upright = view.across
    near = _NEAR * float(np.ptp(view.scene.fields.mesh.points[:, across]))
    for row in _piezometers(view):
        point, read = gauges.second[row], gauges.measured[row, state - 1]
        if abs(point[across] - x) > near or not np.isfinite(read):
            continue
        (site,) = view.sites(state, point[None, [across, upright]])
        if site is not None:
            value = read - gauges.computed[row, state - 1] + site.shapes @ excess[site.nodes]
            axes.plot(value / size, point[upright], "o", ms=3.5, color=paint)
