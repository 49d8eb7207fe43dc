"""From the yield limits of a material to the law at its strain points, with exact derivatives.

A smooth Mohr-Coulomb surface is a law in principal stresses; all else becomes one polyhedron, the
common inside of all surfaces of the material.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from geoident.fem.yielding.law import LawSlopes, YieldLaw
from geoident.fem.yielding.polyhedral import PolyhedralLaw
from geoident.fem.yielding.principal import PrincipalLaw
from geoident.forward.ground.elasticity import elasticity_slopes
from geoident.forward.yielding.cones import drucker_prager, weak_plane
from geoident.forward.yielding.mohr_coulomb import given_planes, mohr_coulomb, smooth_mohr_coulomb
from geoident.forward.yielding.planes import Facets, joined
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Point
from geoident.model.yielding import DruckerPrager, GivenPlanes, MohrCoulomb, WeakPlane, YieldSurface

Values = Mapping[str, float]
"""Parameter name to value, SI."""

_KINDS: Mapping[type, str] = {
    GivenPlanes: "planes",
    MohrCoulomb: "mohr-coulomb",
    DruckerPrager: "drucker-prager",
    WeakPlane: "weak-plane",
}

_ANYWHERE: Values = defaultdict(lambda: 0.5)  # the names of planes depend on no value


def is_smooth(material: Material) -> bool:
    """Whether the material yields by the smooth Mohr-Coulomb surface."""
    return any(isinstance(s, MohrCoulomb) and s.planes is None for s in material.yields)


def yield_law(material: Material, values: Values, elasticity: Floats) -> YieldLaw | None:
    """The law of a material, or None if it does not yield.

    Args:
        material: the material.
        values: parameters, SI.
        elasticity: E (s, s), Pa.
    """
    if not material.yields:
        return None
    planes = facets_of(material, Point(values, ()), len(elasticity)).planes()
    if is_smooth(material):
        return PrincipalLaw(elasticity, planes)
    return PolyhedralLaw(elasticity, planes)


def law_slopes(
    material: Material, values: Values, names: Sequence[str], n_strain: int
) -> dict[str, LawSlopes]:
    """Derivatives of what the law of a material is made of.

    Args:
        material: the material.
        values: parameters, SI.
        names: parameters to differentiate by.
        n_strain: number s of strain components.

    Returns:
        Parameter to derivatives, for the parameters on which the law depends.
    """
    if not material.yields:
        return {}
    facets = facets_of(material, Point(values, names), n_strain)
    stiffening = elasticity_slopes(material, values, n_strain)
    slopes = {}
    for column, name in enumerate(names):
        found = replace(facets.slopes(column), elasticity=stiffening.get(name))
        if all(getattr(found, field.name) is None for field in fields(found)):
            continue
        slopes[name] = found
    return slopes


def plane_names(material: Material, n_strain: int) -> tuple[str, ...]:
    """Names of the planes of a material's law, without the name of the material.

    Those of a smooth surface are its planes for principal stresses in descending order.
    """
    if not material.yields:
        return ()
    return facets_of(material, Point(_ANYWHERE, ()), n_strain).names


def plane_distances(material: Material, values: Values, n_strain: int) -> Floats:
    """Distances k (y,) of the planes of a material's law, Pa."""
    if not material.yields:
        return np.empty(0)
    return facets_of(material, Point(values, ()), n_strain).planes().distances


def facets_of(material: Material, point: Point, n_strain: int) -> Facets:
    """All planes of a material with their derivatives."""
    if is_smooth(material):
        (surface,) = material.yields
        assert isinstance(surface, MohrCoulomb)
        return smooth_mohr_coulomb(surface, point)
    parts = [_facets(surface, point, n_strain) for surface in material.yields]
    return parts[0] if len(parts) == 1 else joined(_labelled(material.yields, parts))


def _facets(surface: YieldSurface, point: Point, n_strain: int) -> Facets:
    if isinstance(surface, GivenPlanes):
        return given_planes(surface, point, n_strain)
    if isinstance(surface, MohrCoulomb):
        return mohr_coulomb(surface, point, n_strain)
    if isinstance(surface, DruckerPrager):
        return drucker_prager(surface, point, n_strain)
    return weak_plane(surface, point, n_strain)


def _labelled(surfaces: Sequence[YieldSurface], parts: Sequence[Facets]) -> list[Facets]:
    """Facets with names that also say which surface they are of."""
    kinds = [_KINDS[type(surface)] for surface in surfaces]
    labels = [
        f"{kind} {kinds[: n + 1].count(kind)}" if kinds.count(kind) > 1 else kind
        for n, kind in enumerate(kinds)
    ]
    return [
        replace(part, names=tuple(f"{label}: {name}" for name in part.names))
        for label, part in zip(labels, parts, strict=True)
    ]
