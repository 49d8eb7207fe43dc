"""``geoident batch``: the runs of a campaign, computed, kept as they end, and put in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from geoident.errors import ExitCode, LostCluster
from geoident.io.result.campaign import RunJournal
from geoident.model.cluster import Cluster
from geoident.model.results.many.campaign import INTERRUPTED, SET_ASIDE, CampaignTable, RunRecord
from geoident.workflow.campaign.one_run import RunTask, set_up, without_result
from geoident.workflow.campaign.plan import CampaignPlan, PlannedRun
from geoident.workflow.campaign.runs import table_of, write_tables
from geoident.workflow.executing.executor import Answered, Executor, usable_cores
from geoident.workflow.executing.processes import LocalProcesses

RunExecutor = Executor[RunTask, RunRecord]


def local_executor(plan: CampaignPlan, jobs: int) -> LocalProcesses[RunTask, RunRecord]:
    """Processes of this machine for the runs of a campaign.

    Args:
        plan: of the campaign.
        jobs: number of processes at most.
    """
    campaign = plan.campaign
    return LocalProcesses(
        max(1, min(jobs, len(plan.remaining))),
        set_up,
        time_limit=campaign.time_limit,
        retries=campaign.retries,
    )


@contextmanager
def run_executor(
    plan: CampaignPlan, where: Cluster | None, jobs: int | None, tell: Callable[[str], None]
) -> Iterator[tuple[RunExecutor, Callable[[], int]]]:
    """What computes the runs of a campaign, and how many at a time.

    Args:
        plan: of the campaign.
        where: a cluster; None for processes of this machine.
        jobs: number of processes here, at most; None for the cores there are.
        tell: is told what people should know.

    Raises:
        InputError: nobody answers there, or workers cannot compute for us.
    """
    at_once = jobs or usable_cores()
    if where is None or not plan.remaining:
        with local_executor(plan, at_once) as processes:
            yield processes, lambda: at_once
        return
    # dask is imported when a cluster is asked for
    from geoident.workflow.campaign.away import AwayRuns, cluster_executor  # noqa: PLC0415

    with cluster_executor(plan, where, at_once, tell) as cluster:
        yield AwayRuns(cluster, plan), lambda: cluster.workers


def compute(
    plan: CampaignPlan,
    executor: RunExecutor,
    watch: Callable[[RunRecord], None],
    csv: Callable[[CampaignTable], str],
    *,
    fresh: bool = False,
    trust: bool = False,
    permitted: tuple[str, ...] = (),
) -> CampaignTable:
    """Compute the runs that are not known, and write the tables of all.

    Each run is kept when it ends, so that the same command goes on after any interruption.

    Args:
        plan: of the campaign.
        executor: computes the runs.
        watch: is told of each run that has ended.
        csv: makes the text of ``runs.csv``.
        fresh: what is known of a run does not count.
        trust: what a case names as its model may be run, whatever varies.
        permitted: `Execution.portable` of what may be run in any case.

    Raises:
        OutputError: something cannot be written.
        LostCluster: the cluster has gone; the tables have what had ended.
    """
    if plan.settled:
        return table_of(plan.head, [plan.known[run.name] for run in plan.runs])
    ended, left = dict(plan.known), plan.remaining
    bare = replace(plan.campaign, runs=(), sampling=None, cluster=None)  # sent with every run
    tasks = [RunTask(bare, plan.folder, run, fresh, trust, permitted) for run in left]
    if fresh:  # forgotten once: a run that is begun again goes on from its own
        for task in tasks:
            task.checkpoint.unlink(missing_ok=True)
    with RunJournal(plan.folder, plan.head, tuple(plan.known.values())) as journal:
        lost: LostCluster | None = None
        try:
            for answer in executor.run(tasks):
                record = _record_of(answer, left[answer.number])
                if not (answer.stopped and not answer.seconds):  # it was never begun
                    journal.add(record)
                    ended[record.name] = record
                    watch(record)
        except LostCluster as error:
            lost = error
        records = [ended[run.name] for run in plan.runs if run.name in ended]
        table = table_of(plan.head, records)
        write_tables(table, plan.folder, csv, inputs=plan.inputs)
    if lost is not None:
        raise lost
    return table


def _record_of(answer: Answered[RunRecord], run: PlannedRun) -> RunRecord:
    """The record of a run, also of one whose processes were lost."""
    if answer.value is not None:
        return replace(answer.value, losses=answer.losses)
    if answer.stopped:
        record = without_result(run, INTERRUPTED, ExitCode.TERMINATED, "cut short")
    else:
        record = without_result(run, SET_ASIDE, ExitCode.BUG, answer.why_set_aside)
    return replace(record, seconds=answer.seconds, losses=answer.losses)
