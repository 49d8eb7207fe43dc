"""Results and where they stand; the log of evaluations that outlives a run cut short."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from geoident.errors import ExitCode, InputError, Interrupted, ModelError, Term, TimeIsUp
from geoident.identify.problem.problem import STOPPED
from geoident.io.result.checkpoint import EvaluationLog
from geoident.io.result.file import read_identity, read_result, write_result
from geoident.model.results.result import Result
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Job
from geoident.workflow.running.outputs import Standing, Target


@contextmanager
def evaluation_log(job: Job, control: Control) -> Iterator[EvaluationLog]:
    """The log of a job's evaluations; kept if the run is cut short, removed when it is done.

    Raises:
        Interrupted: the run was; says how to go on.
    """
    if job.request.fresh:
        job.place.checkpoint.unlink(missing_ok=True)
    log = EvaluationLog.open(str(job.place.checkpoint), job.identity)
    if log.trouble:
        control.monitor.warn(log.trouble)
    elif len(log):
        kept = "blocks of evaluations" if job.command == "sample" else "evaluations"
        control.monitor.inform(f"Going on from {job.place.checkpoint}: {len(log)} {kept}")
    try:
        yield log
    except Interrupted as stop:
        log.close()
        raise Interrupted(_how_to_go_on(job), exit_code=stop.exit_code) from stop
    except TimeIsUp as end:
        log.close()
        raise Interrupted(_too_short(job, log), exit_code=ExitCode.NOT_CONVERGED) from end
    except (InputError, ModelError):
        log.remove()  # it would end the same way again
        raise
    except BaseException:
        log.close()
        raise
    if control.out_of_time:
        log.close()
    else:
        log.remove()


def _too_short(job: Job, log: EvaluationLog) -> str:
    """That no result could be written in the time that was given."""
    if not len(log):
        return "The time that was given is used up before the model was evaluated once."
    return (
        "The time that was given is used up before a result could be written. "
        f"What was computed is kept in {job.place.checkpoint}.\n"
        f"    {Term.SAME_AGAIN} goes on from there."
    )


def _how_to_go_on(job: Job) -> str:
    same = f"{Term.SAME_AGAIN} without {Term.FRESH}" if job.request.fresh else Term.SAME_AGAIN
    return (
        f"Interrupted. What was computed is kept in {job.place.checkpoint}.\n"
        f"    {same} goes on from there."
    )


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
    if not overwrite:  # the same may have been computed by another run meanwhile
        other = read_identity(place.path) if place.path.exists() else None
        if other is not None and other.identity == result.provenance.identity:
            if other.status != STOPPED:
                return keep(place)
            overwrite = True
    return Finished(result, write_result(result, place.path, overwrite=overwrite, inputs=inputs))
