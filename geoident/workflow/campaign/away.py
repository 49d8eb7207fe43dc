"""Runs of a campaign on other machines: what a run reads travels there, its files come back.

There everything lies as it does here, so that a result is the same as if it had been made here.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from geoident.errors import ExitCode, Fault, InputError, Location
from geoident.io.case.file import named_files
from geoident.io.result.file import read_identity
from geoident.io.text.atomic import atomic_output, make_folder
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
from geoident.model.cluster import Cluster
from geoident.model.results.campaign import FAILED, RunRecord
from geoident.workflow.campaign.one_run import RunTask, compute
from geoident.workflow.campaign.plan import CampaignPlan
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import Answered, Executor
from geoident.workflow.executing.parcel import layout_of, own_copy, packed, relative
from geoident.workflow.running.outputs import set_aside


@dataclass(frozen=True)
class AwayTask:
    """What a process far away is told of a run.

    Args:
        task: the run; its paths are relative.
        kept: name to content of files in the folder of results with which it goes on.
    """

    task: RunTask
    kept: Mapping[str, bytes]


@dataclass(frozen=True)
class AwayEnd:
    """How a run has ended far away.

    Args:
        record: of the run.
        files: name to content of what it has left in the folder of results.
    """

    record: RunRecord
    files: Mapping[str, bytes]


class AwayRuns:
    """An executor of runs that has them computed by another one, and writes what comes back.

    Args:
        executor: computes on other machines.
        plan: of the campaign.
    """

    def __init__(self, executor: Executor[AwayTask, AwayEnd], plan: CampaignPlan) -> None:
        self._executor = executor
        self._plan = plan

    def run(self, tasks: Iterable[RunTask]) -> Iterator[Answered[RunRecord]]:
        """The records as the runs end; their files are written then.

        Args:
            tasks: the runs.

        Raises:
            OutputError: a result cannot be written.
        """
        folder = self._plan.folder
        for answer in self._executor.run(map(_sent, tasks)):
            end = answer.value
            record = None if end is None else _kept(end, folder, self._plan.inputs)
            yield Answered(
                answer.number, record, answer.losses, answer.stopped, answer.seconds, answer.process
            )

    def ask_to_stop(self) -> None:
        """Begin no more runs, and let those that run end as soon as they can."""
        self._executor.ask_to_stop()

    def kill(self) -> None:
        """End all runs at once."""
        self._executor.kill()


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
    _require_relative(campaign.case)
    layout = layout_of((*plan.inputs, plan.folder))
    return DaskCluster(
        cluster,
        partial(set_up_away, layout.here),
        packed({layout.name(path): Path(path) for path in plan.inputs}),
        jobs=max(1, min(jobs, len(plan.left))),
        time_limit=campaign.time_limit,
        retries=campaign.retries,
        tell=tell,
    )


def _require_relative(case: str) -> None:
    """Refuse a case that names a file by its place on this machine.

    Raises:
        InputError: it does.
    """
    folder = Path(relative(str(Path(case).parent)))
    text = decode(read_bytes(case, limit=MAX_BYTES, what="case"), case)
    hint = "Name it as seen from the folder of the case."
    faults = [
        Fault("absolute-path", f"'{name}' is not in this place on a cluster", hint, Location(case))
        for name in named_files(parse_yaml(text, case).data, folder)
        if Path(name).is_absolute()
    ]
    if faults:
        raise InputError(faults)


def _sent(task: RunTask) -> AwayTask:
    """A run as it travels, with the evaluations that an interrupted one has left."""
    campaign = task.campaign
    there = replace(
        campaign,
        path=relative(campaign.path),
        case=relative(campaign.case),
        result=relative(campaign.result) if campaign.result else "",
    )
    folder = Path(relative(str(task.folder)))
    kept = {}
    checkpoint = task.folder / f"{task.run.name}.{campaign.command}.checkpoint"
    with suppress(OSError):
        if not task.fresh:
            kept[checkpoint.name] = checkpoint.read_bytes()
    return AwayTask(replace(task, campaign=there, folder=folder), kept)


def set_up_away(here: str, unpacked: Path) -> Callable[[AwayTask], AwayEnd]:
    """What a process does with its tasks, in a copy of the files of its own.

    Args:
        here: where paths are meant from, as seen from the folder of the files.
        unpacked: that folder.
    """
    own_copy(unpacked, here)
    return compute_away


def compute_away(away: AwayTask) -> AwayEnd:
    """Run one variation, and take what it leaves."""
    folder = away.task.folder
    make_folder(folder)
    for name, content in away.kept.items():
        (folder / name).write_bytes(content)
    record = compute(away.task)
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}
    shutil.rmtree(folder, ignore_errors=True)
    return AwayEnd(record, files)


def _kept(end: AwayEnd, folder: Path, inputs: Iterable[str]) -> RunRecord:
    """Write what a run has left.

    Raises:
        OutputError: it cannot be written.
    """
    record = end.record
    make_folder(folder)
    place = folder / record.file if record.file else None
    if place is not None and place.exists() and read_identity(place) is None:
        reason = f"{place}: exists and is no result of geoident; it is not overwritten"
        return replace(
            record, status=FAILED, exit_code=int(ExitCode.OUTPUT), reason=reason, file=""
        )
    for name, content in end.files.items():
        with atomic_output(folder / name, overwrite=True, inputs=inputs) as temporary:
            Path(temporary).write_bytes(content)
            if place is not None and name == place.name:
                _set_other_aside(place, temporary)
    if place is not None:
        checkpoint = place.with_name(place.name.removesuffix(".h5") + ".checkpoint")
        if checkpoint.name not in end.files:
            checkpoint.unlink(missing_ok=True)
    return record


def _set_other_aside(place: Path, coming: str) -> None:
    """Keep a result of other input that is about to be replaced, as if it were computed here."""
    old, new = read_identity(place), read_identity(coming)
    if old is None or new is None or new.kind not in ("fit", "scan"):
        return
    if old.identity != new.identity:
        set_aside(place)
