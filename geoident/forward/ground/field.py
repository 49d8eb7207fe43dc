"""Constants that vary from place to place: from what a case says to modes at strain points.

The logarithm of a field is Gaussian (theory 10). Its modes are made on the strain points of all
ground that is ever of the material, so that it has its value wherever the material is met.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import format_point
from geoident.fem.random_field import (
    Matern,
    conditioning,
    principal_modes,
    scaling_of,
)
from geoident.forward.ground.elasticity import material_axes
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.dual import ParameterPoint
from geoident.model.ground import PointField, RandomField
from geoident.model.parameter import Parameter, Prior, Values

EXPLAINED = 0.99
"""Part of the variance that modes hold where the case does not limit their number."""

MOST_MODES = 300
"""Modes where the case says nothing of their number, at most."""

_MOST_OF_IT = 0.9
"""Part of the variance below which it is said that the modes leave some of the field out."""

MODE = ".mode-"
"""Between the name of a field and the number of a mode, from 1."""

FARTHEST = 10.0
"""Bounds of the coefficient of a mode, in standard deviations of its prior."""


def covariance_of(field: RandomField, dim: int) -> Matern:
    """The covariance of the logarithm of a field in a model of 2 or 3 dimensions."""
    axes = material_axes(field.frame, ParameterPoint({}, ()), section=dim == 2).value
    first, last = field.lengths[0], field.lengths[-1]
    middle = field.lengths[1] if len(field.lengths) == 3 else first
    lengths = np.array([first, middle, last])
    return Matern(field.sd, scaling_of(axes[:dim], lengths), field.smoothness)


def point_field(field: RandomField, points: Ints, positions: Floats, start: Values) -> PointField:
    """A field at the strain points of its material.

    Args:
        field: as the case says it.
        points: (n,) numbers of the strain points, ascending.
        positions: (n, dim) their coordinates, m.
        start: parameter values against whose mean the tests count.
    """
    covariance = covariance_of(field, positions.shape[1])
    reference = field.mean.value(start)
    at = np.array([test.position for test in field.measured]).reshape(-1, positions.shape[1])
    values = np.array([test.value for test in field.measured])
    noise = np.array([(test.accuracy / test.value) ** 2 for test in field.measured])
    conditioned = conditioning(covariance, positions, at, noise)
    most = MOST_MODES if field.modes is None else field.modes
    modes = principal_modes(covariance, positions, conditioned, explained=EXPLAINED, most=most)
    return PointField(
        material=field.material,
        constant=field.constant,
        surface=field.surface,
        points=points,
        known=conditioned.weights @ np.log(values / reference),
        modes=modes.shapes,
        names=tuple(f"{field.name}{MODE}{k + 1}" for k in range(modes.shapes.shape[1])),
        pull=conditioned.weights.sum(axis=1),
        reference=reference,
        explained=modes.explained,
    )


def with_modes(case: Case, fields: Sequence[PointField]) -> Case:
    """The case with the coefficients of the modes of its fields among its parameters, the last.

    Args:
        case: as it is written.
        fields: one for each of its `Case.fields`.
    """
    names = [name for made in fields for name in made.names]
    return replace(case, parameters=(*named_parameters(case), *mode_parameters(case, names)))


def mode_parameters(case: Case, names: Sequence[str]) -> tuple[Parameter, ...]:
    """The coefficients of modes as parameters.

    Args:
        case: with their fields.
        names: of parameters; those that are of no field are passed over.
    """
    return tuple(
        Parameter(
            name=name,
            start=0.0,
            lower=-FARTHEST,
            upper=FARTHEST,
            prior=Prior(0.0, 1.0),
            field=field.name,
        )
        for name in names
        for field in case.fields
        if name.rpartition(MODE)[0] == field.name
    )


def named_parameters(case: Case) -> tuple[Parameter, ...]:
    """The parameters that the case names, without those of modes."""
    return tuple(parameter for parameter in case.parameters if not parameter.field)


def field_notes(case: Case, fields: Sequence[PointField]) -> list[str]:
    """How many modes each field has and how much of its variance they hold.

    Args:
        case: as it is written.
        fields: one for each of its `Case.fields`.
    """
    notes = []
    for field, made in zip(case.fields, fields, strict=True):
        number, part = len(made.names), 100 * made.explained
        note = f"the field {field.name} has {number} modes with {part:.3g} % of its variance"
        if field.measured:
            note += f" (what {len(field.measured)} measured values leave of it)"
        if made.explained < _MOST_OF_IT:
            note += "; what they leave out is smoother in the model than in the ground: give " + (
                "more `modes`" if field.modes is not None else "longer lengths or more `modes`"
            )
        notes.append(note)
    return notes


def field_faults(case: Case, not_in: Callable[[str, tuple[float, ...]], str | None]) -> list[Fault]:
    """Measured points that do not lie in their material.

    Args:
        case: the case.
        not_in: of a material and a point (dim,): None where the point lies in such ground, else
            what is there, half a sentence.
    """
    faults = []
    for field in case.fields:
        for test in field.measured:
            reason = not_in(field.material, test.position)
            if reason is None:
                continue
            origin = f" ({test.origin})" if test.origin else ""
            message = f"the measured point {format_point(test.position)}{origin} {reason}"
            hint = "Correct its coordinates, or remove it: it gives no information on "
            hint += f"{field.material!r}."
            faults.append(
                case.source.fault((*field.path, *test.path), "point-outside", message, hint)
            )
    return faults
