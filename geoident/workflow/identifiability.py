"""``geoident check --identifiability``: what planned gauges could determine, before any reading.

The sensitivities of the model at the start values and the accuracies of the gauges are all that
theory 6 needs: covariance and singular values do not depend on what is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.errors import InputError
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.problem.problem import Problem
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Reading
from geoident.model.results.summary import Identifiability
from geoident.workflow.estimating.diagnosis import parameter_table
from geoident.workflow.estimating.surface_error import with_surface_error
from geoident.workflow.running.jobs import (
    NO_READINGS,
    Inputs,
    build_model,
    load_inputs,
    require_stages,
    start_values,
)
from geoident.workflow.running.readings import error_structure, select_readings


def identifiability(
    path: str, *, overrides: Sequence[str] = (), solver: str = "auto"
) -> Identifiability:
    """Assess the gauges of a case at its start values. Readings need not exist.

    Every channel counts as read at every stage of ``fit.stages`` (all stages, if not given) after
    the one at which it is zeroed, with its stated accuracy. Where stages last and the case has a
    list of readings, it says when which channel is read; its values do not matter, and may be
    missing.

    Args:
        path: of the case; ``-`` for stdin.
        overrides: ``KEY=VALUE`` in place of what the case says.
        solver: name of the sparse solver, or ``auto``.

    Raises:
        InputError: the case is faulty, or no gauge can be read in the stages of the fit.
        ModelError: the model has no solution at the start values.
    """
    inputs = load_inputs(path, overrides=[*overrides, NO_READINGS])
    require_stages(inputs.case)
    has_readings = _has_readings(inputs)
    listed = _with_list(inputs, path, overrides) if has_readings and inputs.case.lasts else None
    inputs = listed or inputs
    model = build_model(inputs, solver=solver)
    case = model.case
    p = start_values(case, model)
    case = with_surface_error(case, model, p)
    survey = model.survey(p, fields=False)
    if listed is None:
        rows = planned_readings(case, survey.computed)
        readings = [
            Reading(case.channels[i].name, case.stages[j].name, None) for i, j in rows.tolist()
        ]
    else:
        rows, readings = listed_readings(case, model)
    pairs = zip(rows[:, 0].tolist(), readings, strict=True)
    sd, shared = error_structure([(case.channels[i], reading) for i, reading in pairs]).stated
    problem = Problem(
        model.response(()), survey.computed[*rows.T], sd, case.parameters, shared=shared
    )
    known = assess(problem, p, survey.sensitivity[*rows.T])
    table = parameter_table(case.parameters, p, known)
    return Identifiability(
        table.picked(table.named),
        known.findings,
        known.singular_values,
        len(rows),
        read=has_readings,
        listed=listed is not None,
    )


def _with_list(planned: Inputs, path: str, overrides: Sequence[str]) -> Inputs | None:
    """A case with its readings, and states at their dates; None where their file is not there yet.

    Raises:
        InputError: the readings are faulty.
    """
    text = planned.loaded.text if path == "-" else None
    try:
        listed = load_inputs(path, overrides=overrides, text=text)
    except InputError as error:
        if any(fault.code != "missing-file" for fault in error.faults):
            raise
        return None
    return listed if listed.case.readings else None


def listed_readings(case: Case, model: ObservedModel) -> tuple[Ints, list[Reading]]:
    """The readings of a case that a fit would use if all had values, and their rows (g, 2).

    Raises:
        InputError: there are none.
    """
    filled = [replace(r, value=1.0 if r.value is None else r.value) for r in case.readings]
    used = select_readings(replace(case, readings=tuple(filled)), model).used
    readings = [reading for reading, use in zip(case.readings, used, strict=True) if use]
    if not readings:
        raise _nothing_to_read(case)
    channel = {one.name: n for n, one in enumerate(case.channels)}
    stage = {one.name: n for n, one in enumerate(case.stages)}
    rows = [(channel[reading.channel], stage[reading.stage]) for reading in readings]
    return np.array(rows, dtype=np.int64), readings


def _has_readings(inputs: Inputs) -> bool:
    """Whether the case names readings, which planning does not read."""
    data = parse_yaml(inputs.loaded.text, inputs.path).data
    return isinstance(data, dict) and bool(data.get("readings"))


def planned_readings(case: Case, computed: Floats) -> Ints:
    """(g, 2) rows and columns of the channels and stages that would be read.

    Raises:
        InputError: there are none.
    """
    rows = [
        (i, j)
        for j, stage in enumerate(case.stages)
        for i, channel in enumerate(case.channels)
        if np.isfinite(computed[i, j])
        and not (channel.is_zeroed and stage.name == channel.zero)
        and (case.fit.stages is None or stage.name in case.fit.stages)
    ]
    if not rows:
        raise _nothing_to_read(case)
    return np.array(rows, dtype=np.int64)


def _nothing_to_read(case: Case) -> InputError:
    message = "no gauge can be read in the stages of the fit"
    hint = "add gauges, zero them earlier, or extend 'fit.stages'"
    return InputError([case.source.fault(("gauges",), "no-planned-readings", message, hint)])
