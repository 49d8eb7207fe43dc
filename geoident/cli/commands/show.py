"""``geoident show``."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import click

from geoident.cli.options import Options, takes
from geoident.cli.several import each, failures_as_json

EPILOG = """\b
Examples:
  geoident show case.fit.h5
  geoident show results/*.fit.h5 | less
  geoident show case.fit.h5 --json | jq .parameters
"""


@click.command(epilog=EPILOG)
@click.argument("results", nargs=-1, required=True, metavar="RESULT...")
@takes("as_json")
def command(results: tuple[str, ...], options: Options) -> int:
    """Print results: parameters, findings, readings and predictions.

    The text has the units of the case and readings in mm; --json has SI units.
    """
    return each(results, lambda path: _show(path, options))


def _show(path: str, options: Options) -> int:
    from geoident.report.json import dumps, result_object
    from geoident.report.text import result_text
    from geoident.workflow.provenance import case_path
    from geoident.workflow.show import show

    with failures_as_json(path, options):
        result = show(path)
    case = case_path(path, result.provenance.case_file)
    if options.as_json:
        click.echo(dumps(result_object(result, case=case, output=path)))
    else:
        click.echo(result_text(result, title=f"{path}: {result.kind} of {case}") + "\n")
    return 0
