"""``geoident report``."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import click

from geoident.cli.options import Options, takes
from geoident.errors import UsageError

EPILOG = """\b
Examples:
  geoident report case.fit.h5 --figures figures
  geoident report case.fit.h5 --figures . --format png --force
"""


@click.command(epilog=EPILOG)
@click.argument("result", metavar="RESULT")
@click.option("--figures", "folder", metavar="DIR", required=True, help="Folder for the figures.")
@click.option(
    "--format",
    "suffix",
    type=click.Choice(["svg", "png", "pdf"]),
    default="svg",
    show_default=True,
    help="Format of the figures.",
)
@takes("force")
def command(result: str, folder: str, suffix: str, options: Options) -> int:
    """Draw a result: displacements around the gauges, readings measured, computed and predicted.

    Writes DIR/overview.svg and prints its path. Needs matplotlib: pip install "geoident[report]".
    """
    from functools import partial

    from geoident.workflow.report import write_figures

    try:
        from geoident.report.figures import FIGURES, save_figures
    except ModuleNotFoundError as error:
        if error.name != "matplotlib":
            raise
        msg = 'figures need matplotlib: pip install "geoident[report]"'
        raise UsageError(msg) from error
    outputs = write_figures(
        result,
        names=tuple(FIGURES),
        folder=folder,
        suffix=suffix,
        overwrite=options.force,
        save=partial(save_figures, suffix=suffix),
    )
    for output in outputs:
        click.echo(output)
    return 0
