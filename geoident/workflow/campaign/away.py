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
from geoident.io.text.named_files import named_files
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
from geoident.model.cluster import Cluster
from geoident.model.external import ExternalProgram, ExternalSource, PythonFunction
from geoident.model.results.many.campaign import FAILED, RunRecord
from geoident.workflow.campaign.one_run import RunTask, checkpoint_of, compute
from geoident.workflow.campaign.plan import CampaignPlan, model_of
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
        task = self.task
        return checkpoint_of(task.campaign, task.folder, task.run).as_posix()


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

        super().__init__(executor, lambda task: _sent(task, runs), kept)


def cluster_executor(
    plan: CampaignPlan,
    cluster: Cluster,
    jobs: int,
    tell: Callable[[str], None],
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
    campaign = plan.campaign
    model = _model(plan)
    ran = model if isinstance(model, ExternalProgram | PythonFunction) else None
    first = ran.command[0] if isinstance(ran, ExternalProgram) else ""
    _require_relative(campaign.case, but=first)
    on_cluster = {first} if ran is None else {first, *model_files(ran)} - set(ran.inputs)
    inputs = [path for path in plan.inputs if path not in on_cluster]
    logs = known_logs([] if ran is None else [Path(_runs_of(plan))])
    return DaskCluster(
        cluster,
        partial(begun_with, logs, set_up_away),
        packed(inputs, beside=[plan.folder], programs=() if ran is None else program_of(ran)),
        jobs=max(1, min(jobs, len(plan.remaining))),
        time_limit=campaign.time_limit,
        retries=campaign.retries,
        tell=tell,
    )


def _model(plan: CampaignPlan) -> ExternalSource | None:
    """The model of the base case where that is elsewhere, with paths as they are there.

    Raises:
        InputError: the case is wrong.
    """
    case = plan.campaign.case
    text = decode(read_bytes(case, limit=MAX_BYTES, what="case"), case)
    campaign = replace(plan.campaign, case=relative(case))
    return model_of(campaign, parse_yaml(text, case).data)


def _runs_of(plan: CampaignPlan) -> str:
    """The folder of the runs of the model; empty where that runs nothing."""
    model = _model(plan)
    if not isinstance(model, ExternalProgram | PythonFunction):
        return ""
    return str(runs_folder(relative(plan.campaign.case)))


def _require_relative(case: str, *, but: str = "") -> None:
    """Refuse a case that names a file by its place on this machine.

    Args:
        case: its path.
        but: a program that may be named so.

    Raises:
        InputError: it does.
    """
    folder = Path(relative(str(Path(case).parent)))
    text = decode(read_bytes(case, limit=MAX_BYTES, what="case"), case)
    hint = "Name it as seen from the folder of the case."
    faults = [
        Fault("absolute-path", f"'{name}' is not in this place on a cluster", hint, Location(case))
        for name in named_files(parse_yaml(text, case).data, folder)
        if Path(name).is_absolute() and name != but
    ]
    if faults:
        raise InputError(faults)


def _sent(task: RunTask, runs: str) -> AwayTask:
    """A run as it travels, with the evaluations that an interrupted one has left."""
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
            if place is not None and name == place.name:
                _set_other_aside(place, temporary)
    if place is not None:
        checkpoint = place.with_name(place.name.removesuffix(".h5") + ".checkpoint")
        if checkpoint.name not in answer.files:
            checkpoint.unlink(missing_ok=True)
    return record


def _set_other_aside(place: Path, coming: str) -> None:
    """Keep a result of other input that is about to be replaced, as if it were computed here."""
    old, new = read_identity(place), read_identity(coming)
    if old is None or new is None or new.kind not in ("fit", "scan"):
        return
    if old.identity != new.identity:
        set_aside(place)
