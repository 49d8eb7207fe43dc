"""Runs that leave a result: the same steps as the commands, with the same files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from geoident.api.calling import AnyPath, Progress, control, spoken
from geoident.api.cases import CaseFile, origin_of
from geoident.api.result_handle import Stored
from geoident.api.results import (
    BacktestResult,
    FitResult,
    PlanResult,
    PredictionResult,
    ResultFile,
    SampleResult,
    ScanResult,
)
from geoident.model.results.result import Result
from geoident.workflow.backtest import backtest as run_backtest
from geoident.workflow.estimating.finished import Finished
from geoident.workflow.fit import fit as run_fit
from geoident.workflow.plan import PlanRequest, make_plan, plan_gauges
from geoident.workflow.predict import PredictRequest, plan_prediction
from geoident.workflow.predict import predict as run_prediction
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Job, Request, plan_backtest, plan_fit, plan_scan
from geoident.workflow.sample import SampleRequest, plan_sample
from geoident.workflow.sample import sample as run_sample
from geoident.workflow.scan import scan as run_scan
from geoident.workflow.updating.update import UpdateRequest, updating
from geoident.workflow.updating.update import update as run_update


@spoken
def fit(
    case: CaseFile | AnyPath,
    *,
    output: AnyPath | None = None,
    seed: int = 0,
    max_time: float | None = None,
    jobs: int | None = None,
    cluster: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
    progress: Progress | None = None,
    solver: str = "auto",
) -> FitResult:
    """Identify the parameters from the readings.

    A result of the same input is kept and comes back at once. A call that is interrupted leaves a
    checkpoint beside the result, and the same call goes on from there.

    Args:
        case: as loaded, or its path.
        output: file or existing folder of the result; ``CASE.fit.h5`` beside the case if None.
        seed: of random numbers.
        max_time: seconds after which the search ends with what it has.
        jobs: number of processes for what a search can compute at a time; None for all cores,
            where that saves time.
        cluster: in place of processes of this machine: address of a scheduler of dask, ``local``,
            or the path of a cluster file.
        force: overwrite a result of other input.
        fresh: compute again what is up to date.
        progress: is told of every iteration.
        solver: name of the sparse solver, or ``auto``.

    Raises:
        InputError: the case, its mesh or its readings are wrong; with all faults.
        ModelError: the model has no solution.
        OutputError: the result cannot be written, or would replace one of other input.
        UsageError: there is no such solver.
    """
    request = _request(case, output, seed=seed, force=force, fresh=fresh, solver=solver)
    return FitResult(*_run(request, plan_fit, run_fit, control(progress, max_time, jobs, cluster)))


@spoken
def update(
    fitted: ResultFile | CaseFile | AnyPath,
    *,
    output: AnyPath | None = None,
    max_time: float | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    solver: str = "auto",
) -> FitResult:
    """Judge new readings by the last fit, then fit them in.

    New readings are those in the files of the case that the last fit has not used. Without any the
    result stays as it is; where there is no result yet, this is `fit`.

    Args:
        fitted: what `fit` found, or the path of its file or of the case.
        output: file or existing folder of the result; ``CASE.fit.h5`` beside the case if None.
        max_time: seconds after which the search ends with what it has.
        jobs: number of processes for what a search can compute at a time; None for all cores,
            where that saves time.
        progress: is told of every iteration.
        solver: name of the sparse solver, or ``auto``.

    Returns:
        The fit. Its ``updates`` say of each update whether the readings belonged to the model.

    Raises:
        InputError: the case is wrong, or has other parameters than the last fit.
        ModelError: the model has no solution.
        OutputError: the result cannot be written.
    """
    path = fitted.path if isinstance(fitted, ResultFile | CaseFile) else os.fspath(fitted)
    place = None if output is None else os.fspath(output)
    overrides = fitted.overrides if isinstance(fitted, CaseFile) else ()
    with updating(UpdateRequest(path, overrides, output=place, solver=solver)) as task:
        finished = run_update(task, control(progress, max_time, jobs)).finished
    return FitResult(finished.result, finished.paths[0], finished.up_to_date)


@spoken
def scan(
    case: CaseFile | AnyPath,
    *,
    output: AnyPath | None = None,
    max_time: float | None = None,
    jobs: int | None = None,
    cluster: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
    progress: Progress | None = None,
    solver: str = "auto",
    reduced: ResultFile | AnyPath | None = None,
) -> ScanResult:
    """Compute the misfit on a grid over one or two parameters (``fit.scan`` of the case).

    Args:
        case: as loaded, or its path.
        output: file or existing folder of the result; ``CASE.scan.h5`` beside the case if None.
        max_time: seconds after which the scan ends with what it has.
        jobs: number of processes for what a scan can compute at a time; None for all cores,
            where that saves time.
        cluster: in place of processes of this machine: address of a scheduler of dask, ``local``,
            or the path of a cluster file.
        force: overwrite a result of other input.
        fresh: compute again what is up to date.
        progress: is told of every point.
        solver: name of the sparse solver, or ``auto``.
        reduced: what `fit` found, or the path of its result, with a reduced model that it keeps
            (``fit.reduced: keep``): it answers where it is estimated to be close enough.

    Raises:
        InputError: the case, its mesh or its readings are wrong; with all faults.
        ModelError: the model has no solution.
        OutputError: the result cannot be written, or would replace one of other input.
        UsageError: there is no such solver.
    """
    request = _request(case, output, seed=0, force=force, fresh=fresh, solver=solver)
    if reduced is not None:
        request = replace(request, reduced=path_of(reduced))
    return ScanResult(
        *_run(request, plan_scan, run_scan, control(progress, max_time, jobs, cluster))
    )


@spoken
def backtest(
    case: CaseFile | AnyPath,
    *,
    output: AnyPath | None = None,
    seed: int = 0,
    max_time: float | None = None,
    jobs: int | None = None,
    cluster: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
    progress: Progress | None = None,
    solver: str = "auto",
) -> BacktestResult:
    """Fit the first stages, predict those after them, and score; for every number of stages.

    Args:
        case: as loaded, or its path.
        output: file or existing folder of the result; ``CASE.backtest.h5`` beside the case if None.
        seed: of random numbers.
        max_time: seconds after which it ends with what it has.
        jobs: number of processes for what a search can compute at a time; None for all cores,
            where that saves time.
        cluster: in place of processes of this machine: address of a scheduler of dask, ``local``,
            or the path of a cluster file.
        force: overwrite a result of other input.
        fresh: compute again what is up to date.
        progress: is told of every iteration.
        solver: name of the sparse solver, or ``auto``.

    Raises:
        InputError: the case is wrong, or fewer than two stages were read.
        ModelError: the model has no solution.
        OutputError: the result cannot be written, or would replace one of other input.
        UsageError: there is no such solver.
    """
    request = _request(case, output, seed=seed, force=force, fresh=fresh, solver=solver)
    return BacktestResult(
        *_run(request, plan_backtest, run_backtest, control(progress, max_time, jobs, cluster))
    )


@spoken
def predict(
    fitted: ResultFile | AnyPath,
    *,
    stages: str | Sequence[str] = (),
    case: CaseFile | AnyPath | None = None,
    output: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
    solver: str = "auto",
) -> PredictionResult:
    """Predict readings, with 95 % bands, from a fit.

    Args:
        fitted: what `fit` found, or the path of its result.
        stages: one or several to predict; all that took no part in the fit if empty.
        case: another case, whose parameters are those of the fit; its gauges are those of the fit
            if it has all readings that the fit has used, else it counts as another section.
        output: file or existing folder of the result; beside the fit if None.
        force: overwrite a prediction of other input.
        fresh: compute again what is up to date.
        solver: name of the sparse solver, or ``auto``.

    Returns:
        The prediction; ``.data.prediction`` has means and bands, (n_channels, n_stages), SI.

    Raises:
        InputError: the result is no fit, or the case does not suit it.
        ModelError: the model has no solution.
        OutputError: the result cannot be written, or would replace one of other input.
        UsageError: there is no such stage or solver.
    """
    request = Request(
        path_of(fitted), output=_place(output), solver=solver, force=force, fresh=fresh
    )
    chosen, of = (stages,) if isinstance(stages, str) else tuple(stages), None
    if case is not None:
        new = origin_of(case)
        request, of = replace(request, overrides=new.overrides, text=new.text), new.path
    asked = PredictRequest(request, chosen, of)
    return PredictionResult(*_parts(run_prediction(plan_prediction(asked), control())))


@spoken
def sample(
    fitted: ResultFile | AnyPath,
    *,
    draws: int = 10_000,
    effective: int = 1000,
    output: AnyPath | None = None,
    seed: int = 0,
    max_time: float | None = None,
    jobs: int | None = None,
    cluster: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
) -> SampleResult:
    """Draw parameters from their posterior, and predict readings with each draw.

    Args:
        fitted: what `fit` found, or the path of its result.
        draws: how many to write.
        effective: target effective sample size.
        output: file or existing folder of the result; beside the fit if None.
        seed: of random numbers.
        max_time: seconds after which sampling ends with what it has.
        jobs: number of processes that evaluate the model; None for all cores, where that
            saves time.
        cluster: in place of processes of this machine: address of a scheduler of dask, ``local``,
            or the path of a cluster file.
        force: overwrite a sample of other input.
        fresh: compute again what is up to date.

    Returns:
        The draws; ``.draws`` has them as an array, and ``arviz.from_netcdf`` opens ``.path``.

    Raises:
        InputError: the result is no fit.
        ModelError: the model has no solution.
        OutputError: the result cannot be written, or would replace one of other input.
        UsageError: a package that samples is not installed.
    """
    obeyed = control(max_time=max_time, jobs=jobs, cluster=cluster)
    request = Request(path_of(fitted), output=_place(output), seed=seed, force=force, fresh=fresh)
    asked = SampleRequest(request, draws, effective)
    return SampleResult(*_parts(run_sample(plan_sample(asked), obeyed)))


@spoken
def plan(
    source: CaseFile | ResultFile | AnyPath,
    *,
    candidates: AnyPath,
    budget: float,
    wanted: str | Sequence[str],
    draws: int = 4,
    output: AnyPath | None = None,
    seed: int = 0,
    force: bool = False,
    fresh: bool = False,
    solver: str = "auto",
) -> PlanResult:
    """Choose the gauges that tell most of a prediction, a parameter or a limit.

    Args:
        source: a case, of which all is known that priors and bounds say; or what `fit` found; or
            the path of either.
        candidates: file of gauges to choose from, written as in a case, each with `cost` and the
            `stages` at which it is read.
        budget: that their costs must not exceed.
        wanted: one or several, such as ``CV1 at bench 5``, ``CV1 > 40 mm at bench 5``, ``E_rock``.
        draws: of the parameters at which the plan must be good, too.
        output: file or existing folder of the result; ``CASE.plan.h5`` beside the source if None.
        seed: of the draws.
        force: overwrite a plan of other input.
        fresh: compute again what is up to date.
        solver: name of the sparse solver, or ``auto``.

    Raises:
        InputError: the case, the fit or the candidates are wrong; with all faults.
        ModelError: the model has no solution.
        OutputError: the result cannot be written, or would replace one of other input.
        UsageError: there is nothing of that kind to be known, or the budget buys nothing.
    """
    place = source.path if isinstance(source, ResultFile) else source
    request = _request(place, output, seed=seed, force=force, fresh=fresh, solver=solver)
    goals = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    asked = PlanRequest(request, os.fspath(candidates), float(budget), goals, draws)
    return PlanResult(*_parts(make_plan(plan_gauges(asked), control())))


def path_of(source: Stored | AnyPath) -> str:
    """The path of a result, from itself or its path."""
    return os.fspath(source) if isinstance(source, str | os.PathLike) else source.path


def _place(output: AnyPath | None) -> str | None:
    return None if output is None else os.fspath(output)


def _request(
    case: CaseFile | AnyPath,
    output: AnyPath | None,
    *,
    seed: int,
    force: bool,
    fresh: bool,
    solver: str,
) -> Request:
    origin = origin_of(case)
    return Request(
        case=origin.path,
        overrides=origin.overrides,
        output=_place(output),
        seed=seed,
        solver=solver,
        force=force,
        fresh=fresh,
        text=origin.text,
    )


_Written = tuple[Result, str, bool]


def _run(
    request: Request,
    plan: Callable[[Request], Job],
    run: Callable[[Job, Control], Finished],
    obeyed: Control,
) -> _Written:
    return _parts(run(plan(request), obeyed))


def _parts(finished: Finished) -> _Written:
    return finished.result, finished.paths[0], finished.up_to_date
