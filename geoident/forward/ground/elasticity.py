"""Elastic moduli of a material at its strain points, with exact derivatives by the parameters.

The numbers of a case go through the formulas of `fem.elasticity`, one for each symmetry. Where
constants are fields, the formulas are taken at all strain points at once, with dual numbers whose
derivatives are by few things: the parameters that the material's own numbers depend on, and the
logarithm of each field. The modes follow by the chain rule, dE/dxi_k = (dE/dlog c) modes[:, k]; no
array has as many columns as there are modes. Constants that grow with depth or stress bring their
values and derivatives at every point along.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem import elasticity as formulas
from geoident.fem.elasticity import (
    Moduli,
    PointwiseModuli,
    ScaledModuli,
    UniformModuli,
)
from geoident.fem.location import format_point
from geoident.forward.stages import CaseOnMesh, Index
from geoident.forward.stages import numbers as places_of
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Material
from geoident.model.creep import impossible, impossible_ageing
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import (
    Anisotropic,
    Attitude,
    Elastic,
    Frame,
    Isotropic,
    LoveModuli,
    Orthotropic,
    PointField,
    PointGrowth,
    TransverselyIsotropic,
    bounded,
    breach,
    constants,
    elastic_scalars,
)
from geoident.model.parameter import Values
from geoident.model.yielding import bounded_surfaces

_FORMULAS: Mapping[type, Callable[[formulas.Constants], Dual]] = {
    Isotropic: formulas.isotropic,
    TransverselyIsotropic: formulas.transversely_isotropic,
    LoveModuli: formulas.love,
    Orthotropic: formulas.orthotropic,
    Anisotropic: formulas.anisotropic,
}


def elastic_matrix(elastic: Elastic, point: ParameterPoint, *, section: bool) -> Dual:
    """E (6, 6) in the axes of the model, or of a plane section, Pa.

    Args:
        elastic: symmetry, constants and axes.
        point: the parameters.
        section: the model is a plane section, seen looking north.
    """
    numbers = {n: point.number(s) for n, s in constants(elastic).items()}
    return elasticity_of(elastic, numbers, point, section=section)


def elasticity_of(
    elastic: Elastic,
    numbers: formulas.Constants,
    point: ParameterPoint,
    *,
    section: bool,
) -> Dual:
    """E (6, 6), or (q, 6, 6) at several points, of constants that are given.

    Args:
        elastic: symmetry and axes.
        numbers: its constants, or (q, 1, 1) of them, with derivatives by n parameters; by other
            quantities after them.
        point: the n parameters.
        section: the model is a plane section, seen looking north.
    """
    matrix = _FORMULAS[type(elastic)](numbers)
    frame: Frame | None = getattr(elastic, "frame", None)
    if frame is None:
        return matrix
    axes = material_axes(frame, point, section=section).columns
    others = matrix.n + 1 - axes.shape[2]
    return formulas.turned(matrix, Dual(np.pad(axes, ((0, 0), (0, 0), (0, others)))))


def material_axes(frame: Frame, point: ParameterPoint, *, section: bool) -> Dual:
    """Material axes 1, 2, 3 as columns (3, 3) in the axes of the model.

    Args:
        frame: attitude or vectors.
        point: the parameters.
        section: the model is a plane section, seen looking north.
    """
    if isinstance(frame, Attitude):
        dip, direction = point.number(frame.dip), point.number(frame.dip_direction)
        rotation = point.number(frame.rotation)
        return formulas.axes_of_attitude(dip, direction, rotation, section=section)
    axes = formulas.axes_of_vectors(np.array(frame.first), np.array(frame.second))
    return point.constant(axes)


@dataclass(frozen=True, eq=False)
class ModeSlopes:
    """Derivatives of moduli by the modes of a field.

    Args:
        moduli: dE/dlog c at the points (q).
        field: whose modes multiply it.
        places: (q,) the points among those of the field; None: all of them, in order.
    """

    moduli: Moduli
    field: PointField
    places: Ints | None = None

    @property
    def modes(self) -> Floats:
        """(q, n_modes) Phi at the points."""
        return self.field.modes if self.places is None else self.field.modes[self.places]


@dataclass(frozen=True, eq=False)
class MaterialModuli:
    """E at strain points (q) of a material, and its derivatives.

    Args:
        value: E, Pa.
        slopes: parameter to dE/dp, for those that E depends on otherwise than by a mode.
        modes: derivatives by modes.
    """

    value: Moduli
    slopes: Mapping[str, Moduli]
    modes: tuple[ModeSlopes, ...] = ()

    def at(self, places: Ints) -> MaterialModuli:
        """At some of the points, (k,) by place."""
        return MaterialModuli(
            self.value.at(places),
            {name: moduli.at(places) for name, moduli in self.slopes.items()},
            tuple(ModeSlopes(m.moduli.at(places), m.field, places) for m in self.modes),
        )


def field_moduli(
    elastic: Elastic,
    fields: Sequence[PointField],
    point: ParameterPoint,
    n_strain: int,
    growths: Sequence[PointGrowth] = (),
) -> MaterialModuli:
    """Moduli with constants that are fields or grow, at all strain points of their material.

    Args:
        elastic: symmetry, constants and axes; the constants of the fields are their means, those
            that grow are their typical numbers.
        fields: of the material.
        point: the parameters.
        n_strain: number s of strain components of the analysis.
        growths: of the material; one of these or of the fields at least.
    """
    own = {name for scalar in elastic_scalars(elastic).values() for name in scalar.parameters}
    own = own.union(*(growth.names for growth in growths))
    local = ParameterPoint(point.values, tuple(name for name in point.names if name in own))
    by_modes = any(name in point.names for field in fields for name in field.names)
    if vary_whole(elastic, fields, growths):
        return _scaled(elastic, fields, growths, local, n_strain, by_modes=by_modes)
    return _pointwise(elastic, fields, growths, local, n_strain, by_modes=by_modes)


def vary_whole(
    elastic: Elastic, fields: Sequence[PointField], growths: Sequence[PointGrowth]
) -> bool:
    """Whether one factor at every point multiplies the whole matrix.

    That is so where all moduli (not the ratios) vary together: E grows in proportion to them.

    Args:
        elastic: symmetry and constants.
        fields: of the material.
        growths: of the material.
    """
    moduli = {name for name in constants(elastic) if not name.startswith("nu")}
    if growths:
        return not fields and len(growths) == 1 and moduli == {growths[0].growth.constant}
    first = fields[0]
    return (
        moduli == {field.constant for field in fields}
        and all(
            field.names == first.names
            and np.array_equal(field.known, first.known)
            and np.array_equal(field.modes, first.modes)
            and not (field.pull.any() or first.pull.any())  # their factors depend on their means
            for field in fields[1:]
        )
    )


def _scaled(
    elastic: Elastic,
    fields: Sequence[PointField],
    growths: Sequence[PointGrowth],
    local: ParameterPoint,
    s: int,
    *,
    by_modes: bool,
) -> MaterialModuli:
    """One matrix, of the means or typical numbers, times a factor of every point."""
    matrix = Dual(elastic_matrix(elastic, local, section=s < 6).columns[:s, :s])
    if growths:
        factor = growths[0].value(local) / growths[0].typical
    else:
        mean = local.number(constants(elastic)[fields[0].constant])
        factor = field_factor(fields[0], mean, local.values)
    value = ScaledModuli(np.ascontiguousarray(matrix.value), np.ascontiguousarray(factor.value))
    slopes: dict[str, Moduli] = {}
    for n, name in enumerate(local.names):
        slope, change = matrix.slope(n), factor.slope(n)
        if slope is not None and change is not None:
            both = slope[..., None] * value.factor + value.matrix[..., None] * change
            slopes[name] = PointwiseModuli(both)
        elif slope is not None:
            slopes[name] = ScaledModuli(slope, value.factor)
        elif change is not None:
            slopes[name] = ScaledModuli(value.matrix, change)
    return MaterialModuli(value, slopes, (ModeSlopes(value, fields[0]),) if by_modes else ())


def _pointwise(
    elastic: Elastic,
    fields: Sequence[PointField],
    growths: Sequence[PointGrowth],
    local: ParameterPoint,
    s: int,
    *,
    by_modes: bool,
) -> MaterialModuli:
    """A matrix of its own at every point."""
    extra = len(fields) if by_modes else 0

    def matrices(columns: Floats) -> Dual:
        """Numbers (..., 1 + n) that broadcast to matrices at points, with more derivatives."""
        return Dual(np.pad(np.atleast_2d(columns), ((0, 0), (0, extra)))[:, None, None])

    numbers = {name: matrices(local.number(c).columns) for name, c in constants(elastic).items()}
    for n, field in enumerate(fields):
        mean = local.number(constants(elastic)[field.constant])
        number = matrices((field_factor(field, mean, local.values) * mean).columns)
        if by_modes:
            number.columns[..., local.n_columns + n] = number.value
        numbers[field.constant] = number
    for growth in growths:
        numbers[growth.growth.constant] = matrices(growth.value(local).columns)
    dual = elasticity_of(elastic, numbers, local, section=s < 6)
    entries = np.moveaxis(dual.columns[:, :s, :s], 0, 2)  # (s, s, q, 1 + k)
    parts = [PointwiseModuli(np.ascontiguousarray(entries[..., k])) for k in range(dual.n + 1)]
    k = local.n_columns
    slopes = zip(local.names, parts[1:k], strict=True)
    return MaterialModuli(
        parts[0],
        {name: part for name, part in slopes if part.entries.any()},
        tuple(ModeSlopes(part, field) for part, field in zip(parts[k:], fields, strict=False)),
    )


def field_factor(field: PointField, mean: Dual, values: Values) -> Dual:
    """By what the mean of a field is multiplied at its points, (q, 1 + n).

    Where tests hold the field, the factor depends on the mean m, by m^-pull.

    Args:
        field: the field; its modes are not differentiated by.
        mean: m, with its n derivatives.
        values: parameters by name, SI.
    """
    factor = field.factor(values, float(mean.value))
    slope = -np.outer(factor * field.pull, mean.columns[1:] / mean.value)
    return Dual(np.column_stack([factor, slope]))


class ModuliAt:
    """Moduli of all materials of a case at one parameter vector, each made once.

    Args:
        on_mesh: the case on its mesh, with its fields.
        point: the parameters; all derivatives are by its names.
        n_strain: number s of strain components of the analysis.
    """

    def __init__(self, on_mesh: CaseOnMesh, point: ParameterPoint, n_strain: int) -> None:
        self.on_mesh, self.point, self.n_strain = on_mesh, point, n_strain
        self._moduli: dict[str, MaterialModuli] = {}
        self._parts: dict[str, tuple[Index, MaterialModuli]] = {}
        self._elasticities: dict[str, Dual] = {}

    def moduli(self, material: str, points: Index | None = None) -> MaterialModuli:
        """E at strain points of a material with its derivatives.

        Args:
            material: its name.
            points: (q,) which of its points; needed only where a constant varies.
        """
        if material not in self._moduli:
            fields = self.on_mesh.elastic_fields(material)
            growths = self.on_mesh.elastic_growths(material)
            if fields or growths:
                elastic, s = self.on_mesh.elastic(material), self.n_strain
                moduli = field_moduli(elastic, fields, self.point, s, growths)
            else:
                matrix = self.elastic_matrix(material)
                slopes = ((name, matrix.slope(n)) for n, name in enumerate(self.point.names))
                moduli = MaterialModuli(
                    UniformModuli(np.ascontiguousarray(matrix.value)),
                    {name: UniformModuli(slope) for name, slope in slopes if slope is not None},
                )
            self._moduli[material] = moduli
        moduli = self._moduli[material]
        if points is None or isinstance(moduli.value, UniformModuli):
            return moduli
        of_material = self.on_mesh.material_points(material)
        wanted = places_of(points, self.on_mesh.discretization.points.n_points)
        if len(wanted) == len(of_material):
            return moduli
        # The points of a stage are asked for several times, always as the same object.
        kept = self._parts.get(material)
        if kept is None or kept[0] is not points:
            kept = points, moduli.at(np.searchsorted(of_material, wanted))
            self._parts[material] = kept
        return kept[1]

    def elastic_matrix(self, material: str) -> Dual:
        """E (s, s) of a material, Pa; where a constant is a field, that of its mean.

        Where one grows, that of its typical number.
        """
        if material not in self._elasticities:
            elastic, s = self.on_mesh.elastic(material), self.n_strain
            full = elastic_matrix(elastic, self.point, section=s < 6)
            self._elasticities[material] = Dual(np.ascontiguousarray(full.columns[:s, :s]))
        return self._elasticities[material]


def inadmissible(material: Material, values: Values) -> str | None:
    """Why the moduli or strengths are not admissible, as a sentence; None if they are."""
    surfaces = bounded_surfaces(material.yields, material.growths)
    breaches = (surface.breach(values) for surface in surfaces)
    elastic = bounded(material.elastic, material.growths)
    reason = breach(elastic, values) or next(filter(None, breaches), None)
    if reason is None and material.soil is not None:
        reason = material.soil.breach(values)
    if reason is None:
        clauses = [impossible(one, values) for one in material.creep]
        if material.ageing is not None:
            clauses.append(impossible_ageing(material.ageing, values))
        clause = next(filter(None, clauses), None)
        return clause and f"of {material.name} {clause}"
    return f"{reason.constant} of {material.name} is {reason.shown}, {reason.limit}"


def inadmissible_moduli(
    material: Material,
    fields: Sequence[PointField],
    values: Values,
    n_strain: int,
    growths: Sequence[PointGrowth] = (),
) -> str | None:
    """Why moduli that vary from point to point are not admissible; None if they are.

    Args:
        material: the material; of constants that grow it has the typical numbers.
        fields: its elastic constants that are fields.
        values: parameters by name, SI.
        n_strain: number s of strain components of the analysis.
        growths: its elastic constants that grow; one of these or of the fields at least.
    """
    elastic, numbers = material.elastic, constants(material.elastic)
    for growth in growths:
        reason = not_positive(growth, values)
        if reason is not None:
            return reason
    for field in fields:
        with np.errstate(over="ignore"):
            factor = field.factor(values, numbers[field.constant].value(values))
        if not (np.isfinite(factor).all() and factor.min() > 0.0):
            return (
                f"{field.constant} of {material.name} is zero or too large to compute with at a "
                "strain point"
            )
    if vary_whole(elastic, fields, growths):
        return None
    moduli = field_moduli(elastic, fields, ParameterPoint(values, ()), n_strain, growths).value
    points = fields[0].points if fields else growths[0].points
    matrices = moduli.matrices(np.arange(len(points)))
    if np.linalg.eigvalsh(matrices).min() > 0.0:
        return None
    grown = (growth.growth.constant for growth in growths)
    names = ", ".join((*(field.constant for field in fields), *grown))
    return (
        f"where {names} of {material.name} varies most, its elasticity is not positive definite: "
        "ratios that its other constants allow at the mean are not allowed there"
    )


def not_positive(one: PointGrowth, values: Values) -> str | None:
    """Where a constant is not positive at parameter values, half a sentence; None for nowhere."""
    with np.errstate(all="ignore"):
        stiffness = one.value(ParameterPoint(values, ())).value
    if np.isfinite(stiffness).all() and stiffness.min() > 0.0:
        return None
    worst = int(np.argmin(np.where(np.isfinite(stiffness), stiffness, -np.inf)))
    number, where = stiffness[worst], format_point(one.positions[worst])
    return f"{one.growth.words}: it is {number:.4g} Pa at {where}, where it must be positive"
