"""``geoident scan``."""

from __future__ import annotations

import click

from geoident.cli.clusters import cluster_option
from geoident.cli.options import Arguments, Options, Steps, line, overrides, result_of, takes

EPILOG = """\b
Examples:
  geoident scan case.yaml
  geoident scan case.yaml --set fit.scan.points=41 -j 8
  geoident scan case.yaml --set "fit.scan.grid.E={from: 5 GPa, to: 9 GPa}"
  geoident scan case.yaml --cluster tcp://node1:8786
  geoident scan case.yaml --reduced case.fit.h5
  geoident scan case.yaml --json | jq .grid
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    case = arguments["case"]
    if options.dry_run:
        return (line("scan", case, *overrides(options)),)
    return line("show", result_of("scan", case, options)), line("fit", case)


@click.command(epilog=EPILOG)
@click.argument("case", metavar="CASE", type=click.Path())
@cluster_option
@takes(
    "output", "jobs", "overrides", "seed", "max_time", "solver", "reduced",
    "dry_run", "force", "fresh", "as_json", "trust",
    after=_next,
)  # fmt: skip
def command(case: str, cluster: str | None, options: Options) -> int:
    """Compute the misfit on a grid of one or two parameters.

    The grid is that of fit.scan in the case, otherwise it spans the bounds of the first one or two
    parameters. Writes CASE.scan.h5 and prints its path.
    """
    from geoident.cli.jobs import run_case
    from geoident.workflow.running.jobs import plan_scan
    from geoident.workflow.scan import scan

    return run_case(case, options, plan=plan_scan, run=scan, cluster=cluster)
