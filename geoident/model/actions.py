"""What acts on the ground from outside: loads, water and temperature. Numbers in SI units."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.in_situ import Surface
from geoident.model.parameter import Scalar


@dataclass(frozen=True)
class Pressure:
    """A pressure (Pa, positive pushes onto the ground) on the free face of a facet group."""

    group: str
    value: Scalar


@dataclass(frozen=True)
class Traction:
    """A force per area (Pa) in the coordinate directions on a facet group."""

    group: str
    value: tuple[Scalar, ...]


@dataclass(frozen=True)
class HeadLine:
    """Along this line the level of the water falls linearly; beyond its ends it is constant.

    Args:
        start: (dim,) where the level is the one of the load, m.
        end: (dim,) where it is ``level``, m.
        level: level of the water at the end, m.
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    level: Scalar


@dataclass(frozen=True)
class WaterPressure:
    """The pressure of water on the free face of a facet group, growing with depth below a level.

    Args:
        group: facet group; the part of it above the level is dry.
        level: of the water, m.
        unit_weight: of the water, N/m3.
        falls: uplift under a dam: how the level falls along the face; None: still water.
    """

    group: str
    level: Scalar
    unit_weight: Scalar
    falls: HeadLine | None = None


@dataclass(frozen=True)
class PointForce:
    """A force in the coordinate directions, N (N/m in plane strain).

    Args:
        place: a point (dim,), m, or a node group whose nodes share the force equally.
        value: (dim,) components.
    """

    place: str | tuple[float, ...]
    value: tuple[Scalar, ...]


@dataclass(frozen=True)
class Seismic:
    """Pseudo-static earthquake: a part of its own weight acts on all ground in each direction.

    Args:
        factors: (dim,) force per weight, without unit; along the coordinate axes.
    """

    factors: tuple[Scalar, ...]


@dataclass(frozen=True)
class MotionField:
    """Motions measured at points, linear between them.

    Args:
        points: (k, dim) coordinates, m.
        components: (c,) directions that were measured, 0 for x, 1 for y, 2 for z.
        values: (k, c) motions, m.
        factor: multiplies them all.
    """

    points: tuple[tuple[float, ...], ...]
    components: tuple[int, ...]
    values: tuple[tuple[float, ...], ...]
    factor: Scalar = Scalar(1.0)


@dataclass(frozen=True)
class Contraction:
    """A wall moves towards its centre, so that a part of the area within it is lost (theory 2.8).

    Args:
        part: of the area.
        centre: (2,) in the plane, m; None: the centroid of the area within.
        axis: in a solid, direction (0, 1 or 2) of the axis through ``centre`` (3,).
    """

    part: Scalar
    centre: tuple[float, ...] | None = None
    axis: int | None = None


FaceLoad = Pressure | Traction | WaterPressure
Load = FaceLoad | PointForce | Seismic


@dataclass(frozen=True)
class Water:
    """Water in the pores: stresses are effective, the pressure of the water loads the skeleton.

    Args:
        table: level (m) or group of faces below which the pores are full of still water.
        unit_weight: of the water, N/m3.
        groups: element groups with water in their pores; None: all.
    """

    table: Surface
    unit_weight: Scalar
    groups: tuple[str, ...] | None = None


@dataclass(frozen=True)
class TemperatureField:
    """Temperature changes given at points, linear between them, nearest beyond them.

    Args:
        points: (k, dim) coordinates, m.
        values: (k,) changes, K.
        factor: multiplies them all.
    """

    points: tuple[tuple[float, ...], ...]
    values: tuple[float, ...]
    factor: Scalar = Scalar(1.0)


Temperature = Scalar | TemperatureField
"""Change of temperature since the initial state or since placing, K."""
