"""``geoident sample``: draws of the posterior of a fit, and what they predict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geoident.errors import ExitCode, Fault, InputError, Interrupted, Location
from geoident.fem.solvers.threads import one_thread
from geoident.forward.model import StagedModel
from geoident.forward.openings.model import OpeningModel
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import (
    Draws,
    SamplingProgress,
    SamplingRequest,
    SamplingWatch,
    Stopped,
    library,
)
from geoident.identify.posterior.importance import ADAPTING
from geoident.identify.posterior.sampling import sample_posterior
from geoident.identify.problem.problem import Problem
from geoident.io.result.checkpoint import EvaluationLog
from geoident.io.result.file import read_result
from geoident.model.arrays import Floats
from geoident.model.gauges import ReadingTable
from geoident.model.results.result import (
    Result,
)
from geoident.workflow.drawn import DrawnPosterior
from geoident.workflow.estimating.accuracies import Possible
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.finished import Finished, evaluation_log, job_at_hand, write
from geoident.workflow.estimating.setup import (
    Setup,
    model_error_of_result,
    problem_of,
    problem_of_result,
)
from geoident.workflow.executing.processes import LocalProcesses
from geoident.workflow.running.answers import (
    Asked,
    BeginWorkers,
    Compute,
    KeptAnswers,
    here,
    in_processes,
)
from geoident.workflow.running.computed import accuracies
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import (
    Inputs,
    Job,
    Request,
    build_model,
    inputs_of_result,
    job_provenance,
    of_fit,
)
from geoident.workflow.running.kept_reduced import restored_of, spread_around
from geoident.workflow.running.outputs import existing, require_free, target
from geoident.workflow.running.readings import used_rows
from geoident.workflow.running.reduced_answers import ReducedAnswers, reduced_answers
from geoident.workflow.running.result_files import case_path, files_of_result
from geoident.workflow.running.workers import ModelParts, runs_on_cluster, worthwhile_processes

EFFECTIVE = 1000
"""Target effective sample size, unless another one is asked for."""

EVALUATIONS = 50_000
"""Evaluations of the model at most, unless another number is given."""


@dataclass(frozen=True)
class SampleRequest:
    """What to draw.

    Args:
        result: path of a fit.
        draws: how many to write.
        effective: target effective sample size; at most ``draws``.
        evaluations: of the model at most.
        output: a file or an existing folder; None for beside the result.
        seed: of random numbers.
        solver: name of the sparse solver, or ``auto``.
        force: overwrite a sample of other input.
        fresh: compute again what is up to date, and forget the checkpoint.
    """

    result: str
    draws: int = 10_000
    effective: int = EFFECTIVE
    evaluations: int = EVALUATIONS
    output: str | None = None
    seed: int = 0
    solver: str = "auto"
    force: bool = False
    fresh: bool = False

    @property
    def of_sampler(self) -> SamplingRequest:
        """What is asked of the sampler."""
        return SamplingRequest(self.draws, float(min(self.effective, self.draws)), self.evaluations)


@dataclass(frozen=True)
class SampleTask:
    """A sample that can be drawn.

    Args:
        request: what was asked for.
        fit: the fit.
        job: where its model comes from and the sample goes.
    """

    request: SampleRequest
    fit: Result
    job: Job

    @property
    def files_read(self) -> tuple[str, ...]:
        """Paths of the fit and of what it was made from."""
        return (*files_of_result(self.fit, self.request.result), *self.job.inputs.files)


def plan_sample(request: SampleRequest) -> SampleTask:
    """Read a fit, and look at what stands where the sample goes.

    Raises:
        InputError: the result is no fit, or its mesh has changed.
        OutputError: the sample could not be written, or another one would be lost.
        UsageError: the libraries for it are not installed.
    """
    for name in ("emcee", "arviz"):
        library(name)
    fit, inputs = fit_and_inputs(request.result)
    place = target(request.result, "sample", output=request.output)
    asked_for = request.of_sampler
    purpose = (
        f"sample {fit.fingerprint} {asked_for.draws} {asked_for.effective} {asked_for.evaluations}"
    )
    identity = inputs.identity(purpose, (), seed=request.seed)
    asked = Request(
        case=request.result,
        output=request.output,
        seed=request.seed,
        solver=request.solver,
        force=request.force,
        fresh=request.fresh,
    )
    job = Job(
        request=asked,
        command="sample",
        place=place,
        identity=identity,
        existing=existing(place, identity, kind="sample", case=inputs.path),
        methods=(),
        inputs=inputs,
    )
    return SampleTask(request, fit, job)


def fit_and_inputs(path: str) -> tuple[Result, Inputs]:
    """A fit, and the case that it was made from, with its mesh.

    Raises:
        InputError: the result is no fit, or its mesh has changed.
    """
    fit = read_result(path)
    if fit.kind != "fit":
        message = f"A {fit.kind} cannot be sampled from; the result of a fit is expected."
        raise InputError([Fault("not-a-fit", message, location=Location(path))])
    inputs = inputs_of_result(fit, case_path(path, fit.provenance.case_file))
    if inputs.mesh_sha256 != fit.provenance.mesh_sha256:
        message = "The mesh is not the one that the fit was made with."
        place = Location(inputs.loaded.mesh_path or inputs.path)
        raise InputError([Fault("changed-mesh", message, "Run the fit again.", place)])
    return fit, inputs


@one_thread()
def sample(task: SampleTask, control: Control) -> Finished:
    """Draw from the posterior and write the draws; keep a sample that is up to date.

    Raises:
        Interrupted: a stop was asked for; a checkpoint is there.
        ModelError: the model has no solution at the fit.
    """
    job, request = task.job, task.request
    if (before := job_at_hand(job)) is not None:
        return before
    control.require_cluster()
    require_free(job.existing, job.place, force=request.force, inputs=task.files_read)
    setup, asked = _asked(task.fit, job.inputs, request.solver)
    require_same_modes(task.fit, setup.model, setup.case, task.fit.parameters.values)
    with evaluation_log(job, control, setup.model) as log:
        response = problem_of(setup, log, control).response
        problem = problem_of_result(task.fit, setup.case, response)
        with _answers(task, asked, log, control) as (answers, led):
            density = PosteriorDensity(problem, answers, _possible(task.fit, setup, problem))
            draws = _drawn(task, density, control)
            drawn = DrawnPosterior(
                task.fit,
                setup,
                problem,
                density,
                draws,
                answers,
                asked.places,
                request.seed,
                request.of_sampler.effective,
                led,
            )
            drawn_result = drawn.result()
        made = of_fit(job_provenance(job), task.fit, request.result, job.place.path)
        result = replace(drawn_result, provenance=made)
        return write(
            result, job.place, job.existing, inputs=task.files_read, force=job.request.force
        )


def _drawn(task: SampleTask, density: PosteriorDensity, control: Control) -> Draws:
    """Draws, by the first sampler that is reliable.

    Raises:
        Interrupted: the time was up before there were any.
    """
    try:
        return sample_posterior(
            density,
            _minima(task.fit),
            task.request.of_sampler,
            rng=np.random.default_rng(task.request.seed),
            watch=_watch(control),
        )
    except Stopped as stop:
        raise Interrupted(stop.reason, exit_code=ExitCode.NOT_CONVERGED) from stop


def _minima(fit: Result) -> Sequence[Floats]:
    """The minima (n,), SI, that a fit has found: its answer and the rivals of that."""
    if fit.rivals is None:
        return [fit.parameters.values]
    return list(fit.rivals.values)


def _asked(fit: Result, inputs: Inputs, solver: str) -> tuple[Setup, Asked]:
    model = build_model(inputs, solver=solver)
    error = model_error_of_result(fit, inputs.case)
    setup = Setup(model, inputs.case, fit.gauges.readings, fit.accuracies, error)
    return setup, Asked(model, inputs.case, setup.readings)


def _possible(fit: Result, setup: Setup, problem: Problem) -> list[tuple[Problem, float]]:
    """The problem at the accuracies that are possible beside those estimated, with weights."""
    used = fit.gauges.readings.used
    possible = Possible.of(fit.accuracies, used)
    if possible is None:
        return []
    structure = possible.structure(used_rows(setup.case, used))
    if setup.model_error is not None:
        structure = setup.model_error.with_later(structure)
    problems = possible.problems(problem, structure)[1:]
    return list(zip(problems, possible.table.flat.tolist(), strict=True))


def build_elsewhere(parts: ModelParts, readings: ReadingTable) -> Asked:
    """The model of a fit, in a process of its own.

    Args:
        parts: of the model.
        readings: of which some are used.
    """
    return Asked(parts.build(), parts.case, readings)


@contextmanager
def _answers(
    task: SampleTask, asked: Asked, log: EvaluationLog, control: Control
) -> Iterator[tuple[KeptAnswers, ReducedAnswers | None]]:
    """The model as the sampler asks it, and what helps it."""
    cheap = isinstance(asked.model, OpeningModel)  # to compute again costs less than to keep
    kept, request = None if cheap else log, task.request
    with _computed(request, asked, task.fit.gauges.readings, control) as compute:
        led = _reduced(task.fit, asked, compute, control)
        answers = KeptAnswers(led or compute, kept, control)
        try:
            yield answers, led
        finally:
            answers.keep(now=True)


@contextmanager
def _computed(
    request: SampleRequest, asked: Asked, readings: ReadingTable, control: Control
) -> Iterator[Compute]:
    """The model's own answers.

    Args:
        request: what to draw.
        asked: the model, in this process.
        readings: of which some are used.
        control: says how many processes there may be, or on which cluster they are.
    """
    jobs, cluster = control.jobs, control.cluster
    parts = ModelParts.of(asked.model, asked.case, request.solver)
    if jobs is None:
        jobs = worthwhile_processes(asked.model, request.solver, request.draws)
    if parts is None:
        with runs_on_cluster(asked.model, control):
            yield here(asked)
        return
    if jobs == 1 and cluster is None:
        yield here(asked)
        return
    begin: BeginWorkers = partial(LocalProcesses, jobs) if cluster is None else cluster.begin
    build = partial(build_elsewhere, parts, readings)
    with in_processes(begin, build, asked.beside) as compute:
        yield compute


def _reduced(
    fit: Result, asked: Asked, compute: Compute, control: Control
) -> ReducedAnswers | None:
    """The same with the help of a reduced model, made around the fit; None where there is none."""
    table, case = fit.parameters, asked.model.case
    staged = isinstance(asked.model, StagedModel) and case.fit.reduced
    if not staged or not np.all(np.isfinite(table.covariance)):
        return None
    kept = restored_of(fit, case)
    if kept is None:
        control.monitor.detail("making a reduced model")
    used = fit.gauges.readings.sd[fit.gauges.readings.used]
    accuracy = np.concatenate([used, accuracies(case)[tuple(asked.places.T)]])
    training = spread_around(table, case.parameters)
    return reduced_answers(asked, table.values, training, accuracy, compute, kept)


def _watch(control: Control) -> SamplingWatch:
    def watch(progress: SamplingProgress) -> str | None:
        words = (
            f"{progress.sampler}: {progress.evaluations} evaluations, effective size"
            f" {progress.effective:.0f} of {progress.wanted:.0f}"
        )
        adapting = progress.sampler == ADAPTING  # nobody knows how long
        done = 0.0 if adapting else min(1.0, progress.effective / progress.wanted)
        control.monitor.part(words, done)
        return control.over()

    return watch
