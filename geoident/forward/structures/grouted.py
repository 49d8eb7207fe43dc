"""Grouted bars on the mesh: their stations, what holds them, and the parts that they are made of.

A structure of grouted bars has several parts in the analysis (`members.StructureMembers`): the
grouted lengths, which bear its name; free lengths from plates to the grout, which are plain bars
and are stressed by a jack as these are; of piles toes, springs that only press, and, where they
bend, what holds them across themselves, and their bending.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from geoident.fem.grouted_bars import GroutedRows, bar_axes, stations
from geoident.fem.location import Site
from geoident.fem.structures import Members
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis, Case
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.mesh import Mesh, with_stations
from geoident.model.structures import (
    Bars,
    GroutedBars,
    PileBending,
    PileContacts,
    Piles,
    PileToes,
)

_Ends = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
BarLines = tuple[tuple[_Ends, float, int, bool], ...]
"""What says where the stations of all grouted bars of a case are: ends, free length, pieces; and
whether they bend."""


def bar_lines(case: Case) -> BarLines:
    """Where the grouted bars of a case are, for each such structure."""
    bars = (one for one in case.structures.values() if isinstance(one, GroutedBars))
    return tuple((one.ends, one.free, one.pieces, one.bends) for one in bars)


def with_bars(mesh: Mesh, lines: BarLines) -> Mesh:
    """The mesh with unknowns for the stations of grouted bars."""
    if not lines:
        return mesh
    each = [_stations(*line[:3]).reshape(-1, mesh.dim) for line in lines]
    bends = np.repeat([line[3] for line in lines], [len(own) for own in each])
    return with_stations(mesh, np.concatenate(each), bends)


def _stations(ends: _Ends, free: float, pieces: int) -> Floats:
    return stations(np.array(ends, dtype=np.float64), free, pieces)


def points_of(structure: GroutedBars) -> Floats:
    """Stations (n_bars, pieces + 1, dim) of a structure, from head to toe, m."""
    return _stations(structure.ends, structure.free, structure.pieces)


def axes_of(structure: GroutedBars, bar: int) -> Floats:
    """Unit vectors (dim, dim) from head to toe of a bar, and across it."""
    head, toe = np.array(structure.ends[bar], dtype=np.float64)
    return bar_axes(toe - head)


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
    head = [("the head", ends[0])] if structure.head != "free" else []
    has_toe = isinstance(structure, Piles) and structure.k_base is not None
    toe = [("the toe", ends[1])] if has_toe else []
    return head, [("the grout at", tuple(point)) for point in middles.tolist()] + toe


class PlacedBars:
    """Grouted bars on the mesh: what holds them, and their rows.

    Args:
        on_mesh: the case on its mesh.
        name: of the structure.
        structure: in ground that holds all its points (`structures.checks`).
        present: (n_elements,) what is there as long as it stands.
    """

    def __init__(
        self, on_mesh: CaseOnMesh, name: str, structure: GroutedBars, present: Bools
    ) -> None:
        self._on_mesh, self._present = on_mesh, present
        self._circles = _around_shafts(on_mesh, structure)
        points = points_of(structure)
        self.at_heads = np.array([head for head, _ in structure.ends], dtype=np.float64)
        bars = range(len(points))
        joined = structure.head != "free"
        self.heads = [self.holding(n, self.at_heads[n]) for n in bars] if joined else None
        extent = np.ones(len(points))
        if on_mesh.case.analysis is Analysis.AXISYMMETRIC and structure.spacing is not None:
            extent = 2 * np.pi * self.at_heads[:, 0]
        first, heads = first_station(on_mesh.case, name), None if structure.free else self.heads
        self.rows = GroutedRows(on_mesh.mesh, first, points, extent, heads)

    def holding(self, bar: int, point: Floats, *, around: bool = False) -> list[Site]:
        """What holds a point (dim,) of a bar, m; for the mean motion around its shaft, several."""
        ring = point + self._circles[bar] if around else point[None]
        locator = self._on_mesh.locator
        sites = [locator.best(tuple(x), self._present) for x in ring.tolist()]
        if not any(sites):  # beside the mesh
            sites = [locator.best(tuple(point.tolist()), self._present)]
        return [site for site in sites if site is not None]


def parts_of(
    on_mesh: CaseOnMesh, name: str, structure: GroutedBars, present: Bools
) -> Iterator[tuple[str, Bars, Members]]:
    """The parts of grouted bars: a name, what the part is, its members; see `PlacedBars`."""
    placed, points = PlacedBars(on_mesh, name, structure, present), points_of(structure)
    rows, heads = placed.rows, placed.heads
    middles = [
        placed.holding(bar, point, around=True)
        for bar, own in enumerate((points[:, :-1] + points[:, 1:]) / 2)
        for point in own
    ]
    yield name, _shafts(structure), rows.grouted(middles)
    if structure.free and heads is not None:
        free = rows.free_lengths(heads, placed.at_heads)
        yield f"{name} (free length)", _free_lengths(structure, points), free
    if not isinstance(structure, Piles):
        return
    ends, spacing, number = structure.ends, structure.spacing, structure.number
    if structure.k_base is not None:
        toes = PileToes(
            ends, spacing, number=number, stiffness=structure.k_base,
            strength=structure.base_capacity,
        )  # fmt: skip
        sites = [placed.holding(bar, own[-1], around=True) for bar, own in enumerate(points)]
        yield f"{name} (toe)", toes, rows.toes(sites)
    if structure.k_lateral is not None:
        contacts = PileContacts(
            ends, spacing, number=number, stiffness=structure.k_lateral,
            strength=structure.lateral_resistance,
        )  # fmt: skip
        yield f"{name} (contact)", contacts, rows.contacts(middles)
        bends = PileBending(
            ends, spacing, structure.E, structure.diameter, number=number, EI=structure.EI
        )
        bending = rows.bending(clamped=structure.head == "clamped")
        yield f"{name} (bending)", bends, bending


def across_moments(structure: GroutedBars, moments: Floats) -> Floats:
    """M at the stations of piles, by axes across them, (k, n_bars, pieces + 1, ...).

    Args:
        structure: the piles.
        moments: q (n_rows, ...) of their bending: M at the heads of pieces. At toes it is zero.
    """
    shape = (-1, len(structure.ends), structure.pieces, *moments.shape[1:])
    at_heads = moments.reshape(shape)
    return np.concatenate([at_heads, np.zeros_like(at_heads[:, :, :1])], axis=2)


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
    # on no plane of symmetry on which its axis may lie, where half of them would be beside the mesh
    angle = 2 * np.pi * (np.arange(_AROUND)[:, None] + 0.5) / _AROUND
    across = [bar_axes(pair[1] - pair[0])[1:] for pair in ends]
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
