"""Moduli of a material with their derivatives: uniform, or with constants that are fields.

Where constants are fields, the formulas of `fem.elasticity` are taken at all strain points at once,
with dual numbers whose derivatives are by few things: the parameters that the material's own
numbers depend on, and the logarithm of each field. The modes follow by the chain rule,
dE/dxi_k = (dE/dlog c) modes[:, k]; no array has as many columns as there are modes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem.moduli import Moduli, PointwiseModuli, ScaledModuli, UniformModuli
from geoident.forward.ground.elasticity import elasticity, elasticity_of
from geoident.forward.ground.point_fields import PointField
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Elastic, constants, numbers_of


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


def uniform_moduli(columns: Dual, names: Sequence[str]) -> MaterialModuli:
    """Moduli without fields.

    Args:
        columns: E (s, s) with its derivatives by n parameters.
        names: of these.
    """
    slopes = ((name, columns.slope(n)) for n, name in enumerate(names))
    return MaterialModuli(
        UniformModuli(np.ascontiguousarray(columns.value)),
        {name: UniformModuli(slope) for name, slope in slopes if slope is not None},
    )


def scales_whole(elastic: Elastic, fields: Sequence[PointField]) -> bool:
    """Whether fields multiply the whole matrix by one factor.

    That is so where all moduli (not the ratios) vary together: E grows in proportion to them.
    """
    moduli = {name for name in constants(elastic) if not name.startswith("nu")}
    alike = all(field.same_variation(fields[0]) for field in fields[1:])
    return moduli == {field.constant for field in fields} and alike


def field_moduli(
    elastic: Elastic, fields: Sequence[PointField], point: ParameterPoint, n_strain: int
) -> MaterialModuli:
    """Moduli with constants that are fields, at all strain points of their material.

    Args:
        elastic: symmetry, constants and axes; the constants of the fields are their means.
        fields: of the material, one at least.
        point: the parameters.
        n_strain: number s of strain components of the analysis.
    """
    s, section = n_strain, n_strain < 6
    own = {scalar.parameter for scalar in numbers_of(elastic).values()}
    local = ParameterPoint(point.values, tuple(name for name in point.names if name in own))
    differentiated = any(name in point.names for field in fields for name in field.names)
    if scales_whole(elastic, fields):
        factor = fields[0].factor(point.values)
        matrix = Dual(elasticity(elastic, local, section=section).columns[:s, :s])
        mean = uniform_moduli(matrix, local.names)
        value = ScaledModuli(np.ascontiguousarray(matrix.value), factor)
        slopes = {
            name: ScaledModuli(matrix.columns[..., 1 + n], factor)
            for n, name in enumerate(local.names)
            if name in mean.slopes
        }
        modes = (ModeSlopes(value, fields[0]),) if differentiated else ()
        return MaterialModuli(value, slopes, modes)
    extra = len(fields) if differentiated else 0
    numbers = {name: _wide(local.number(c), extra) for name, c in constants(elastic).items()}
    for n, field in enumerate(fields):
        varying = numbers[field.constant].times(field.factor(point.values)[:, None, None])
        if differentiated:
            varying.columns[..., varying.n - extra + n + 1] = varying.value
        numbers[field.constant] = varying
    columns = elasticity_of(elastic, numbers, local, section=section, extra=extra).columns
    entries = np.ascontiguousarray(np.moveaxis(columns[:, :s, :s], 0, -2))  # (s, s, q, 1 + k)
    parts = [
        PointwiseModuli(np.ascontiguousarray(entries[..., k])) for k in range(entries.shape[3])
    ]
    k = 1 + len(local.names)
    return MaterialModuli(
        parts[0],
        {
            name: part
            for name, part in zip(local.names, parts[1:k], strict=True)
            if part.entries.any()
        },
        tuple(ModeSlopes(part, field) for part, field in zip(parts[k:], fields, strict=False)),
    )


def _wide(number: Dual, extra: int) -> Dual:
    """A number as an array (1, 1, 1) that broadcasts to matrices at points, with more columns."""
    columns = np.concatenate([number.columns, np.zeros(extra)])
    return Dual(columns[None, None, None])
