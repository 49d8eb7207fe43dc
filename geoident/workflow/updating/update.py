"""``geoident update``: new readings judged by the last fit, then fitted in from its answer.

A new reading is one that the case uses now and the last fit did not. It is held against what that
fit had predicted of it (`judging`); then the search goes on from the old answer with all readings.
The result takes the place of the last one and has the history of both (`history`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from geoident.errors import Fault, InputError, Location, Term, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.observed import ObservedModel
from geoident.io.result.file import read_identity, read_result
from geoident.io.text.lock import locked_meanwhile
from geoident.io.text.text_file import STDIN
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.gauges import ReadingTable
from geoident.model.results.findings import Finding
from geoident.model.results.result import STOPPED, Result
from geoident.workflow.estimating.finished import Finished
from geoident.workflow.fit import fit
from geoident.workflow.in_service.effects import all_is_known
from geoident.workflow.in_service.fit import with_reasons
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import (
    Earlier,
    Inputs,
    Job,
    Request,
    build_model,
    inputs_of_result,
    load_inputs,
    plan_fit,
)
from geoident.workflow.running.outputs import Existing, Target, target
from geoident.workflow.running.readings import select_readings
from geoident.workflow.running.result_files import case_path
from geoident.workflow.scoring.trials import nearby
from geoident.workflow.updating.files import state_of
from geoident.workflow.updating.history import extended, history_of, made_again, step_of
from geoident.workflow.updating.judging import Judgement, judged_by_fit, judged_in_service
from geoident.workflow.updating.readings import ReadingChanges, change_words, compared_readings


@dataclass(frozen=True)
class UpdateRequest:
    """What to bring up to date.

    Args:
        path: of a case, or of the result of its fit.
        overrides: of the case; if none, those that the last fit was made with.
        output: a file or an existing folder; None for beside the case.
        solver: name of the sparse solver, or ``auto``.
    """

    path: str
    overrides: tuple[str, ...] = ()
    output: str | None = None
    solver: str = "auto"


@dataclass(frozen=True)
class UpdateTask:
    """A fit that may be brought up to date.

    Args:
        job: the fit to make.
        before: the last one; None where there is none.
        path: of it.
    """

    job: Job
    before: Result | None
    path: str


@dataclass(frozen=True)
class Updated:
    """What came of an update.

    Args:
        finished: the fit, and where it stands.
        nothing_new: nothing was done; the remark of the fit says why.
    """

    finished: Finished
    nothing_new: bool = False

    @property
    def alarm(self) -> bool:
        """The new readings do not belong to the model, or have reached an alarm value."""
        history = self.finished.result.updates
        return not self.nothing_new and history is not None and history.steps[-1].alarm


def plan_update(request: UpdateRequest) -> UpdateTask:
    """Read the case as it is now, and its last fit.

    Raises:
        InputError: the case is wrong or changes while it is read, what stands there is no fit, or
            the case has other parameters.
        OutputError: the result could not be written.
    """
    case, output, place = _places(request)
    before = read_result(place.path) if place.path.exists() else None
    overrides = request.overrides
    if before is not None:
        _require_fit(before, str(place.path))
        stands: Mapping[str, Any] = json.loads(before.provenance.stamp or "{}")
        overrides = overrides or tuple(stands.get("overrides", ()))
    asked = Request(
        case=case,
        overrides=overrides,
        output=output,
        seed=0 if before is None else before.provenance.seed,
        solver=request.solver,
        force=before is not None,  # its history stays in the result
    )
    files = state_of(case)
    job = plan_fit(asked)
    if job.existing is Existing.FOREIGN:
        message = "this is the fit of another case"
        hint = f"Give the update of {case} another place with {Term.OUTPUT}."
        raise InputError([Fault("other-case", message, hint, Location(str(place.path)))])
    if state_of(case) != files:
        message = "it, or a file that it names, was being written while it was read"
        raise InputError([Fault("being-written", message, "Try again.", Location(case))])
    return UpdateTask(job, before, str(place.path))


def _places(request: UpdateRequest) -> tuple[str, str | None, Target]:
    """The case, what was said of the place of its result, and that place."""
    case, output = request.path, request.output
    if case == STDIN:
        message = "A case from stdin has no files that grow: give its path, or that of its fit."
        raise UsageError(message)
    if case.endswith(".h5"):
        identity = read_identity(case)
        if identity is None:
            read_result(case)  # says what is wrong with it
        else:
            case, output = case_path(case, identity.case_file), output or case
    return case, output, target(case, "fit", output=output)


def _require_fit(before: Result, path: str) -> None:
    if before.kind != "fit":
        message = f"this is the result of a {before.kind}; a fit can be updated"
        hint = f"Name the fit: {before.provenance.fit_file or 'CASE.fit.h5'}."
        raise InputError([Fault("not-a-fit", message, hint, Location(path))])


@contextmanager
def updating(request: UpdateRequest) -> Iterator[UpdateTask]:
    """`plan_update` while no other process updates the same result.

    Raises:
        InputError, OutputError: as `plan_update`; another process updates it.
    """
    _, _, place = _places(request)
    lock = place.path.with_name(f".{place.path.name}.lock")
    busy = f"{place.path}: another geoident updates it now\n    wait for its end"
    with locked_meanwhile(lock, busy):
        yield plan_update(request)


@one_thread()
def update(task: UpdateTask, control: Control) -> Updated:
    """Judge new readings and fit them in; the first time it is a fit.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    job, before = task.job, task.before
    if before is None:
        control.monitor.inform("There is no result yet: this is the first fit.")
        return Updated(fit(job, control))
    if job.existing is Existing.UP_TO_DATE:
        return _unchanged(task, before, "its files are those of the last result")
    origin = inputs_of_result(before, job.inputs.path)
    ladder = bool(job.inputs.case.fit.ladder)
    inputs = _as_judged(task, control) if ladder else job.inputs
    if inputs is None:
        return Updated(fit(job, control))
    _require_same_parameters(before, inputs)
    model = build_model(inputs, solver=job.request.solver)
    table = select_readings(model.case, model)
    acting = inputs.case.in_time
    if acting is not None:
        table = with_reasons(table, acting, all_is_known(inputs.case, model, table.time))
    changes = compared_readings(before.gauges.readings, table)
    case_changed = _without_readings(origin) != _without_readings(inputs)
    case_changed |= inputs.mesh_sha256 != before.provenance.mesh_sha256
    again = job.existing is Existing.UNFINISHED or before.status == STOPPED
    if not changes and not case_changed and not again:
        return _unchanged(task, before, _why_nothing_new(before, table))
    resumed = again and before.updates is not None and not changes
    judgement = Judgement()
    if changes.new and not resumed:
        judgement = _judged(before, origin, inputs, model, table, changes, not case_changed)
    words = change_words(changes, before.gauges.readings, table)
    if case_changed:
        words += " The case has changed beside its readings: it is fitted as it is now."
    onward = _continued(
        task, before, changes, judgement, words.strip(),
        case_changed=case_changed, resumed=resumed,
    )  # fmt: skip
    return Updated(fit(onward, control))


def _unchanged(task: UpdateTask, before: Result, why: str) -> Updated:
    """The last result, which stays as it is."""
    remark = f"Nothing new: {why}. {task.path} stays as it is."
    return Updated(Finished(before, (task.path,), remarks=(remark,)), nothing_new=True)


def _as_judged(task: UpdateTask, control: Control) -> Inputs | None:
    """Of a ladder of models the one that was chosen, with the readings as they are now."""
    assert task.before is not None
    try:
        return load_inputs(task.job.inputs.path, text=task.before.case_resolved)
    except InputError as error:
        fault = error.faults[0].message
        control.monitor.warn(f"The new readings are not judged by the chosen model: {fault}.")
        return None


def _require_same_parameters(before: Result, inputs: Inputs) -> None:
    named = {before.parameters.names[i] for i in before.parameters.named}
    now = {parameter.name for parameter in inputs.case.parameters}
    if named != now:
        message = f"the case identifies {', '.join(sorted(now))}; the last result has "
        message += f"{', '.join(sorted(named))}: it cannot be continued"
        hint = "Fit the case: the last result is kept beside the new one, with its history."
        place = inputs.case.source.locate(("parameters",))
        raise InputError([Fault("other-parameters", message, hint, place, "parameters")])


def _without_readings(inputs: Inputs) -> Any:
    """A case as data, without its readings and the head of its report."""
    data = parse_yaml(inputs.loaded.computed or inputs.loaded.resolved, inputs.path).data
    assert isinstance(data, dict)  # a case that was read
    return {key: value for key, value in data.items() if key != "readings"}


def _why_nothing_new(before: Result, table: ReadingTable) -> str:
    """Why nothing is fitted: of readings that came and are not used, what stands in their way."""
    known = {*zip(before.gauges.readings.channel, before.gauges.readings.stage,
                  before.gauges.readings.value.tolist(), strict=True)}  # fmt: skip
    came = [
        k
        for k in table.unused.tolist()
        if (table.channel[k], table.stage[k], float(table.value[k])) not in known
        and table.value[k] == table.value[k]
    ]
    if not came:
        return "no used reading is new, changed or gone since the last result"
    why = "; ".join(dict.fromkeys(table.reason[k] for k in came))
    return f"{len(came)} new readings are not used ({why})"


def _judged(
    before: Result,
    origin: Inputs,
    inputs: Inputs,
    model: ObservedModel,
    table: ReadingTable,
    changes: ReadingChanges,
    same_case: bool,
) -> Judgement:
    """New readings held against the last fit."""
    if before.seasonal is not None:
        return judged_in_service(before, inputs.case, model, table, changes.new)
    inputs = replace(inputs, loaded=replace(inputs.loaded, case=model.case))
    return judged_by_fit(before, origin, inputs, model, table, changes.new, same_case=same_case)


def _continued(
    task: UpdateTask,
    before: Result,
    changes: ReadingChanges,
    judgement: Judgement,
    words: str,
    *,
    case_changed: bool,
    resumed: bool,
) -> Job:
    """The fit from the old answer, whose result has the history of both.

    Args:
        task: the update.
        before: the last fit.
        changes: of its readings.
        judgement: of the new ones.
        words: what else has changed; empty for nothing.
        case_changed: so has the case beside them.
        resumed: the last fit was this one, cut short: its readings were judged before.
    """
    job, history = task.job, history_of(before)

    def joined(result: Result) -> Result:
        reached = {(one.gauge, one.level) for one in result.alarms if one.reached}
        reached -= {(one.gauge, one.level) for one in before.alarms if one.reached}
        off = not judgement.belong and before.status in _TRUSTED
        alarm = off or bool(reached)
        step = step_of(result, changes, judgement, alarm=alarm, case_changed=case_changed)
        findings = list(judgement.findings)
        if words:
            findings.append(Finding("changed-readings", "", words))
        if resumed:
            return replace(result, updates=made_again(history, step, result))
        whole = extended(history, step, judgement, result)
        return replace(result, findings=(*findings, *result.findings), updates=whole)

    names = (before.parameters.names, before.parameters.values.tolist())
    ended = before.status not in (STOPPED, "not-converged")
    earlier = Earlier(dict(zip(*names, strict=True)), ended, joined)
    methods = job.methods  # an answer that is in doubt is searched from all starts again
    if judgement.belong and before.rivals is None:
        methods = tuple(nearby(options) for options in methods)
    return replace(job, earlier=earlier, methods=methods)


_TRUSTED = ("converged", "not-determined")
"""Ends of a fit whose bands are to be relied on, as far as they are finite."""
