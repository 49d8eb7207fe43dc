"""``geoident sample``."""

from __future__ import annotations

import click

from geoident.cli.clusters import cluster_option
from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Arguments, Options, Steps, line, on_result, result_of, takes

EPILOG = """\b
Examples:
  geoident sample case.fit.h5
  geoident sample case.fit.h5 -n 2000 --effective 500 --max-time 2h -j 4
  geoident export case.sample.h5 --table draws > draws.csv

\b
In Python:  arviz.from_netcdf("case.sample.h5")
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    path = result_of("sample", arguments["result"], options)
    return (*on_result(path), line("export", path, "--table", "draws"))


@click.command(epilog=EPILOG)
@click.argument("result", metavar="RESULT", type=click.Path())
@click.option(
    "-n", "--draws", type=click.IntRange(min=100), default=10_000, show_default=True,
    help="Number of draws to write.",
)  # fmt: skip
@click.option(
    "--effective", type=click.IntRange(min=100), default=1000, show_default=True, metavar="N",
    help="Target effective sample size.",
)  # fmt: skip
@click.option(
    "--max-evaluations", type=click.IntRange(min=100), default=50_000, show_default=True,
    metavar="N", help="Evaluations of the model at most.",
)  # fmt: skip
@cluster_option
@takes(
    "output", "jobs", "seed", "max_time", "solver", "force", "fresh", "as_json", "trust",
    after=_next,
)  # fmt: skip
def command(
    result: str,
    draws: int,
    effective: int,
    max_evaluations: int,
    cluster: str | None,
    options: Options,
) -> int:
    """Draw parameters from their posterior, and predict readings with each draw.

    The posterior is exp(-misfit/2) times the priors within the bounds, with the accuracies and
    shared errors of the fit. Without a prior a parameter of scale log is flat in its logarithm, one
    of scale linear in its value, between its bounds: where the readings do not determine it, the
    bounds do. Every evaluation computes the model, or a reduced one where that is estimated to be
    as good; the effective sample size shows how many independent draws they are worth. Samplers,
    from cheap to robust: importance sampling from the normal approximation at the fit, the same
    from proposals adapted to the draws, an affine-invariant ensemble; preconditioned Crank-Nicolson
    steps for fields and many parameters.

    Writes CASE.sample.h5, which `arviz.from_netcdf` opens, and prints its path.

    Needs emcee and arviz: pip install "geoident[sample]".
    """
    from geoident.cli.jobs import request_of, run_sample
    from geoident.workflow.sample import SampleRequest

    with failures_as_json(result, options):
        request = request_of(result, options)
        asked = SampleRequest(request, draws, effective, max_evaluations)
        return run_sample(asked, options, cluster=cluster)
