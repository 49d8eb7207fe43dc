"""``geoident plan``."""

from __future__ import annotations

import click

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Arguments, Options, Steps, on_result, result_of, takes

EPILOG = """\b
Examples:
  geoident plan case.yaml --candidates new.yaml --budget 5 --for E_rock
  geoident plan a.fit.h5 --candidates new.yaml --budget 9 --for "CV1 at dig 5"
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    return on_result(result_of("plan", arguments["source"], options))


@click.command(epilog=EPILOG)
@click.argument("source", metavar="CASE|RESULT", type=click.Path())
@click.option(
    "--candidates",
    metavar="FILE",
    type=click.Path(),
    required=True,
    help="Gauges to choose from, written as in a case, each with `cost` (default 1) and `stages` "
    "at which it is read (default all from its zero on).",
)
@click.option(
    "--budget", type=float, required=True, metavar="COST", help="What the gauges may cost together."
)
@click.option(
    "--for",
    "wanted",
    multiple=True,
    required=True,
    metavar="WHAT",
    help="What is to be known: 'CHANNEL at STAGE', 'CHANNEL > VALUE at STAGE' or a parameter; may "
    "be repeated.",
)
@click.option(
    "--draws",
    type=click.IntRange(0, 1000),
    default=4,
    show_default=True,
    metavar="N",
    help="Draws of the parameters at which the plan must be good, too.",
)
@takes("output", "overrides", "seed", "solver", "force", "fresh", "as_json", "trust", after=_next)
def command(
    source: str,
    candidates: str,
    budget: float,
    wanted: tuple[str, ...],
    draws: int,
    options: Options,
) -> int:
    """Choose the gauges that tell most of a prediction, a parameter or a limit.

    Of a case all is known that its priors and bounds say, of the result of a fit what its readings
    have told. The gauges of the case count as read until what is to be known is due, except those
    in fit.predict_gauges. What counts is how far the readings of the chosen gauges let its variance
    fall, with the errors that gauges share and the model error. Prints what each gauge adds, and
    what the loss of any one costs.
    Writes CASE.plan.h5 and prints its path; `geoident report` makes a page with a picture.
    """
    from geoident.cli.jobs import request_of, run_plan
    from geoident.workflow.plan import PlanRequest

    with failures_as_json(source, options):
        request = request_of(source, options)
        return run_plan(PlanRequest(request, candidates, budget, wanted, draws), options)
