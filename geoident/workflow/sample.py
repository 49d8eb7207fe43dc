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
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.diagnosis import library
from geoident.identify.posterior.draws import Draws, SamplingProgress, SamplingWatch, Stopped, Wish
from geoident.identify.posterior.importance import ADAPTING
from geoident.identify.posterior.predictive import with_errors
from geoident.identify.posterior.sampling import sample_posterior, trustworthy
from geoident.identify.problem.problem import Problem
from geoident.io.result.checkpoint import EvaluationLog
from geoident.io.result.file import read_result
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import ReadingTable
from geoident.model.parameter import Parameter
from geoident.model.results.posterior import LEVELS, PosteriorDraws
from geoident.model.results.result import (
    Counts,
    ParameterTable,
    Prediction,
    Provenance,
    Result,
)
from geoident.workflow.estimating.estimate import known_errors
from geoident.workflow.estimating.fields import drawn_fields, require_same_modes
from geoident.workflow.estimating.finished import Finished, evaluation_log, job_at_hand, write
from geoident.workflow.estimating.predictions import KnownErrors
from geoident.workflow.estimating.setup import (
    Setup,
    model_error_of_result,
    problem_of,
    problem_of_result,
)
from geoident.workflow.executing.processes import LocalProcesses
from geoident.workflow.running.answers import (
    Asked,
    Begin,
    Compute,
    KeptAnswers,
    WhereWorthWhile,
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
from geoident.workflow.running.outputs import require_free, standing, target
from geoident.workflow.running.reduced_answers import ReducedAnswers, reduced_answers
from geoident.workflow.running.result_files import case_path, files_of_result
from geoident.workflow.running.workers import WORTH, ModelParts, as_many_as_fit, runs_on_cluster

EFFECTIVE = 1000
"""Effective size at which draws are enough, unless another one is asked for."""

EVALUATIONS = 50_000
"""Evaluations of the model at most, unless another number is given."""

SHRUNK = 0.95
"""Standard deviation of draws by that of the prior from which on the readings tell nothing."""

POOR = "poor-fit"
POOR_FIT = (
    "The model does not fit the readings (see the findings): neither draws nor predictions are to "
    "be relied on."
)

_MOST_NUMBERS = 4_000_000  # of predicted readings in the file


@dataclass(frozen=True)
class SampleRequest:
    """What to draw.

    Args:
        result: path of a fit.
        draws: how many to write.
        effective: effective size at which it is enough; at most ``draws``.
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
    def wish(self) -> Wish:
        """What is asked of the sampler."""
        return Wish(self.draws, float(min(self.effective, self.draws)), self.evaluations)


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
    wish = request.wish
    purpose = f"sample {fit.fingerprint} {wish.draws} {wish.effective} {wish.evaluations}"
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
        asked,
        "sample",
        (),
        inputs,
        place,
        identity,
        standing(place, identity, kind="sample", case=inputs.path),
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
    require_free(job.found, job.place, force=request.force, inputs=task.files_read)
    setup, asked = _asked(task.fit, job.inputs, request.solver)
    require_same_modes(task.fit, setup.model, setup.case, task.fit.parameters.values)
    with evaluation_log(job, control) as log:
        response = problem_of(setup, log, control).response
        problem = problem_of_result(task.fit, setup.case, response)
        with _answers(task, asked, log, control) as (answers, led):
            density = PosteriorDensity(problem, answers)
            draws = _drawn(task, density, control)
            found = _Found(task, setup, problem, density, draws, answers, asked.places, led)
            result = found.result()
        return write(result, job.place, job.found, inputs=task.files_read, force=job.request.force)


def _drawn(task: SampleTask, density: PosteriorDensity, control: Control) -> Draws:
    """Draws, by the first sampler that can be believed.

    Raises:
        Interrupted: the time was up before there were any.
    """
    try:
        return sample_posterior(
            density,
            _minima(task.fit),
            task.request.wish,
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
    setup = Setup(model, inputs.case, fit.gauges.readings, model_error=error)
    return setup, Asked(model, inputs.case, setup.readings)


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
    most = as_many_as_fit(asked.model, request.solver) if jobs is None else jobs
    if parts is None:
        with runs_on_cluster(asked.model, control):
            yield here(asked)
        return
    if most == 1 and cluster is None:
        yield here(asked)
        return
    begin: Begin = partial(LocalProcesses, most) if cluster is None else cluster.begin
    processes = partial(in_processes, begin, build_elsewhere, (parts, readings), asked.beside)
    unasked = jobs is None and cluster is None
    with WhereWorthWhile(asked, processes, WORTH if unasked else 0.0) as compute:
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


@dataclass(frozen=True)
class _Found:
    """Draws, and all that makes a result of them."""

    task: SampleTask
    setup: Setup
    problem: Problem
    density: PosteriorDensity
    draws: Draws
    answers: KeptAnswers
    places: Ints
    led: ReducedAnswers | None

    def _provenance(self) -> Provenance:
        task = self.task
        found = job_provenance(task.job)
        return of_fit(found, task.fit, task.request.result, task.job.place.path)

    def result(self) -> Result:
        fit, case = self.task.fit, self.setup.case
        posterior = self._posterior()
        status, reason = _ending(self.draws, posterior, self.task.request.wish.effective)
        if status == "converged" and fit.status == POOR:
            status, reason = POOR, f"{reason} {POOR_FIT}"
        table = _parameters(fit.parameters, posterior, self.density)
        return replace(
            fit,
            kind="sample",
            status=status,
            exit_code=ExitCode.DONE if status == "converged" else ExitCode.NOT_CONVERGED,
            method=f"{posterior.sampler} sampling",
            reason=reason,
            findings=(*_findings(table), *fit.findings),
            notes=(*granted(fit, case.parameters), *self._led(), *case.notes),
            provenance=self._provenance(),
            parameters=table,
            counts=self._counts(),
            prediction=self._prediction(posterior),
            posterior=posterior,
            varied=drawn_fields(self.setup.model, posterior.flat),
            history=(),
            fields=None,
            members=None,
            reactions=None,
            yielded=None,
            mechanism=None,
            diagnostics=None,
            evidence=None,
            rivals=None,
            certificate=None,
            reduced=None,
            sensitivity=None,
            grid=None,
        )

    def _led(self) -> list[str]:
        """How many evaluations are those of a reduced model."""
        return [] if self.led is None else [self.led.note]

    def _posterior(self) -> PosteriorDraws:
        draws, problem = self.draws, self.problem
        chains, length, m = draws.x.shape
        values = self.density.natural(draws.x.reshape(-1, m)).reshape(chains, length, -1)
        every = max(1, int(np.ceil(chains * length * len(self.places) / _MOST_NUMBERS)))
        taken = np.arange(0, length, every)
        predicted = self._predicted(values[:, taken].reshape(-1, values.shape[2]))
        effective, r_hat = (np.full(len(self.density.free), np.nan) for _ in range(2))
        effective[self.density.free], r_hat[self.density.free] = draws.effective, draws.r_hat
        channels, stages = self.setup.case.channels, self.setup.case.stages
        return PosteriorDraws(
            names=tuple(q.name for q in problem.parameters),
            fields=tuple(q.field for q in problem.parameters),
            values=values,
            log_density=draws.logarithms,
            sampler=draws.sampler,
            pareto_k=draws.pareto_k,
            effective=effective,
            r_hat=r_hat,
            acceptance=draws.acceptance,
            evaluations=self.density.evaluations,
            channels=tuple(channels[i].name for i, _ in self.places.tolist()),
            stages=tuple(stages[j].name for _, j in self.places.tolist()),
            predicted=predicted.reshape(chains, len(taken), -1),
            taken=taken,
        )

    def _predicted(self, points: Floats) -> Floats:
        """Readings (k, m) that draws p (k, n) predict, with their errors."""
        unique, place = np.unique(points, axis=0, return_inverse=True)
        found = self.answers.at(unique)
        later = np.array([found[k].later for k in place.ravel().tolist()])
        rng = np.random.default_rng([self.task.request.seed, 1])
        known = self._errors()
        if known is None:
            sd = accuracies(self.setup.case)[tuple(self.places.T)]
            return np.asarray(later + sd * rng.standard_normal(later.shape))
        none = np.full(len(self.problem.measured), np.nan)
        used = np.array(
            [none if found[k].used is None else found[k].used for k in place.ravel().tolist()]
        )
        problem, errors = known.with_later(self.places)
        return with_errors(problem, used, later, errors, rng)

    def _errors(self) -> KnownErrors | None:
        """What used readings tell of the errors of later ones, as the loss leaves them at the fit.

        The model error grows with the steps of the model at the fit. None where nothing is shared.
        """
        fit, setup = self.task.fit, self.setup
        readings = fit.gauges.readings
        computed = readings.computed[readings.used]
        left = replace(self.problem, sd=effective_sd(self.problem, computed))
        survey = setup.model.survey(fit.parameters.values, fields=False, partial=True)
        nothing = np.empty((len(computed), 0))
        return known_errors(setup, left, survey, computed, nothing)

    def _prediction(self, posterior: PosteriorDraws) -> Prediction:
        shape = self.task.fit.gauges.computed.shape
        place = tuple(self.places.T)
        values = posterior.predicted.reshape(-1, len(self.places))
        stands = np.isfinite(values).all(axis=0)
        columns = {name: np.full(shape, np.nan) for name in ("mean", "sd", "lower95", "upper95")}
        of_all = np.full((4, len(self.places)), np.nan)
        some = values[:, stands]
        if some.shape[1]:
            of_all[:, stands] = [some.mean(axis=0), some.std(axis=0),
                                 *np.quantile(some, (LEVELS[0], LEVELS[-1]), axis=0)]  # fmt: skip
        for column, row in zip(columns.values(), of_all, strict=True):
            column[place] = row
        return Prediction(**columns)

    def _counts(self) -> Counts:
        counts = self.setup.model.counts
        return replace(counts, evaluations=self.density.evaluations)


def _parameters(
    table: ParameterTable, posterior: PosteriorDraws, density: PosteriorDensity
) -> ParameterTable:
    """The parameters as their draws have them: median, standard deviation, quantiles."""
    covariance = np.atleast_2d(np.cov(posterior.flat.T, bias=True))
    sd = posterior.sd
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = covariance / np.outer(sd, sd)
    return replace(
        table,
        values=posterior.quantiles[:, LEVELS.index(0.5)],
        sd=sd,
        lower95=posterior.quantiles[:, 0],
        upper95=posterior.quantiles[:, -1],
        at_bound=np.zeros(len(sd), dtype=np.bool_),
        determined=_shrunk(posterior, density.problem.parameters),
        covariance=covariance,
        correlation=correlation,
    )


def _shrunk(posterior: PosteriorDraws, parameters: tuple[Parameter, ...]) -> Bools:
    """(n,) the draws are clearly closer together than what was known before."""
    return np.array(
        [
            _spread(parameter, values) < SHRUNK
            for parameter, values in zip(parameters, posterior.flat.T, strict=True)
        ]
    )


def _spread(parameter: Parameter, values: Floats) -> float:
    """Standard deviation of draws by that of the prior, or of the flat density in the bounds."""
    if parameter.prior is not None:
        prior = parameter.prior
        if prior.kind == "normal":
            return float(np.std(values)) / prior.sd
        return float(np.std(np.log(values))) * prior.mean / prior.sd
    by_log = parameter.scale == "log"
    ends = np.array([parameter.lower, parameter.upper])
    values, ends = (np.log(values), np.log(ends)) if by_log else (values, ends)
    return float(np.std(values) / (np.ptp(ends) / np.sqrt(12.0))) if np.ptp(ends) > 0.0 else 0.0


def _ending(draws: Draws, posterior: PosteriorDraws, wanted: float) -> tuple[str, str]:
    """Status and reason."""
    size = posterior.least_effective
    worth = f"{posterior.n_draws} draws are worth {size:.0f} independent ones"
    if np.isfinite(posterior.pareto_k):
        said = f"{worth} (Pareto k {posterior.pareto_k:.2f})"
    else:
        said = f"{worth} (R-hat {posterior.largest_r_hat:.3f})"
    good = trustworthy(draws, posterior.evaluations, wanted=wanted)
    said += "." if good else ": do not rely on the ends of intervals."
    if draws.stopped:
        return "out-of-budget", f"{draws.stopped} {said}"
    return ("converged" if good else "not-converged"), said


def _findings(table: ParameterTable) -> list[str]:
    loose = [table.names[i] for i in table.named if not table.determined[i]]
    if not loose:
        return []
    return [
        f"{', '.join(loose)}: the draws are as far apart as prior and bounds allow; the readings "
        "tell nothing of it alone."
    ]


def granted(fit: Result, parameters: tuple[Parameter, ...]) -> list[str]:
    """What was taken for granted of the density that is drawn from.

    Args:
        fit: whose posterior it is.
        parameters: the n unknowns.
    """
    error = fit.model_error
    if error is None or error.kind != "estimated":
        return [_flat_note(parameters)]
    return [
        _flat_note(parameters),
        f"The size of the model error is that of the fit in all draws ({_percent(error.size)} of "
        f"the computed motion; its 95 % interval is {_percent(error.lower95)} to "
        f"{_percent(error.upper95)}): what is not known of it is in no draw.",
    ]


def _flat_note(parameters: tuple[Parameter, ...]) -> str:
    """What the density is where no prior is given."""
    flat = [q for q in parameters if q.prior is None]
    parts = []
    for scale, words in (("log", "in its logarithm"), ("linear", "in its value")):
        names = [q.name for q in flat if q.scale == scale]
        if names:
            parts.append(f"{', '.join(names)} {words}")
    if not parts:
        return "All parameters have priors."
    return f"Without a prior a density is flat within the bounds: {'; '.join(parts)}."


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %"
