"""``geoident batch``."""

from __future__ import annotations

import click

from geoident.cli.clusters import cluster_option
from geoident.cli.options import Arguments, Options, Steps, line, takes

EPILOG = """\b
Examples:
  geoident batch campaign.yaml
  geoident batch campaign.yaml -j 4 --json > runs.jsonl
  geoident batch campaign.yaml --cluster tcp://node1:8786
  geoident batch campaign.yaml --dry-run
  geoident show campaign.batch
  geoident report campaign.batch

\b
Exit codes: 0 all runs are done, 4 some have finished, but not converged, not
determined or poorly fitted, 7 some have failed, others as for all.
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    from geoident.workflow.campaign.plan import folder_of

    campaign = arguments["campaign"]
    if options.dry_run:
        return (line("batch", campaign),)
    folder = str(folder_of(campaign, options.output))
    return line("show", folder), line("report", folder)


@click.command(epilog=EPILOG)
@click.argument("campaign", metavar="CAMPAIGN", type=click.Path())
@click.option(
    "-j",
    "--jobs",
    "processes",
    type=click.IntRange(min=1),
    metavar="N",
    help="Number of runs to compute at a time, one process each.  [default: number of cores]",
)
@cluster_option
@takes("output", "dry_run", "force", "fresh", "as_json", "trust", after=_next)
def command(campaign: str, processes: int | None, cluster: str | None, options: Options) -> int:
    """Compute many variations of one case: a campaign.

    A campaign file names a base case, what varies (a table, a product of lists, or a sampling), and
    the command of each run: fit, simulate, predict or scan. Writes into CAMPAIGN.batch one HDF5
    file a run, runs.csv and campaign.h5 with all runs, and prints the path of the folder; with
    --json one line a run as it ends. Runs that are up to date are not computed again. A run whose
    process is lost starts again, and is skipped after three crashes. The same command continues an
    interrupted campaign.
    """
    from geoident.cli.campaign import run_campaign

    return run_campaign(campaign, options, jobs=processes, cluster=cluster)
