"""How materials yield at given parameters: their laws, and their surfaces as yield planes.

All surfaces of a material together are one polyhedron, the common inside; the exact Mohr-Coulomb
surface is planes in sorted principal stresses. Planes come with their derivatives, one function a
surface, one table: a new surface of planes is one more function in `_PLANES`,
one in principal stresses or curved is told apart in `yield_limits`, `yield_planes` and `law`.

*Drucker-Prager's cone, and Coulomb's on the planes of strata and joints*, with facets.

Drucker and Prager (1952, Soil mechanics and plastic analysis or limit design, Quart. Appl. Math.
10): alpha I1 + sqrt(J2) <= k, with alpha and k from Mohr-Coulomb's c and phi

    outer         alpha = 2 sin phi / (sqrt3 (3 - sin phi)), k = alpha 3 c / tan phi
    inner         alpha = 2 sin phi / (sqrt3 (3 + sin phi)), k = alpha 3 c / tan phi
    plane strain  alpha = tan phi / sqrt(9 + 12 tan^2 phi),  k = 3 c / sqrt(9 + 12 tan^2 phi)

(W. F. Chen and E. Mizuno, 1990, Nonlinear Analysis in Soil Mechanics, chapter 3.) sqrt(J2) is
1 / sqrt2 of the deviator's length, in a space of three dimensions in a section and of five in a
solid; facets touch the sphere in directions that are spread evenly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from math import sqrt
from typing import Literal

import numpy as np

from geoident.fem.elasticity import ScaledModuli
from geoident.fem.yielding.hoek_brown import HoekBrownConstants, HoekBrownLaw
from geoident.fem.yielding.law import YieldLaw
from geoident.fem.yielding.plane_laws import PolyhedralLaw, PrincipalLaw
from geoident.fem.yielding.planes import YieldPlanes, common_inside
from geoident.fem.yielding.scaled_law import ScaledLaw
from geoident.forward.ground.elasticity import ModuliAt, material_axes
from geoident.forward.stages import Index, numbers
from geoident.forward.yielding.facets import (
    deviator_basis,
    polygon_shrinkage,
    shrinkage,
    spread_deviators,
)
from geoident.forward.yielding.hoek_brown import hoek_brown
from geoident.forward.yielding.mohr_coulomb import cut_off, exact_mohr_coulomb, mohr_coulomb
from geoident.forward.yielding.varied import mean_surface, surface_factors, with_common_surface
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint, stacked
from geoident.model.yielding import (
    DruckerPrager,
    Fit,
    GivenPlanes,
    HoekBrown,
    MohrCoulomb,
    WeakPlane,
    YieldSurface,
)


class YieldLaws:
    """Yield laws of all materials of a case at one parameter vector, each made once.

    A law keeps the active sets that it meets, so one serves a whole analysis.

    Args:
        moduli: of the materials at the parameters, with the case on its mesh.
    """

    def __init__(self, moduli: ModuliAt) -> None:
        self._moduli, self._on_mesh, self._point = moduli, moduli.on_mesh, moduli.point
        self._materials = moduli.on_mesh.case.materials
        self._laws: dict[str, YieldLaw | None] = {}
        self._factors: dict[str, tuple[Dual, Dual] | None] = {}

    @cached_property
    def limits(self) -> dict[str, YieldPlanes | HoekBrownConstants]:
        """Planes or constants of the surface of every material of the case that yields.

        Where a strength is a field or grows, those of its mean.
        """
        grown = self._on_mesh.strength_growths
        return {
            name: self._limits(mean_surface(material, grown(name), self._point))
            for name, material in self._materials.items()
            if material.yields
        }

    def at(self, material: str, points: Index) -> YieldLaw | None:
        """The law of a material at some of its strain points, or None if it does not yield.

        Where moduli or strengths vary, that of `law` with the factors of the points.

        Args:
            material: its name.
            points: (q,) which of its points.

        Raises:
            EmptyDomain: no stress satisfies the planes of an exact surface.
        """
        law = self.law(material)
        if law is None:
            return None
        factors, moduli = self._factors_of(material), self._moduli.moduli(material, points).value
        if factors is None and not isinstance(moduli, ScaledModuli):
            return law
        wanted = numbers(points, self._on_mesh.discretization.points.n_points)
        places = np.searchsorted(self._on_mesh.material_points(material), wanted)
        one, none = (self._point.constant(np.full(len(wanted), x)) for x in (1.0, 0.0))
        strength, shift = (one, none) if factors is None else (each[places] for each in factors)
        stiffness = moduli.factor if isinstance(moduli, ScaledModuli) else one.value
        return ScaledLaw(law, strength, shift, stiffness)

    def law(self, material: str) -> YieldLaw | None:
        """The law of a material, or None if it does not yield.

        Of the means of its fields, and of the surface common to its points where strengths grow.

        Raises:
            EmptyDomain: no stress satisfies the planes of an exact surface.
        """
        if material not in self._laws:
            self._laws[material] = self._made(self._materials[material])
        return self._laws[material]

    def _made(self, material: Material) -> YieldLaw | None:
        if not material.yields:
            return None
        planes = self._limits(with_common_surface(self._on_mesh, material))
        elasticity = self._moduli.elastic_matrix(material.name)
        if isinstance(planes, HoekBrownConstants):
            return HoekBrownLaw(elasticity, planes)
        law = PrincipalLaw if in_principal_stresses(material) else PolyhedralLaw
        return law(elasticity, planes)

    def _limits(self, material: Material) -> YieldPlanes | HoekBrownConstants:
        return yield_limits(material, self._point, self._moduli.n_strain)

    def _factors_of(self, material: str) -> tuple[Dual, Dual] | None:
        if material not in self._factors:
            self._factors[material] = surface_factors(self._on_mesh, material, self._point)
        return self._factors[material]


def in_principal_stresses(material: Material) -> bool:
    """Whether the material yields by an exact surface, a law of principal stresses."""
    return any(surface.in_principal_stresses for surface in material.yields)


def yield_limits(
    material: Material, point: ParameterPoint, n_strain: int
) -> YieldPlanes | HoekBrownConstants:
    """How a material yields: its planes, or the constants of a curved surface.

    Args:
        material: the material, which yields.
        point: the parameters.
        n_strain: number s of strain components.
    """
    curved = curved_surface(material)
    return yield_planes(material, point, n_strain) if curved is None else hoek_brown(curved, point)


def curved_surface(material: Material) -> HoekBrown | None:
    """The surface of a material that is not made of planes, even in principal stresses."""
    return next((s for s in material.yields if isinstance(s, HoekBrown)), None)


def yield_planes(material: Material, point: ParameterPoint, n_strain: int) -> YieldPlanes:
    """All planes (y) of a material that yields by planes, with their derivatives.

    Args:
        material: the material.
        point: the parameters.
        n_strain: number s of strain components.
    """
    if in_principal_stresses(material):
        (surface,) = material.yields
        assert isinstance(surface, MohrCoulomb)
        return exact_mohr_coulomb(surface, point)
    parts = [_PLANES[type(surface)](surface, point, n_strain) for surface in material.yields]
    return parts[0] if len(parts) == 1 else common_inside(_labelled(material.yields, parts))


def _labelled(surfaces: Sequence[YieldSurface], parts: Sequence[YieldPlanes]) -> list[YieldPlanes]:
    """Planes with names that also say which surface they are of."""
    kinds = [surface.kind for surface in surfaces]
    labels = [
        f"{kind} {kinds[: n + 1].count(kind)}" if kinds.count(kind) > 1 else kind
        for n, kind in enumerate(kinds)
    ]
    return [
        replace(part, names=tuple(f"{label}: {name}" for name in part.names))
        for label, part in zip(labels, parts, strict=True)
    ]


def given_planes(surface: GivenPlanes, point: ParameterPoint, n_strain: int) -> YieldPlanes:
    """The planes of a case, cut to the components of the analysis.

    Args:
        surface: as the case states it.
        point: the parameters.
        n_strain: number s of strain components.
    """
    normals = np.array([plane.normal[:n_strain] for plane in surface.planes])
    distances = stacked([point.number(plane.distance) for plane in surface.planes])
    hardening = point.number(surface.hardening)
    return YieldPlanes(
        point.constant(normals),
        distances,
        hardening=hardening * np.eye(len(normals)) if hardening.columns.any() else None,
        names=tuple(plane.name for plane in surface.planes),
    )


def drucker_prager(surface: DruckerPrager, point: ParameterPoint, n_strain: int) -> YieldPlanes:
    """Drucker-Prager's cone with facets, and its cut-off of tension.

    Args:
        surface: as the case states it.
        point: the parameters.
        n_strain: number s of strain components.
    """
    alpha, k = cone(surface, point)
    deviators = _facets_of_sphere(surface.planes, n_strain, surface.fit)
    trace = np.zeros(n_strain)
    trace[:3] = 1.0
    normals = alpha * trace + point.constant(deviators / sqrt(2.0))
    names = tuple(f"shear {n}" for n in range(1, 1 + len(deviators)))
    distances = Dual(np.repeat(k.columns[None], len(names), axis=0))
    parts = [YieldPlanes(normals, distances, names=names)]
    if surface.tension is not None:
        count = cut_off_count(surface.planes, n_strain)
        limit = point.number(surface.tension)
        parts.append(cut_off(limit, point, n_strain, count, surface.fit))
    return common_inside(parts).of_unit_length()


def cut_off_count(planes: int, n_strain: int) -> int:
    """Sides or directions of the cut-off of a cone with some facets."""
    return max(4, 2 * (planes // 4)) if n_strain < 6 else planes // 6


def cone(surface: DruckerPrager, point: ParameterPoint) -> tuple[Dual, Dual]:
    """Its alpha and k."""
    angle = point.number(surface.friction)
    S, C, c = angle.sine(), angle.cosine(), point.number(surface.cohesion)
    width = _width(surface.match, S)
    return S / width, c * C * 3.0 / width


def _width(match: Literal["outer", "inner", "plane-strain"], S: Dual) -> Dual:
    """S / alpha: sqrt3 / 2 (3 -+ S), or sqrt(9 + 3 S^2), which is cos phi sqrt(9 + 12 tan^2)."""
    if match == "plane-strain":
        return (9.0 + S * S * 3.0).root()
    return (3.0 - S if match == "outer" else 3.0 + S) * (sqrt(3.0) / 2)


@lru_cache(maxsize=32)
def _facets_of_sphere(count: int, n_strain: int, fit: Fit) -> Floats:
    """Deviators (y, n_strain) whose largest product with a stress stands for its length."""
    facets = spread_deviators(count, n_strain) @ deviator_basis(n_strain)
    return facets / shrinkage(fit, facets, lambda x: np.linalg.norm(x, axis=1))


def weak_plane(surface: WeakPlane, point: ParameterPoint, n_strain: int) -> YieldPlanes:
    """Coulomb on planes of one orientation: |tau| cos phi + sigma_n sin phi <= c cos phi.

    In a section the planes stand on it, and two facets are exact. In a solid tau has two
    components, and a polygon of the same size on average takes the place of the circle.

    Args:
        surface: as the case states it.
        point: the parameters.
        n_strain: number s of strain components.
    """
    angle = point.number(surface.friction)
    S, C = angle.sine(), angle.cosine()
    normal, slides = _directions(surface, point, n_strain)
    pressing = _traction(normal, normal, n_strain)
    normals = [S * pressing + C * _traction(normal, slide, n_strain) for slide in slides]
    distances = [C * point.number(surface.cohesion)] * len(slides)
    names = [f"slip {n}" for n in range(1, 1 + len(slides))]
    if surface.tension is not None:
        normals.append(pressing)
        distances.append(point.number(surface.tension))
        names.append("opening")
    planes = YieldPlanes(stacked(normals), stacked(distances), names=tuple(names))
    return planes.of_unit_length()


def _directions(
    surface: WeakPlane, point: ParameterPoint, n_strain: int
) -> tuple[Dual, list[Dual]]:
    """The normal (3,), and the directions of sliding (3,), longer where a polygon is shrunk."""
    section = n_strain < 6
    axes = material_axes(surface.frame, point, section=section)
    first, second, normal = (axes[:, k] for k in range(3))
    if section:
        x, y = normal[0], normal[1]
        along = Dual(np.stack([-y.columns, x.columns, np.zeros_like(x.columns)]))
        return normal, [along, -along]
    turns = 2 * np.pi * np.arange(surface.planes) / surface.planes
    longer = 1 / polygon_shrinkage(surface.planes, "best")
    pairs = longer * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return normal, [first * a + second * b for a, b in pairs]


def _traction(a: Dual, b: Dual, n_strain: int) -> Dual:
    """What takes a^T sigma b from the components of a stress, (n_strain,)."""
    straight = [a[i] * b[i] for i in range(3)]
    shear = [a[i] * b[j] + a[j] * b[i] for i, j in ((0, 1), (1, 2), (0, 2))]
    return stacked([*straight, *shear])[:n_strain]


_PLANES: Mapping[type, Callable[..., YieldPlanes]] = {
    GivenPlanes: given_planes,
    MohrCoulomb: mohr_coulomb,
    DruckerPrager: drucker_prager,
    WeakPlane: weak_plane,
}
