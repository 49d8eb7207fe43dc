"""``geoident show``."""

from __future__ import annotations

import click

from geoident.cli.error_boundary import each, failures_as_json
from geoident.cli.options import Arguments, Options, Steps, line, takes

EPILOG = """\b
Examples:
  geoident show case.fit.h5
  geoident show results/*.fit.h5 | less
  geoident show case.fit.h5 --json | jq .parameters
  geoident show case.fit.h5 --csv > case.csv
  geoident show case.fit.h5 --as-of 2025-03-21
  geoident show campaign.batch
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    from geoident.io.result.campaign import is_campaign
    from geoident.io.result.project import is_project_result

    results = arguments["results"]
    if any(is_campaign(path) or is_project_result(path) for path in results):
        return (line("report", results[0]),) if len(results) == 1 else ()
    return line("report", *results), line("export", *results)


@click.command(epilog=EPILOG)
@click.argument("results", nargs=-1, required=True, metavar="RESULT...", type=click.Path())
@click.option("--csv", "as_csv", is_flag=True, help="All tables as CSV, one below the other.")
@click.option(
    "--as-of",
    metavar="DATE|UPDATE",
    help="Of a fit with updates: as it was at the end of this day (UTC), such as 2025-03-21, or "
    "after one of them, such as 'update 3'.",
)
@takes("as_json", after=_next)
def command(results: tuple[str, ...], as_csv: bool, as_of: str | None, options: Options) -> int:
    """Print results: parameters, findings, readings and predictions.

    For a campaign (its folder CAMPAIGN.batch) it prints the completed runs, also while others run.
    The text and --csv have the units of the case and readings in mm; --json has SI units. `geoident
    export` writes the tables into files.
    """
    if as_csv and options.as_json:
        raise click.UsageError("--csv and --json exclude each other.")
    return each(results, lambda path: _show(path, options, as_csv=as_csv, as_of=as_of))


def _show(path: str, options: Options, *, as_csv: bool, as_of: str | None) -> int:
    from geoident.io.result.campaign import is_campaign
    from geoident.io.result.file import read_result
    from geoident.io.result.project import is_project_result
    from geoident.report.text.csv_tables import all_csv
    from geoident.report.text.json import dumps, result_object
    from geoident.report.text.result import result_text
    from geoident.workflow.running.result_files import (
        case_path,
        outdated_sentence,
        with_outdated,
    )

    if is_campaign(path):
        return _show_campaign(path, options, as_csv=as_csv)
    if is_project_result(path):
        from geoident.cli.project import show_project

        return show_project(path, options, as_csv=as_csv)
    with failures_as_json(path, options):
        result, outdated = with_outdated(read_result(path), path)
    if as_of is not None:
        from geoident.workflow.updating.history import as_of as as_it_was

        result, outdated = as_it_was(result, as_of), ()
    case = case_path(path, result.provenance.case_file)
    if options.as_json:
        click.echo(dumps(result_object(result, case=case, output=path, outdated=outdated)))
    elif as_csv:
        click.echo(all_csv(result), nl=False)
    else:
        outdated_text = outdated_sentence(outdated) if result.kind == "fit" else ""
        text = result_text(result, title=f"{path}: {result.kind} of {case}")
        click.echo("\n\n".join(part for part in (text, outdated_text) if part) + "\n")
    return 0


def _show_campaign(path: str, options: Options, *, as_csv: bool) -> int:
    from geoident.io.result.campaign import record_object
    from geoident.report.text.campaign.spreadsheet import runs_csv
    from geoident.report.text.campaign.tables import campaign_text
    from geoident.report.text.json import dumps
    from geoident.workflow.campaign.runs import read_runs

    with failures_as_json(path, options):
        table = read_runs(path)
    if options.as_json:
        for run in table.runs:
            entries = {"outdated": table.outdated} if table.outdated else {}
            click.echo(dumps({**record_object(run), **entries}))
    elif as_csv:
        click.echo(runs_csv(table), nl=False)
    else:
        title = f"{path}: {table.command} of {table.total} variations of {table.case_file}"
        click.echo(campaign_text(table, title=title))
    return 0
