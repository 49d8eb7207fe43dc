"""What interfaces carry and how far they have moved, point by point and stage by stage."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.columns import Record, column


class InterfaceStates(Record):
    """Tractions and jumps of interfaces; NaN while the ground of a side is not there.

    They are so, too, where an interface ends inside the ground, which holds its sides together.

    Args:
        interfaces: (m,) name of the interface of each point.
        sides: (m,) where the ground is, seen from the beam or shell on which the point is: towards
            ``-x``, ``+x``, ``-y`` and so on, ``inside`` or ``outside`` of one that is round; empty
            where both sides are ground.
        faces: (m,) number of its face within the interface, from 1; the corners of a face come
            first, then the middles of its edges and its centre.
        stages: names of the stages, the virgin state not among them.
        points: (m, dim) m.
        normals: (m, dim) unit vectors from the first side to the second.
        areas: (m,) m2 that belong to the points: per metre in plane strain, of the whole turn
            about an axis.
        normal_traction: (m, n_stages) t_n, Pa, tension positive.
        shear_traction: (m, n_stages) t_s, Pa; its size in space.
        opening: (m, n_stages) of the second side against the first since both are there, m.
        slip: (m, n_stages) m, in the direction of t_s; its size in space.
        slips: (m, n_stages) whether the shear traction is at its limit, closed.
        parts: (m, n_stages) whether the normal traction is at its limit: it opens.
    """

    interfaces: tuple[str, ...] = column("joint", name="interface")
    sides: tuple[str, ...] = column("joint", name="side")
    faces: Ints = column("joint", name="face")
    stages: tuple[str, ...] = column("stage", name="stage")
    points: Floats = column(
        "joint", "axis", name="points", title="point", sheet="{axis}", dimension="length", shown="m"
    )
    normals: Floats = column(
        "joint", "axis", name="normal", sheet="normal_{axis}", hidden=("json",)
    )
    areas: Floats = column(
        "joint", name="area", dimension="area", unit="m2, or m in plane strain", hidden=("csv",)
    )
    normal_traction: Floats = column(
        "joint", "stage", name="t_n", dimension="pressure", shown="kPa"
    )
    shear_traction: Floats = column("joint", "stage", name="t_s", dimension="pressure", shown="kPa")
    opening: Floats = column("joint", "stage", dimension="length", shown="mm")
    slip: Floats = column("joint", "stage", dimension="length", shown="mm")
    slips: Bools = column("joint", "stage")
    parts: Bools = column("joint", "stage", name="opens")

    @property
    def standing(self) -> list[list[int]]:
        """Numbers of each stage and point where there are tractions."""
        places: list[list[int]] = np.argwhere(np.isfinite(self.normal_traction.T)).tolist()
        return places

    @property
    def lines(self) -> tuple[tuple[str, str], ...]:
        """Name and side of what lies apart: of an interface along a wall each of its sides."""
        return tuple(dict.fromkeys(zip(self.interfaces, self.sides, strict=True)))

    def of(self, name: str, side: str) -> Ints:
        """Numbers (k,) of the points of an interface on a side."""
        pairs = zip(self.interfaces, self.sides, strict=True)
        return np.flatnonzero([pair == (name, side) for pair in pairs])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the interfaces."""
        return tuple(dict.fromkeys(self.interfaces))

    @property
    def face_points(self) -> list[Ints]:
        """Numbers of the points of each face, one face after the other."""
        places = np.array([self.names.index(name) for name in self.interfaces])
        new = (np.diff(places) != 0) | (np.diff(self.faces) != 0)
        return np.split(np.arange(len(places)), np.flatnonzero(new) + 1)


def titled(name: str, side: str) -> str:
    """An interface, and its side if it has several."""
    if not side:
        return name
    return f"{name}, ground {side if side.endswith('side') else f'towards {side}'}"
