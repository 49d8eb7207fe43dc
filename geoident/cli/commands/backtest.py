"""``geoident backtest``."""

from __future__ import annotations

import click

from geoident.cli.clusters import cluster_option
from geoident.cli.options import (
    Arguments,
    Options,
    Steps,
    for_one,
    line,
    on_result,
    overrides,
    result_of,
    takes,
)

EPILOG = """\b
Examples:
  geoident backtest case.yaml
  geoident backtest case.yaml --max-time 10min --json | jq .backtest.next
  geoident backtest -j 2 cases/*.yaml -o results/
  geoident report case.backtest.h5

\b
Exit codes: 0 done and the bands hold, 4 finished, but the bands do not hold
or a fit has not converged (see the reason), others as for all.
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    def steps(case: str) -> Steps:
        if options.dry_run:
            return (line("backtest", case, *overrides(options)),)
        return on_result(result_of("backtest", case, options))

    return for_one(arguments["cases"], steps)


@click.command(epilog=EPILOG)
@click.argument("cases", nargs=-1, required=True, metavar="CASE...", type=click.Path())
@cluster_option
@takes(
    "output", "jobs", "overrides", "seed", "max_time", "solver",
    "dry_run", "force", "fresh", "as_json", "trust",
    after=_next,
)  # fmt: skip
def command(cases: tuple[str, ...], cluster: str | None, options: Options) -> int:
    """Test predictions on stages that were read: do the bands hold?

    Fits the readings up to every stage, predicts the later ones, and compares: parameters as
    readings are added, coverage and width of the 95 % bands, standardized errors. Readings of
    stages after the last one of fit.stages count too. Writes CASE.backtest.h5 beside each case and
    prints its path. An interrupted run continues from CASE.backtest.checkpoint.
    """
    if len(cases) > 1:
        from geoident.cli.several import run_cases

        return run_cases("backtest", cases, options, cluster=cluster)
    from geoident.cli.jobs import run_case
    from geoident.workflow.backtest import backtest
    from geoident.workflow.running.jobs import plan_backtest

    return run_case(cases[0], options, plan=plan_backtest, run=backtest, cluster=cluster)
