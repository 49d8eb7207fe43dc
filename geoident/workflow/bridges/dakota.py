"""``geoident simulate CASE --dakota PARAMS RESULTS``: an evaluation that Dakota asks for.

Values of variables are in the units in which the case gives the starts of its parameters, those of
responses in the units of their gauges. Gradients are the exact derivatives of the model, where a
program elsewhere computes it central differences.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from geoident.errors import Fault, InputError, ModelError
from geoident.forward.external.model import ExternalModel
from geoident.forward.observed import ObservedModel
from geoident.io.bridges.dakota import (
    GRADIENT,
    AskedResponse,
    DakotaRequest,
    data_text,
    failure_text,
    input_text,
    read_request,
    results_text,
)
from geoident.io.bridges.names import plain, reading_names
from geoident.io.text.atomic import atomic_output
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.units import in_unit, size_in
from geoident.workflow.bridges.driven import DrivenCase, driven_case, untold
from geoident.workflow.running.jobs import NO_READINGS, load_inputs
from geoident.workflow.simulate import (
    BY_MODEL,
    ComputedBy,
    answering_model,
    simulated_pairs,
    values_for,
    with_starts,
)

_EXPERIMENT = re.compile("_[0-9]+$")


def answer(
    path: str,
    parameters: str,
    results: str,
    *,
    overrides: Sequence[str] = (),
    by: ComputedBy = BY_MODEL,
    force: bool = False,
) -> None:
    """Answer a request of Dakota.

    Args:
        path: of the case.
        parameters: path of the file of parameters.
        results: path of the file of results.
        overrides: ``KEY=VALUE`` in place of what the case says.
        by: what computes it.
        force: a file of results that exists is replaced.

    Raises:
        InputError: the case or the request is wrong, or the two do not fit; there is no file of
            results then, so that Dakota stops.
        ModelError: the model has no solution; the file of results says so, as Dakota expects.
        OutputError: the file of results cannot be written.
    """
    request = read_request(parameters)
    inputs = load_inputs(path, overrides=[*overrides, NO_READINGS])
    files = (*inputs.files, parameters)
    inputs = with_starts(inputs, request.values)
    failure = None
    try:
        text = _answered(answering_model(inputs, by), request)
    except ModelError as error:
        text, failure = failure_text(error.message), error
    with atomic_output(results, overwrite=force, inputs=files) as part:
        Path(part).write_text(text, encoding="utf-8")
    if failure is not None:
        raise failure


def _answered(model: ObservedModel, request: DakotaRequest) -> str:
    places = _places(model, request.asked)
    columns = _columns(model, request)
    p = values_for(model, request.values)
    case, slopes = model.case, np.zeros((0, 0, 0))
    if isinstance(model, ExternalModel) and not any(o.parts & GRADIENT for o in request.asked):
        computed, columns = model.computed(p), []  # derivatives would take more runs
    else:
        survey = model.survey(p, fields=isinstance(model, ExternalModel))
        computed, slopes = survey.computed, survey.sensitivity
    values = np.zeros(len(places))
    gradients = np.zeros((len(places), len(columns)))
    for k, (row, stage) in enumerate(places):
        unit = case.channels[row].unit, case.channels[row].dimension
        values[k] = in_unit(float(computed[row, stage]), *unit)
        for d, column in enumerate(columns):
            by = case.parameters[column]
            size = size_in(by.unit, by.dimension) or 1.0
            gradients[k, d] = in_unit(float(slopes[row, stage, column]) * size, *unit)
    for one, value, gradient in zip(request.asked, values, gradients, strict=True):
        if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
            raise ModelError(f"the model gives no number for {one.name}")
    return results_text(request.asked, values, gradients)


def _places(model: ObservedModel, asked: Sequence[AskedResponse]) -> list[tuple[int, int]]:
    """Channel and stage of each response.

    Raises:
        InputError: some are no readings of the case.
    """
    pairs = simulated_pairs(model)
    rows = {channel.name: n for n, channel in enumerate(model.case.channels)}
    stages = {stage.name: n for n, stage in enumerate(model.case.stages)}
    known = {
        name: (rows[channel], stages[stage])
        for name, (channel, stage) in zip(reading_names(pairs), pairs, strict=True)
    }
    places, faults = [], []
    for one in asked:
        name = one.name.lower()
        # with a file of readings Dakota adds the number of the experiment to each name
        name = name if name in known else _EXPERIMENT.sub("", name)
        if name in known:
            places.append(known[name])
        else:
            message = f"the response '{shorten(one.name)}' is not a reading of the case"
            hint = did_you_mean(one.name, known, what="Its readings are called")
            faults.append(Fault("unknown-response", message, hint, one.place))
    if faults:
        raise InputError(faults)
    return places


def _columns(model: ObservedModel, request: DakotaRequest) -> list[int]:
    """Numbers of the parameters by which derivatives are wanted."""
    names = [parameter.name for parameter in model.case.parameters]
    faults = [
        Fault(
            "unknown-parameter",
            f"there is no parameter '{shorten(name)}' in the case to differentiate by",
            did_you_mean(name, names, what="Parameters"),
            place,
        )
        for name, place in request.by
        if name not in names
    ]
    if faults:
        raise InputError(faults)
    return [names.index(name) for name, _ in request.by]


def export_dakota(
    path: str, *, output: str | None = None, force: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Write an input file of Dakota for a case, and the readings beside it.

    Args:
        path: of the case.
        output: folder of the files; ``CASE.dakota`` beside the case if None.
        force: replace files that stand there.

    Returns:
        The files, the input file first; what Dakota is not told of the case.

    Raises:
        InputError: the case is wrong.
        UsageError: the case comes from stdin, or a path has blanks.
        OutputError: a file exists or cannot be written.
    """
    driven = driven_case(path, "Dakota", output, not_taken=" \t'\"", force=force)
    stem, case, readings = plain(Path(path).stem), driven.model.case, driven.readings
    channels = {channel.name: channel for channel in case.channels}
    values, sds = [], []
    for (channel, _), k in driven.used.items():
        unit = channels[channel].unit, channels[channel].dimension
        values.append(in_unit(float(readings.value[k]), *unit))
        sds.append(in_unit(float(readings.sd[k]), *unit))
    names = [driven.names[pair] for pair in driven.used]
    texts = {
        f"{stem}.in": input_text(stem, driven.seen, case.parameters, names),
        f"{stem}.dat": data_text(values, sds),
    }
    return driven.write(texts, stem), tuple(_notes(driven))


def _notes(driven: DrivenCase) -> Iterator[str]:
    """What Dakota is not told of a case."""
    case = driven.model.case
    priors = [parameter.name for parameter in case.parameters if parameter.prior is not None]
    if priors:
        yield f"the priors of {listing(priors)} are left out: least squares of Dakota has none"
    if driven.errors.columns.nnz:
        yield "readings share errors, of which Dakota knows only their size"
    yield from untold(case, "Dakota")
