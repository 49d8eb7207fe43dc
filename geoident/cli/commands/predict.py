"""``geoident predict``."""

from __future__ import annotations

import click

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Arguments, Options, Steps, on_result, result_of, takes

EPILOG = """\b
Examples:
  geoident predict case.fit.h5
  geoident predict case.fit.h5 --stages "bench 3,bench 4"
  geoident predict case.fit.h5 --case other-layout.yaml -o other.predict.h5
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    return on_result(result_of("predict", arguments["result"], options))


@click.command(epilog=EPILOG)
@click.argument("result", metavar="RESULT", type=click.Path())
@click.option(
    "--stages", metavar="A,B", help="Stages to predict; by default those that were not fitted."
)
@click.option(
    "--case",
    metavar="NEW",
    type=click.Path(),
    help="Another case, computed with the parameters of the fit. Its gauges are those of the fit "
    "if it has all readings that the fit has used; if not, it counts as another section.",
)
@takes("output", "overrides", "solver", "force", "fresh", "as_json", "trust", after=_next)
def command(result: str, stages: str | None, case: str | None, options: Options) -> int:
    """Predict readings, with 95 % bands, from a fit.

    The case is that of the fit unless --case gives another one; --set applies to the latter. Writes
    RESULT.predict.h5 and prints its path.
    """
    from geoident.cli.jobs import request_of, run_prediction
    from geoident.workflow.predict import PredictRequest

    if options.overrides and case is None:
        raise click.UsageError("--set needs --case: the case of a fit is what it was.")
    with failures_as_json(case or result, options):
        chosen = tuple(name.strip() for name in stages.split(",")) if stages else ()
        return run_prediction(PredictRequest(request_of(result, options), chosen, case), options)
