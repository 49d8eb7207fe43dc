"""``geoident compare``."""

from __future__ import annotations

import click

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Options, always, takes

EPILOG = """\b
Examples:
  geoident compare isotropic.fit.h5 strata.fit.h5
  geoident compare *.fit.h5 --json | jq .chosen
  geoident compare one-K0.fit.h5 two-K0.fit.h5

\b
Exit codes: 0 compared (also where the readings do not decide), others as
for all commands: 3 for fits of different readings.
"""


@click.command(epilog=EPILOG)
@click.argument("results", nargs=-1, required=True, metavar="RESULT...", type=click.Path())
@takes("as_json", after=always("geoident report RESULT   # of the model that is preferred"))
def command(results: tuple[str, ...], options: Options) -> int:
    """Show which of several models the readings support.

    Compares fits of the same readings by the evidence of their models, which a parameter that is
    not needed lowers, and by the backtest of the last fitted stage. A richer model is preferred
    only where the readings clearly support it. `fit.ladder` of a case does all fits at once.
    """
    from geoident.report.text.json import dumps
    from geoident.report.text.rivals import models_object, models_text
    from geoident.workflow.compare import compare

    if len(results) < 2:
        raise click.UsageError("Two results at least are needed.")
    with failures_as_json(" ".join(results), options):
        comparison = compare(results)
    if options.as_json:
        click.echo(dumps(models_object(comparison)))
    elif not options.quiet:
        click.echo(models_text(comparison))
    return 0
