"""What a fit knows of constants that vary from place to place (theory 10.4)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geoident.errors import InputError
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.uncertainty import Assessment
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.dual import ParameterPoint
from geoident.model.ground import PointField, PointGrowth, RandomField
from geoident.model.results.result import Result
from geoident.model.results.varied import FieldEstimate

_NOTHING = 1e-6
"""Prior variance, in parts of the field's, below which there is nothing left to reduce."""

_SAME_FIELD = 1e-6
"""Difference of the logarithm of a field at an element up to which its modes are the same."""

_BLOCK = 500
"""Draws of a field that are held at once."""


def field_estimates(
    model: ObservedModel, values: Floats, assessment: Assessment
) -> tuple[FieldEstimate, ...]:
    """The fields of a case at the elements of their materials, from the linearised posterior.

    Args:
        model: of the case.
        values: (n,) the estimate, SI.
        assessment: how well the parameters are known.
    """
    if not isinstance(model, StagedModel):
        return ()
    dp_dx, estimates = assessment.dp_dx, list[FieldEstimate]()
    covariance = np.outer(dp_dx, dp_dx) * assessment.posterior.covariance
    for field, made in zip(model.case.fields, model.on_mesh.fields, strict=True):
        _, mean_of = _averages(model, made.points)
        slopes, columns = mean_of @ made.modes, [model.names.index(name) for name in made.names]
        if field.mean.parameter is not None:
            at = model.names.index(field.mean.parameter)
            slope = (1 - mean_of @ made.pull) / values[at]
            columns, slopes = [at, *columns], np.column_stack([slope, slopes])
        variance = np.einsum("qi,qi->q", slopes @ covariance[np.ix_(columns, columns)], slopes)
        logarithm = _logarithm(model, field, made, values)
        estimates.append(_random(model, field, made, logarithm, np.maximum(variance, 0.0)))
    point = ParameterPoint(model.values(values), model.names)
    for growth in model.on_mesh.growths:
        _, mean_of = _averages(model, growth.points)
        grown = np.asarray(mean_of @ growth.value(point).columns)
        relative = grown[:, 1:] / grown[:, :1]
        moved = np.flatnonzero(relative.any(axis=0))  # an undetermined parameter elsewhere is NaN
        slopes, part = relative[:, moved], covariance[np.ix_(moved, moved)]
        variance = np.einsum("qi,qi->q", slopes @ part, slopes)
        estimates.append(_grown(model, growth, grown[:, 0], variance))
    return tuple(estimates)


def drawn_fields(model: ObservedModel, draws: Floats) -> tuple[FieldEstimate, ...]:
    """The same from draws of the posterior.

    Logarithms are averaged over the strain points of an element, then over the draws; of a constant
    that grows the mean over the strain points comes first.

    Args:
        model: of the case.
        draws: (k, n) parameters and modes, SI.
    """
    if not isinstance(model, StagedModel):
        return ()
    estimates = list[FieldEstimate]()
    for field, made in zip(model.case.fields, model.on_mesh.fields, strict=True):
        _, mean_of = _averages(model, made.points)
        modes, pull = np.asarray(mean_of @ made.modes), np.asarray(mean_of @ made.pull)
        columns = [model.names.index(name) for name in made.names]
        total, squares = np.zeros((2, len(modes)))
        shift: Floats | None = None
        for start in range(0, len(draws), _BLOCK):
            block = draws[start : start + _BLOCK]
            mean = np.log([field.mean.value(model.values(row)) for row in block])
            logarithm = np.outer(1.0 - pull, mean) + modes @ block[:, columns].T
            shift = logarithm.mean(axis=1) if shift is None else shift
            total += (logarithm - shift[:, None]).sum(axis=1)
            squares += ((logarithm - shift[:, None]) ** 2).sum(axis=1)
        assert shift is not None
        centre = total / len(draws)
        variance = np.maximum(squares / len(draws) - centre**2, 0.0)
        middle = shift + centre + pull * np.log(made.reference) + mean_of @ made.known
        estimates.append(_random(model, field, made, middle, variance))
    for growth in model.on_mesh.growths:
        elements, mean_of = _averages(model, growth.points)
        total, squares, first = np.zeros(len(elements)), np.zeros(len(elements)), None
        for row in draws:
            point = ParameterPoint(model.values(row), ())
            logarithm = np.log(mean_of @ growth.value(point).value)
            first = logarithm if first is None else first
            total, squares = total + (logarithm - first), squares + (logarithm - first) ** 2
        assert first is not None
        centre = total / len(draws)
        variance = squares / len(draws) - centre**2
        estimates.append(_grown(model, growth, np.exp(first + centre), variance))
    return tuple(estimates)


def _random(
    model: StagedModel, field: RandomField, made: PointField, logarithm: Floats, variance: Floats
) -> FieldEstimate:
    """A random field at its elements, from the middle (n,) of its logarithm and the variance."""
    elements, mean_of = _averages(model, made.points)
    modes = np.asarray(mean_of @ made.modes)
    prior = np.einsum("qi,qi->q", modes, modes)
    left = np.divide(variance, prior, out=np.ones_like(prior), where=prior > _NOTHING * field.sd**2)
    return FieldEstimate(
        name=field.name,
        material=field.material,
        constant=field.constant,
        dimension=field.dimension,
        unit=_unit(model, field.unit, field.mean.parameter),
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


def _grown(
    model: StagedModel, made: PointGrowth, values: Floats, variance: Floats
) -> FieldEstimate:
    """A constant that grows at its elements, with the variance (n,) of its logarithm."""
    growth, (elements, mean_of) = made.growth, _averages(model, made.points)
    return FieldEstimate(
        name=growth.name,
        material=growth.material,
        constant=growth.constant,
        dimension=growth.dimension,
        unit=_unit(model, growth.unit, growth.base.parameter),
        elements=elements,
        centres=np.asarray(mean_of @ made.positions),
        values=values,
        sd=np.sqrt(np.maximum(variance, 0.0)),
        prior_sd=np.full(len(values), np.nan),
        reduction=np.zeros(len(values)),
        modes=0,
        explained=1.0,
    )


def _logarithm(model: StagedModel, field: RandomField, made: PointField, values: Floats) -> Floats:
    """Logarithm of a field at its elements, the mean of that at their strain points."""
    known = model.values(values)
    mean = field.mean.value(known)
    mean_of = _averages(model, made.points)[1]
    return np.asarray(np.log(mean) + mean_of @ np.log(made.factor(known, mean)))


def require_same_modes(fit: Result, model: ObservedModel, case: Case, values: Floats) -> None:
    """Refuse a model whose modes, made again from its mesh, give another field than the fit has.

    The coefficients of a fit mean something with its own modes only. They are of the mesh, of the
    ground that is of the material, and of the libraries that found them.

    Args:
        fit: holds the values of its fields at the elements.
        model: of the case.
        case: the case.
        values: (n,) the estimate of the fit, in the order of the model, SI.

    Raises:
        InputError: with those fields.
    """
    if not isinstance(model, StagedModel) or not model.on_mesh.fields:
        return
    estimates = {estimate.name: estimate for estimate in fit.varied}
    faults = []
    for field, made in zip(model.case.fields, model.on_mesh.fields, strict=True):
        before = estimates.get(field.name)
        if before is None:  # a result that does not tell
            continue
        elements, _ = _averages(model, made.points)
        if not np.array_equal(elements, before.elements):
            why = f"they are of {len(elements)} elements, those of the fit of "
            why += f"{len(before.elements)}"
            if len(elements) == len(before.elements):
                why = "they are of other elements"
        else:
            now = _logarithm(model, field, made, values)
            apart = float(np.abs(now - np.log(before.values)).max())
            if apart <= _SAME_FIELD:
                continue
            why = f"with its coefficients they give values up to {100 * np.expm1(apart):.2g} % "
            why += "from those of the fit"
        faults.append(
            case.source.fault(
                field.path,
                "other-field",
                f"the modes of {field.name} are not those of the fit: {why}",
                "Keep mesh and groups as they were, or run the fit again.",
            )
        )
    if faults:
        raise InputError(faults)


def _averages(model: StagedModel, points: Ints) -> tuple[Ints, sp.csr_array]:
    """Elements (n,), and the means over their strain points of numbers at points, (n, points)."""
    strain_points = model.discretization.points
    elements, row = np.unique(strain_points.element[points], return_inverse=True)
    weight = strain_points.volume[points]
    weight = weight / np.bincount(row, weight)[row]
    return elements, sp.csr_array(
        (weight, (row, np.arange(len(points)))), shape=(len(elements), len(points))
    )


def _unit(model: StagedModel, unit: str, parameter: str | None) -> str:
    """The unit of a number: its own, or that of the parameter to which it is tied."""
    units = {q.name: q.unit for q in model.case.parameters}
    return unit or units.get(parameter or "", "")
