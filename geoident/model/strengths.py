"""Which strengths and angles make a yield surface, and which bound those break that do not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import degrees, pi, tan

from geoident.model.admissible import Breach
from geoident.model.parameter import Scalar
from geoident.model.yields import (
    DruckerPrager,
    GivenPlanes,
    MohrCoulomb,
    WeakPlane,
    YieldSurface,
)

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
