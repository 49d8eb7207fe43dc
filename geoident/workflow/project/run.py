"""``geoident fit`` of a project: each section by itself, all together, and what follows."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from geoident.errors import ExitCode, InputError, Interrupted, ModelError, Term, TimeIsUp
from geoident.fem.solvers.threads import one_thread
from geoident.identify.hierarchical.joint_problem import SectionReadings
from geoident.identify.hierarchical.search import SectionsStart, fit_sections
from geoident.io.result.checkpoint import EvaluationLog
from geoident.io.result.file import read_identity
from geoident.io.result.project import read_project_result, write_project_result
from geoident.model.arrays import Floats
from geoident.model.results.many.project import ProjectResult
from geoident.model.results.result import STOPPED
from geoident.workflow.project.models import ChosenSections, SectionAnswers, section_executor
from geoident.workflow.project.outcome import Fitted, LeftOut, project_result
from geoident.workflow.project.plan import ProjectJob
from geoident.workflow.project.sections import (
    PreparedSection,
    SectionSource,
    SectionSources,
)
from geoident.workflow.running.control import Control
from geoident.workflow.running.outputs import Existing, restore, set_aside


@dataclass(frozen=True)
class FinishedProject:
    """The result of a project and where it stands.

    Args:
        result: what was found, now or before.
        path: of the file.
        up_to_date: it stood there already and was not computed again.
        remarks: sentences on what became of a result that stood there before.
    """

    result: ProjectResult
    path: str
    up_to_date: bool = False
    remarks: tuple[str, ...] = ()


@one_thread()
def fit_project(job: ProjectJob, control: Control) -> FinishedProject:
    """Fit all sections of a project and write the result; keep one that is up to date.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    before = _at_hand(job)
    if before is not None:
        return before
    place, request = job.place, job.request
    control.require_cluster()
    if request.fresh:
        place.checkpoint.unlink(missing_ok=True)
    log = EvaluationLog.open(place.checkpoint, job.identity)
    if log.trouble:
        control.monitor.warn(log.trouble)
    elif len(log):
        said = f"Going on from {place.checkpoint}: {len(log)} evaluations"
        control.monitor.inform(said)
    sources = _sources(job, control)
    try:
        result = _found(job, sources, log, control)
    except Interrupted as stop:
        log.close()
        words = f"Interrupted. What was computed is kept in {place.checkpoint}.\n"
        words += f"    {Term.SAME_AGAIN} goes on from there."
        raise Interrupted(words, exit_code=stop.exit_code) from stop
    except TimeIsUp as end:
        log.close()
        words = "The time that was given is used up before a result could be written.\n"
        words += f"    {Term.SAME_AGAIN} goes on from there."
        raise Interrupted(words, exit_code=ExitCode.NOT_CONVERGED) from end
    except (InputError, ModelError):
        _forget(log, sources)  # it would end the same way again
        raise
    except BaseException:
        log.close()
        raise
    if result.status == STOPPED:
        log.close()
    else:
        _forget(log, sources)
    return _written(job, result)


def _forget(log: EvaluationLog, sources: SectionSources) -> None:
    log.remove()
    for number in range(len(sources.sources)):
        with suppress(OSError):
            sources.log_path(number).unlink(missing_ok=True)


def _at_hand(job: ProjectJob) -> FinishedProject | None:
    """The result of the same input where it is there already."""
    place, request = job.place, job.request
    if request.fresh:
        return None
    if job.found is Existing.UP_TO_DATE:
        return FinishedProject(read_project_result(place.path), str(place.path), up_to_date=True)
    if job.found is not Existing.OTHER or request.force:
        return None
    moved = restore(place, job.identity)
    if moved is None:
        return None
    was, aside = moved
    said = f"{was} was made from this input: it is {place.path} again, and what stood there is "
    said += f"kept as {aside}"
    result = read_project_result(place.path)
    return FinishedProject(result, str(place.path), up_to_date=True, remarks=(said,))


def _written(job: ProjectJob, result: ProjectResult) -> FinishedProject:
    """Put the result in its place; an earlier one of the same project is kept beside."""
    place, remarks = job.place, []
    if job.found is Existing.OTHER and not job.request.force and read_identity(place.path):
        aside, removed = set_aside(place.path)
        remarks.append(f"{place.path} was made from other input: it is kept as {aside}")
        remarks += [f"{path}, an older one, is removed" for path in removed]
    overwrite = job.found is not Existing.NOTHING
    (path,) = write_project_result(result, place.path, overwrite=overwrite, inputs=job.files)
    return FinishedProject(result, path, remarks=tuple(remarks))


def _sources(job: ProjectJob, control: Control) -> SectionSources:
    listed = tuple(
        SectionSource(
            section.name, section.case, section.overrides, section.predicted,
            one.identity("fit", one.case.fit.methods, seed=job.request.seed),
        )
        for section, one in zip(job.project.sections, job.inputs, strict=True)
    )  # fmt: skip
    request = job.request
    return SectionSources(
        listed, request.solver, job.place.checkpoint.absolute(), control.max_time, request.fresh
    )


def _found(
    job: ProjectJob, sources: SectionSources, log: EvaluationLog, control: Control
) -> ProjectResult:
    executor = section_executor(sources, job.inputs, control, jobs=job.request.jobs)
    with executor, control.stop.heard_by(executor.ask_to_stop):
        models = SectionAnswers(executor, log, control, job.project)
        prepared = models.prepared()
        fitted = _Fits(job, models, prepared, control)
        numbers = [n for n, s in enumerate(job.project.sections) if not s.predicted]
        whole = fitted.of(numbers)
        left_out: tuple[LeftOut, ...] = ()
        if job.request.leave_one_out and whole.fit.outcome.status != STOPPED:
            left_out = fitted.each_left_out(whole)
        control.stop.check()
        return project_result(job, models, whole, left_out)


class _Fits:
    """Fits of several sections of a project."""

    def __init__(
        self,
        job: ProjectJob,
        models: SectionAnswers,
        prepared: Sequence[PreparedSection],
        control: Control,
    ) -> None:
        self._job, self._models, self._control = job, models, control
        self._prepared = tuple(prepared)
        self._readings = tuple(
            SectionReadings(
                section.name, one.parameters, section.covariates, one.measured, one.sd, one.shared
            )
            for section, one in zip(job.project.sections, prepared, strict=True)
        )

    def of(self, numbers: Sequence[int], begin: SectionsStart | None = None) -> Fitted:
        """The fit of some sections."""
        project = self._job.project
        chosen = [self._readings[n] for n in numbers]
        models = ChosenSections(self._models, numbers)
        begin = begin or SectionsStart(points=self._own_points(numbers))
        fit = fit_sections(
            chosen, project.shared, project.laws, models, self._control.on_iteration, begin=begin
        )
        return Fitted(fit, tuple(numbers), self._readings, self._prepared)

    def each_left_out(self, whole: Fitted) -> tuple[LeftOut, ...]:
        """Each section as the fit of all others predicts it, begun where the fit of all ended."""
        found = []
        for position, number in enumerate(whole.numbers):
            others = [n for n in whole.numbers if n != number]
            if not others:
                return ()
            words = f"{position + 1} of {len(whole.numbers)} sections left out in turn"
            self._control.monitor.part(words, position / len(whole.numbers))
            joint, values = whole.fit.joint, whole.fit.outcome.values
            points = [
                joint.point(k, values)[0]
                for k, n in enumerate(whole.numbers) if n != number
            ]  # fmt: skip
            begin = SectionsStart(
                values[: joint.n_common],
                tuple(points),
                np.where(whole.fit.tau > 0.0, whole.fit.tau, 0.02 * joint.largest),
            )
            found.append(LeftOut(number, self.of(others, begin)))
        return tuple(found)

    def _own_points(self, numbers: Sequence[int]) -> tuple[Floats, ...]:
        """What the own fits of sections found; NaN where they determine nothing."""
        return tuple(self._prepared[n].alone[0] for n in numbers)
