"""``geoident fit`` of a project: each section by itself, all together, and what follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.fem.solvers.threads import one_thread
from geoident.identify.hierarchical.joint_problem import SectionReadings
from geoident.identify.hierarchical.search import HierarchicalFit, SectionsStart, fit_sections
from geoident.io.result.project import read_project_result, write_project_result
from geoident.model.results.many.project import ProjectResult
from geoident.model.results.result import STOPPED
from geoident.workflow.estimating.finished import FinishedRun, ResultFiles, evaluation_log
from geoident.workflow.project.common_errors import CommonErrors, WithCommonErrors, on_one_clock
from geoident.workflow.project.error_sizes import weighed_together
from geoident.workflow.project.errors import STATED, ErrorsAt, MadeOf
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


TURNS = 20
"""At most so many times parameters and errors of the readings take turns."""

EAGER = 3
"""Turns after which they go half of the way, since they may swing between two states."""


def _halfway(one: MadeOf, other: MadeOf) -> MadeOf:
    return 0.5 * (one[0] + other[0]), 0.5 * (one[1] + other[1])


class _Fits:
    """Fits of several sections of a project."""

    def __init__(self, job: ProjectJob, models: SectionAnswers, control: Control) -> None:
        self._job, self._models, self._control = job, models, control
        prepared = models.prepared()
        errors = on_one_clock([one.errors for one in prepared])
        self._common = common = CommonErrors.of(errors)
        pairs = zip(prepared, errors, strict=True)
        self._prepared = tuple(replace(one, errors=own) for one, own in pairs)
        self._readings = tuple(
            SectionReadings(
                section.name,
                (*one.parameters, *common.parameters),
                section.covariates,
                one.measured,
                one.sd,
                one.shared,
            )
            for section, one in zip(job.project.sections, prepared, strict=True)
        )

    def of(self, numbers: Sequence[int], near: Fitted | None = None) -> Fitted:
        """The fit of some sections, with the errors that all of them together show.

        Args:
            numbers: of the sections.
            near: a fit of more of them; None to begin where their own fits ended.
        """
        models, readings = ChosenSections(self._models, numbers), dict(enumerate(self._readings))
        common = self._common
        if near is None:  # at what their own fits found; NaN where they determine nothing
            none = np.zeros(len(common.names))
            own = (np.append(self._prepared[n].alone[0], none) for n in numbers)
            begin = SectionsStart(points=tuple(own))
        else:
            readings |= zip(near.numbers, near.fit.joint.sections, strict=True)
            begin = near.start(numbers)
        sizes = None if near is None else near.sizes
        made: list[MadeOf] = []
        for turn in range(TURNS):
            used = [self._prepared[n].errors for n in numbers]
            basis = [common.basis(one, sizes or STATED)[one.used] for one in used]
            with_common = WithCommonErrors(models, dict(enumerate(basis)))
            fit = self._searched([readings[n] for n in numbers], with_common, begin)
            fitted = Fitted(
                fit, tuple(numbers), self._readings, self._prepared, sizes or STATED, common
            )
            if fit.outcome.status == STOPPED:
                return fitted
            points = fitted.points
            now_made = [self._models.steps(n, points[n]) for n in numbers]
            if turn >= EAGER:
                now_made = [_halfway(*pair) for pair in zip(made, now_made, strict=True)]
            made = now_made
            errors = [ErrorsAt.of(*pair).used() for pair in zip(used, made, strict=True)]
            answers = models.evaluate(dict(enumerate(points.values())))
            of_models = [answers[k] for k in range(len(numbers))]
            now = weighed_together(fit, of_models, errors, common, sizes)
            if sizes is not None and now.near(sizes):
                return fitted
            if sizes is not None and turn >= EAGER:
                now = now.halfway(sizes)
            sizes, begin = now, fitted.start(numbers)
            for n, one in zip(numbers, errors, strict=True):
                sd, shared = one.sized(sizes).stated
                readings[n] = replace(readings[n], sd=sd, shared=shared)
        return replace(fitted, at_rest=False)

    def _searched(
        self, chosen: Sequence[SectionReadings], models: WithCommonErrors, begin: SectionsStart
    ) -> HierarchicalFit:
        project, on_iteration = self._job.project, self._control.on_iteration
        shared = (*project.shared, *self._common.names)
        return fit_sections(chosen, shared, project.laws, models, on_iteration, begin=begin)

    def each_left_out(self, whole: Fitted) -> dict[int, Fitted]:
        """Number of each section to the fit of all others, begun where the fit of all ended."""
        fits = {}
        for position, number in enumerate(whole.numbers):
            others = [n for n in whole.numbers if n != number]
            if not others:
                return {}
            words = f"{position + 1} of {len(whole.numbers)} sections left out in turn"
            self._control.monitor.part(words, position / len(whole.numbers))
            fits[number] = self.of(others, near=whole)
        return fits
