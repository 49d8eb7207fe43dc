"""Interfaces: tractions, opening and slip along them or on them, and where they slip or open."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.interfaces import InterfaceStates, titled
from geoident.model.results.result import Result
from geoident.report.drawing.fields.panels import add_lines, draw_lines, finish, panel_figure
from geoident.report.drawing.forces import LINE_STYLES, chain
from geoident.report.drawing.scene import SheetView
from geoident.report.drawing.style import FAINT, WIDTH, Picture, colour, evenly, key, short
from geoident.report.drawing.unrolled import (
    MOST_SHEET_STAGES,
    MOST_SHEETS,
    Sheet,
    sheet_figure,
    sheets,
)

_MOST_STAGES = 8
_CORNERS = {3: 3, 7: 3, 4: 4, 9: 4}
"""Corners of a face in space by the number of its points."""

_FLAT = 1e-6
"""Sine of the dip below which a face has no strike: its first axis is x then."""

_STICKS, _SLIPS, _OPENS = "#4c78a8", "#e08214", "#c4122f"
_STATES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("sticks", {"color": _STICKS, "lw": 1.4}),
    ("slips", {"color": _SLIPS, "lw": 2.8}),
    ("opens", {"color": _OPENS, "lw": 2.8, "ls": (0, (1, 0.6))}),
)


def interface_pictures(result: Result) -> tuple[Picture, ...]:
    """Tractions and jumps along each interface, in space on its faces."""
    states = result.interfaces
    if states is None:
        return ()
    if states.points.shape[1] == 3:
        return tuple(_sheet_pictures(states))
    count = int(np.isfinite(states.normal_traction).any(axis=0).sum())
    words = (
        "Tension and opening are positive; slip is positive where the side beyond the interface "
        "moves to the left, seen across it. Rings: the shear traction is at its limit."
    )
    if count > _MOST_STAGES:
        words += f" Drawn are {_MOST_STAGES} of the {count} stages."
    return tuple(
        Picture(
            f"interface-{n}",
            f"Along the interface {titled(*line)}",
            words,
            partial(_along_figure, states, line),
        )
        for n, line in enumerate(states.lines, start=1)
    )


def _sheet_pictures(states: InterfaceStates) -> Iterator[Picture]:
    """Maps of interfaces in space, the largest pieces first; values are means over the faces."""
    points = states.face_points
    corners = np.full((len(points), 4, 3), np.nan)
    for face, own in zip(corners, points, strict=True):
        n = _CORNERS[len(own)]
        face[:n] = states.points[own[:n]]
    normals = states.normals[[own[0] for own in points]]
    level = np.cross([0.0, 0.0, 1.0], normals)
    flat = np.linalg.norm(level, axis=1) < _FLAT
    level[flat] = [1.0, 0.0, 0.0]
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    axes = np.stack([level, np.cross(normals, level), normals], axis=1)
    lines = [(states.interfaces[own[0]], states.sides[own[0]]) for own in points]
    every = sheets(corners, axes, "interface", [side for _, side in lines], either_way=True)
    for count, sheet in enumerate(every[:MOST_SHEETS], start=1):
        on_sheet = [points[face] for face in sheet.faces]
        there = np.isfinite(states.normal_traction[np.concatenate(on_sheet)]).any(axis=0)
        stages = np.flatnonzero(there)
        if not len(stages):
            continue
        names = list(dict.fromkeys(titled(*lines[face]) for face in sheet.faces))
        stages = stages[evenly(len(stages), MOST_SHEET_STAGES)]
        drawn = f"{len(stages)} of {int(there.sum())} stages"
        words = (
            f"{sheet.words} Axis 1 is level. Means over the faces; tension and opening are "
            f"positive, t_s and slip are sizes. Drawn are {drawn}, "
            f"{min(len(every), MOST_SHEETS)} of {len(every)} pieces."
        )
        yield Picture(
            f"interface-{count}",
            f"On the interface {short(', '.join(names), 60)}",
            words,
            partial(_sheet_figure, states, sheet, on_sheet, stages),
        )


def _sheet_figure(
    states: InterfaceStates, sheet: Sheet, points: list[Ints], stages: Ints
) -> Figure:
    """Maps of tractions and jumps on the faces of a sheet with these points."""
    rows = {}
    for name, values, factor in _quantities(states):
        means = np.full((len(points), len(stages)), np.nan)
        for mean, own in zip(means, points, strict=True):
            known = values[np.ix_(own, stages)]
            there = np.isfinite(known)
            some = there.any(axis=0)
            total = np.where(there, known, 0.0).sum(axis=0)
            mean[some] = factor * total[some] / there.sum(axis=0)[some]
        rows[name] = means
    return sheet_figure(sheet, rows, [states.stages[stage] for stage in stages])


def _quantities(states: InterfaceStates) -> tuple[tuple[str, Floats, float], ...]:
    """Name, values and factor of what is drawn."""
    return (
        ("t_n (kPa)", states.normal_traction, 1e-3),
        ("t_s (kPa)", states.shear_traction, 1e-3),
        ("opening (mm)", states.opening, 1e3),
        ("slip (mm)", states.slip, 1e3),
    )


def interface_map_pictures(view: SheetView) -> tuple[Picture, ...]:
    """Where interfaces slip and open, stage by stage; none in space, or where nothing ever does."""
    states = view.scene.result.interfaces
    if states is None or view.scene.solid or not (states.slips | states.parts).any():
        return ()
    words = (
        "Where the shear traction is at its limit an interface slips; at that of tension it opens."
    )
    draw = partial(_map_figure, view, states)
    return (Picture("interfaces", "Where interfaces slip and open, stage by stage", words, draw),)


def _faces(states: InterfaceStates) -> Ints:
    """(n, 2) numbers of the points at the ends of the faces of interfaces in the plane."""
    return np.array([face[:2] for face in states.face_points])


def _along_figure(states: InterfaceStates, line: tuple[str, str]) -> Figure:
    """Four panels over the length of an interface, or of its side, a line for each stage."""
    faces = _faces(states)
    faces = faces[np.isin(faces[:, 0], states.of(*line))]
    order, turned, label, along = chain(states.points[faces])
    ends = np.where(turned[:, None], faces[order][:, ::-1], faces[order]).ravel()
    there = np.flatnonzero(np.isfinite(states.normal_traction[ends]).any(axis=0))
    stages = there[evenly(len(there), _MOST_STAGES)]
    figure = Figure(figsize=(WIDTH, 4.8))
    grid = figure.subplots(2, 2, sharex=True)
    for axes, (title, values, factor) in zip(grid.ravel(), _quantities(states), strict=True):
        axes.axhline(0.0, color=FAINT, lw=0.6)
        for k, stage in enumerate(stages):
            style: dict[str, Any] = {"color": colour(k), "ls": LINE_STYLES[k % 4], "lw": 1.2}
            axes.plot(along.ravel(), factor * values[ends, stage], **style)
            at = states.slips[ends, stage]
            if title.startswith("t_s") and at.any():
                axes.plot(along.ravel()[at], factor * values[ends, stage][at], ls="", marker="o",
                          ms=4, mfc="none", color=colour(k))  # fmt: skip
        axes.set_ylabel(title)
        axes.grid(visible=True)
        axes.yaxis.set_major_locator(MaxNLocator(5))
    for axes in grid[1]:
        axes.set_xlabel(label.replace("the line", "the interface"))
    handles = [
        key(short(states.stages[stage], 24), color=colour(k), ls=LINE_STYLES[k % 4])
        for k, stage in enumerate(stages)
    ]
    figure.legend(handles=handles, loc="outside right upper")
    return figure


def _map_figure(view: SheetView, states: InterfaceStates) -> Figure:
    """The ground with its interfaces, sticking, slipping and open, in a panel for each stage."""
    shown = [state for state in view.scene.states if state]
    figure, panels = panel_figure(view, len(shown))
    for axes, state in zip(panels, shown, strict=True):
        draw_lines(axes, view, state, on_white=True)
        for part, (_, style) in zip(_by_state(states, state - 1), _STATES, strict=True):
            if len(part):
                add_lines(axes, view, part, zorder=4, **style)
        finish(axes, view, state)
    handles = [key(word, **style) for word, style in _STATES]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def _by_state(states: InterfaceStates, stage: int) -> tuple[Floats, Floats, Floats]:
    """Lines (k, 2, 2), m, that stick, slip and open: the halves of faces next to their points."""
    faces = _faces(states)
    ends = states.points[faces]
    middles = ends.mean(axis=1, keepdims=True)
    halves = np.stack([ends, np.broadcast_to(middles, ends.shape)], axis=2).reshape(-1, 2, 2)
    points = faces.ravel()
    there = np.isfinite(states.normal_traction[points, stage])
    slips, parts = states.slips[points, stage], states.parts[points, stage]
    masks: tuple[Bools, ...] = (there & ~slips & ~parts, there & slips, there & parts)
    sticks, slipping, opening = (halves[mask] for mask in masks)
    return sticks, slipping, opening
