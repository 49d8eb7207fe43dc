"""How a job ends: its result, where it stands, and what is said of the readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.identify.problem.problem import Outcome, Problem
from geoident.io.result.file import read_result, write_result
from geoident.model.result import Result
from geoident.workflow.running.control import Control
from geoident.workflow.running.estimate import Setup, evaluation_log, prepare, problem_of, search
from geoident.workflow.running.jobs import Job
from geoident.workflow.running.outputs import Standing
from geoident.workflow.running.readings import unused_by_stage


@dataclass(frozen=True)
class Finished:
    """A result and where it stands.

    Args:
        result: what was found, now or before.
        paths: the files that hold it, the result file first.
        up_to_date: it stood there already and was not computed again.
    """

    result: Result
    paths: tuple[str, ...]
    up_to_date: bool = False


def keep(job: Job) -> Finished:
    """The result of a job that is up to date."""
    return Finished(read_result(job.place.path), (str(job.place.path),), up_to_date=True)


def write(job: Job, result: Result) -> Finished:
    """Put the result of a job in its place."""
    overwrite = job.found is not Standing.NOTHING
    path, inputs = job.place.path, job.files_read
    return Finished(result, write_result(result, path, overwrite=overwrite, inputs=inputs))


def searched(
    job: Job, control: Control, result: Callable[[Setup, Problem, Outcome], Result]
) -> Finished:
    """Runs the search of a command and writes its result; keeps one that is up to date.

    Args:
        job: what to do.
        control: progress, budget and stops.
        result: what is written of the case, its problem and the outcome of the search.

    Raises:
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    if job.up_to_date:
        return keep(job)
    setup = prepare(job)
    _tell_readings(setup, control)
    with evaluation_log(job, control) as log:
        problem = problem_of(setup, log, control)
        outcome = search(problem, job.methods, control)
        return write(job, result(setup, problem, outcome))


def _tell_readings(setup: Setup, control: Control) -> None:
    """Say how many readings are used, which are not, and why."""
    readings = setup.readings
    control.monitor.detail(f"{np.count_nonzero(readings.used)} readings are used")
    for unused in unused_by_stage(readings):
        control.monitor.detail(f"not used: {unused}")
