"""``geoident export``."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import click

from geoident.cli.error_boundary import each
from geoident.cli.options import OneOf, Options, always, takes
from geoident.errors import UsageError

if TYPE_CHECKING:
    from geoident.model.results.result import Result

FORMATS = ("csv", "vtu", "vtkhdf")
TABLES = (
    "parameters",
    "gauges",
    "diagnostics",
    "prediction",
    "history",
    "correlation",
    "sensitivity",
    "structures",
    "opening",
    "ground-reaction",
    "opening-stresses",
    "grid",
    "readings",
    "accuracies",
    "posterior",
    "draws",
    "fields",
    "backtest",
    "backtest-parameters",
)

EPILOG = """\b
Examples:
  geoident export case.fit.h5
  geoident export case.fit.h5 --table gauges > gauges.csv
  geoident export case.fit.h5 --format vtu -o for-paraview
  geoident export results/*.fit.h5 --format csv --format vtkhdf -o export

\b
Tables:
""" + textwrap.fill(", ".join(TABLES), 76, initial_indent="  ", subsequent_indent="  ")


@click.command(epilog=EPILOG)
@click.argument("results", nargs=-1, required=True, metavar="RESULT...")
@click.option(
    "--format",
    "formats",
    type=OneOf(FORMATS),
    multiple=True,
    default=["csv"],
    show_default=True,
    help="csv: tables; vtu: one file per stage and a .pvd; vtkhdf: one file. May be repeated.",
)
@click.option(
    "--table",
    type=OneOf(TABLES),
    metavar="NAME",
    help="One of the tables below as CSV, to stdout or to the file -o.",
)
@takes("output", "force", after=always("open .csv in a spreadsheet, .pvd or .vtkhdf in ParaView"))
def command(
    results: tuple[str, ...], formats: tuple[str, ...], table: str | None, options: Options
) -> int:
    """Write results for spreadsheets (CSV) and for ParaView (VTU with PVD, VTKHDF).

    Files go to the folder RESULT.export beside each result, or to the folder -o; their paths are
    printed. RESULT.sha256 there lists their checksums: files as listed give way to those of another
    fit of the case; what was edited is replaced only with --force.

    CSV has the units of the case, readings in mm; VTU and VTKHDF have SI units. Rock that
    is removed is left out of VTU and hidden in VTKHDF. xarray opens the groups of a result file
    directly.
    """
    from geoident.workflow.export import refuse_clashes

    if table is not None:
        if len(results) > 1:
            msg = "--table takes one result; without it all tables of several results are written"
            raise UsageError(msg)
        return _one_table(results[0], table, options)
    refuse_clashes(results, options.output)
    return each(results, lambda path: _export(path, formats, options))


def _one_table(path: str, name: str, options: Options) -> int:
    from geoident.io.result.file import read_result
    from geoident.report.text.csv_tables import csv_tables, csv_text
    from geoident.workflow.export import write_table

    result = read_result(path)
    found = csv_tables(result)

    def earlier(kept: str) -> str:
        table = csv_tables(read_result(kept)).get(name)
        return "" if table is None else csv_text(table)

    if name not in found:
        msg = f"{path}: has no table {name!r}; it has {', '.join(found)}"
        raise UsageError(msg)
    text = csv_text(found[name])
    if options.output in (None, "-"):
        click.echo(text, nl=False)
    else:
        write_table(
            text,
            str(options.output),
            path=path,
            result=result,
            earlier=earlier,
            overwrite=options.force,
        )
        click.echo(options.output)
    return 0


def _export(path: str, formats: tuple[str, ...], options: Options) -> int:
    from geoident.io.result.file import read_result

    result = read_result(path)
    for kind in dict.fromkeys(formats):
        for file in _write(kind, path, result, options):
            click.echo(file)
    return 0


def _write(kind: str, path: str, result: Result, options: Options) -> tuple[str, ...]:
    from geoident.report.text.csv_tables import csv_tables, csv_text
    from geoident.workflow import export

    folder = export.export_folder(path, options.output)
    files = export.Export(path, result, folder, options.force)
    if kind == "csv":
        texts = {name: csv_text(table) for name, table in csv_tables(result).items()}
        return export.export_texts(files, texts)
    return export.export_vtu(files) if kind == "vtu" else export.export_vtkhdf(files)
