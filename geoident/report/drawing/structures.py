"""Pictures of structures: where they stand in a case, and what they bear in a result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from geoident.forward.structures.members import hinge_nodes, straight_pieces
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.mesh import Mesh
from geoident.model.results.result import MemberForces, Result
from geoident.model.structures import Anchors, Bars, Beam, Bolts, Structure, Struts
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.style import FAINT, SMALL, Picture, colour, hide_unused, key, short

INK = "#6a1b6a"
_HALO = [withStroke(linewidth=2.0, foreground="white")]
_WORDS: Mapping[type[Structure], tuple[str, dict[str, Any]]] = {
    Beam: ("wall or lining", {"lw": 2.4}),
    Bolts: ("bolt", {"lw": 1.0}),
    Struts: ("strut", {"lw": 1.6, "ls": (0, (4, 1))}),
    Anchors: ("anchor (thick: grouted)", {"lw": 1.0}),
}
_ENDS = {"fixed": ("fixed end", "s"), "symmetry": ("end on a plane of symmetry", "|")}
_MOST_STAGES = 8
_KILO = 1e3
_PER_ROW = 4


def draw_structures(axes: Any, case: Case, mesh: Mesh, *, names: bool = True) -> list[Any]:
    """Draws all structures of a case into the picture of its mesh; what the lines mean.

    Args:
        axes: of the plane or of space.
        case: the case.
        mesh: its mesh.
        names: whether their names are written.
    """
    meanings: dict[str, Any] = {}
    for name, structure in case.structures.items():
        label, style = _WORDS[type(structure)]
        meanings[label] = key(label, color=INK, **style)
        lines = structure_lines(structure, mesh)
        for line in lines:
            axes.plot(*line.T, color=INK, zorder=5.5, solid_capstyle="butt", **style)
        if isinstance(structure, Bars):
            meanings |= _draw_ends(axes, structure)
        else:
            meanings |= _draw_hinges(axes, mesh, structure)
        if names:
            middles = [line.mean(axis=0) for line in lines]
            place_labels(axes, [middles], [short(name)], avoid=lines, colour=INK)
    return list(meanings.values())


def structure_lines(structure: Structure, mesh: Mesh) -> list[Floats]:
    """Lines (2, dim) of a structure, m."""
    if isinstance(structure, Beam):
        return list(mesh.points[straight_pieces(mesh, structure.group)])
    return [np.array(pair, dtype=np.float64) for pair in structure.ends]


def _draw_ends(axes: Any, bars: Bars) -> dict[str, Any]:
    """Grouted lengths, and marks at ends that the mesh does not hold."""
    for first, second in np.array(bars.ends):
        if isinstance(bars, Anchors):
            along = (second - first) / np.linalg.norm(second - first)
            grout = np.stack([second - bars.grouted * along, second])
            axes.plot(*grout.T, color=INK, lw=3.2, alpha=0.55, zorder=5.5)
    if bars.second_end not in _ENDS:
        return {}
    label, marker = _ENDS[bars.second_end]
    style: dict[str, Any] = {"ls": "", "marker": marker, "ms": 5, "color": INK}
    axes.plot(*np.array([pair[1] for pair in bars.ends]).T, zorder=6, **style)
    return {label: key(label, **style)}


def _draw_hinges(axes: Any, mesh: Mesh, beam: Beam) -> dict[str, Any]:
    nodes = [hinge_nodes(mesh, beam, hinge) for hinge in beam.hinges]
    if not nodes:
        return {}
    style: dict[str, Any] = {"ls": "", "marker": "o", "ms": 4, "mfc": "white", "color": INK}
    axes.plot(*mesh.points[np.concatenate(nodes)].T, zorder=6, **style)
    return {"hinge": key("hinge", **style)}


def structure_pictures(result: Result) -> tuple[Picture, ...]:
    """Forces along each wall or lining, and in bars from stage to stage."""
    found = result.members
    if found is None:
        return ()
    names = np.array(found.structures)
    beams = [str(n) for n in dict.fromkeys(names[found.per_metre])]
    bars = [str(n) for n in dict.fromkeys(names[~found.per_metre])]
    pictures = [
        Picture(
            f"forces-{number}",
            f"Forces in {name}",
            "Per metre, at each stage at which it stands. Tension is positive; a moment is "
            "positive with tension on the right when one goes along the line from its beginning.",
            partial(_beam_figure, found, name),
        )
        for number, name in enumerate(beams, start=1)
    ]
    if bars:
        pictures.append(
            Picture(
                "bar-forces",
                "Forces in struts, anchors and bolts",
                "Axial force of each bar, tension positive. A ring is the force that a jack gave, "
                "at which the bar was locked off.",
                partial(_bar_figure, found, bars),
            )
        )
    return tuple(pictures)


def _beam_figure(found: MemberForces, name: str) -> Figure:
    members = np.flatnonzero(np.array(found.structures) == name)
    stages = np.flatnonzero(np.isfinite(found.axial[members[0]]))
    if len(stages) > _MOST_STAGES:
        stages = stages[
            np.unique(np.linspace(0, len(stages) - 1, _MOST_STAGES).round().astype(int))
        ]
    order, turned, label, along = _chain(found.ends[members])
    members = members[order]
    panels = [("M (kNm/m)", found.moment), ("N (kN/m)", found.axial), ("Q (kN/m)", found.shear)]
    if np.isfinite(found.hoop[members]).any():
        panels.append(("hoop N (kN/m)", found.hoop))
    figure = Figure(figsize=(10.0, 3.6))
    for axes, (title, forces) in zip(
        np.atleast_1d(figure.subplots(1, len(panels), sharey=True)), panels, strict=True
    ):
        axes.axvline(0.0, color=FAINT, lw=0.6)
        for k, stage in enumerate(stages):
            here = forces[members][..., stage] / _KILO
            if here.ndim == 1:
                here = np.stack([here, here], axis=1)
            here = np.where(turned[:, None], here[:, ::-1], here)
            axes.plot(here.ravel(), along.ravel(), color=colour(k), lw=1.2)
        axes.set_xlabel(title)
        axes.grid(visible=True)
        axes.xaxis.set_major_locator(MaxNLocator(4))
    figure.axes[0].set_ylabel(label)
    handles = [key(short(found.stages[s], 24), color=colour(k)) for k, s in enumerate(stages)]
    figure.legend(handles=handles, loc="outside right upper")
    return figure


def _chain(ends: Floats) -> tuple[Ints, Floats, str, Floats]:
    """Pieces of a beam in their order along it.

    Args:
        ends: (n, 2, dim) of the pieces, m.

    Returns:
        Order (n,), which of them (in that order) are turned round (n,), what the coordinate is, and
        the coordinate (n, 2) of their ends in the order: y of a wall that stands upright, else the
        length along the line.
    """
    keys = [tuple(point) for point in ends.round(6).reshape(-1, ends.shape[2]).tolist()]
    at: dict[tuple[float, ...], list[int]] = {}
    for n, place in enumerate(keys):
        at.setdefault(place, []).append(n // 2)
    single = [n for n, place in enumerate(keys) if len(at[place]) == 1]
    left, order, turned = set(range(len(ends))), [], []
    here = keys[single[0]] if single else keys[0]
    while left:
        following = next((n for n in at[here] if n in left), None)
        if following is None:
            following = min(left)
            here = keys[2 * following]
        left.discard(following)
        order.append(following)
        turned.append(keys[2 * following] != here)
        here = keys[2 * following] if turned[-1] else keys[2 * following + 1]
    chosen, back = np.array(order), np.array(turned)
    pieces = np.where(back[:, None, None], ends[chosen][:, ::-1], ends[chosen])
    if np.ptp(pieces[..., 0]) <= 1e-3 * np.ptp(pieces[..., 1]):
        return chosen, back, "y (m)", np.asarray(pieces[..., 1])
    length = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1)
    end = np.cumsum(length)
    return chosen, back, "along the line (m)", np.stack([end - length, end], axis=1)


def _bar_figure(found: MemberForces, names: list[str]) -> Figure:
    rows = -(-len(names) // _PER_ROW)
    figure = Figure(figsize=(10.0, 1.0 + 2.6 * rows))
    grid = figure.subplots(rows, min(len(names), _PER_ROW), squeeze=False)
    panels = list(grid.ravel())
    for axes, (name, members) in zip(panels, _bars_of(found, names), strict=False):
        _draw_bars(axes, found, members)
        axes.set_title(short(name, 24))
    hide_unused(panels, len(names))
    return figure


def _bars_of(found: MemberForces, names: list[str]) -> Iterator[tuple[str, Ints]]:
    every = np.array(found.structures)
    return ((name, np.flatnonzero(every == name)) for name in names)


def _draw_bars(axes: Axes, found: MemberForces, members: Ints) -> None:
    places = np.arange(len(found.stages))
    for k, member in enumerate(members[:7]):
        axes.plot(places, found.axial[member] / _KILO, "-o", ms=3, lw=1.2, color=colour(k),
                  label=f"bar {found.numbers[member]}")  # fmt: skip
        axes.plot(places, found.prestress[member] / _KILO, ls="", marker="o", ms=8, mfc="none",
                  color=colour(k))  # fmt: skip
    for member in members[7:]:
        axes.plot(places, found.axial[member] / _KILO, "-", lw=0.6, color=FAINT)
    axes.axhline(0.0, color=FAINT, lw=0.6)
    axes.set_xticks(places, [short(s, 12) for s in found.stages], rotation=45, ha="right")
    axes.set_xlim(-0.5, len(places) - 0.5)
    axes.set_ylabel("N (kN)")
    axes.grid(visible=True, axis="y")
    if len(members) > 1:
        axes.legend(fontsize=SMALL)
