"""``geoident diff``.

Its exit codes are those of ``diff`` and ``cmp``: 1 says that the results differ. What is wrong
otherwise has the codes of the other commands, and a bug, which they call 1, is 70 here (EX_SOFTWARE
of sysexits.h), so that a script can never take a bug for a difference.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from geoident.cli.error_boundary import code_of, failures_as_json
from geoident.cli.options import Options, always, takes
from geoident.errors import ExitCode

if TYPE_CHECKING:
    from geoident.model.results.comparison import Tolerance

DIFFERENT = 1
BUG = 70

EPILOG = """\b
Examples:
  geoident diff case.fit.h5 simplex.h5
  geoident diff old.fit.h5 new.fit.h5 --rtol 0.01 --atol 0.01mm --atol 1kPa
  geoident diff -q old.fit.h5 new.fit.h5 && echo the same

\b
Exit codes: 0 the same, 1 different, 70 a bug, others as for all commands.
"""


@click.command(epilog=EPILOG)
@click.argument("first", metavar="A")
@click.argument("second", metavar="B")
@click.option(
    "--rtol",
    type=click.FloatRange(min=0.0),
    default=1e-6,
    show_default=True,
    help="Numbers may differ by this share of the larger one.",
)
@click.option(
    "--atol",
    "absolute",
    multiple=True,
    metavar="QUANTITY",
    help="Or by this much, such as 0.01mm or 1kPa, for numbers of that kind; may be repeated.",
)
@takes("as_json", after=always("geoident report A B   # both on one page"))
def command(
    first: str, second: str, rtol: float, absolute: tuple[str, ...], options: Options
) -> int:
    """Compare two results: parameters, readings, predictions, objective.

    Prints what differs and by how much. What only one of the results has counts as a difference.
    """
    try:
        return _diff(first, second, _tolerance(rtol, absolute), options)
    except Exception as error:
        code = code_of(error)
        return BUG if code == ExitCode.BUG else code


def _tolerance(rtol: float, absolute: tuple[str, ...]) -> Tolerance:
    from geoident.model.results.comparison import Tolerance
    from geoident.units import UnitError, read_quantity

    try:
        quantities = [read_quantity(text) for text in absolute]
    except UnitError as error:
        raise click.BadParameter(str(error), param_hint="--atol") from error
    if any(quantity.value < 0 for quantity in quantities):
        raise click.BadParameter("a tolerance is not negative", param_hint="--atol")
    return Tolerance(rtol, {quantity.dimension: quantity.value for quantity in quantities})


def _diff(first: str, second: str, tolerance: Tolerance, options: Options) -> int:
    from geoident.report.text.comparison import comparison_object, comparison_text
    from geoident.report.text.json import dumps
    from geoident.workflow.diff import diff

    with failures_as_json(f"{first} {second}", options):
        comparison = diff(first, second, tolerance)
    if options.as_json:
        click.echo(dumps(comparison_object(comparison)))
    elif not options.quiet:
        click.echo(comparison_text(comparison))
    return 0 if comparison.same else DIFFERENT
