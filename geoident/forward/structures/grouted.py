"""Grouted bars on the mesh: their stations, what holds them, and the parts that they are made of.

A structure of grouted bars is up to three parts of the analysis (`members.StructureMembers`): the
grouted lengths, which bear its name; free lengths from plates to the grout, which are plain bars
and are stressed by a jack as these are; and toes of piles, springs that only press.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from geoident.fem.grouted_bars import GroutedRows, stations
from geoident.fem.location import Site
from geoident.fem.structures import Members
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis, Case
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.mesh import Mesh, with_stations
from geoident.model.structures import Bars, GroutedBars, Piles, PileToes

_Ends = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
BarLines = tuple[tuple[_Ends, float, int], ...]
"""What says where the stations of all grouted bars of a case are: ends, free length, pieces."""


def bar_lines(case: Case) -> BarLines:
    """Where the grouted bars of a case are, for each such structure."""
    bars = (one for one in case.structures.values() if isinstance(one, GroutedBars))
    return tuple((one.ends, one.free, one.pieces) for one in bars)


def with_bars(mesh: Mesh, lines: BarLines) -> Mesh:
    """The mesh with unknowns for the stations of grouted bars."""
    if not lines:
        return mesh
    return with_stations(mesh, np.concatenate([_stations(*line).reshape(-1, mesh.dim)
                                               for line in lines]))  # fmt: skip


def _stations(ends: _Ends, free: float, pieces: int) -> Floats:
    return stations(np.array(ends, dtype=np.float64), free, pieces)


def points_of(structure: GroutedBars) -> Floats:
    """Stations (n_bars, pieces + 1, dim) of a structure, from head to toe, m."""
    return _stations(structure.ends, structure.free, structure.pieces)


@dataclass(frozen=True)
class PlaceAlong:
    """A place on the grouted length of a bar.

    Args:
        piece: of the bar, from 0.
        part: of the piece that lies before it, 0 to 1.
        length: of the piece, m.
        point: (dim,) m.
    """

    piece: int
    part: float
    length: float
    point: tuple[float, ...]


def place_along(structure: GroutedBars, bar: int, point: Sequence[float]) -> PlaceAlong:
    """The place of a bar's grouted length nearest to a point (dim,), m."""
    own = points_of(structure)[bar]
    along = own[-1] - own[0]
    pieces = structure.pieces
    at = float(np.clip((np.array(point) - own[0]) @ along / (along @ along), 0.0, 1.0))
    piece = min(int(at * pieces), pieces - 1)
    foot = own[0] + at * along
    length = float(np.linalg.norm(along)) / pieces
    return PlaceAlong(piece, at * pieces - piece, length, tuple(foot.tolist()))


def first_station(case: Case, name: str) -> int:
    """How many stations the grouted bars before a structure have."""
    first = 0
    for other, structure in case.structures.items():
        if other == name:
            break
        if isinstance(structure, GroutedBars):
            first += len(structure.ends) * (structure.pieces + 1)
    return first


def held_points(
    structure: GroutedBars, ends: tuple[tuple[float, ...], tuple[float, ...]]
) -> tuple[list[tuple[str, tuple[float, ...]]], list[tuple[str, tuple[float, ...]]]]:
    """What the ground holds of a bar, by its first end and by its second: what it is, and where."""
    points = stations(np.array([ends], dtype=np.float64), structure.free, structure.pieces)[0]
    middles = (points[:-1] + points[1:]) / 2
    head = [("the head", ends[0])] if structure.head == "joined" else []
    toe = [("the toe", ends[1])] if _has_toe(structure) else []
    return head, [("the grout at", tuple(point)) for point in middles.tolist()] + toe


def _has_toe(structure: GroutedBars) -> bool:
    return isinstance(structure, Piles) and structure.k_base is not None


def grouted_rows(on_mesh: CaseOnMesh, name: str, structure: GroutedBars) -> GroutedRows:
    """The rows of the bars of a structure."""
    points = points_of(structure)
    extent = np.ones(len(points))
    if on_mesh.case.analysis is Analysis.AXISYMMETRIC and structure.spacing is not None:
        extent = 2 * np.pi * np.array([head[0] for head, _ in structure.ends])
    return GroutedRows(on_mesh.mesh, first_station(on_mesh.case, name), points, extent)


def parts_of(
    on_mesh: CaseOnMesh, name: str, structure: GroutedBars, present: Bools
) -> Iterator[tuple[str, Bars, Members]]:
    """The parts of grouted bars: a name, what the part is, its members.

    Args:
        on_mesh: the case on its mesh.
        name: of the structure.
        structure: in ground that holds all its points (`structures.checks`).
        present: (n_elements,) what is there as long as it stands.
    """
    circles = _around_shafts(on_mesh, structure)

    def holding(points: Floats, *, around: bool = False) -> list[list[Site]]:
        """What holds points (n, dim), or (n, k, dim) of several bars."""
        every = points.reshape(len(structure.ends), -1, points.shape[-1])
        held = []
        for circle, own in zip(circles, every, strict=True):
            for point in own:
                ring = point + circle if around else point[None]
                sites = [on_mesh.locator.best(tuple(x), present) for x in ring.tolist()]
                if not any(sites):  # beside the mesh
                    sites = [on_mesh.locator.best(tuple(point.tolist()), present)]
                held.append([site for site in sites if site is not None])
        return held

    rows, points = grouted_rows(on_mesh, name, structure), points_of(structure)
    at_head = np.array([head for head, _ in structure.ends], dtype=np.float64)
    heads = holding(at_head) if structure.head == "joined" else None
    middles = holding((points[:, :-1] + points[:, 1:]) / 2, around=True)
    yield name, _shafts(structure), rows.grouted(middles, None if structure.free else heads)
    if structure.free and heads is not None:
        yield f"{name} (free length)", _free_lengths(structure, points), rows.free_lengths(
            heads, at_head
        )  # fmt: skip
    if isinstance(structure, Piles) and structure.k_base is not None:
        toes = PileToes(
            structure.ends,
            structure.spacing,
            number=structure.number,
            stiffness=structure.k_base,
            strength=structure.base_capacity,
        )
        yield f"{name} (toe)", toes, rows.toes(holding(points[:, -1], around=True))


_AROUND = 8
"""Points around the shaft of a pile in a solid."""


def _around_shafts(on_mesh: CaseOnMesh, structure: GroutedBars) -> list[Floats]:
    """For each bar points (k, dim) around its axis, of which the mean motion counts, m.

    In the plane a row of piles is spread along a line; elsewhere a pile has the diameter with which
    it starts.
    """
    ends = np.array(structure.ends, dtype=np.float64)
    line, case = np.zeros((1, ends.shape[2])), on_mesh.case
    if not isinstance(structure, Piles) or structure.diameter is None:
        return [line] * len(ends)
    radius = structure.diameter.value(case.start) / 2
    if case.analysis is Analysis.AXISYMMETRIC:
        return [np.array([[radius, 0.0]]) if not pair[:, 0].any() else line for pair in ends]
    if case.analysis is Analysis.PLANE_STRAIN:
        return [line] * len(ends)
    angle = 2 * np.pi * np.arange(_AROUND)[:, None] / _AROUND
    across = [np.linalg.svd(pair[1:] - pair[:1])[2][1:] for pair in ends]
    return [radius * (np.cos(angle) * a + np.sin(angle) * b) for a, b in across]


def _shafts(structure: GroutedBars) -> GroutedBars:
    """The grouted lengths by themselves: of piles without their toes."""
    if not isinstance(structure, Piles):
        return structure
    return GroutedBars(**{f.name: getattr(structure, f.name) for f in fields(GroutedBars)})


def _free_lengths(structure: GroutedBars, points: Floats) -> Bars:
    """The free lengths as bars of their own."""
    ends = tuple(
        (head, tuple(start))
        for (head, _), start in zip(structure.ends, points[:, 0].tolist(), strict=True)
    )
    return Bars(
        ends, structure.spacing, structure.E, structure.diameter, structure.EA, structure.area,
        structure.number, capacity=structure.capacity,
    )  # fmt: skip


def bar_share(bars: Bars, point: ParameterPoint) -> Dual:
    """The force of one bar per generalized force q of all: the spacing, or 1 / number, or 1."""
    if bars.spacing is not None:
        return point.number(bars.spacing)
    return point.constant(1.0) if bars.number is None else 1.0 / point.number(bars.number)
