"""``geoident check``."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import click

from geoident.cli.options import Options, takes
from geoident.cli.several import each, failures_as_json

EPILOG = """\b
Examples:
  geoident check case.yaml
  geoident check cases/*.yaml -q
  geoident check case.yaml --set mesh.file=fine.msh --json
  geoident check case.yaml --identifiability
"""


@click.command(epilog=EPILOG)
@click.argument("cases", nargs=-1, required=True, metavar="CASE...", type=click.Path())
@click.option(
    "--identifiability",
    is_flag=True,
    help="Compute what the planned gauges can determine; readings need not exist.",
)
@takes("overrides", "solver", "as_json")
def command(cases: tuple[str, ...], identifiability: bool, options: Options) -> int:
    """Tell everything that is wrong with a case, before computing.

    Prints what the case amounts to: groups, stages, gauges, and which readings are used. With
    --identifiability it solves the model once, at the start values, and prints to what 95 %
    interval each parameter could be known if every gauge were read at every stage of the fit, and
    what no reading would tell apart.
    """
    run = _identifiability if identifiability else _check
    return each(cases, lambda case: run(case, options))


def _identifiability(case: str, options: Options) -> int:
    from geoident.report.json import dumps, plan_object
    from geoident.report.text import plan_text
    from geoident.workflow.identifiability import identifiability

    with failures_as_json(case, options):
        plan = identifiability(case, overrides=options.overrides, solver=options.solver)
    if options.as_json:
        click.echo(dumps(plan_object(case, plan)))
    elif not options.quiet:
        click.echo(plan_text(case, plan))
    return 0


def _check(case: str, options: Options) -> int:
    from geoident.report.check_text import summary_text
    from geoident.report.json import dumps, summary_object
    from geoident.workflow.check import check

    with failures_as_json(case, options):
        checked = check(case, overrides=options.overrides, solver=options.solver)
    if options.as_json:
        click.echo(dumps(summary_object(checked.summary)))
    elif not options.quiet:
        click.echo(summary_text(checked.summary))
    return 0
