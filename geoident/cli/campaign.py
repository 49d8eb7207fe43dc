"""Running a campaign: what is said of its runs while they are computed, and at the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import click

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Options
from geoident.cli.signals import stop_runs_on_signals
from geoident.cli.terminal import Terminal
from geoident.errors import ExitCode
from geoident.io.result.campaign import record_object
from geoident.model.results.many.campaign import RunRecord
from geoident.report.text.campaign.spreadsheet import runs_csv
from geoident.report.text.campaign.tables import failed_table, outcome_sentences, seconds_text
from geoident.report.text.json import dumps
from geoident.workflow.campaign.campaign import compute, run_executor
from geoident.workflow.campaign.plan import CampaignPlan, cluster_of, plan_campaign, require_trust

_NAMED = 3
"""Failed runs that the live line names: the last ones."""


@dataclass
class Progress:
    """Tells of runs as they end: a live line, a line of each failed one, objects for programs.

    Args:
        options: of the command.
        terminal: where to.
        remaining: number of runs to be computed.
        at_a_time: how many are computed at a time.
    """

    options: Options
    terminal: Terminal
    remaining: int
    at_a_time: Callable[[], int]
    ended: int = 0
    failed: list[str] = field(default_factory=list)
    slowest: RunRecord | None = None

    def __call__(self, record: RunRecord) -> None:
        """Tell of a run that has ended."""
        self.ended += 1
        if self.slowest is None or record.seconds > self.slowest.seconds:
            self.slowest = record
        if self.options.as_json:
            click.echo(dumps(record_object(record)))
        if not record.finished:
            self.failed.append(record.name)
            reason = (record.reason.splitlines() or [""])[0]
            self.terminal.inform(f"{record.name}: {record.status}: {reason}")
        failed = f"{len(self.failed)} failed"
        if self.failed:
            more = "..., " if len(self.failed) > _NAMED else ""
            failed += f" ({more}{', '.join(self.failed[-_NAMED:])})"
        running = min(self.at_a_time(), self.remaining - self.ended)
        words = (
            f"{self.ended} of {self.remaining} runs ended, {failed}, {running} running, "
            f"slowest {self.slowest.name} ({seconds_text(self.slowest.seconds)})"
        )
        self.terminal.part(words, self.ended / self.remaining)


def run_campaign(
    path: str, options: Options, *, jobs: int | None, cluster: str | None = None
) -> int:
    """Compute a campaign and say what came out.

    Args:
        path: of its file.
        options: of the command.
        jobs: number of processes; None for the cores there are.
        cluster: address, ``local`` or file of a cluster in place of that of the campaign; None for
            none.

    Returns:
        The exit code: 7 if some runs have failed.
    """
    terminal = Terminal(options)
    with failures_as_json(path, options):
        plan = plan_campaign(path, output=options.output, fresh=options.fresh, force=options.force)
        if options.dry_run:
            return _say_plan(plan, options)
        where = cluster_of(plan, cluster)
        permitted = require_trust(plan)
        if options.as_json:
            for run in plan.runs:
                if run.name in plan.known:
                    click.echo(dumps(record_object(plan.known[run.name])))
        count = len(plan.remaining)
        with (
            run_executor(plan, where, jobs, terminal.inform) as (executor, at_a_time),
            terminal.live(f"{count} runs"),
            stop_runs_on_signals(executor) as log,
        ):
            table = compute(
                plan, executor, Progress(options, terminal, count, at_a_time), runs_csv,
                fresh=options.fresh, trust=options.trust, permitted=permitted,
            )  # fmt: skip
    known = len(plan.known)
    terminal.inform(f"{len(table.runs) - known} runs computed, {known} up to date.")
    for text in outcome_sentences(table):
        terminal.inform(text)
    if table.failed:
        terminal.inform(f"\n{failed_table(table).text}")
    if not options.as_json:
        click.echo(plan.folder)
    return int(log.code or table.exit_code)


def _say_plan(plan: CampaignPlan, options: Options) -> int:
    """What would be computed; nothing is written."""
    remaining = {run.name for run in plan.remaining}
    if options.as_json:
        for run in plan.runs:
            given = {"name": run.name, "settings": dict(run.varied), "seed": run.seed}
            click.echo(dumps({**given, "up_to_date": run.name not in remaining}))
        return ExitCode.DONE
    click.echo(f"{len(plan.runs)} runs of {plan.campaign.command}, {len(remaining)} to be computed")
    varied = f"What varies: {', '.join(plan.paths)}" if plan.paths else "Nothing varies"
    click.echo(varied)
    for run in plan.runs:
        words = " ".join(f"{path}={value}" for path, value in run.varied if value)
        click.echo(f"{run.name}  {words}{'' if run.name in remaining else '  (up to date)'}")
    click.echo(f"\nWould write {plan.folder}")
    return ExitCode.DONE
