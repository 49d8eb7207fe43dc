"""Fitting a project: what is said while it is computed, and at the end."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import click

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.jobs import run_and_say, say_plan
from geoident.cli.options import Options
from geoident.cli.terminal import Terminal
from geoident.errors import ExitCode, UsageError
from geoident.io.result.project import read_project_result
from geoident.report.text.csv_tables import csv_text
from geoident.report.text.json import dumps
from geoident.report.text.project.json import plan_object, project_object
from geoident.report.text.project.spreadsheet import project_csv, project_tables
from geoident.report.text.project.tables import plan_text, project_text
from geoident.workflow.project.check import check_project
from geoident.workflow.project.export import export_project, write_project_table
from geoident.workflow.project.plan import ProjectRequest, plan_project
from geoident.workflow.project.run import fit_project
from geoident.workflow.running.result_files import case_path

_SETS_ITSELF = "A project sets values of its sections itself: sections[..].set."


def run_project(
    path: str, options: Options, *, leave_one_out: bool, cluster: str | None = None
) -> int:
    """Fit a project and say what came out.

    Args:
        path: of its file.
        options: of the command.
        leave_one_out: predict each section from the others, too.
        cluster: address, ``local`` or file of a cluster; None for processes of this machine.

    Returns:
        The exit code.

    Raises:
        UsageError: values are to be set, which a project does itself.
    """
    if options.overrides:
        raise UsageError(_SETS_ITSELF)
    with failures_as_json(path, options):
        request = ProjectRequest(
            case=path,
            output=options.output,
            seed=options.seed,
            solver=options.solver,
            force=options.force,
            fresh=options.fresh,
            leave_one_out=leave_one_out,
            jobs=options.jobs,
        )
        job = plan_project(request)
        if options.dry_run:
            counts = [len(one.case.readings) for one in job.inputs]
            plan = plan_text(job.project, counts), plan_object(job.project, counts)
            return say_plan(job, *plan, options)
        work, terminal = partial(fit_project, job), Terminal(options)
        return run_and_say(work, terminal, options, title=path, case=path, cluster=cluster)


def check_one_project(path: str, options: Options) -> int:
    """Say what a project amounts to, or all that is wrong with it.

    Args:
        path: of its file.
        options: of the command.

    Raises:
        UsageError: values are to be set, which a project does itself.
    """
    if options.overrides:
        raise UsageError(_SETS_ITSELF)
    with failures_as_json(path, options):
        project, summaries = check_project(path, solver=options.solver)
    counts = [summary.used for summary in summaries]
    if options.as_json:
        click.echo(dumps({"project": path, **plan_object(project, counts)}))
    elif not options.quiet:
        click.echo(f"{path}: {plan_text(project, counts)}")
    return ExitCode.DONE


def show_project(path: str, options: Options, *, as_csv: bool = False) -> int:
    """Print the result of a project.

    Args:
        path: of the result.
        options: of the command.
        as_csv: its tables for spreadsheets.
    """
    with failures_as_json(path, options):
        result = read_project_result(path)
    project = case_path(path, result.provenance.case_file)
    if options.as_json:
        click.echo(dumps(project_object(result, project=project, output=path)))
    elif as_csv:
        click.echo(project_csv(result), nl=False)
    else:
        title = f"{path}: fit of {len(result.sections)} sections of {project}"
        click.echo(project_text(result, title=title))
    return ExitCode.DONE


def export_project_tables(path: str, formats: Sequence[str], options: Options) -> int:
    """Write all tables of the result of a project.

    Args:
        path: of the result.
        formats: as asked for.
        options: of the command.

    Raises:
        UsageError: a format is not that of tables.
    """
    if set(formats) != {"csv"}:
        raise UsageError(f"{path} is the result of several sections: --format csv is all it has.")
    result = read_project_result(path)
    texts = {name: csv_text(table) for name, table in project_tables(result).items()}
    for file in export_project(path, result, texts, output=options.output, force=options.force):
        click.echo(file)
    return ExitCode.DONE


def export_project_table(path: str, name: str, options: Options) -> int:
    """Write one table of the result of a project.

    Args:
        path: of the result.
        name: of the table.
        options: of the command.

    Raises:
        UsageError: it has no such table.
    """
    result = read_project_result(path)
    tables = project_tables(result)
    if name not in tables:
        raise UsageError(f"{path}: has no table {name!r}; it has {', '.join(tables)}")
    text = csv_text(tables[name])
    if options.output in (None, "-"):
        click.echo(text, nl=False)
        return ExitCode.DONE
    write_project_table(path, result, text, output=str(options.output), force=options.force)
    click.echo(options.output)
    return ExitCode.DONE
