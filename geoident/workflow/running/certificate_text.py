"""What a certificate says of parameters, and of all stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.forward.protocols import Survey
from geoident.model.parameter import Parameter
from geoident.model.result import ParameterTable
from geoident.model.yielding import Certificate
from geoident.units import DIMENSIONS, UNITS


def bound_findings(found: Certificate | None, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """A sentence for each parameter whose yield planes no strain point reaches."""
    if found is None:
        return ()
    unreached = [q for q in parameters if q.name in found.lower_bounds]
    least = {q.name: found.lower_bounds[q.name] for q in unreached}
    said = [
        f"No strain point reaches the yield planes of {q.name}: "
        f"{q.name} is at least {_in_unit(least[q.name], q)}, the other parameters being as found."
        for q in unreached
        if least[q.name] > max(q.lower, 0.0)
    ]
    said += [
        f"No strain point reaches the yield planes of {q.name}, wherever it is within its bounds."
        for q in unreached
        if least[q.name] <= max(q.lower, 0.0)
    ]
    names = ", ".join(dict.fromkeys([*(q.name for q in unreached), *found.open_above]))
    if names:
        said.append(
            f"The bands of predicted stages hold as long as {names} keeps the ground from yielding "
            "as in the fitted stages; where a later stage loads it more, readings will tell."
        )
    return tuple(said)


def opened(table: ParameterTable, found: Certificate | None) -> ParameterTable:
    """The parameters, with intervals up to the bound where readings exclude nothing above."""
    if found is None or not found.open_above:
        return table
    above = np.isin(table.names, found.open_above)
    return replace(table, upper95=np.where(above, table.upper, table.upper95))


def over_all_stages(found: Certificate | None, survey: Survey) -> Certificate | None:
    """The certificate with what yields in predicted stages too.

    What is known of planes that are never reached stays that of the stages with readings.
    """
    if found is None or survey.activity is None:
        return found
    yielding = survey.activity
    activity = replace(found.activity, points=yielding.points, biactive=yielding.biactive)
    return replace(found, activity=activity)


def _in_unit(value: float, parameter: Parameter) -> str:
    dimension, size = UNITS.get(parameter.unit, ("", 1.0))
    if dimension != parameter.dimension:
        return f"{value:.4g} {DIMENSIONS.get(parameter.dimension, '')}".rstrip()
    return f"{value / size:.4g} {parameter.unit}"
