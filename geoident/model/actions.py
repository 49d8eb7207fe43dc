"""What acts on the ground from outside: loads, water, temperature, and release as a face advances.

Numbers in SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.in_situ import Surface
from geoident.model.parameter import Scalar

WATER = Scalar(9.81e3)
"""Unit weight of water, N/m3."""


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
class Drain:
    """A row of drains across a line along which the level of the water falls.

    Args:
        at: (dim,) where, m.
        left: part of the fall of the whole line that is still to come there.
    """

    at: tuple[float, ...]
    left: Scalar


@dataclass(frozen=True)
class HeadLine:
    """Along this line the level of the water falls linearly; beyond its ends it is constant.

    With a drain it falls linearly to the drain, and from there.

    Args:
        start: (dim,) where the level is the one of the load, m.
        end: (dim,) where it is ``level``, m.
        level: level of the water at the end, m.
        drain: between them, or None.
    """

    start: tuple[float, ...]
    end: tuple[float, ...]
    level: Scalar
    drain: Drain | None = None

    def parts(self, positions: Floats) -> Floats:
        """How far along the line positions (m, dim) are, (m,), from 0 at its start to 1."""
        start = np.array(self.start)
        span = np.array(self.end) - start
        return np.asarray(np.clip((positions - start) @ span / (span @ span), 0.0, 1.0))


@dataclass(frozen=True)
class WaterPressure:
    """The pressure of water on the free face of a facet group, growing with depth below a level.

    Args:
        group: facet group; the part of it above the level is dry.
        level: of the water, m.
        unit_weight: of the water, N/m3.
        falls: uplift under a dam: how the level falls along the face; None: still water.
        parts: into which each edge of a face is divided where the pressure is summed: of a level
            that moves up and down a face the forces then change without steps.
    """

    group: str
    level: Scalar
    unit_weight: Scalar = WATER
    falls: HeadLine | None = None
    parts: int = 1


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
class HeadForce:
    """A force from outside on the free head of each of the grouted bars of a structure.

    Args:
        structure: name of it.
        value: of one bar along itself, N: it pulls the bar out of the ground; negative, it pushes.
        direction: (dim,) unit vector along which it acts instead; None: along the bar.
    """

    structure: str
    value: Scalar
    direction: tuple[float, ...] | None = None


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
        centre: (2,) in the plane, m, in a solid (3,) a point of the axis; None: the centroid of
            the area within.
    """

    part: Scalar
    centre: tuple[float, ...] | None = None


FaceLoad = Pressure | Traction | WaterPressure
Load = FaceLoad | PointForce | HeadForce | Seismic


@dataclass(frozen=True)
class Water:
    """Water in the pores: stresses are effective, the pressure of the water loads the skeleton.

    Args:
        table: level (m) or group of faces below which the pores are full of still water.
        unit_weight: of the water, N/m3.
        groups: element groups with water in their pores, and interfaces with water in them beside
            ground without; None: all.
        falls: how the level, a number, falls along a line: seepage; None: still water.
    """

    table: Surface
    unit_weight: Scalar = WATER
    groups: tuple[str, ...] | None = None
    falls: HeadLine | None = None


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


@dataclass(frozen=True, eq=False)
class PointTemperature:
    """Temperature changes at all strain points of a mesh, (n_points,), K: computed, not given."""

    values: Floats


Temperature = Scalar | TemperatureField | PointTemperature
"""Change of temperature since the initial state or since placing, K."""


ProfileLaw = Literal["vlachopoulos-diederichs", "panet", "chern"]
"""Names of longitudinal displacement profiles, as users write them."""

Conversion = Literal["reaction-curve", "mesh", "direct"]
"""How a part of the final motion becomes a part of the stress that is released, as users write."""


@dataclass(frozen=True)
class FaceProfile:
    """How the motion of a tunnel's wall grows with the distance to its face (theory 2.9).

    Args:
        law: the longitudinal displacement profile.
        groups: element groups that the tunnel fills; none: what the case releases by distance.
        radius: R of the tunnel, m.
        constants: of Panet's profile alpha and m; of Chern's the reach (in radii) and the exponent;
            of that of Vlachopoulos and Diederichs none.
        plastic_radius: R_p around the tunnel far from its face, without support, m; None: by the
            closed form of the opening. Only where that of Vlachopoulos and Diederichs counts.
        centre: (2,) where the in-situ stress is taken, m; None: the middle of the groups.
        conversion: None: by the reaction curve where the ground at the wall yields; in elastic
            ground all are one.
    """

    law: ProfileLaw
    groups: tuple[str, ...]
    radius: Scalar
    constants: tuple[Scalar, ...] = ()
    plastic_radius: Scalar | None = None
    centre: tuple[float, ...] | None = None
    conversion: Conversion | None = None
    averaged: tuple[tuple[FaceProfile, Scalar], ...] = ()

    @property
    def laws(self) -> tuple[ProfileLaw, ...]:
        """Names of the profiles that count."""
        return (self.law, *(profile.law for profile, _ in self.averaged))


@dataclass(frozen=True)
class FaceDistance:
    """A part of stress that is released as far as the face has gone on.

    Args:
        distance: of the section behind the face, m; negative where the face has yet to come.
    """

    distance: Scalar


Release = Scalar | FaceDistance
"""The part of the stress of what left that is released, or the distance that says it."""
