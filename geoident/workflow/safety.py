"""``--safety``: factors of safety by strength reduction, of a case or with bands of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ExitCode, InputError, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.forward.safety.search import Search, safety_factors
from geoident.forward.safety.strengths import reducible
from geoident.io.bridges.values import WrittenValue, read_values
from geoident.io.text.wording import nearest
from geoident.model.arrays import Floats
from geoident.model.moments import stage_and_time
from geoident.model.results.result import Result
from geoident.model.results.safety import StageSafety, alike
from geoident.workflow.estimating.diagnosis import bare_parameter_table
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.finished import Finished, job_at_hand, write
from geoident.workflow.estimating.from_fit import (
    known_by_fit,
    plan_on_fit,
    read_fit,
    require_same_mesh,
)
from geoident.workflow.factors_at_draws import SafetyDraws
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import (
    NO_READINGS,
    Job,
    Request,
    build_model,
    job_provenance,
    load_inputs,
    of_fit,
    require_stages,
)
from geoident.workflow.running.outputs import require_free
from geoident.workflow.running.readings import reading_table
from geoident.workflow.running.result_files import files_of_result
from geoident.workflow.running.workers import ModelParts
from geoident.workflow.simulate import values_for, with_starts

DRAWS = 30
"""Draws of the posterior at which a factor is computed."""


@dataclass(frozen=True)
class SafetyRequest:
    """What is asked.

    Args:
        request: with the path of a case, or of the result of a fit, as its case.
        stages: names; the last one if empty.
        values: path of a table of values of parameters in place of the starts of a case, or None.
        draws: of the posterior of a fit at which the factor is computed.
        seed: of these; None for that of the fit.
    """

    request: Request
    stages: tuple[str, ...] = ()
    values: str | None = None
    draws: int = DRAWS
    seed: int | None = None


@dataclass(frozen=True)
class Safety:
    """Factors of safety.

    Args:
        finished: the result that has them, and where it stands.
        files_read: paths that no output may replace.
    """

    finished: Finished
    files_read: tuple[str, ...]

    @property
    def result(self) -> Result:
        """With the factors."""
        return self.finished.result

    @property
    def critical(self) -> StageSafety:
        """The stage of the smallest factor."""
        return min(self.result.safety, key=lambda one: one.value)


@dataclass(frozen=True)
class _Task:
    """Factors that can be computed.

    Args:
        asked: what was asked for.
        job: the case that is computed, and the place of the result.
        fit: whose parameters count; None for the start values of the case.
        written: values in place of these.
    """

    asked: SafetyRequest
    job: Job
    fit: Result | None = None
    written: tuple[WrittenValue, ...] = ()

    @property
    def files_read(self) -> tuple[str, ...]:
        """Paths of all that was read."""
        values, path = self.asked.values, self.job.request.case
        first = () if self.fit is None else files_of_result(self.fit, path)
        return (*first, *self.job.inputs.files, *(() if values is None else (values,)))


def safety_of_case(asked: SafetyRequest, control: Control) -> Safety:
    """Factors of safety at the start values of the parameters.

    They are written, beside the case if nothing else is said; those that are up to date are kept.

    Raises:
        InputError: the case is wrong, or nothing in it has strength that could be divided.
        UsageError: there is no such stage, or the case is not computed stage by stage on a mesh.
        ModelError: the model has no solution even with much more strength.
        OutputError: the result cannot be written.
    """
    request = asked.request
    written = () if asked.values is None else read_values(asked.values)
    overrides = [*request.overrides, NO_READINGS]
    inputs = load_inputs(request.case, overrides=overrides, text=request.text)
    require_stages(inputs.case)
    values = [(one.name, one.text, one.unit) for one in written]
    job = plan_on_fit("safety", f"{asked.stages} {values}", request, None, inputs)
    return _written(_Task(asked, job, written=written), control)


def safety_of_fit(asked: SafetyRequest, control: Control) -> Safety:
    """Factors of safety at the values of a fit, and what their posterior makes of them.

    They are written, beside the fit if nothing else is said; those that are up to date are kept.

    Raises:
        InputError: the result is no fit, its mesh has changed, or nothing in its case has strength
            to be divided.
        UsageError: there is no such stage, or the case is not computed stage by stage on a mesh.
        ModelError: the model has no solution even with much more strength.
        OutputError: the result cannot be written.
    """
    fit, inputs = read_fit(asked.request.case, "predicted")
    require_same_mesh(fit, inputs, "Run the fit again.")
    seed = fit.provenance.seed if asked.seed is None else asked.seed
    purpose, request = f"{asked.stages} {asked.draws}", replace(asked.request, seed=seed)
    job = plan_on_fit("safety", purpose, request, fit, inputs)
    return _written(_Task(asked, job, fit), control)


@one_thread()
def _written(task: _Task, control: Control) -> Safety:
    """The factors that stand there already, or new ones, written in their place."""
    job, files = task.job, task.files_read
    finished, force = job_at_hand(job), job.request.force
    if finished is None:
        require_free(job.existing, job.place, force=force, inputs=files)
        result = _result(task, control)
        finished = write(result, job.place, job.existing, inputs=files, force=force)
    return Safety(finished, files)


def _result(task: _Task, control: Control) -> Result:
    """Factors of safety; with a fit their bands, in place of what its search ends with."""
    job, fit, asked = task.job, task.fit, task.asked
    inputs = with_starts(job.inputs, task.written)
    model = _staged(build_model(inputs, solver=job.request.solver))
    case, states = model.case, _states(model, asked.stages)
    if fit is None:
        parameters = bare_parameter_table(case.parameters, values_for(model, task.written))
    else:
        require_same_modes(fit, model, inputs.case, fit.parameters.values)
        parameters = fit.parameters.of(model.names)
    p = parameters.values

    def tell(words: str) -> None:
        control.stop.check()
        control.monitor.part(words, 0.0)

    found = list(safety_factors(model, p, states, Search(tell=tell)))
    _, mechanism = min(found, key=lambda one: one[0].value)
    rows, status = [row for row, _ in found], "done"
    if fit is not None:
        draws = _draws(task, fit, model, p, control)
        rows = [draws.band(p, *one) for one in zip(states, rows, strict=True)]
        if any(row.undetermined for row in rows):
            status = "not-determined"
        if fit.status == "poor-fit":
            status = fit.status
    nothing_read = replace(case, channels=(), readings=())
    result = Result(
        kind="safety",
        status=status,
        exit_code=ExitCode.DONE if status == "done" else ExitCode.NOT_CONVERGED,
        method="strength reduction",
        reason="Factors of safety at given values of the parameters, without bands.",
        objective=np.nan,
        findings=(),
        case_text=inputs.loaded.text,
        case_resolved=inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=parameters,
        gauges=gauge_table(
            nothing_read, reading_table(nothing_read, ()), np.zeros((0, len(case.stages)))
        ),
        counts=model.counts,
        fields=model.fields_up_to_collapse(p),
        mechanism=mechanism,
        safety=alike(rows),
    )
    if fit is None:
        return result
    path = job.request.case
    return replace(
        result,
        reason=f"Factors of safety from {path} ({fit.status}).",
        objective=fit.objective,
        findings=fit.findings,
        provenance=of_fit(result.provenance, fit, path, job.place.path),
        gauges=fit.gauges,
        singular_values=fit.singular_values,
        varied=fit.varied,
    )


def _draws(
    task: _Task, fit: Result, model: StagedModel, p: Floats, control: Control
) -> SafetyDraws:
    """The draws of the posterior of a fit at which factors are computed."""
    case, request = task.job.inputs.case, task.job.request
    survey = model.survey(p, fields=False, partial=True)
    known = known_by_fit(fit, case, model, case, survey, same_case=True, follow=False)
    parts = ModelParts.of(model, case, request.solver)
    assert parts is not None  # a staged model has them
    return SafetyDraws(model, parts, control, known.assessment, task.asked.draws, request.seed)


def _staged(model: ObservedModel) -> StagedModel:
    """The model, if its strength can be reduced.

    Raises:
        UsageError: it has no mesh.
    """
    if not isinstance(model, StagedModel):
        raise UsageError(
            "Strength is reduced in cases that geoident computes on a mesh, stage by stage; this "
            "one is computed in another way."
        )
    return model


def _states(model: StagedModel, wanted: Sequence[str]) -> list[int]:
    """The numbers of the states whose factors are wanted, ascending.

    Raises:
        UsageError: there is no such stage.
        InputError: nothing in one of them has strength that could be divided.
    """
    case = model.case
    names = [stage.name for stage in case.stages]
    for name in wanted:
        moment = stage_and_time(name, {stage.whole for stage in case.stages if stage.lasts})
        if name not in names and moment is not None:
            raise UsageError(
                f"The case has no moment '{name}'; its states are: {', '.join(names)}. Add "
                f"'moments: [{moment[1]}]' to the stage '{moment[0]}', with other moments that you "
                "want."
            )
        if name not in names:
            near = nearest(name, names)
            more = f" Did you mean '{near}'?" if near else ""
            raise UsageError(
                f"There is no stage '{name}'; the stages are: {', '.join(names)}.{more}"
            )
    states = sorted({1 + names.index(name) for name in wanted or names[-1:]})
    for state in (model.sequence.states[n] for n in states):
        present = [case.materials[name] for name in dict.fromkeys(state.materials.values())]
        parts = (part for part in model.structures.parts if part.joint is not None)
        slips = any(part.structure.yields and part.stands(state) for part in parts)
        if not slips and not any(reducible(material) for material in present):
            planes = any(material.yields for material in present)
            message = f"at stage '{state.name}' no ground and no interface has a strength that "
            message += "could be divided"
            message += ": given planes have no cohesion and friction" if planes else ""
            hint = "Give 'yield: {type: mohr-coulomb, cohesion: ..., friction: ...}' in a material."
            raise InputError([case.source.fault(("materials",), "no-strength", message, hint)])
    return states
