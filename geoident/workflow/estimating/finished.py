"""Results and where they stand; the log of evaluations that outlives a run cut short."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

from geoident.errors import ExitCode, InputError, Interrupted, ModelError, Term, TimeIsUp
from geoident.fem.solvers.kept_solutions import KeepsSolutions
from geoident.forward.observed import ObservedModel
from geoident.io.result.checkpoint import EvaluationLog
from geoident.io.result.file import read_identity, read_result, write_result
from geoident.model.results.many.project import ProjectResult
from geoident.model.results.result import STOPPED, Result
from geoident.workflow.estimating.setup import Setup, with_workers
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Job, Planned
from geoident.workflow.running.older_files import older_files
from geoident.workflow.running.outputs import Existing, Target, restore, set_aside


@contextmanager
def evaluation_log(
    job: Planned, control: Control, model: ObservedModel | None = None
) -> Iterator[EvaluationLog]:
    """The log of a job's evaluations; kept if the run is cut short, removed when it is done.

    Args:
        job: what is done.
        control: is told what is known already.
        model: evaluates; what it solves for long is logged, too. None for several models.

    Raises:
        Interrupted: the run was; says how to go on.
    """
    if job.request.fresh and not job.request.begun:
        job.place.checkpoint.unlink(missing_ok=True)
    log = EvaluationLog.open(str(job.place.checkpoint), job.identity)
    if log.trouble:
        control.monitor.warn(log.trouble)
    elif len(log) or log.solutions:
        kept = "blocks of evaluations" if job.command == "sample" else "evaluations"
        also = f", {log.solutions} solutions that took long" if log.solutions else ""
        control.monitor.inform(f"Going on from {job.place.checkpoint}: {len(log)} {kept}{also}")
    if isinstance(model, KeepsSolutions):
        model.keep_solutions(log)
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


def _too_short(job: Planned, log: EvaluationLog) -> str:
    """That no result could be written in the time that was given."""
    if not len(log) and not log.solutions:
        return "Time limit reached before the model was evaluated once."
    return (
        "Time limit reached before a result could be written. "
        f"What was computed is kept in {job.place.checkpoint}.\n"
        f"    {Term.SAME_AGAIN} continues from there."
    )


def _how_to_go_on(job: Planned) -> str:
    same = f"{Term.SAME_AGAIN} without {Term.FRESH}" if job.request.fresh else Term.SAME_AGAIN
    return (
        f"Interrupted. What was computed is kept in {job.place.checkpoint}.\n"
        f"    {same} continues from there."
    )


R = TypeVar("R", bound=Result | ProjectResult)


@dataclass(frozen=True)
class FinishedRun(Generic[R]):
    """A result and where it stands.

    Args:
        result: what was found, now or before.
        paths: the files that hold it, the result file first.
        up_to_date: it stood there already and was not computed again.
        remarks: sentences on what became of a result that stood there before.
    """

    result: R
    paths: tuple[str, ...]
    up_to_date: bool = False
    remarks: tuple[str, ...] = ()


Finished = FinishedRun[Result]


@dataclass(frozen=True)
class ResultFiles(Generic[R]):
    """Files of results of one kind: kept where they are up to date, set aside where they are not.

    Args:
        read: reads one.
        write_new: writes one, as `geoident.io.result.file.write_result`.
    """

    read: Callable[[Path], R]
    write_new: Callable[..., tuple[str, ...]]

    def keep(self, place: Target) -> FinishedRun[R]:
        """A result that is up to date."""
        result = self.read(place.path)
        older = older_files(place.path, result.provenance.identity, new=False)
        return FinishedRun(result, (str(place.path),), up_to_date=True, remarks=older)

    def at_hand(
        self, place: Target, identity: str, existing: Existing, *, force: bool, fresh: bool
    ) -> FinishedRun[R] | None:
        """The result of an input where it is there already: in its place, or kept from before.

        Args:
            place: of the result.
            identity: hash of everything that it depends on.
            existing: what stands there.
            force: what stands there is to be replaced.
            fresh: it is to be computed again.
        """
        if fresh:
            return None
        if existing is Existing.UP_TO_DATE:
            return self.keep(place)
        if existing is not Existing.OTHER or force:
            return None
        moved = restore(place, identity)
        if moved is None:
            return None
        was, aside = moved
        kept = self.keep(place)
        remark = f"{was} was made from this input: it is {place.path} again, and what stood there "
        remark += f"is kept as {aside}"
        older = older_files(place.path, kept.result.provenance.identity, new=True)
        return replace(kept, remarks=(remark, *older))

    def write(
        self, result: R, place: Target, existing: Existing, *, inputs: Sequence[str], force: bool
    ) -> FinishedRun[R]:
        """Put a result in its place; an earlier one of the same case is kept beside.

        Args:
            result: what was found.
            place: of the result.
            existing: what stood there when the command began.
            inputs: paths that were read, and so must not be written.
            force: what stands there is not to be kept.
        """
        now = read_identity(place.path) if place.path.exists() else None
        same = now is not None and now.identity == result.provenance.identity
        if now is not None and same and existing in (Existing.NOTHING, Existing.OTHER):
            if now.status != STOPPED:  # computed by another run meanwhile
                return self.keep(place)
            existing = Existing.UNFINISHED
        remarks: tuple[str, ...] = ()
        lost = now is not None and "updates" in now.contents.split()
        lost = lost and getattr(result, "updates", None) is None
        if now is not None and (lost or (existing is Existing.OTHER and not force)):
            aside, removed = set_aside(place.path)
            why = "has the history of its updates" if lost else "was made from other input"
            remarks = (
                f"{place.path} {why}: it is kept as {aside}",
                *(f"{path}, an older one, is removed" for path in removed),
            )
        overwrite = existing is not Existing.NOTHING
        paths = self.write_new(result, place.path, overwrite=overwrite, inputs=inputs)
        older = older_files(place.path, result.provenance.identity, new=existing is Existing.OTHER)
        return FinishedRun(result, paths, remarks=(*remarks, *older))


RESULTS = ResultFiles(read_result, write_result)
"""Those of single cases."""
at_hand, write = RESULTS.at_hand, RESULTS.write


def job_at_hand(job: Job) -> Finished | None:
    """The result of a job where it is there already."""
    request = job.request
    return at_hand(job.place, job.identity, job.existing, force=request.force, fresh=request.fresh)


def run_job(
    job: Job,
    control: Control,
    prepare: Callable[[Job], Setup],
    compute: Callable[[Setup, Log], Result],
) -> Finished:
    """The result of a job: the one that is at hand, or a new one, written in its place.

    Args:
        job: what to do.
        control: progress, budget and stops.
        prepare: builds the model and selects the readings.
        compute: makes the result; what it evaluates is logged.

    Raises:
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    if (before := job_at_hand(job)) is not None:
        return before
    control.require_cluster()
    prepared = prepare(job)
    with (
        evaluation_log(job, control, prepared.model) as log,
        with_workers(job, prepared, control) as setup,
    ):
        result, force = job.joined(compute(setup, log)), job.request.force
        return write(result, job.place, job.existing, inputs=job.inputs.files, force=force)
