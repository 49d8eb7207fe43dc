"""From the yield limits of a material to the law at its strain points, with exact derivatives.

A smooth Mohr-Coulomb surface is a law in principal stresses; all else becomes one polyhedron, the
common inside of all surfaces of the material.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from geoident.fem.plastic.law import LawSlopes, Planes, YieldLaw
from geoident.forward.facets import Facets, joined
from geoident.forward.jets import Point
from geoident.forward.materials import elasticity as elasticity_of
from geoident.forward.materials import elasticity_slopes
from geoident.forward.polyhedra import given_planes, mohr_coulomb, smooth_mohr_coulomb
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.yields import GivenPlanes, MohrCoulomb, YieldSurface

Values = Mapping[str, float]
"""Parameter name to value, SI."""

_ANYWHERE: Values = defaultdict(lambda: 0.5)  # the names of planes depend on no value


def is_smooth(material: Material) -> bool:
    """Whether the material yields by the smooth Mohr-Coulomb surface."""
    return any(isinstance(s, MohrCoulomb) and s.planes is None for s in material.yields)


def yield_law(
    material: Material, values: Values, elasticity: Floats, *, ratio: float = 0.0
) -> YieldLaw | None:
    """The law of a material, or None if it does not yield.

    Args:
        material: the material.
        values: parameters, SI.
        elasticity: E (s, s), Pa.
        ratio: hardening added to every plane, in parts of n^T E m.
    """
    if not material.yields:
        return None
    planes = facets_of(material, Point(values, ()), len(elasticity)).planes()
    if ratio > 0.0:
        planes = replace(
            planes, hardening=_own(planes) + ratio * np.diag(_drop(planes, elasticity))
        )
    if is_smooth(material):
        from geoident.fem.plastic.principal import PrincipalLaw  # noqa: PLC0415

        return PrincipalLaw(elasticity, planes)
    from geoident.fem.plastic.polyhedral import PolyhedralLaw  # noqa: PLC0415

    return PolyhedralLaw(elasticity, planes)


def law_slopes(
    material: Material, values: Values, names: Sequence[str], n_strain: int, *, ratio: float = 0.0
) -> dict[str, LawSlopes]:
    """Derivatives of what the law of a material is made of.

    Args:
        material: the material.
        values: parameters, SI.
        names: parameters to differentiate by.
        n_strain: number s of strain components.
        ratio: as in `yield_law`.

    Returns:
        Parameter to derivatives, for the parameters on which the law depends.
    """
    if not material.yields:
        return {}
    facets = facets_of(material, Point(values, names), n_strain)
    stiffening = elasticity_slopes(material, values, n_strain)
    E = elasticity_of(material, values, n_strain)
    slopes = {}
    for column, name in enumerate(names):
        found = replace(facets.slopes(column), elasticity=stiffening.get(name))
        if all(getattr(found, field.name) is None for field in fields(found)):
            continue
        if ratio > 0.0:
            found = _with_hardening(found, facets.planes(), E, ratio)
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
    return joined([_facets(surface, point, n_strain) for surface in material.yields])


def _facets(surface: YieldSurface, point: Point, n_strain: int) -> Facets:
    if isinstance(surface, GivenPlanes):
        return given_planes(surface, point, n_strain)
    assert isinstance(surface, MohrCoulomb)
    return mohr_coulomb(surface, point, n_strain)


def _own(planes: Planes) -> Floats:
    """H of the planes themselves, (y, y)."""
    y = len(planes.normals)
    return np.zeros((y, y)) if planes.hardening is None else planes.hardening


def _drop(planes: Planes, elasticity: Floats) -> Floats:
    """n^T E m, (y,): how far a plane's yield function falls by its own multiplier, Pa.

    Normals of principal stresses take the block of normal stresses; E is isotropic there.
    """
    flow = planes.normals if planes.flow is None else planes.flow
    s = planes.normals.shape[1]
    return np.asarray(np.einsum("ys,st,yt->y", planes.normals, elasticity[:s, :s], flow))


def _with_hardening(
    slopes: LawSlopes, planes: Planes, elasticity: Floats, ratio: float
) -> LawSlopes:
    """Slopes that also have those of the hardening added by `ratio`."""
    s = planes.normals.shape[1]
    E = elasticity[:s, :s]
    flow = planes.normals if planes.flow is None else planes.flow
    change = np.zeros(len(flow))
    if slopes.elasticity is not None:
        change += _drop(planes, slopes.elasticity)
    if slopes.normals is not None:
        change += np.einsum("ys,st,yt->y", slopes.normals, E, flow)
    by_flow = slopes.normals if planes.flow is None else slopes.flow
    if by_flow is not None:
        change += np.einsum("ys,st,yt->y", planes.normals, E, by_flow)
    added = ratio * np.diag(change)
    return replace(
        slopes, hardening=added if slopes.hardening is None else slopes.hardening + added
    )
