"""Ground whose strength is divided by a factor F (theory 5.14).

    c / F ,  tan(phi) / F ,  T / F ,  psi not above the friction that is left ,

of Mohr and Coulomb (so Tresca's c), of Drucker and Prager's cone through c and phi, of weak planes
and of interfaces (R_inter multiplies what is left): the convention of practice (Zienkiewicz,
Humpheson & Lewis 1975, Geotechnique 25; Griffiths & Lane 1999, Geotechnique 49). The apex
c / tan(phi) stays where it is, and the cut-off T is divided. What varies from place to place is
divided everywhere alike. Planes that a case gives one by one have no c and phi: they stay, and so
do structures.

Hardening soil becomes Mohr and Coulomb's with its c, phi, psi and tension, and the modulus of
unloading at its reference pressure: whether loads can be carried is a question of strength, and
strength is all that is left of that law there.

Hoek and Brown's curve has no c and phi either, but each of its tangents has. The curve that all
tangents of c / F and tan(phi) / F touch is the shear strength divided by F; the curve of the same
kind that comes nearest is taken (Hammah, Yacoub, Corkum & Curran 2005, The shear strength reduction
method for the generalized Hoek-Brown criterion, Alaska Rocks, ARMA/USRMS 05-810).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import atan, sqrt, tan

import numpy as np

from geoident.forward.stages import CaseOnMesh
from geoident.forward.yielding.hoek_brown import RockMassStrength
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import PointField, PointGrowth
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar, Values
from geoident.model.yielding import (
    GivenPlanes,
    HardeningSoil,
    HoekBrown,
    MohrCoulomb,
    YieldSurface,
    with_strengths,
)

_DIVIDED = ("cohesion", "tension")
"""Strengths that are divided themselves; of friction the tangent is."""

_CONFINED = 24
"""Confining stresses at which two curves are compared."""

_EXPONENT = (0.25, 0.85)
"""Between which a of a reduced curve is looked for."""


def reducible(material: Material) -> bool:
    """Whether the strength of a material can be divided by a factor."""
    return material.soil is not None or any(
        not isinstance(surface, GivenPlanes) for surface in material.yields
    )


def surfaces(material: Material) -> tuple[YieldSurface, ...]:
    """The yield surfaces of a material whose strength is divided; none where it never yields."""
    return material.yields if material.soil is None else (_limit(material.soil),)


def _limit(soil: HardeningSoil) -> MohrCoulomb:
    """Mohr and Coulomb's limit of a hardening soil."""
    return MohrCoulomb(soil.cohesion, soil.friction, soil.dilation, soil.tension)


def with_reduced_strength(
    on_mesh: CaseOnMesh, values: Values, factor: float, confined: Mapping[str, float]
) -> CaseOnMesh:
    """The case with the strength of its ground divided by a factor, as numbers at parameters.

    Interfaces, too; hardening soil has its limit alone, also with a factor of one.

    Args:
        on_mesh: the case on its mesh.
        values: parameters by name, SI.
        factor: F.
        confined: material to the largest confining stress that counts, Pa, for curves.
    """
    if factor == 1.0 and not on_mesh.case.hardens:
        return on_mesh
    materials = {
        name: replace(
            material,
            soil=None,
            yields=tuple(
                _reduced(surface, values, factor, confined.get(name, 0.0))
                for surface in surfaces(material)
            ),
        )
        for name, material in on_mesh.case.materials.items()
    }
    interfaces = {
        name: reduced_interface(given, values, factor)
        for name, given in on_mesh.case.interfaces.items()
    }
    case = replace(on_mesh.case, materials=materials, interfaces=interfaces)
    fields = tuple(_reduced_field(field, factor) for field in on_mesh.fields)
    growths = tuple(_reduced_growth(growth, factor) for growth in on_mesh.growths)
    return on_mesh.with_fields(case, fields, growths)


def _reduced(surface: YieldSurface, values: Values, F: float, confined: float) -> YieldSurface:
    if isinstance(surface, GivenPlanes):
        return surface
    if isinstance(surface, HoekBrown):
        return reduced_curve(surface, values, F, confined)
    numbers = {name: one.value(values) for name, one in surface.strengths.items()}
    friction = atan(tan(numbers["friction"]) / F)
    changed = {name: x / F for name, x in numbers.items() if name in _DIVIDED}
    changed["friction"] = friction
    if "dilation" in numbers:
        changed["dilation"] = min(numbers["dilation"], friction)
    (reduced,) = with_strengths([surface], {(0, name): Scalar(x) for name, x in changed.items()})
    return reduced


def reduced_interface(given: Interface, values: Values, F: float) -> Interface:
    """An interface whose strength is divided by a factor, as numbers at parameters."""
    if given.friction is None:
        return given
    steep = tan(given.friction.value(values)) / F
    share = 1.0 if given.R_inter is None else given.R_inter.value(values)
    cohesion = 0.0 if given.cohesion is None else given.cohesion.value(values)
    return replace(
        given,
        cohesion=Scalar(cohesion / F),
        friction=Scalar(atan(steep)),
        tensile_strength=Scalar(given.tensile_strength.value(values) / F),
        dilation=Scalar(min(given.dilation.value(values), atan(share * steep))),
    )


def _reduced_field(field: PointField, F: float) -> PointField:
    """A field counts in parts of a mean, which is divided: what tests hold it at is, too."""
    if field.surface is None or field.constant not in _DIVIDED:
        return field
    return replace(field, reference=field.reference / F)


def _reduced_growth(one: PointGrowth, F: float) -> PointGrowth:
    if one.growth.surface is None or one.growth.constant not in _DIVIDED:
        return one
    stated: Callable[[ParameterPoint], Dual] = one.value
    return replace(
        one, value=lambda point: Dual(stated(point).columns / F), typical=one.typical / F
    )


def reduced_curve(surface: HoekBrown, values: Values, F: float, confined: float) -> HoekBrown:
    """The curve of Hoek and Brown nearest to one whose shear strength is divided by a factor.

    sigci is kept; mb, s and a are found, by least squares of sigma_1 - sigma_3 in parts of it.

    Args:
        surface: as the case states it.
        values: parameters by name, SI.
        F: the factor.
        confined: the largest confining stress that counts, Pa, compression positive.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - help must not wait for it

    mass = RockMassStrength.of(surface, values)
    tip = mass.s * mass.sigci / mass.mb
    most = max(confined, 2.0 * tip, 0.01 * mass.sigci)
    # dense at low stress, where the curve bends
    sigma_3 = -0.5 * tip + (most + 0.5 * tip) * np.linspace(0.0, 1.0, _CONFINED) ** 2
    wanted = divided_strength(mass, sigma_3, F)

    def rest(x: Floats) -> Floats:
        mb, s, a = np.exp(x[0]), np.exp(x[1]), x[2]
        base = np.maximum(s + mb * sigma_3 / mass.sigci, 1e-12)
        return np.asarray(mass.sigci * base**a / wanted - 1.0)

    start = [np.log(mass.mb / F ** (1 / mass.a)), np.log(mass.s / F ** (1 / mass.a)), mass.a]
    most_s = 0.0 if F >= 1.0 else np.log(1.0)
    bounds = ([-40.0, -60.0, _EXPONENT[0]], [10.0, most_s, _EXPONENT[1]])
    clipped = np.clip(start, bounds[0], bounds[1])
    mb, s, a = least_squares(rest, clipped, bounds=bounds, x_scale=[1.0, 1.0, 0.1]).x
    friction = _steepest(mass, F)
    changed = dict.fromkeys(("mi", "GSI", "D"))
    if surface.dilation is not None:
        changed["dilation"] = Scalar(min(surface.dilation.value(values), friction))
    if surface.tension is not None:
        changed["tension"] = Scalar(surface.tension.value(values) / F)
    return replace(
        surface, **changed,
        sigci=Scalar(mass.sigci), mb=Scalar(np.exp(mb)), s=Scalar(np.exp(s)), a=Scalar(a),
    )  # fmt: skip


def divided_strength(mass: RockMassStrength, sigma_3: Floats, F: float) -> Floats:
    """sigma_1 - sigma_3 (k,) where the shear strength of a rock mass is divided by a factor, Pa.

    The least over the tangents of the curve, each with c / F and tan(phi) / F.

    Args:
        mass: the rock mass.
        sigma_3: (k,) confining stresses, Pa, compression positive.
        F: the factor.
    """
    tip = mass.s * mass.sigci / mass.mb
    reach = float(sigma_3.max()) + tip
    touched = -tip + reach * np.geomspace(1e-6, 20.0, 2000)
    y = mass.s + mass.mb * touched / mass.sigci
    slope = 1.0 + mass.a * mass.mb * y ** (mass.a - 1.0)  # d sigma_1 / d sigma_3
    start = touched + mass.sigci * y**mass.a - slope * touched  # sigma_1 at no confinement
    tangent = (slope - 1.0) / (2.0 * np.sqrt(slope)) / F
    cohesion = start / (2.0 * np.sqrt(slope)) / F
    root = tangent + np.sqrt(1.0 + tangent**2)  # of the reduced slope: tan(45 deg + phi / 2)
    lines = np.outer(sigma_3, root**2 - 1.0) + 2.0 * cohesion * root
    return np.asarray(lines.min(axis=1))


def _steepest(mass: RockMassStrength, F: float) -> float:
    """The largest friction angle of the reduced curve, at its tip without confinement, rad."""
    slope = 1.0 + mass.a * mass.mb * max(mass.s, 1e-12) ** (mass.a - 1.0)
    return atan((slope - 1.0) / (2.0 * sqrt(slope)) / F)
