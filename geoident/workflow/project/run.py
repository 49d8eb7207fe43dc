"""``geoident fit`` of a project: each section by itself, all together, and what follows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.fem.solvers.threads import one_thread
from geoident.identify.hierarchical.joint_problem import SectionReadings
from geoident.identify.hierarchical.search import SectionsStart, fit_sections
from geoident.io.result.project import read_project_result, write_project_result
from geoident.model.results.many.project import ProjectResult
from geoident.model.results.result import STOPPED
from geoident.workflow.estimating.finished import FinishedRun, ResultFiles, evaluation_log
from geoident.workflow.project.models import ChosenSections, SectionAnswers, section_executor
from geoident.workflow.project.outcome import Fitted, project_result
from geoident.workflow.project.plan import ProjectJob
from geoident.workflow.project.sections import SectionSources
from geoident.workflow.running.control import Control

PROJECTS = ResultFiles(read_project_result, write_project_result)


@one_thread()
def fit_project(job: ProjectJob, control: Control) -> FinishedRun[ProjectResult]:
    """Fit all sections of a project and write the result; keep one that is up to date.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    request, place = job.request, job.place
    before = PROJECTS.at_hand(
        place, job.identity, job.existing, force=request.force, fresh=request.fresh
    )
    if before is not None:
        return before
    control.require_cluster()
    sources = SectionSources(
        job.project.sections,
        tuple(one.identity("fit", one.case.fit.methods, seed=request.seed) for one in job.inputs),
        request.solver,
        place.checkpoint.absolute(),
        control.max_time,
        request.fresh,
    )
    executor = section_executor(sources, job.inputs, control, jobs=request.jobs)
    try:
        with (
            evaluation_log(job, control) as log,
            executor,
            control.stop.heard_by(executor.ask_to_stop),
        ):
            models = SectionAnswers(executor, log, control, job.project)
            fits = _Fits(job, models, control)
            whole = fits.of([n for n, s in enumerate(job.project.sections) if not s.predicted])
            left_out: dict[int, Fitted] = {}
            if request.leave_one_out and whole.fit.outcome.status != STOPPED:
                left_out = fits.each_left_out(whole)
            control.stop.check()
            result = project_result(job, models, whole, left_out)
            return PROJECTS.write(
                result, place, job.existing, inputs=job.files, force=request.force
            )
    finally:
        if not place.checkpoint.exists():  # those of the sections go with it
            for number in range(len(sources.sections)):
                sources.log_path(number).unlink(missing_ok=True)


class _Fits:
    """Fits of several sections of a project."""

    def __init__(self, job: ProjectJob, models: SectionAnswers, control: Control) -> None:
        self._job, self._models, self._control = job, models, control
        self._prepared = prepared = models.prepared()
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
        if begin is None:  # at what their own fits found; NaN where they determine nothing
            begin = SectionsStart(points=tuple(self._prepared[n].alone[0] for n in numbers))
        fit = fit_sections(
            chosen, project.shared, project.laws, models, self._control.on_iteration, begin=begin
        )
        return Fitted(fit, tuple(numbers), self._readings, self._prepared)

    def each_left_out(self, whole: Fitted) -> dict[int, Fitted]:
        """Number of each section to the fit of all others, begun where the fit of all ended."""
        fits = {}
        for position, number in enumerate(whole.numbers):
            others = [n for n in whole.numbers if n != number]
            if not others:
                return {}
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
            fits[number] = self.of(others, begin)
        return fits
