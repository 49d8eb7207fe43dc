"""``geoident sample``: draws of the posterior of a fit, and what they predict."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from geoident.errors import ExitCode, Interrupted
from geoident.fem.solvers.threads import one_thread
from geoident.forward.model import StagedModel
from geoident.forward.openings.model import OpeningModel
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import (
    Draws,
    SamplingProgress,
    SamplingRequest,
    Stopped,
    library,
)
from geoident.identify.posterior.importance import ADAPTING, WORTH_ADAPTING
from geoident.identify.posterior.sampling import sample_posterior
from geoident.io.result.checkpoint import EvaluationLog
from geoident.model.gauges import ReadingTable
from geoident.model.results.result import Result
from geoident.workflow.drawn import DrawnPosterior
from geoident.workflow.estimating.estimate import possible_problems
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.finished import Finished, evaluation_log, job_at_hand
from geoident.workflow.estimating.from_fit import FitTask, plan_on_fit, read_fit, require_same_mesh
from geoident.workflow.estimating.setup import problem_of, problem_of_result, setup_of_result
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
from geoident.workflow.running.jobs import Request, build_model
from geoident.workflow.running.kept_reduced import restored_of, spread_around
from geoident.workflow.running.reduced_answers import ReducedAnswers, reduced_answers
from geoident.workflow.running.workers import ModelParts, runs_on_cluster, worthwhile_processes

EFFECTIVE = 1000
"""Target effective sample size, unless another one is asked for."""

EVALUATIONS = 50_000
"""Evaluations of the model at most, unless another number is given."""

_LONG = 5.0
"""Seconds of an evaluation beside which the start of a process does not count."""

_WORTH_TELLING = 10.0
"""Seconds from which on it is said before how long a sample will take."""


@dataclass(frozen=True)
class SampleRequest:
    """What to draw.

    Args:
        request: with the path of a fit as its case.
        draws: how many to write.
        effective: target effective sample size; at most ``draws``.
        evaluations: of the model at most.
    """

    request: Request
    draws: int = 10_000
    effective: int = EFFECTIVE
    evaluations: int = EVALUATIONS

    @property
    def of_sampler(self) -> SamplingRequest:
        """What is asked of the sampler."""
        return SamplingRequest(self.draws, float(min(self.effective, self.draws)), self.evaluations)


@dataclass(frozen=True, kw_only=True)
class SampleTask(FitTask):
    """A sample that can be drawn.

    Args:
        request: what was asked for.
    """

    request: SampleRequest


def plan_sample(asked: SampleRequest) -> SampleTask:
    """Read a fit, and look at what stands where the sample goes.

    Raises:
        InputError: the result is no fit, or its mesh has changed.
        OutputError: the sample could not be written, or another one would be lost.
        UsageError: the libraries for it are not installed.
    """
    for name in ("emcee", "arviz"):
        library(name)
    fit, inputs = read_fit(asked.request.case, "sampled")
    require_same_mesh(fit, inputs, "Run the fit again.")
    of = asked.of_sampler
    purpose = f"{of.draws} {of.effective} {of.evaluations}"
    job = plan_on_fit("sample", purpose, asked.request, fit, inputs)
    return SampleTask(fit=fit, job=job, request=asked)


@one_thread()
def sample(task: SampleTask, control: Control) -> Finished:
    """Draw from the posterior and write the draws; keep a sample that is up to date.

    Raises:
        Interrupted: a stop was asked for; a checkpoint is there.
        ModelError: the model has no solution at the fit.
    """
    job, fit, request = task.job, task.fit, task.request
    if (before := job_at_hand(job)) is not None:
        return before
    control.require_cluster()
    task.require_free()
    case = job.inputs.case
    model = build_model(job.inputs, solver=job.request.solver)
    setup = setup_of_result(fit, case, model)
    asked = Asked(model, case, setup.readings)
    require_same_modes(fit, model, case, fit.parameters.values)
    with evaluation_log(job, control, model) as log:
        problem = problem_of_result(fit, case, problem_of(setup, log, control).response)
        with _answers(task, asked, log, control) as (answers, led):
            _tell_duration(request, fit, answers, control)
            others = possible_problems(setup, problem)[1:]
            flat = [] if fit.accuracies is None else fit.accuracies.flat.tolist()
            possible = list(zip(others, flat, strict=True)) if others else []
            density = PosteriorDensity(problem, answers, possible)
            drawn = DrawnPosterior(
                fit,
                setup,
                problem,
                density,
                _draws(task, density, control),
                answers,
                asked.places,
                job.request.seed,
                request.of_sampler.effective,
                led,
            )
            result = drawn.result()
        return task.write(result)


def _tell_duration(
    request: SampleRequest, fit: Result, answers: KeptAnswers, control: Control
) -> None:
    """Say how long the draws will take, by the time of an evaluation for each process.

    Where nobody would wait for it, nothing is said.

    Args:
        request: what to draw.
        fit: is sampled.
        answers: of the model, with the reduced model that helps it.
        control: says how many processes there are.

    Raises:
        Interrupted: a stop was asked for.
    """
    table, at_once = fit.parameters, max(control.jobs or 1, 1)
    sd = np.where(np.isfinite(table.sd), table.sd, 0.0)
    each = np.inf
    for k in range(2):  # the first of all also starts a process, or fills a cache
        parts = 0.1 * k + np.linspace(-0.5, 0.5, at_once + 1)[:-1, None]  # near the fit, all apart
        begun = time.monotonic()
        with suppress(Stopped):  # out of time: the sampler says so
            answers.at(np.clip(table.values + parts * sd, table.lower, table.upper))
        each = min(each, (time.monotonic() - begun) / at_once)
        if each > _LONG:
            break
    wanted = request.of_sampler.effective
    least, most = (min(n, request.evaluations) for n in (wanted, wanted / WORTH_ADAPTING))
    if least * each < _WORTH_TELLING:
        return
    control.monitor.inform(
        f"An evaluation takes {_duration(each)}: a sample worth {wanted:.0f} independent draws "
        f"takes {_duration(least * each)} to {_duration(most * each)} ({least:.0f} to "
        f"{most:.0f} evaluations), and {_duration(request.evaluations * each)} at most "
        f"({request.evaluations} evaluations). A limit of time ends it with what there is then."
    )


def _duration(seconds: float) -> str:
    """A time for people.

    >>> _duration(0.214), _duration(75), _duration(7300), _duration(20000)
    ('0.21 s', '75 s', '122 min', '5.6 h')
    """
    if seconds < 600.0:
        return f"{seconds:.2f} s" if seconds < 10.0 else f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 10000.0 else f"{seconds / 3600:.1f} h"


def _draws(task: SampleTask, density: PosteriorDensity, control: Control) -> Draws:
    """Draws, by the first sampler that is reliable.

    Raises:
        Interrupted: the time was up before there were any.
    """
    fit, request = task.fit, task.request

    def watch(progress: SamplingProgress) -> str | None:
        words = (
            f"{progress.sampler}: {progress.evaluations} evaluations, effective size"
            f" {progress.effective:.0f} of {progress.wanted:.0f}"
        )
        adapting = progress.sampler == ADAPTING  # nobody knows how long
        done = 0.0 if adapting else min(1.0, progress.effective / progress.wanted)
        control.monitor.part(words, done)
        return control.over()

    try:
        return sample_posterior(
            density,
            [fit.parameters.values] if fit.rivals is None else list(fit.rivals.values),
            request.of_sampler,
            rng=np.random.default_rng(task.job.request.seed),
            watch=watch,
        )
    except Stopped as stop:
        raise Interrupted(stop.reason, exit_code=ExitCode.NOT_CONVERGED) from stop


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
    """The model as the sampler asks it, and the reduced model around the fit that helps it.

    Args:
        task: the sample.
        asked: the model, in this process.
        log: keeps the answers of a model that is not cheaper to ask again.
        control: says how many processes there may be, or on which cluster they are.
    """
    fit, table, case = task.fit, task.fit.parameters, asked.model.case
    kept = None if isinstance(asked.model, OpeningModel) else log
    with _computed(task, asked, control) as compute:
        led = None
        staged = isinstance(asked.model, StagedModel) and case.fit.reduced
        if staged and np.all(np.isfinite(table.covariance)):
            restored = restored_of(fit, case)
            if restored is None:
                control.monitor.detail("making a reduced model")
            used = fit.gauges.readings.sd[fit.gauges.readings.used]
            accuracy = np.concatenate([used, accuracies(case)[tuple(asked.places.T)]])
            training = spread_around(table, case.parameters)
            led = reduced_answers(asked, table.values, training, accuracy, compute, restored)
        answers = KeptAnswers(led or compute, kept, control)
        try:
            yield answers, led
        finally:
            answers.keep(now=True)


@contextmanager
def _computed(task: SampleTask, asked: Asked, control: Control) -> Iterator[Compute]:
    """The model's own answers.

    Args:
        task: the sample.
        asked: the model, in this process.
        control: says how many processes there may be, or on which cluster they are.
    """
    jobs, cluster, solver = control.jobs, control.cluster, task.job.request.solver
    parts = ModelParts.of(asked.model, asked.case, solver)
    if jobs is None:
        jobs = worthwhile_processes(asked.model, solver, task.request.draws)
    if parts is None:
        with runs_on_cluster(asked.model, control):
            yield here(asked)
        return
    if jobs == 1 and cluster is None:
        yield here(asked)
        return
    begin: BeginWorkers = partial(LocalProcesses, jobs) if cluster is None else cluster.begin
    build = partial(build_elsewhere, parts, task.fit.gauges.readings)
    with in_processes(begin, build, asked.beside) as compute:
        yield compute
