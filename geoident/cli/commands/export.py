"""``geoident export``."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import click

from geoident.cli.error_boundary import each
from geoident.cli.options import Arguments, OneOf, Options, Steps, takes
from geoident.errors import UsageError

if TYPE_CHECKING:
    from geoident.model.results.result import Result

OF_RESULTS = ("csv", "vtu", "vtkhdf")
OF_CASES = ("pest", "dakota")
FORMATS = (*OF_RESULTS, *OF_CASES)
TABLES = (
    "parameters",
    "gauges",
    "diagnostics",
    "prediction",
    "history",
    "correlation",
    "sensitivity",
    "structures",
    "shells",
    "interfaces",
    "reactions",
    "alarms",
    "decisions",
    "telling-readings",
    "safety",
    "plan",
    "plan-targets",
    "convergence",
    "settlement",
    "troughs",
    "yielded",
    "opening",
    "ground-reaction",
    "opening-stresses",
    "opening-supports",
    "face",
    "face-profile",
    "grid",
    "readings",
    "times",
    "accuracies",
    "left-out",
    "posterior",
    "draws",
    "fields",
    "seasonal",
    "judged",
    "changes",
    "parameter-changes",
    "power",
    "backtest",
    "backtest-parameters",
    "updates",
    "update-gauges",
    "update-readings",
    "update-parameters",
    "update-predictions",
)
OF_PROJECTS = (
    "common",
    "laws",
    "sections",
    "section-parameters",
    "section-readings",
    "law-curves",
    "left-out-parameters",
    "left-out-readings",
)

EPILOG = """\b
Examples:
  geoident export case.fit.h5
  geoident export case.fit.h5 --table gauges > gauges.csv
  geoident export case.fit.h5 --format vtu -o for-paraview
  geoident export results/*.fit.h5 --format csv --format vtkhdf -o export
  geoident export case.yaml --format pest

\b
Tables:
""" + textwrap.fill(", ".join(TABLES), 76, initial_indent="  ", subsequent_indent="  ")
EPILOG += "\n\n\b\nTables of several sections:\n" + textwrap.fill(
    ", ".join(OF_PROJECTS), 76, initial_indent="  ", subsequent_indent="  "
)


def _next(arguments: Arguments, options: Options) -> Steps:
    if "pest" in arguments["formats"]:
        return ("run pestpp-glm or pestpp-ies on the .pst, in its folder",)
    if "dakota" in arguments["formats"]:
        return ("run dakota on the .in, in its folder",)
    return ("open .csv in a spreadsheet, .pvd or .vtkhdf in ParaView",)


@click.command(epilog=EPILOG)
@click.argument("results", nargs=-1, required=True, metavar="RESULT...|CASE...")
@click.option(
    "--format",
    "formats",
    type=OneOf(FORMATS),
    multiple=True,
    default=["csv"],
    show_default=True,
    help="csv: tables; vtu: one file per stage and a .pvd; vtkhdf: one file; pest, dakota: a case "
    "for these programs. May be repeated.",
)
@click.option(
    "--table",
    type=OneOf((*TABLES, *OF_PROJECTS)),
    metavar="NAME",
    help="One of the tables below as CSV, to stdout or to the file -o.",
)
@takes("output", "force", after=_next)
def command(
    results: tuple[str, ...], formats: tuple[str, ...], table: str | None, options: Options
) -> int:
    """Write results for spreadsheets (CSV) and for ParaView (VTU with PVD, VTKHDF).

    Files go to the folder RESULT.export beside each result, or to the folder -o; their paths are
    printed. RESULT.sha256 there lists their checksums: unchanged files are replaced by those of
    another fit of the case, edited ones only with --force.

    CSV has the units of the case, readings in mm; VTU and VTKHDF have SI units. Rock that
    is removed is left out of VTU and hidden in VTKHDF. xarray opens the groups of a result file
    directly.

    With --format pest or dakota, a case goes to the folder CASE.pest or CASE.dakota, or to -o: all
    that PEST++, pyEMU or Dakota need to drive `geoident simulate` (how-to/pest, how-to/dakota).
    """
    from geoident.workflow.export import refuse_clashes

    of_cases = [name for name in formats if name in OF_CASES]
    _refuse_mixed(results, formats, table)
    if of_cases:
        return _export_case(of_cases[0], results[0], options)
    if table is not None:
        if len(results) > 1:
            msg = "--table takes one result; without it all tables of several results are written"
            raise UsageError(msg)
        return _one_table(results[0], table, options)
    refuse_clashes(results, options.output)
    return each(results, lambda path: _export(path, formats, options))


def _refuse_mixed(paths: tuple[str, ...], formats: tuple[str, ...], table: str | None) -> None:
    """Refuse a format of cases together with one of results, or with a file of the other kind."""
    of_cases = [name for name in formats if name in OF_CASES]
    if of_cases and (table is not None or len(of_cases) < len(formats)):
        msg = (
            f"--format {of_cases[0]} is of a case, and cannot go with tables and formats of results"
        )
        raise UsageError(msg)
    if of_cases and len(paths) > 1:
        raise UsageError(f"--format {of_cases[0]} takes one case")
    for path in paths:
        if of_cases and path.endswith(".h5"):
            msg = f"{path}: --format {of_cases[0]} takes a case, such as case.yaml, not a result"
            raise UsageError(msg)


def _export_case(kind: str, path: str, options: Options) -> int:
    from geoident.workflow.bridges.dakota import export_dakota
    from geoident.workflow.bridges.pest import export_pest

    export = export_pest if kind == "pest" else export_dakota
    files, notes = export(path, output=options.output, force=options.force)
    if not options.quiet:
        for note in notes:
            click.echo(f"note: {note}", err=True)
    for file in files:
        click.echo(file)
    return 0


def _one_table(path: str, name: str, options: Options) -> int:
    from geoident.io.result.file import read_result
    from geoident.io.result.project import is_project_result
    from geoident.report.text.csv_tables import csv_tables, csv_text
    from geoident.workflow.export import write_table

    if is_project_result(path):
        from geoident.cli.project import export_project_table

        return export_project_table(path, name, options)
    result = read_result(path)
    tables = csv_tables(result)

    def earlier(kept: str) -> str:
        table = csv_tables(read_result(kept)).get(name)
        return "" if table is None else csv_text(table)

    if name not in tables:
        msg = f"{path}: has no table {name!r}; it has {', '.join(tables)}"
        raise UsageError(msg)
    text = csv_text(tables[name])
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
    from geoident.io.result.project import is_project_result

    if is_project_result(path):
        from geoident.cli.project import export_project_tables

        return export_project_tables(path, formats, options)
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
