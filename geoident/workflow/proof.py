"""What a certificate says of parameters, in words."""

from __future__ import annotations

from collections.abc import Sequence

from geoident.model.certificate import Certificate
from geoident.model.parameter import Parameter
from geoident.units import DIMENSIONS, UNITS


def bound_findings(found: Certificate | None, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """A sentence for each parameter whose yield planes no strain point reaches."""
    if found is None:
        return ()
    return tuple(
        f"No strain point reaches the yield planes of {q.name}: "
        f"{q.name} is at least {_in_unit(found.lower_bounds[q.name], q)}."
        for q in parameters
        if q.name in found.lower_bounds
    )


def _in_unit(value: float, parameter: Parameter) -> str:
    dimension, size = UNITS.get(parameter.unit, ("", 1.0))
    if dimension != parameter.dimension:
        return f"{value:.4g} {DIMENSIONS.get(parameter.dimension, '')}".rstrip()
    return f"{value / size:.4g} {parameter.unit}"
