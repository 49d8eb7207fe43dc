"""Supports, loads and water as marks in a picture of a model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.transforms import ScaledTranslation

from geoident.fem.faces import face_table, load_patches
from geoident.forward.actions.supports import all_supports, group_nodes, support_nodes
from geoident.model.actions import (
    FaceLoad,
    HeadForce,
    Load,
    PointForce,
    Pressure,
    Seismic,
    Traction,
    Water,
    WaterPressure,
)
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar, Values
from geoident.model.structures import Bars
from geoident.report.drawing.model.construction import Construction, stress_text
from geoident.report.drawing.style import key
from geoident.report.text.layout import number

LOAD, WATER = "#a52714", "#1f5fa8"
_SUPPORT: dict[str, Any] = {"ls": "", "ms": 4.5, "mec": "black", "mew": 0.7}
_POINTING = {(0, 1): ">", (0, -1): "<", (1, 1): "^", (1, -1): "v"}
_OFF = 3.2  # from the edge of the model to the middle of a mark, points
_MOST_MARKS = 11
_MOST_ARROWS = 9
_ROUND = 0.2  # across to along, from which on a group goes round


def draw_supports(axes: Any, case: Case, mesh: Mesh, box: tuple[Floats, Floats]) -> list[Any]:
    """Triangles along what is held, outside of the model; what they mean.

    One that points at the model holds it along its own direction, a black one in all directions.

    Args:
        axes: of the plane.
        case: the case.
        mesh: its mesh.
        box: its low and high corner, each of shape (2,), m: marks beyond it are left out.
    """
    meanings: dict[str, Any] = {}
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for support in all_supports(case):
        fixed = len(support.components) == mesh.dim
        held_nodes = support_nodes(mesh, support)
        nodes = _some(held_nodes, mesh)
        points = mesh.points[nodes]
        span = np.ptp(mesh.points[held_nodes], axis=0)
        axis = int(span.argmin()) if fixed else support.components[0]
        side = 1 if points[:, axis].mean() < (low[axis] + high[axis]) / 2 else -1
        style = {**_SUPPORT, "mfc": "black" if fixed else "white"}
        away = np.zeros(2)
        marker = "D" if support.moves else "s"
        if span.min() <= _ROUND * span.max():  # along a side, not all around
            marker = _POINTING[axis, side]
            away[axis] = -side * _OFF / 72
        moved = axes.transData + ScaledTranslation(away[0], away[1], axes.figure.dpi_scale_trans)
        points = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
        if not len(points):
            continue
        axes.plot(*points.T, zorder=5, clip_on=False, transform=moved, marker=marker, **style)
        held = " and ".join("xyz"[c] for c in support.components)
        label = "held in all directions" if fixed else f"held along {held}"
        label = label.replace("held", "moved") if support.moves else label
        meanings.setdefault(label, key(label, marker=marker, **style))
    return list(meanings.values())


def _some(nodes: Ints, mesh: Mesh) -> Ints:
    """Nodes evenly out of many, from one end to the other."""
    points = mesh.points[nodes]
    span = np.ptp(points, axis=0)
    along = points[:, span.argmax()]
    if span.min() > _ROUND * span.max():  # all around, not along a side
        away = points - (points.min(axis=0) + points.max(axis=0)) / 2
        along = np.arctan2(away[:, 1], away[:, 0])
    order = nodes[np.argsort(along, kind="stable")]
    wanted = np.linspace(along.min(), along.max(), _MOST_MARKS)
    nearest = np.abs(np.sort(along)[:, None] - wanted[None]).argmin(axis=0)
    return np.asarray(order[np.unique(nearest)])


@dataclass(frozen=True)
class ShownLoad:
    """A load as it is drawn: where it acts and what is written at it.

    Args:
        label: what it is called, its size and its stages.
        tips: (k, dim) where its arrows end, m; none where it has no place.
        arrows: (k, dim) its arrows, the longest of length 1.
        water: whether water is the load.
        level: of the water, m; None for no water.
    """

    label: str
    tips: Floats
    arrows: Floats
    water: bool = False
    level: float | None = None


def shown_loads(
    case: Case, mesh: Mesh, made: Construction, values: Values
) -> tuple[ShownLoad, ...]:
    """The loads of a case, those of one name and place together.

    Args:
        case: the case.
        mesh: its mesh.
        made: what happens in its stages.
        values: of the parameters, SI.
    """
    acting: dict[tuple[str, str, type], list[tuple[int, Load]]] = {}
    for n, name, load in _all_loads(case):
        acting.setdefault((name, _place(load), type(load)), []).append((n, load))
    return tuple(
        _shown(name, loads, case, mesh, made, values, several=len(case.stages) > 1)
        for (name, _, _), loads in acting.items()
    )


def _all_loads(case: Case) -> Iterator[tuple[int, str, Load]]:
    """Stage (0 for the beginning), name and load of every entry of a case."""
    yield from ((0, name, load) for name, load in case.loads.items())
    for n, stage in enumerate(case.stages, start=1):
        yield from ((n, name, load) for name, load in stage.loads.items())


def _place(load: Load) -> str:
    """The group or the point where a load acts; nothing for one that acts on all ground."""
    if isinstance(load, Seismic):
        return ""
    if isinstance(load, HeadForce):
        return load.structure
    return str(load.place) if isinstance(load, PointForce) else str(load.group)


def _shown(
    name: str,
    loads: list[tuple[int, Load]],
    case: Case,
    mesh: Mesh,
    made: Construction,
    values: Values,
    *,
    several: bool,
) -> ShownLoad:
    sizes = [_size(load, values) for _, load in loads]
    stage, load = loads[int(np.argmax([abs(size) for size in sizes]))]
    label = f"{name}: {_words(load, min(sizes), max(sizes))}"
    if several:
        numbers = sorted({n for n, _ in loads})
        label += " (from the beginning)" if numbers == [0] else f" ({_stages(numbers)})"
    if isinstance(load, HeadForce):
        tips, arrows = _on_heads(load, case, values)
    else:
        tips, arrows = _arrows(load, mesh, made, stage, values)
    longest = float(np.linalg.norm(arrows, axis=1).max(initial=0.0)) or 1.0
    level = load.level.value(values) if isinstance(load, WaterPressure) else None
    return ShownLoad(label, tips, arrows / longest, level is not None, level)


def _stages(numbers: list[int]) -> str:
    """Numbers of stages in few words.

    >>> _stages([2]), _stages([2, 3, 4]), _stages([2, 5]), _stages([1, 2, 4, 6])
    ('stage 2', 'stages 2 to 4', 'stages 2, 5', '4 stages, 1 to 6')
    """
    numbers = [n for n in numbers if n]
    if len(numbers) == 1:
        return f"stage {numbers[0]}"
    if numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"stages {numbers[0]} to {numbers[-1]}"
    if len(numbers) > 3:
        return f"{len(numbers)} stages, {numbers[0]} to {numbers[-1]}"
    return "stages " + ", ".join(map(str, numbers))


def _size(load: Load, values: Values) -> float:
    match load:
        case Pressure():
            return load.value.value(values)
        case WaterPressure():
            return load.level.value(values)
        case Traction() | PointForce():
            return float(np.linalg.norm(_vector(load.value, values)))
        case HeadForce():
            return load.value.value(values)
        case Seismic():
            return float(np.linalg.norm(_vector(load.factors, values)))


def _words(load: Load, low: float, high: float) -> str:
    """The size of a load, from the smallest to the largest."""
    match load:
        case WaterPressure():
            return f"water to {_range(low, high, 4)} m"
        case PointForce() | HeadForce():
            return f"{_range(low / 1e3, high / 1e3, 3)} kN"
        case Seismic():
            return f"{_range(low, high, 3)} of the weight"
        case _:
            first, last = stress_text(low), stress_text(high)
            if first.split()[1] == last.split()[1] and first != last:
                first = first.split()[0]
            return first if first == last else f"{first} to {last}"


def _range(low: float, high: float, digits: int) -> str:
    first, last = number(low, digits), number(high, digits)
    return first if first == last else f"{first} to {last}"


def _vector(numbers: tuple[Scalar, ...], values: Values) -> Floats:
    return np.array([scalar.value(values) for scalar in numbers])


def _on_heads(load: HeadForce, case: Case, values: Values) -> tuple[Floats, Floats]:
    """The same of a pull or push on the heads of bars."""
    bars = case.structures[load.structure]
    assert isinstance(bars, Bars)
    head, toe = np.array(bars.ends, dtype=np.float64).swapaxes(0, 1)
    along = (head - toe) / np.linalg.norm(head - toe, axis=1)[:, None]
    if load.direction is not None:
        along = np.broadcast_to(load.direction, along.shape)
    return head, along * np.sign(load.value.value(values))


def _arrows(
    load: FaceLoad | PointForce | Seismic,
    mesh: Mesh,
    made: Construction,
    stage: int,
    values: Values,
) -> tuple[Floats, Floats]:
    """Tips (k, dim), m, and sizes with directions (k, dim) of the arrows of a load."""
    none = np.empty((0, mesh.dim))
    if isinstance(load, Seismic):
        return none, none
    if isinstance(load, PointForce):
        value = _vector(load.value, values)
        tip = _point_of(load, mesh)
        return tip[None], value[None] / (float(np.linalg.norm(value)) or 1.0)
    faces = load_patches(mesh, face_table(mesh), load.group, made.present[stage])
    if not faces:
        return none, none
    corners = [mesh.points[f.nodes[:, : CELLS[f.kind].n_corners]] for f in faces]
    middle = np.concatenate([c.mean(axis=1) for c in corners])
    inward = np.concatenate([-_normals(c) for c in corners])
    along = middle[:, np.ptp(middle, axis=0).argmax()]
    order = np.argsort(along, kind="stable")
    kept = order[np.unique(np.linspace(0, len(order) - 1, _MOST_ARROWS).astype(int))]
    middle, inward = middle[kept], inward[kept]
    if isinstance(load, Traction):
        return middle, np.broadcast_to(_vector(load.value, values), middle.shape).copy()
    if isinstance(load, Pressure):
        return middle, inward * np.sign(load.value.value(values))
    depth = np.maximum(load.level.value(values) - middle[:, -1], 0.0)
    return middle[depth > 0], (inward * depth[:, None])[depth > 0]


def _point_of(load: PointForce, mesh: Mesh) -> Floats:
    if isinstance(load.place, str):
        return np.asarray(mesh.points[group_nodes(mesh, load.place)].mean(axis=0))
    return np.array(load.place, dtype=np.float64)


def _normals(corners: Floats) -> Floats:
    """(n, dim) outward unit normals of faces (n, n_corners, dim)."""
    along = corners[:, 1] - corners[:, 0]
    if corners.shape[2] == 2:
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    else:
        normal = np.cross(along, corners[:, 2] - corners[:, 0])
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def water_levels(case: Case, mesh: Mesh, values: Values) -> dict[str, Floats]:
    """Label to line (k, dim), m, of the water in the pores.

    Args:
        case: with water before the first stage or from a stage on.
        mesh: with the nodes of a water table that is a group.
        values: of the parameters, which a level may be.
    """
    levels: dict[str, Floats] = {}
    states: list[tuple[int, Water]] = [(0, case.water)] if case.water is not None else []
    states += [(n, s.water) for n, s in enumerate(case.stages, start=1) if s.water is not None]
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for n, water in states:
        when = f" (stage {n})" if n else ""
        if isinstance(water.table, str):
            points = mesh.points[group_nodes(mesh, water.table)]
            levels[f"water table{when}"] = points[np.argsort(points[:, 0], kind="stable")]
        else:
            level = water.table.value(values)
            ends = np.array([low, high])
            ends[:, -1] = level
            levels[f"water table {number(level)} m{when}"] = ends
    return levels
