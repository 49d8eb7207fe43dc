"""What a picture of a case shows: which element belongs to what, and the colour of each thing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps

from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel
from geoident.model.mesh import Mesh

Colour = tuple[float, float, float]
_GROUND = ((0.91, 0.91, 0.89), (0.79, 0.83, 0.86), (0.86, 0.81, 0.76), (0.74, 0.74, 0.74))
_ORDER = "YlOrBr"
_PLACED = "YlGnBu"


@dataclass(frozen=True)
class Part:
    """Elements that are drawn alike.

    Args:
        label: for the legend.
        mark: for the place itself; empty for none.
        colour: red, green and blue.
        elements: indices of the elements.
    """

    label: str
    mark: str
    colour: Colour
    elements: Ints


def parts_of(case: Case, mesh: Mesh) -> tuple[Part, ...]:
    """Ground that stays, group by group; then what is dug and what is placed, stage by stage."""
    moved: dict[str, tuple[int, bool]] = {}
    for n, stage in enumerate(case.stages):
        for name in stage.excavate:
            moved.setdefault(name, (n, True))
        for name in stage.install:
            moved.setdefault(name, (n, False))
    still = [name for name in case.groups if name not in moved]
    parts = [
        Part(name, "", _GROUND[k % len(_GROUND)], mesh.groups[name]) for k, name in enumerate(still)
    ]
    for n, stage in enumerate(case.stages):
        for dug, verb in ((True, "excavated"), (False, "placed")):
            names = [name for name, when in moved.items() if when == (n, dug)]
            if names:
                elements = np.unique(np.concatenate([mesh.groups[name] for name in names]))
                colour = _in_order(n, len(case.stages), dug=dug)
                parts.append(Part(f"{n + 1}  {stage.name}: {verb}", str(n + 1), colour, elements))
    return tuple(part for part in parts if len(part.elements))


def _in_order(n: int, count: int, *, dug: bool) -> Colour:
    """Light for the first stage, dark for the last."""
    shade = colormaps[_ORDER if dug else _PLACED](0.2 + 0.55 * n / max(1, count - 1))
    return shade[0], shade[1], shade[2]


def gauge_lines(case: Case) -> dict[str, list[Floats]]:
    """Of each gauge, its lines: (2, dim) from point to point, (1, dim) for a point by itself, m."""
    lines: dict[str, list[Floats]] = {}
    for channel in case.channels:
        lines.setdefault(channel.gauge, []).append(_line(channel))
    return lines


def _line(channel: Channel) -> Floats:
    ends = [point for point in (channel.first, channel.second) if point is not None]
    return np.array(ends, dtype=np.float64)


def centre(mesh: Mesh, elements: Ints) -> Floats:
    """Middle of that element which lies next to the middle of all, (dim,) m."""
    middles = element_centres(mesh)[elements]
    nearest = np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin()
    return np.asarray(middles[nearest])


def element_centres(mesh: Mesh) -> Floats:
    """(n_elements, dim) means of the nodes, m."""
    return np.vstack([mesh.points[block.nodes].mean(axis=1) for block in mesh.blocks])


def window(case: Case, mesh: Mesh, parts: tuple[Part, ...]) -> tuple[Floats, Floats]:
    """The box around gauges and all that is dug or placed, with a margin, inside the mesh.

    Args:
        case: with gauges.
        mesh: its mesh.
        parts: what is dug, placed or neither.

    Returns:
        Its lower and its upper corner, (dim,) each, m.
    """
    points = [line for lines in gauge_lines(case).values() for line in lines]
    moved = [part.elements for part in parts if part.mark]
    if moved:
        points.append(element_centres(mesh)[np.concatenate(moved)])
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    if not points:
        return low, high
    inner = np.vstack(points)
    margin = 0.12 * float(np.ptp(inner, axis=0).max()) + 1e-9
    return np.maximum(low, inner.min(axis=0) - margin), np.minimum(high, inner.max(axis=0) + margin)
