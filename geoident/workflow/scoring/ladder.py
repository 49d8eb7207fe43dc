"""A ladder of models: one fit each, from the simplest on, and the one that the readings ask for.

Every model is the case with some changes, and a job of its own with a result of its own
(``CASE.RUNG.fit.h5``), so that a run that was interrupted goes on from there. The chosen one is
the result of the case as well, which holds the comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from geoident.errors import Fault, InputError, ModelError
from geoident.io.text.text_file import STDIN
from geoident.model.case import Case, Rung
from geoident.units import in_unit, shown_unit
from geoident.workflow.estimating.finished import Finished, job_at_hand, write
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Job, job_provenance, load_inputs, plan_fit
from geoident.workflow.scoring.comparison import Candidate, compared
from geoident.workflow.scoring.trials import clause

_NO_LADDER = "fit.ladder="
"""Override for a rung: a case of its own."""


def fit_ladder(job: Job, control: Control, fit_one: Callable[[Job, Control], Finished]) -> Finished:
    """Fits all models of a case, and writes that which the readings ask for as its result.

    Args:
        job: of a case with a ladder.
        control: progress, budget and stops.
        fit_one: fits one model.

    Raises:
        InputError: a model of the ladder is wrong, or none can be fitted.
        Interrupted: a stop was asked for; the same command goes on.
    """
    if (before := job_at_hand(job)) is not None:
        return before
    case, request = job.inputs.case, job.request
    require_sound(request.case, request.overrides, case, request.text)
    fits: list[tuple[Job, Candidate, Finished]] = []
    not_fitted: list[str] = []
    known: dict[str, float] = {}
    for rung in case.fit.ladder:
        one = _plan(job, rung, known)
        control.monitor.inform(f"{rung.name}: {len(one.inputs.case.parameters)} parameters")
        try:
            finished = fit_one(one, control)
        except (InputError, ModelError) as error:
            not_fitted.append(f"{rung.name}: it cannot be fitted: {clause(error)}")
            control.monitor.warn(not_fitted[-1])
            continue
        if control.out_of_time:
            return finished
        result = finished.result
        fits.append((one, Candidate(rung.name, finished.paths[0], result), finished))
        table = result.parameters
        known |= dict(zip(table.names, table.values.tolist(), strict=True))
    if not fits:
        message = f"no model of the ladder can be fitted: {'; '.join(not_fitted)}"
        raise InputError([case.source.fault(("fit", "ladder"), "no-fit", message)])

    usable = [fit for fit in fits if fit[1].result.evidence is not None]
    comparison = None
    if len(usable) > 1:
        comparison = compared([candidate for _, candidate, _ in usable], in_order=True)
    best, candidate, finished = (usable or fits)[0 if comparison is None else comparison.chosen]
    notes = [f"{text}." for text in not_fitted]
    notes += [
        f"{other.name} is not compared: {other.result.status}."
        for _, other, _ in fits
        if other.result.evidence is None
    ]
    result = replace(
        candidate.result,
        provenance=replace(job_provenance(job), case_sha256=best.inputs.case_sha256),
        comparison=comparison,
        notes=(*candidate.result.notes, *notes),
    )
    others = tuple(path for _, _, fit in fits for path in fit.paths)
    inputs = (*job.inputs.files, *others)
    written = write(job.joined(result), job.place, job.existing, inputs=inputs, force=request.force)
    return replace(written, paths=(*written.paths, *others))


def require_sound(path: str, overrides: Sequence[str], case: Case, text: str | None = None) -> None:
    """Refuse a ladder with a model that is no right case, before anything is computed.

    Args:
        path: of the case.
        overrides: of the command.
        case: with a ladder.
        text: of the case where it stands in no file.

    Raises:
        InputError: with the faults of all models, where they stand in the ladder.
    """
    if path == STDIN:
        message = "a case with a ladder cannot be read from stdin: it is read once a model"
        raise InputError([case.source.fault(("fit", "ladder"), "stdin", message)])
    faults: list[Fault] = []
    for n, rung in enumerate(case.fit.ladder):
        try:
            load_inputs(path, overrides=(*overrides, _NO_LADDER, *rung.overrides), text=text)
        except InputError as error:
            for fault in error.faults:
                where = f"{fault.path}: " if fault.path else ""
                message, at = f"model '{rung.name}': {where}{fault.message}", ("fit", "ladder", n)
                faults.append(case.source.fault(at, fault.code, message, fault.hint))
    if faults:
        raise InputError(faults)


def _plan(job: Job, rung: Rung, known: Mapping[str, float]) -> Job:
    """The job of one model, begun where the simpler ones ended.

    Its result stands beside that of the case: ``case.isotropic.fit.h5``.
    """
    request, path = job.request, job.place.path
    overrides = (*request.overrides, _NO_LADDER, *rung.overrides)
    case = load_inputs(request.case, overrides=overrides, text=request.text).case
    stem = path.name.removesuffix(".h5").removesuffix(".fit")
    word = "".join(c if c.isalnum() or c in "-_" else "-" for c in rung.name)
    return plan_fit(
        replace(
            request,
            overrides=(*overrides, *_starts(case, rung, known)),
            output=str(path.with_name(f"{stem}.{word}.fit.h5")),
        )
    )


def _starts(case: Case, rung: Rung, known: Mapping[str, float]) -> list[str]:
    """Starts of parameters at the values of simpler models, as overrides."""
    starts = []
    for parameter in case.parameters:
        origins = (rung.origins or {}).get(parameter.name, ((parameter.name, 1.0),))
        value = next((known[name] * factor for name, factor in origins if name in known), None)
        if value is not None:
            start = min(max(value, parameter.lower), parameter.upper)
            unit = shown_unit(parameter.unit, parameter.dimension)
            size = in_unit(start, parameter.unit, parameter.dimension)
            starts.append(f"parameters.{parameter.name}.start={size!r} {unit}".rstrip())
    return starts
