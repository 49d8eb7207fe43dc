"""Yield limits as a case states them. Tension is positive; stresses and strengths in Pa.

Which strengths and angles make a yield surface, and which bound those break that do not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, pi, tan
from typing import Literal

from geoident.model.ground import Breach, Frame
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


Numbers = Mapping[str, float]

_STRENGTHS = ("cohesion", "friction", "dilation", "tension", "hardening")


def strengths(surface: YieldSurface) -> dict[str, Scalar]:
    """The strengths and angles of strength of a surface, by name."""
    given = {name: getattr(surface, name, None) for name in _STRENGTHS}
    return {name: scalar for name, scalar in given.items() if scalar is not None}


def numbers_of_yield(surface: YieldSurface) -> tuple[Scalar, ...]:
    """All numbers on which its planes depend."""
    distances = [p.distance for p in surface.planes] if isinstance(surface, GivenPlanes) else []
    frame = getattr(surface, "frame", None)
    angles = [s for s in vars(frame).values() if isinstance(s, Scalar)] if frame else []
    return (*strengths(surface).values(), *distances, *angles)


def yield_breach(surface: YieldSurface, values: Mapping[str, float]) -> Breach | None:
    """The first bound that the strengths break at parameter values (SI), or None."""
    numbers = {name: scalar.value(values) for name, scalar in strengths(surface).items()}
    return _CHECKS[type(surface)](numbers)


def apex(surface: YieldSurface, values: Mapping[str, float]) -> float | None:
    """The largest tension that friction and cohesion alone leave, c / tan(phi), Pa.

    None without friction, or for planes that are given.
    """
    numbers = {name: scalar.value(values) for name, scalar in strengths(surface).items()}
    phi = numbers.get("friction", 0.0)
    if not 0.0 < phi < pi / 2:
        return None
    return numbers["cohesion"] / tan(phi)


def _coulomb(given: Numbers) -> Breach | None:
    return _friction(given) or _cohesion(given) or _dilation(given) or _negative(given, "tension")


def _friction(given: Numbers) -> Breach | None:
    if 0.0 <= given["friction"] < pi / 2:
        return None
    return Breach("friction", given["friction"], "it must be from 0 to below 90 deg")


def _cohesion(given: Numbers) -> Breach | None:
    if given["friction"] > 0.0:
        return _negative(given, "cohesion")
    if given["cohesion"] > 0.0:
        return None
    return Breach("cohesion", given["cohesion"], "without friction it must be positive")


def _dilation(given: Numbers) -> Breach | None:
    if "dilation" not in given or 0.0 <= given["dilation"] <= given["friction"]:
        return None
    limit = f"it must be from 0 to the friction angle, {degrees(given['friction']):.6g} deg"
    return Breach("dilation", given["dilation"], limit)


def _planes(given: Numbers) -> Breach | None:
    return _negative(given, "hardening")


def _negative(given: Numbers, name: str) -> Breach | None:
    if given.get(name, 0.0) >= 0.0:
        return None
    return Breach(name, given[name], "it must not be negative")


_CHECKS: Mapping[type, Callable[[Numbers], Breach | None]] = {
    GivenPlanes: _planes,
    MohrCoulomb: _coulomb,
    DruckerPrager: _coulomb,
    WeakPlane: _coulomb,
}
