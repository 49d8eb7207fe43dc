"""Strengths that vary from point to point: surfaces of one shape, scaled and moved (theory 10.7).

A material has one law, of a surface that no point has, and its points have a factor f and a
hydrostatic shift t of that surface (`fem.yielding.scaled_law`). For surfaces by cohesion and
friction, cut off at a tensile strength T, that is all they need: a surface of c_1, phi and T_1 that
is scaled by f and moved by t is one of

    c = f c_1 + t tan(phi) ,  T = f T_1 + t ,
    so with T_1 = 0:  t = T ,  f = (c - T tan(phi)) / c_1 ,

so cohesion and tension may grow each in its way. The surface keeps its shape while T is less than
c / tan(phi): beyond, the cut-off would have no effect. Where a strength is a random field, or sigci
of Hoek and Brown grows, the whole surface is scaled, and t = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import format_point
from geoident.forward.ground.elasticity import not_positive
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import PointField, PointGrowth
from geoident.model.parameter import Scalar, Values
from geoident.model.yielding import HoekBrown, YieldSurface, with_strengths


@dataclass(frozen=True)
class _Computed(Scalar):
    """A number that follows from others, with its derivatives."""

    of_point: Dual | None = None

    def columns(self, values: Values, names: Sequence[str]) -> Floats:
        """Its value and derivatives, at the point at which it was computed."""
        assert self.of_point is not None
        return self.of_point.columns


def mean_surface(
    material: Material, grown: Sequence[PointGrowth], point: ParameterPoint
) -> Material:
    """The material with the means, over its points, of strengths that grow."""
    means = {}
    for one in grown:
        columns = one.value(point).columns.mean(axis=0)
        means[one.growth.surface, one.growth.constant] = _Computed(
            float(columns[0]), of_point=Dual(columns)
        )
    return replace(material, yields=with_strengths(material.yields, means))


def common_surface(
    material: Material, number: int, sizes: Mapping[str, float], start: Values
) -> Material:
    """The material with the surface that is scaled and moved to each of its points.

    It depends on no strength that varies: cohesion and sigci are of a typical size, a cut-off of
    tension is at zero.

    Args:
        material: as the case says it.
        number: index of the surface whose strengths vary.
        sizes: typical numbers of these, by name, Pa.
        start: parameters by name, SI, at which a strength that does not vary is of typical size.
    """
    surface, name = material.yields[number], _main(material.yields[number])
    size = sizes.get(name) or surface.strengths[name].value(start)
    fixed: dict[tuple[int | None, str], Scalar] = {(number, name): Scalar(size or 1.0)}
    if surface.strengths.get("tension") is not None and not isinstance(surface, HoekBrown):
        fixed[number, "tension"] = Scalar(0.0)
    return replace(material, yields=with_strengths(material.yields, fixed))


def with_common_surface(on_mesh: CaseOnMesh, material: Material) -> Material:
    """A material with the surface that is common to its points; as stated where none grows."""
    grown = on_mesh.strength_growths(material.name)
    if not grown:
        return material
    sizes = {one.growth.constant: one.typical for one in grown}
    return common_surface(material, varied_surface(grown), sizes, on_mesh.case.start)


def varied_surface(grown: Sequence[PointGrowth]) -> int:
    """Index of the surface of strengths that grow: a material has one (`checks`)."""
    number = grown[0].growth.surface
    assert number is not None
    return number


def surface_factors(
    on_mesh: CaseOnMesh, material: str, point: ParameterPoint
) -> tuple[Dual, Dual] | None:
    """F and t (q,) with derivatives, at all strain points of a material.

    None where none of its strengths varies.
    """
    stated = on_mesh.case.materials[material]
    grown, fields = on_mesh.strength_growths(material), on_mesh.strength_fields(material)
    if grown:
        number = varied_surface(grown)
        common = with_common_surface(on_mesh, stated).yields[number]
        strengths = {one.growth.constant: one.value(point) for one in grown}
        return factor_and_shift(stated.yields[number], common, strengths, point)
    if fields:  # a surface that keeps its shape has one (`checks`)
        factor = _field_factor(stated, fields[0], point)
        return factor, Dual(np.zeros_like(factor.columns))
    return None


def factor_and_shift(
    surface: YieldSurface,
    common: YieldSurface,
    strengths: Mapping[str, Dual],
    point: ParameterPoint,
) -> tuple[Dual, Dual]:
    """F and t (q,) of strengths at points.

    Args:
        surface: as the case says it.
        common: which is scaled and moved.
        strengths: (q,) those that vary, by name, Pa.
        point: the parameters.
    """
    given, name = surface.strengths, _main(surface)
    count = len(next(iter(strengths.values())).columns)

    def at_points(strength: str) -> Dual:
        if strength in strengths:
            return strengths[strength]
        return Dual(np.tile(point.number(given[strength]).columns, (count, 1)))

    main, size = at_points(name), point.number(common.strengths[name])
    if "tension" not in given or isinstance(surface, HoekBrown):
        return main / size, Dual(np.zeros_like(main.columns))
    tension, friction = at_points("tension"), point.number(given["friction"])
    return (main - tension * (friction.sine() / friction.cosine())) / size, tension


def _main(surface: YieldSurface) -> str:
    """The strength by which a surface is scaled."""
    return "sigci" if isinstance(surface, HoekBrown) else "cohesion"


def _field_factor(material: Material, field: PointField, point: ParameterPoint) -> Dual:
    """The factor (q,) of a field of strength, with its derivatives, also by its modes."""
    assert field.surface is not None
    mean = point.number(material.yields[field.surface].strengths[field.constant])
    factor = field.factor(point.values, float(mean.value))
    slopes = np.outer(-field.pull, mean.columns[1:] / float(mean.value))
    places = {name: k for k, name in enumerate(point.names)}
    for k, name in enumerate(field.names):
        if name in places:
            slopes[:, places[name]] += field.modes[:, k]
    return Dual(np.column_stack([factor, slopes * factor[:, None]]))


def inadmissible_strengths(on_mesh: CaseOnMesh, material: str, values: Values) -> str | None:
    """Why strengths that grow are not admissible at parameter values, a sentence; None if so."""
    grown = on_mesh.strength_growths(material)
    for one in grown:
        reason = not_positive(one, values)
        if reason is not None:
            return reason
    factors = surface_factors(on_mesh, material, ParameterPoint(values, ())) if grown else None
    if factors is None or factors[0].value.min() > 0.0:
        return None
    worst = int(np.argmin(factors[0].value))
    tension, where = float(factors[1].value[worst]), format_point(grown[0].positions[worst])
    return (
        f"at {where} the tension of {material}, {tension / 1e3:.4g} kPa, is not less than "
        "c / tan(phi), so that its cut-off has no effect there"
    )


def strength_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Strengths that grow and leave no tension to cut off somewhere at the start values."""
    case, faults = on_mesh.case, []
    for name in case.materials:
        reason = inadmissible_strengths(on_mesh, name, case.start)
        if reason is not None:
            path = on_mesh.strength_growths(name)[0].growth.path
            hint = "Leave out the tension, let it grow less, or give that ground its own material."
            message = f"{reason} at the start values"
            faults.append(case.source.fault(path, "out-of-range", message, hint))
    return faults
