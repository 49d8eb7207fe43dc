"""Interfaces in the plane: tractions, opening and slip along them, and where they slip or open."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.interfaces import InterfaceStates
from geoident.model.results.result import Result
from geoident.report.drawing.fields.panels import add_lines, draw_lines, finish, panel_figure
from geoident.report.drawing.forces import LINE_STYLES, chain
from geoident.report.drawing.scene import SheetView
from geoident.report.drawing.style import FAINT, WIDTH, Picture, colour, evenly, key, short

_MOST_STAGES = 8
_STICKS, _SLIPS, _OPENS = "#4c78a8", "#e08214", "#c4122f"
_STATES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("sticks", {"color": _STICKS, "lw": 1.4}),
    ("slips", {"color": _SLIPS, "lw": 2.8}),
    ("opens", {"color": _OPENS, "lw": 2.8, "ls": (0, (1, 0.6))}),
)


def interface_pictures(result: Result) -> tuple[Picture, ...]:
    """Tractions and jumps along each interface of a model in the plane."""
    states = result.interfaces
    if states is None or states.points.shape[1] != 2:
        return ()
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
            f"Along the interface {name}",
            words,
            partial(_along_figure, states, name),
        )
        for n, name in enumerate(states.names, start=1)
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


def _faces(states: InterfaceStates, name: str) -> Ints:
    """(n, 2) numbers of the points at the ends of the faces of an interface in the plane."""
    own = [face[:2] for face in states.face_points if states.interfaces[face[0]] == name]
    return np.array(own)


def _along_figure(states: InterfaceStates, name: str) -> Figure:
    """Four panels over the length of an interface, a line for each stage."""
    faces = _faces(states, name)
    order, turned, label, along = chain(states.points[faces])
    ends = np.where(turned[:, None], faces[order][:, ::-1], faces[order]).ravel()
    there = np.flatnonzero(np.isfinite(states.normal_traction[ends]).any(axis=0))
    stages = there[evenly(len(there), _MOST_STAGES)]
    panels: tuple[tuple[str, Floats, float], ...] = (
        ("t_n (kPa)", states.normal_traction, 1e-3),
        ("t_s (kPa)", states.shear_traction, 1e-3),
        ("opening (mm)", states.opening, 1e3),
        ("slip (mm)", states.slip, 1e3),
    )
    figure = Figure(figsize=(WIDTH, 4.8))
    grid = figure.subplots(2, 2, sharex=True)
    for axes, (title, values, factor) in zip(grid.ravel(), panels, strict=True):
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
    faces = np.concatenate([_faces(states, name) for name in states.names])
    ends = states.points[faces]
    middles = ends.mean(axis=1, keepdims=True)
    halves = np.stack([ends, np.broadcast_to(middles, ends.shape)], axis=2).reshape(-1, 2, 2)
    points = faces.ravel()
    there = np.isfinite(states.normal_traction[points, stage])
    slips, parts = states.slips[points, stage], states.parts[points, stage]
    masks: tuple[Bools, ...] = (there & ~slips & ~parts, there & slips, there & parts)
    sticks, slipping, opening = (halves[mask] for mask in masks)
    return sticks, slipping, opening
