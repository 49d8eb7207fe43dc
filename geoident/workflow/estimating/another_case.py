"""What a fit may say of another case: its parameters, its fields and its gauges, compared."""

from __future__ import annotations

from dataclasses import replace
from math import isclose
from typing import Any

import numpy as np

from geoident.errors import InputError
from geoident.identify.assessment.uncertainty import Assessment
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.arrays import Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, Reading, ReadingTable
from geoident.model.ground import RandomField
from geoident.model.results.result import Result
from geoident.workflow.estimating.accuracies import with_found, with_scatter
from geoident.workflow.running.jobs import Inputs
from geoident.workflow.running.readings import reading_table, used_rows, why_useless


def require_identified(fit: Result, inputs: Inputs) -> None:
    """Refuse a case with parameters that a fit does not know.

    Raises:
        InputError: with those parameters.
    """
    known = fit.parameters.names
    faults = [
        inputs.case.source.fault(
            ("parameters", parameter.name),
            "not-identified",
            f"the fit knows no parameter {parameter.name!r}",
            f"It identified {', '.join(known)}; give a number instead.",
        )
        for parameter in inputs.case.parameters
        if parameter.name not in known
    ]
    if faults:
        raise InputError(faults)


def require_same_fields(fit: Result, origin: Case, inputs: Inputs) -> None:
    """Refuse another case whose fields, or their modes, are not those of the fit.

    Raises:
        InputError: with those fields.
    """

    def unplaced(field: RandomField) -> RandomField:
        """A field without where it is written."""
        measured = tuple(replace(test, path=(), origin="") for test in field.measured)
        return replace(field, path=(), measured=measured)

    known = {unplaced(field) for field in origin.fields}
    same_mesh = inputs.mesh_sha256 == fit.provenance.mesh_sha256
    faults = [
        inputs.case.source.fault(
            field.path,
            "other-field",
            f"the modes of {field.name} are not those of the fit"
            + ("" if same_mesh else ", which was made on another mesh"),
            "Modes are of one mesh, covariance and set of tests: keep these as they were.",
        )
        for field in inputs.case.fields
        if not same_mesh or unplaced(field) not in known
    ]
    if faults:
        raise InputError(faults)


def why_other_gauges(fit: Result, origin: Inputs, inputs: Inputs) -> str:
    """Why the gauges of another case are not those of a fit; empty where they are.

    They are where the case has every reading that the fit has used, at a gauge that is written as
    it was. Names tell nothing: gauges of two sections are often called alike.

    Args:
        fit: the result.
        origin: its case.
        inputs: the other case.
    """

    def gauges_as_written(case: Inputs) -> dict[str, Any]:
        data = parse_yaml(case.loaded.resolved, case.path).data
        gauges = data.get("gauges") if isinstance(data, dict) else None
        return gauges if isinstance(gauges, dict) else {}

    written, now = gauges_as_written(origin), gauges_as_written(inputs)
    channels = {channel.name: channel for channel in inputs.case.channels}
    values: dict[tuple[str, str], list[float]] = {}
    for reading in inputs.case.readings:
        if reading.value is not None and not reading.bad:
            values.setdefault((reading.channel, reading.stage), []).append(reading.value)
    for channel, reading in used_rows(origin.case, fit.gauges.readings.used):
        other = channels.get(channel.name)
        if other is None:
            return f"it has no gauge '{channel.name}'"
        same = written.get(channel.gauge) == now.get(channel.gauge)
        if not same or _placed(channel) != _placed(other):
            return f"the gauge '{channel.gauge}' is written otherwise"
        read = values.get((reading.channel, reading.stage), [])
        if not any(isclose(value, reading.value or 0.0, rel_tol=1e-9) for value in read):
            return f"the reading of {reading.channel} at {reading.stage} is not in it"
    return ""


def _placed(channel: Channel) -> Channel:
    """A channel without its errors, which a fit may have estimated."""
    return replace(channel, accuracy=0.0, errors=None, key=())


def with_gauges_of_fit(inputs: Inputs, origin: Inputs, fit: Result) -> Inputs:
    """A case with the gauges of a fit, with the accuracies that this has found.

    Gauges that the fit does not have are as accurate as it found those of their kind.

    Args:
        inputs: of the case.
        origin: of the case of the fit.
        fit: the result.
    """
    case, fitted = inputs.case, {channel.name: channel for channel in origin.case.channels}
    same_mesh = inputs.mesh_sha256 == fit.provenance.mesh_sha256
    same_steps = case.time_steps == origin.case.time_steps
    if fit.model_error is not None:
        case = with_scatter(case, fit.model_error.factor, fit.model_error.zero)
    if fit.accuracies is not None:
        case = with_found(case, fit.accuracies)

    def as_fitted(channel: Channel) -> Channel:
        before = fitted.get(channel.name)
        if before is None or _placed(before) != _placed(channel):
            return channel
        errors = before.errors
        if errors is not None and not same_mesh:
            errors = replace(errors, mesh=())
        if errors is not None and not same_steps:
            errors = replace(errors, steps=())
        return replace(channel, accuracy=before.accuracy, errors=errors)

    case = replace(case, channels=tuple(as_fitted(channel) for channel in case.channels))
    return replace(inputs, loaded=replace(inputs.loaded, case=case))


def pick_assessment(assessment: Assessment, order: Ints) -> Assessment:
    """What is known of some parameters, by their numbers (k,), whatever the others are."""
    intervals = ("sd", "lower95", "upper95", "beyond_bounds", "dp_dx")
    columns = (*intervals, "at_bound", "determined", "from_prior")
    square = np.ix_(order, order)
    return replace(
        assessment,
        covariance=assessment.covariance[square],
        correlation=assessment.correlation[square],
        posterior=assessment.posterior.pick(order),
        uncut_mean=assessment.uncut_mean[order],
        uncut_factor=assessment.uncut_factor[order],
        determined_x=assessment.determined_x[order],
        gaps_x=assessment.gaps_x[order],
        held_covariance_x=assessment.held_covariance_x[square],
        over=None if assessment.over is None else assessment.over.pick(order),
        wider=assessment.wider[order],
        **{name: getattr(assessment, name)[order] for name in columns},
    )


def readings_as_used(case: Case, used: ReadingTable, *, others: bool) -> ReadingTable:
    """The readings of another case: those that a fit has used are used, each of them once.

    Args:
        case: the other case.
        used: the readings of the fit.
        others: its gauges are not those of the fit, of whose readings it then has none.
    """
    left: dict[tuple[str, str], list[float]] = {}
    for k in np.flatnonzero(used.used & (not others)).tolist():
        left.setdefault((used.channel[k], used.stage[k]), []).append(float(used.value[k]))

    def why_unused(reading: Reading) -> str:
        if useless := why_useless(reading):
            return useless
        values = left.get((reading.channel, reading.stage), [])
        for value in values:
            if isclose(value, reading.value or 0.0, rel_tol=1e-9):
                values.remove(value)
                return ""
        return "the fit has not used it"

    return reading_table(case, [why_unused(reading) for reading in case.readings])
