"""A ladder of models: one fit each, from the simplest on, and the one that the readings ask for.

Every model is the case with some changes, and a job of its own with a result of its own
(``CASE.RUNG.fit.h5``), so that a run that was interrupted goes on from there. The chosen one is
the result of the case as well, which holds the comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from geoident.errors import Fault, InputError, ModelError
from geoident.io.text.text_file import STDIN
from geoident.model.case import Case, Rung
from geoident.model.results.result import Result
from geoident.model.results.rivals import ModelComparison
from geoident.units import in_unit, shown_unit
from geoident.workflow.estimating.finished import Finished, job_at_hand, write
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Job, job_provenance, load_inputs, plan_fit
from geoident.workflow.scoring.comparison import Candidate, compared

_NO_LADDER = "fit.ladder="
"""Override for a rung: a case of its own."""


@dataclass(frozen=True)
class _Climbed:
    """One rung that was fitted, or the reason why it was not."""

    rung: Rung
    job: Job | None = None
    finished: Finished | None = None
    why: str = ""


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
    case = job.inputs.case
    require_sound(job.request.case, job.request.overrides, case, job.request.text)
    done: list[_Climbed] = []
    known: dict[str, float] = {}
    for rung in case.fit.ladder:
        one = _fitted(job, rung, known, control, fit_one)
        done.append(one)
        if one.finished is None:
            control.monitor.warn(f"{rung.name}: {one.why}")
            continue
        if control.out_of_time:
            return one.finished
        table = one.finished.result.parameters
        known |= dict(zip(table.names, table.values.tolist(), strict=True))
    return _finished(job, done)


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
        raise InputError([case.source.fault(("fit", "ladder"), code="stdin", message=message)])
    faults: list[Fault] = []
    for n, rung in enumerate(case.fit.ladder):
        try:
            load_inputs(path, overrides=(*overrides, _NO_LADDER, *rung.overrides), text=text)
        except InputError as error:
            faults += [_in_ladder(fault, case, n, rung) for fault in error.faults]
    if faults:
        raise InputError(faults)


def _in_ladder(fault: Fault, case: Case, n: int, rung: Rung) -> Fault:
    where = f"{fault.path}: " if fault.path else ""
    message = f"model '{rung.name}': {where}{fault.message}"
    place = case.source.fault(("fit", "ladder", n), code=fault.code, message=message)
    return replace(place, hint=fault.hint)


def _fitted(
    job: Job,
    rung: Rung,
    known: Mapping[str, float],
    control: Control,
    fit_one: Callable[[Job, Control], Finished],
) -> _Climbed:
    """One model, begun where the simpler ones ended."""
    overrides = (*job.request.overrides, _NO_LADDER, *rung.overrides)
    inputs = load_inputs(job.request.case, overrides=overrides, text=job.request.text)
    request = replace(
        job.request,
        overrides=(*overrides, *_starts(inputs.case, rung, known)),
        output=str(_place(job.place.path, rung.name)),
    )
    one = plan_fit(request)
    control.monitor.inform(f"{rung.name}: {len(one.inputs.case.parameters)} parameters")
    try:
        return _Climbed(rung, one, fit_one(one, control))
    except (InputError, ModelError) as error:
        said = error.faults[0].message if isinstance(error, InputError) else error.message
        return _Climbed(rung, one, None, f"it cannot be fitted: {said.rstrip('.')}")


def _place(path: Path, name: str) -> Path:
    """The result of a model beside that of the case: ``case.isotropic.fit.h5``."""
    stem = path.name.removesuffix(".h5").removesuffix(".fit")
    word = "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)
    return path.with_name(f"{stem}.{word}.fit.h5")


def _starts(case: Case, rung: Rung, known: Mapping[str, float]) -> list[str]:
    """Starts of parameters at what simpler models found, as overrides."""
    found = []
    for parameter in case.parameters:
        origins = (rung.origins or {}).get(parameter.name, ((parameter.name, 1.0),))
        value = next((known[name] * factor for name, factor in origins if name in known), None)
        if value is not None:
            start = min(max(value, parameter.lower), parameter.upper)
            unit = shown_unit(parameter.unit, parameter.dimension)
            size = in_unit(start, parameter.unit, parameter.dimension)
            found.append(f"parameters.{parameter.name}.start={size!r} {unit}".rstrip())
    return found


def _finished(job: Job, done: Sequence[_Climbed]) -> Finished:
    """The result of the case: that of the chosen model, with the comparison."""
    fitted = [(one, one.finished) for one in done if one.finished is not None]
    if not fitted:
        case = job.inputs.case
        message = "no model of the ladder can be fitted: "
        message += "; ".join(f"{one.rung.name}: {one.why}" for one in done)
        raise InputError([case.source.fault(("fit", "ladder"), code="no-fit", message=message)])
    left_out = [f"{one.rung.name}: {one.why}." for one in done if one.finished is None]
    usable = [pair for pair in fitted if pair[1].result.evidence is not None]
    left_out += [
        f"{one.rung.name} is not compared: {finished.result.status}."
        for one, finished in fitted
        if finished.result.evidence is None
    ]
    chosen, found, comparison = _chosen(usable or fitted)
    result = replace(
        found.result,
        provenance=replace(job_provenance(job), case_sha256=_case_hash(chosen, found.result)),
        comparison=comparison,
        notes=(*found.result.notes, *left_out),
    )
    inputs = (*job.inputs.files, *(path for _, other in fitted for path in other.paths))
    written = write(result, job.place, job.found, inputs=inputs, force=job.request.force)
    others = tuple(path for _, finished in fitted for path in finished.paths)
    return replace(written, paths=(*written.paths, *others))


def _case_hash(chosen: _Climbed, result: Result) -> str:
    return result.provenance.case_sha256 if chosen.job is None else chosen.job.inputs.case_sha256


def _chosen(
    fitted: Sequence[tuple[_Climbed, Finished]],
) -> tuple[_Climbed, Finished, ModelComparison | None]:
    """The model that the readings ask for; the first where there is nothing to compare."""
    if len(fitted) < 2 or fitted[0][1].result.evidence is None:
        return (*fitted[0], None)
    comparison = compared(
        [Candidate(one.rung.name, done.paths[0], done.result) for one, done in fitted],
        in_order=True,
    )
    return (*fitted[comparison.chosen], comparison)
