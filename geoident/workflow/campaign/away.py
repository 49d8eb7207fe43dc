"""Runs of a campaign on other machines: what a run reads travels there, its files come back.

There everything lies as it does here, so that a result is the same as if it had been made here.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from geoident.errors import ExitCode, Fault, InputError, Location
from geoident.io.result.file import read_identity
from geoident.io.text.atomic import atomic_output, make_folder
from geoident.io.text.named_files import files_of_text
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES
from geoident.model.cluster import Cluster
from geoident.model.external import ExternalProgram, PythonFunction
from geoident.model.results.many.campaign import FAILED, RunRecord
from geoident.workflow.campaign.one_run import RunTask, compute
from geoident.workflow.campaign.plan import CampaignPlan
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import Converted, Executor
from geoident.workflow.executing.parcel import packed, relative
from geoident.workflow.programs.digest import model_files
from geoident.workflow.programs.program import program_of
from geoident.workflow.programs.travelling import (
    TravellingAnswer,
    TravellingTask,
    begun_with,
    known_logs,
)
from geoident.workflow.running.outputs import runs_folder, set_aside


@dataclass(frozen=True)
class AwayTask(TravellingTask):
    """What a process far away is told of a run.

    Args:
        kept: path to content of the files with which it goes on.
        runs: folder of the runs of its model; empty where that runs nothing.
        task: the run; its paths are relative.
    """

    task: RunTask

    @property
    def checkpoint(self) -> str:
        """Path of the evaluations of the run."""
        return self.task.checkpoint.as_posix()


AwayEnd = TravellingAnswer[RunRecord]


class AwayRuns(Converted[RunTask, AwayTask, RunRecord, AwayEnd]):
    """An executor of runs that has them computed by another one, and writes what comes back.

    Args:
        executor: computes on other machines.
        plan: of the campaign.
    """

    def __init__(self, executor: Executor[AwayTask, AwayEnd], plan: CampaignPlan) -> None:
        runs = _runs_of(plan)

        def kept(answer: AwayEnd) -> RunRecord:
            record = _kept(answer, plan.folder, plan.inputs)
            answer.keep_runs()
            return record

        super().__init__(executor, lambda task: sent(task, runs), kept)


def cluster_executor(
    plan: CampaignPlan, cluster: Cluster, jobs: int, tell: Callable[[str], None]
) -> DaskCluster[AwayTask, AwayEnd]:
    """A cluster for the runs of a campaign.

    Args:
        plan: of the campaign.
        cluster: which one.
        jobs: number of workers at most, where they are started here.
        tell: is told what people should know.

    Raises:
        InputError: a file is named in a way that has no meaning on another machine.
    """
    campaign, model, runs = plan.campaign, plan.model, _runs_of(plan)
    program = model.command[0] if isinstance(model, ExternalProgram) else ""
    _refuse_absolute(campaign.case, program)
    on_cluster, logs = {program}, known_logs([])
    programs: tuple[str, ...] = ()
    if isinstance(model, ExternalProgram | PythonFunction):
        on_cluster = {program, *model_files(model)} - set(model.inputs)
        programs = program_of(model)
        logs = known_logs([Path(runs)])
    return DaskCluster(
        cluster,
        partial(begun_with, logs, set_up_away),
        packed(
            [path for path in plan.inputs if path not in on_cluster],
            beside=[plan.folder],
            programs=programs,
        ),
        jobs=max(1, min(jobs, len(plan.remaining))),
        time_limit=campaign.time_limit,
        retries=campaign.retries,
        tell=tell,
    )


def _runs_of(plan: CampaignPlan) -> str:
    """The folder of the runs of the model, as seen from there; empty where that runs nothing."""
    if not isinstance(plan.model, ExternalProgram | PythonFunction):
        return ""
    return str(runs_folder(relative(plan.campaign.case)))


def _refuse_absolute(case: str, program: str) -> None:
    """Refuse a case that names a file by its place on this machine.

    Args:
        case: its path.
        program: that may be named so.

    Raises:
        InputError: it does.
    """
    text = decode(read_bytes(case, limit=MAX_BYTES, what="case"), case)
    hint = "Name it as seen from the folder of the case."
    faults = [
        Fault("absolute-path", f"'{name}' is not in this place on a cluster", hint, Location(case))
        for name in files_of_text(text, relative(case))
        if Path(name).is_absolute() and name != program
    ]
    if faults:
        raise InputError(faults)


def sent(task: RunTask, runs: str) -> AwayTask:
    """A run as it travels, with the evaluations that an interrupted one has left.

    Args:
        task: the run.
        runs: folder of the runs of its model; empty where that runs nothing.
    """
    campaign = task.campaign
    portable = replace(
        campaign,
        path=relative(campaign.path),
        case=relative(campaign.case),
        result=relative(campaign.result) if campaign.result else "",
    )
    folder = Path(relative(str(task.folder)))
    return AwayTask({}, runs, replace(task, campaign=portable, folder=folder)).going_on()


def set_up_away() -> Callable[[AwayTask], AwayEnd]:
    """What a process far away does with its tasks."""
    return compute_away


def compute_away(away: AwayTask) -> AwayEnd:
    """Run one variation, and take what it leaves."""
    folder = away.task.folder
    make_folder(folder)
    with away.begun() as made:
        record = compute(away.task, remembered=False)
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}
    shutil.rmtree(folder, ignore_errors=True)
    return TravellingAnswer(record, files, away.runs, made)


def _kept(answer: AwayEnd, folder: Path, inputs: Iterable[str]) -> RunRecord:
    """Write what a run has left.

    Raises:
        OutputError: it cannot be written.
    """
    record = answer.end
    make_folder(folder)
    place = folder / record.file if record.file else None
    if place is not None and place.exists() and read_identity(place) is None:
        reason = f"{place}: exists and was not written by geoident; it is not overwritten"
        return replace(
            record, status=FAILED, exit_code=int(ExitCode.OUTPUT), reason=reason, file=""
        )
    for name, content in answer.files.items():
        with atomic_output(folder / name, overwrite=True, inputs=inputs) as temporary:
            Path(temporary).write_bytes(content)
            if place is not None and name == place.name and _replaces_other(place, temporary):
                set_aside(place)
    if place is not None:
        checkpoint = place.with_suffix(".checkpoint")
        if checkpoint.name not in answer.files:
            checkpoint.unlink(missing_ok=True)
    return record


def _replaces_other(place: Path, coming: str) -> bool:
    """Whether a result would replace one of other input, which a command here would keep."""
    old, new = read_identity(place), read_identity(coming)
    if old is None or new is None or new.kind not in ("fit", "scan"):
        return False
    return old.identity != new.identity
