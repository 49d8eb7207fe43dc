"""What a fit knows of constants that vary from place to place (theory 10.4)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geoident.forward.model import StagedModel
from geoident.forward.protocols import CaseModel
from geoident.identify.assessment.uncertainty import Assessment
from geoident.model.arrays import Floats, Ints
from geoident.model.ground import Field, PointField
from geoident.model.results.varied import FieldEstimate

_NOTHING = 1e-6
"""Prior variance, in parts of the field's, below which there is nothing left to reduce."""


def field_estimates(
    model: CaseModel, values: Floats, assessment: Assessment
) -> tuple[FieldEstimate, ...]:
    """The fields of a case at the elements of their materials.

    Args:
        model: of the case.
        values: (n,) the estimate, SI.
        assessment: how well the parameters are known.
    """
    if not isinstance(model, StagedModel) or not model.on_mesh.fields:
        return ()
    slope = assessment.slope
    covariance = np.outer(slope, slope) * assessment.posterior.covariance
    return tuple(
        _estimate(model, field, made, values, covariance)
        for field, made in zip(model.case.fields, model.on_mesh.fields, strict=True)
    )


def _estimate(
    model: StagedModel, field: Field, made: PointField, values: Floats, covariance: Floats
) -> FieldEstimate:
    elements, mean_of = _averages(model, made.points)
    modes, pull = np.asarray(mean_of @ made.modes), np.asarray(mean_of @ made.pull)
    known = model.values(values)
    mean = field.mean.value(known)
    columns = [model.names.index(name) for name in made.names]
    slopes = modes
    if field.mean.parameter is not None:
        at = model.names.index(field.mean.parameter)
        columns, slopes = [at, *columns], np.column_stack([(1 - pull) / values[at], modes])
    part = covariance[np.ix_(columns, columns)]
    variance = np.maximum(np.einsum("qi,qi->q", slopes @ part, slopes), 0.0)
    prior = np.einsum("qi,qi->q", modes, modes)
    left = np.divide(variance, prior, out=np.ones_like(prior), where=prior > _NOTHING * field.sd**2)
    logarithm = np.log(mean) + mean_of @ np.log(made.factor(known, mean))
    return FieldEstimate(
        name=field.name,
        material=field.material,
        constant=field.constant,
        dimension=field.dimension,
        unit=_unit(model, field),
        elements=elements,
        centres=np.asarray(mean_of @ model.discretization.points.position[made.points]),
        values=np.exp(logarithm),
        sd=np.sqrt(variance),
        prior_sd=np.sqrt(prior),
        reduction=np.clip(1.0 - left, 0.0, 1.0),
        modes=len(made.names),
        explained=made.explained,
        tests=len(field.measured),
    )


def _averages(model: StagedModel, points: Ints) -> tuple[Ints, sp.csr_array]:
    """Elements (n,), and the means over their strain points of numbers at points, (n, points)."""
    given = model.discretization.points
    elements, row = np.unique(given.element[points], return_inverse=True)
    weight = given.volume[points]
    weight = weight / np.bincount(row, weight)[row]
    return elements, sp.csr_array(
        (weight, (row, np.arange(len(points)))), shape=(len(elements), len(points))
    )


def _unit(model: StagedModel, field: Field) -> str:
    """The unit of a field: that of its mean, or of the parameter to which that is tied."""
    units = {q.name: q.unit for q in model.case.parameters}
    return field.unit or units.get(field.mean.parameter or "", "")
