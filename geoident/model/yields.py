"""Yield limits as a case states them. Tension is positive; stresses and strengths in Pa."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from geoident.model.elastic import Frame
from geoident.model.parameter import Scalar

Fit = Literal["inscribed", "circumscribed", "best"]
"""How a polyhedron lies to the smooth surface: inside, around, or of the same size on average."""


@dataclass(frozen=True)
class YieldPlane:
    """One plane n^T sigma <= k.

    Args:
        name: in outputs.
        normal: (6,) unit normal in xx, yy, zz, xy, yz, xz (a shear stress counts once).
        distance: k, Pa; planes that name the same parameter are tied.
    """

    name: str
    normal: tuple[float, ...]
    distance: Scalar


@dataclass(frozen=True)
class GivenPlanes:
    """A polyhedron given plane by plane; ``hardening`` h: k grows by h lam of the same plane."""

    planes: tuple[YieldPlane, ...]
    hardening: Scalar = Scalar(0.0)


@dataclass(frozen=True)
class MohrCoulomb:
    """Mohr-Coulomb; Tresca where friction is zero. Planes: None for the smooth surface.

    Args:
        cohesion: c.
        friction: phi, rad.
        dilation: psi, rad; None: phi, associated. Only on the smooth surface.
        tension: cut-off of the largest principal stress; None for none but the apex.
        planes: number of planes of the polyhedron in place of the smooth surface, or None.
        fit: how the polyhedron lies.
    """

    cohesion: Scalar
    friction: Scalar
    dilation: Scalar | None = None
    tension: Scalar | None = None
    planes: int | None = None
    fit: Fit = "best"


@dataclass(frozen=True)
class DruckerPrager:
    """Drucker-Prager's cone, faceted, through Mohr-Coulomb's c and phi.

    Args:
        cohesion: c.
        friction: phi, rad.
        match: where the cone meets Mohr-Coulomb: at its outer (compression) or inner (tension)
            edges, or so that both carry the same in plane strain.
        tension: cut-off of the largest principal stress, or None.
        planes: number of planes.
        fit: how the polyhedron lies to the cone.
    """

    cohesion: Scalar
    friction: Scalar
    match: Literal["outer", "inner", "plane-strain"] = "plane-strain"
    tension: Scalar | None = None
    planes: int = 24
    fit: Fit = "best"


@dataclass(frozen=True)
class WeakPlane:
    """Coulomb on planes of one orientation (strata, joints): tau <= c - sigma_n tan(phi).

    Args:
        frame: its axis 3 is the normal of the planes.
        cohesion: c.
        friction: phi, rad.
        tension: largest normal stress, or None for c / tan(phi).
        planes: facets of the cone in a solid; in a section two suffice.
    """

    frame: Frame
    cohesion: Scalar
    friction: Scalar
    tension: Scalar | None = None
    planes: int = 16


YieldSurface = GivenPlanes | MohrCoulomb | DruckerPrager | WeakPlane
