"""How a job ends: its result, where it stands, and what is said of the readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.identify.problem.problem import Outcome, Problem
from geoident.io.result.file import read_result, write_result
from geoident.model.result import Result
from geoident.workflow.running.control import Control
from geoident.workflow.running.estimate import Setup, evaluation_log, prepare, problem_of, search
from geoident.workflow.running.jobs import Job
from geoident.workflow.running.outputs import Standing, Target
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


def keep(place: Target) -> Finished:
    """A result that is up to date."""
    return Finished(read_result(place.path), (str(place.path),), up_to_date=True)


def write(result: Result, place: Target, found: Standing, *, inputs: Sequence[str]) -> Finished:
    """Put a result in its place.

    Args:
        result: what was found.
        place: of the result.
        found: what stands there.
        inputs: paths that were read, and so must not be written.
    """
    overwrite = found is not Standing.NOTHING
    return Finished(result, write_result(result, place.path, overwrite=overwrite, inputs=inputs))


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
        return keep(job.place)
    setup = prepare(job)
    _tell_readings(setup, control)
    with evaluation_log(job, control) as log:
        problem = problem_of(setup, log, control)
        outcome = search(problem, job.methods, control)
        written = result(setup, problem, outcome)
        return write(written, job.place, job.found, inputs=job.inputs.files)


def _tell_readings(setup: Setup, control: Control) -> None:
    """Say how many readings are used, which are not, and why."""
    readings = setup.readings
    control.monitor.detail(f"{np.count_nonzero(readings.used)} readings are used")
    for unused in unused_by_stage(readings):
        control.monitor.detail(f"not used: {unused}")
