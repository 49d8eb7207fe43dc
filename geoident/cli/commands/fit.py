"""``geoident fit``."""

from __future__ import annotations

import click

from geoident.cli.clusters import cluster_option
from geoident.cli.options import (
    Arguments,
    Options,
    Steps,
    for_one,
    line,
    on_fit,
    on_result,
    overrides,
    result_of,
    takes,
)
from geoident.errors import UsageError

EPILOG = """\b
Examples:
  geoident fit case.yaml
  geoident fit case.yaml --set parameters.E_rock.start="20 GPa" -v
  geoident fit case.yaml --max-time 10min --json > fit.json
  geoident fit -j 4 cases/*.yaml -o results/
  cat case.yaml | geoident fit - -o case.fit.h5
  geoident fit project.yaml --leave-one-out
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    def steps(case: str) -> Steps:
        if options.dry_run:
            return (line("fit", case, *overrides(options)),)
        from geoident.io.project.head import is_project

        result = result_of("fit", case, options)
        return on_result(result) if is_project(case) else on_fit(result)

    return for_one(arguments["cases"], steps)


@click.command(epilog=EPILOG)
@click.argument("cases", nargs=-1, required=True, metavar="CASE...", type=click.Path())
@click.option(
    "--leave-one-out", is_flag=True, help="Of a project: predict each section from all others, too."
)
@cluster_option
@takes(
    "output", "jobs", "overrides", "seed", "max_time", "solver",
    "dry_run", "force", "fresh", "as_json", "trust",
    after=_next,
)  # fmt: skip
def command(
    cases: tuple[str, ...], leave_one_out: bool, cluster: str | None, options: Options
) -> int:
    """Identify the parameters from the readings.

    Writes CASE.fit.h5 beside each case and prints its path. A result of the same input is kept. An
    interrupted run leaves CASE.fit.checkpoint, and the same command continues from there.

    In place of a case a project may be given (format: geoident-project/1): several sections of one
    ground, whose parameters are shared or follow laws with scatter. Sections are
    computed in -j processes, or on a cluster.
    """
    from geoident.io.project.head import is_project

    if any(is_project(case) for case in cases):
        if len(cases) > 1:
            raise UsageError("A project is fitted alone: give no other file.")
        from geoident.cli.project import run_project

        return run_project(cases[0], options, leave_one_out=leave_one_out, cluster=cluster)
    if leave_one_out:
        raise UsageError("--leave-one-out needs a project of several sections.")
    if len(cases) > 1:
        from geoident.cli.several import run_cases

        return run_cases("fit", cases, options, cluster=cluster)
    from geoident.cli.jobs import run_case
    from geoident.workflow.fit import fit
    from geoident.workflow.running.jobs import plan_fit

    return run_case(cases[0], options, plan=plan_fit, run=fit, cluster=cluster)
