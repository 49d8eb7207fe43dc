"""``geoident update``."""

from __future__ import annotations

import click

from geoident.cli.options import Arguments, Options, Steps, on_fit, result_of, takes

EPILOG = """\b
Examples:
  geoident update case.yaml
  geoident update case.fit.h5 --json
  geoident update case.yaml -q || echo look | mail me@example.org
  geoident show case.fit.h5 --as-of 2025-03-21
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    path = arguments["path"]
    if not path.endswith(".h5"):
        path = result_of("fit", path, options)
    return on_fit(path)


@click.command(epilog=EPILOG)
@click.argument("path", metavar="CASE|RESULT", type=click.Path())
@takes(
    "output", "jobs", "overrides", "max_time", "solver", "as_json", "trust", after=_next
)  # fmt: skip
def command(path: str, options: Options) -> int:
    """Judge new readings by the last fit, then fit them in.

    New readings are those in the files of the case that the last fit has not used. They are held
    against what it had predicted of them, each gauge by itself and all together; then the search
    goes on from its answer. The new result takes its place and keeps the history of all updates.
    Without new readings the result stays as it is.
    Readings that do not belong to the model, or reach an alarm value, end with exit code 8.
    """
    from geoident.cli.error_boundary import failures_as_json
    from geoident.cli.jobs import run_update
    from geoident.workflow.updating.update import UpdateRequest

    with failures_as_json(path, options):
        request = UpdateRequest(
            path=path, overrides=options.overrides, output=options.output, solver=options.solver
        )
        return run_update(request, options)
