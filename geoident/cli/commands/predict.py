"""``geoident predict``."""

from __future__ import annotations

from typing import Any

import click

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Arguments, Options, Steps, asks_safety, on_result, result_of, takes

EPILOG = """\b
Examples:
  geoident predict case.fit.h5
  geoident predict case.fit.h5 --stages "bench 3,bench 4"
  geoident predict case.fit.h5 --case other-layout.yaml -o other.predict.h5
  geoident predict case.fit.h5 --safety --at "bench 3"
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    kind = "safety" if arguments["safety"] else "predict"
    return on_result(result_of(kind, arguments["result"], options))


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
@click.option(
    "--draws",
    type=click.IntRange(min=8),
    metavar="N",
    help="Draws of the posterior at which --safety computes the factor.  [default: 30]",
)
@takes("output", "jobs", "overrides", "solver", "force", "fresh", "as_json", "trust", after=_next)
@asks_safety
def command(
    result: str,
    stages: str | None,
    case: str | None,
    safety: tuple[str, ...] | None,
    draws: int | None,
    options: Options,
) -> int:
    """Predict readings, with 95 % bands, from a fit.

    The case is that of the fit unless --case gives another one; --set applies to the latter. Writes
    RESULT.predict.h5 and prints its path. With --safety it writes RESULT.safety.h5 and prints what
    it found.
    """
    from geoident.cli.jobs import request_of, run_prediction
    from geoident.workflow.predict import PredictRequest

    if safety is not None:
        given: dict[str, Any] = {"--stages": stages, "--case": case, "--set": options.overrides}
        return _safety(result, safety, draws, given, options)
    alone = {"--draws": draws, "-j": options.jobs}
    if named := [name for name, value in alone.items() if value]:
        raise click.UsageError(f"{named[0]} needs --safety")
    if options.overrides and case is None:
        raise click.UsageError("--set needs --case: the case of a fit is what it was.")
    with failures_as_json(case or result, options):
        chosen = tuple(name.strip() for name in stages.split(",")) if stages else ()
        return run_prediction(PredictRequest(request_of(result, options), chosen, case), options)


def _safety(
    result: str,
    stages: tuple[str, ...],
    draws: int | None,
    others: dict[str, Any],
    options: Options,
) -> int:
    """Factors of safety and their bands in place of readings."""
    from geoident.cli.jobs import request_of
    from geoident.cli.safety import say_safety
    from geoident.workflow.safety import DRAWS, SafetyRequest, safety_of_fit

    if named := [name for name, value in others.items() if value]:
        raise click.UsageError(f"{named[0]} does not go with --safety")
    with failures_as_json(result, options):
        asked = SafetyRequest(request_of(result, options), stages, draws=draws or DRAWS)
        return say_safety(asked, safety_of_fit, options)
