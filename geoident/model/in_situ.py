"""What a case says of the in-situ stress: models that are the same everywhere or grow with depth.

The vertical is the last coordinate axis (y in 2-D, z in 3-D). Stress is tension positive;
``held`` says whether the ground beyond the edges of the model holds the stress there, by tractions
that stay in all stages. None: yes for a stress that is the same everywhere (it can't be in
equilibrium otherwise), no for one that grows with depth.
"""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.parameter import Scalar

Surface = Scalar | str
"""Where depth is counted from: a level (m), or a group of faces, lines in 2-D, with topography."""

Components = tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]
"""Numbers in the order xx, yy, zz, xy, yz, xz. In 2-D z is out of plane, yz and xz are zero."""


@dataclass(frozen=True)
class ConstantStress:
    """In-situ stress the same everywhere, tension positive, Pa."""

    components: Components
    held: bool | None = None


@dataclass(frozen=True)
class HeimStress:
    """Heim's in-situ stress: a vertical pressure and K0 times it on every horizontal plane.

    Either ``vertical`` (Pa, compression positive, the same everywhere) or ``unit_weight`` (N/m3)
    with the ``surface`` of the ground: sigma_v = -unit_weight * depth.

    Args:
        K0: ratio of horizontal to vertical stress: along x, or along the azimuth.
        K0_across: ratio in the other horizontal direction (out of plane in 2-D); None: K0.
        azimuth: 3-D: direction of K0, rad clockwise from y (north); None: along x.
        tectonic: stress added everywhere, Pa, tension positive; None for none.
        vertical: see above.
        unit_weight: see above.
        surface: see above.
        held: see the module.
    """

    K0: Scalar
    vertical: Scalar | None = None
    unit_weight: Scalar | None = None
    surface: Surface | None = None
    held: bool | None = None
    K0_across: Scalar | None = None
    azimuth: Scalar | None = None
    tectonic: Components | None = None


@dataclass(frozen=True)
class ProfileStress:
    """A stress that changes linearly with depth: sigma = at_surface + gradient * depth.

    Depth is counted downwards from ``surface`` and is negative above it.

    Args:
        at_surface: stress at the surface, Pa.
        gradient: change per metre of depth, Pa/m.
        surface: where depth is counted from.
        held: see the module.
    """

    at_surface: Components
    gradient: Components
    surface: Surface
    held: bool | None = None


InSitu = ConstantStress | HeimStress | ProfileStress
