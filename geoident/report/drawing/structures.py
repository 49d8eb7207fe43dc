"""Structures and interfaces in the picture of a case: where they stand, and how they end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from geoident.fem.shells import corners_of
from geoident.fem.structures import straight_pieces
from geoident.forward.structures.placing import hinge_nodes
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.mesh import Mesh
from geoident.model.structures import (
    Anchors,
    Bars,
    Beam,
    Bolts,
    GroutedBars,
    Piles,
    Shell,
    Structure,
    Struts,
)
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.style import key, short

INK = "#6a1b6a"
_WORDS: Mapping[type[Structure], tuple[str, dict[str, Any]]] = {
    Beam: ("wall or lining", {"lw": 2.4}),
    Shell: ("shell", {"lw": 0.6}),
    Bolts: ("bolt", {"lw": 1.0}),
    Struts: ("strut", {"lw": 1.6, "ls": (0, (4, 1))}),
    Anchors: ("anchor (thick: grouted)", {"lw": 1.0}),
    GroutedBars: ("bolt (thick: grouted)", {"lw": 1.0}),
    Piles: ("pile", {"lw": 1.0}),
}
_INTERFACE: dict[str, Any] = {"color": "#a3182d", "lw": 1.6, "ls": (0, (5, 1, 1, 1))}
_ENDS = {"fixed": ("fixed end", "s"), "symmetry": ("end on a plane of symmetry", "|")}


def draw_structures(axes: Any, case: Case, mesh: Mesh, *, names: bool = True) -> list[Any]:
    """Draws all structures and interfaces of a case into the picture of its mesh; what lines mean.

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
        elif isinstance(structure, Beam):
            meanings |= _draw_hinges(axes, mesh, structure)
        if names:
            middles = [line.mean(axis=0) for line in lines]
            place_labels(axes, [middles], [short(name)], avoid=lines, colour=INK)
    for name, interface in case.interfaces.items():
        if interface.along in mesh.facet_groups:
            meanings["interface"] = key("interface", **_INTERFACE)
            lines = _sides_of_faces(mesh, interface.along)
            for line in lines:
                axes.plot(*line.T, zorder=5.4, **_INTERFACE)
            if names:
                middles = [line.mean(axis=0) for line in lines]
                colour = str(_INTERFACE["color"])
                place_labels(axes, [middles], [short(name)], avoid=lines, colour=colour)
    return list(meanings.values())


def structure_lines(structure: Structure, mesh: Mesh) -> list[Floats]:
    """Lines (2, dim) of a structure, m."""
    if isinstance(structure, Beam):
        return list(mesh.points[straight_pieces(mesh, structure.group)])
    if isinstance(structure, Shell):
        return _sides_of_faces(mesh, structure.group)
    assert isinstance(structure, Bars)
    return [np.array(pair, dtype=np.float64) for pair in structure.ends]


def _sides_of_faces(mesh: Mesh, group: str) -> list[Floats]:
    """Lines (2, dim), m, around the faces of a group, each once; in the plane the faces."""
    faces = corners_of(mesh, mesh.facet_groups[group])
    sides = {tuple(sorted(s)) for own in faces for s in zip(own, own[1:] + own[:1], strict=True)}
    return list(mesh.points[np.array(sorted(sides))])


def _draw_ends(axes: Any, bars: Bars) -> dict[str, Any]:
    """Grouted lengths, and marks at ends that the mesh does not hold."""
    for first, second in np.array(bars.ends):
        if isinstance(bars, Anchors | GroutedBars):
            length = float(np.linalg.norm(second - first))
            grouted = bars.grouted if isinstance(bars, Anchors) else length - bars.free
            grout = np.stack([second - grouted / length * (second - first), second])
            axes.plot(*grout.T, color=INK, lw=3.2, alpha=0.55, zorder=5.5)
    if bars.second_end not in _ENDS:
        return {}
    label, marker = _ENDS[bars.second_end]
    style: dict[str, Any] = {"ls": "", "marker": marker, "ms": 5, "color": INK}
    axes.plot(*np.array([pair[1] for pair in bars.ends]).T, zorder=6, **style)
    return {label: key(label, **style)}


def _draw_hinges(axes: Any, mesh: Mesh, beam: Beam) -> dict[str, Any]:
    if not beam.hinges:
        return {}
    nodes = [hinge_nodes(mesh, beam, hinge) for hinge in beam.hinges]
    style: dict[str, Any] = {"ls": "", "marker": "o", "ms": 4, "mfc": "white", "color": INK}
    axes.plot(*mesh.points[np.concatenate(nodes)].T, zorder=6, **style)
    return {"hinge": key("hinge", **style)}
