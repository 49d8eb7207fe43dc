"""Campaigns from Python: one case in many variations, and all runs in one table."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from geoident.api.calling import AnyPath, processes, spoken
from geoident.api.results import ResultFile, read_result
from geoident.api.tables import ResultTable
from geoident.io.text.wording import did_you_mean
from geoident.model.results.many.campaign import CampaignTable, RunRecord
from geoident.report.text.campaign.spreadsheet import runs_columns, runs_csv
from geoident.report.text.campaign.tables import campaign_text
from geoident.workflow.campaign.campaign import compute, run_executor
from geoident.workflow.campaign.plan import cluster_of, plan_campaign, require_trust
from geoident.workflow.programs.trust import decided_by, trusting

RunWatch = Callable[[RunRecord], None]
"""Is told of every run that ends."""


@dataclass(frozen=True, repr=False)
class CampaignResult(Mapping[str, ResultFile]):
    """All runs of a campaign; by the name of a run that has a result, that result.

    Args:
        data: the runs that have ended: what varied, how each ended, parameters, costs, SI.
        path: of the folder with the results.
        up_to_date: how many runs stood there already and were not computed again.
    """

    data: CampaignTable
    path: str
    up_to_date: int = 0

    @property
    def complete(self) -> bool:
        """Whether all runs have a result; `failed` says which have none."""
        return len(self) == self.data.total

    @property
    def failed(self) -> Mapping[str, str]:
        """Name to reason of the runs without a result."""
        return {run.name: run.reason for run in self.data.failed}

    @cached_property
    def runs(self) -> ResultTable:
        """One row a run, in the units of the case: what ``runs.csv`` holds."""
        columns = runs_columns(self.data)
        return ResultTable(columns.header, columns.rows)

    def __getitem__(self, name: str) -> ResultFile:
        files = self._files
        if name not in files:
            raise KeyError(f"no run '{name}' has a result. {did_you_mean(name, files)}".strip())
        return read_result(Path(self.path) / files[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)

    @property
    def _files(self) -> dict[str, str]:
        return {run.name: run.file for run in self.data.runs if run.finished}

    def __str__(self) -> str:
        return campaign_text(self.data, title=self.path)

    def __repr__(self) -> str:
        text = f"{self.data.command}: {len(self)} of {self.data.total} runs with a result"
        return f"CampaignResult({Path(self.path).as_posix()}: {text})"

    def _repr_html_(self) -> str:
        return self.runs._repr_html_()


@spoken
def batch(
    campaign: AnyPath,
    *,
    output: AnyPath | None = None,
    jobs: int | None = None,
    cluster: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
    trust: bool = False,
    progress: RunWatch | None = None,
) -> CampaignResult:
    """Compute many variations of one case, in processes of their own.

    Runs that are up to date are not computed again; a call that is interrupted goes on by the same
    call. A run that fails does not end the campaign: see `CampaignResult.failed`.

    Args:
        campaign: path of the file that says what varies.
        output: folder for the results; ``CAMPAIGN.batch`` beside the file if None.
        jobs: how many runs at a time; None for the cores there are.
        cluster: in place of processes of this machine: address of a scheduler of dask, ``local``,
            or the path of a cluster file; None for that of the campaign, if it names one.
        force: use a folder that holds something else.
        fresh: compute again what is up to date.
        trust: the program or function that the case names as its model may be run, and what the
            campaign or a cluster file gives to a scheduler or a queue system; remembered.
        progress: is told of every run that ends.

    Raises:
        InputError: the campaign, its table or the case is wrong, or nobody has said that what the
            case names may be run; with all faults. Or there is no such cluster.
        OutputError: the folder is of something else, or cannot be written.
        UsageError: there is no such number of processes.
    """
    place, at_once = None if output is None else os.fspath(output), processes(jobs)
    with decided_by(trusting(trust=trust)):
        plan = plan_campaign(os.fspath(campaign), output=place, fresh=fresh, force=force)
        where = cluster_of(plan, None if cluster is None else os.fspath(cluster))
        permitted = require_trust(plan)
    watch = progress or (lambda record: None)
    with run_executor(plan, where, at_once, lambda message: None) as (executor, _):
        table = compute(
            plan, executor, watch, runs_csv, fresh=fresh, trust=trust, permitted=permitted
        )
    return CampaignResult(table, str(plan.folder), len(plan.known))
