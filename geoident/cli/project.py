"""Fitting a project: what is said while it is computed, and at the end."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

from collections.abc import Sequence

import click
from click.core import ParameterSource

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Options
from geoident.cli.signals import stop_on_signals
from geoident.cli.terminal import Terminal
from geoident.cli.trust import asked
from geoident.errors import ExitCode, UsageError
from geoident.report.text.csv_tables import csv_text
from geoident.report.text.json import dumps
from geoident.report.text.project.json import plan_object, project_object
from geoident.report.text.project.spreadsheet import project_csv, project_tables
from geoident.report.text.project.tables import plan_text, project_summary, project_text
from geoident.workflow.executing.stop import StopRequest
from geoident.workflow.programs.workplace import workplace
from geoident.workflow.project.plan import ProjectJob, ProjectRequest, plan_project
from geoident.workflow.project.run import fit_project
from geoident.workflow.running.control import Control

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
            path=path,
            output=options.output,
            leave_one_out=leave_one_out,
            solver=options.solver,
            jobs=options.jobs if _said("jobs") else None,
            seed=options.seed,
            force=options.force,
            fresh=options.fresh,
        )
        job = plan_project(request)
        if options.dry_run:
            return _say_plan(job, options)
        terminal = Terminal(options)
        control = Control(
            terminal, StopRequest(), max_time=options.max_time,
            cluster=workplace(cluster, request.jobs, terminal.inform),
        )  # fmt: skip
        with (
            asked(trust=options.trust, as_json=options.as_json),
            terminal.live(path),
            stop_on_signals(control.stop),
        ):
            finished = fit_project(job, control)
    result = finished.result
    for remark in finished.remarks:
        terminal.inform(remark)
    if not finished.up_to_date:
        control.tell_of_cluster()
    else:
        terminal.inform(f"{finished.path} is up to date; --fresh computes it again")
    terminal.inform(project_summary(result))
    if result.exit_code != ExitCode.DONE and options.quiet:
        terminal.warn(f"{path}: {result.status}: {result.reason}")
    said = project_object(result, project=path, output=finished.path)
    click.echo(dumps(said) if options.as_json else finished.path)
    return result.exit_code


def _said(name: str) -> bool:
    """Whether an option was given."""
    context = click.get_current_context(silent=True)
    source = None if context is None else context.get_parameter_source(name)
    return source not in (None, ParameterSource.DEFAULT)


def _say_plan(job: ProjectJob, options: Options) -> int:
    """What would be fitted; nothing is computed."""
    project, path = job.project, str(job.place.path)
    counts = [len(one.case.readings) for one in job.inputs]
    if options.as_json:
        plan = {"output": path, "up_to_date": job.up_to_date}
        click.echo(dumps({**plan_object(project, counts), **plan}))
        return ExitCode.DONE
    click.echo(plan_text(project, counts))
    click.echo(f"\n{path} is up to date" if job.up_to_date else f"\nWould write {path}")
    return ExitCode.DONE


def check_one_project(path: str, options: Options) -> int:
    """Say what a project amounts to, or all that is wrong with it.

    Args:
        path: of its file.
        options: of the command.

    Raises:
        UsageError: values are to be set, which a project does itself.
    """
    from geoident.workflow.project.check import check_project

    if options.overrides:
        raise UsageError(_SETS_ITSELF)
    with failures_as_json(path, options):
        found = check_project(path, solver=options.solver)
    counts = [summary.used for summary in found.summaries]
    if options.as_json:
        click.echo(dumps({"project": path, **plan_object(found.project, counts)}))
    elif not options.quiet:
        click.echo(f"{path}: {plan_text(found.project, counts)}")
    return ExitCode.DONE


def show_project(path: str, options: Options, *, as_csv: bool = False) -> int:
    """Print the result of a project.

    Args:
        path: of the result.
        options: of the command.
        as_csv: its tables for spreadsheets.
    """
    from geoident.io.result.project import read_project_result
    from geoident.workflow.running.result_files import case_path

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
    from geoident.io.result.project import read_project_result
    from geoident.workflow.project.export import export_project

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
    from geoident.io.result.project import read_project_result
    from geoident.workflow.project.export import write_project_table

    result = read_project_result(path)
    found = project_tables(result)
    if name not in found:
        raise UsageError(f"{path}: has no table {name!r}; it has {', '.join(found)}")
    text = csv_text(found[name])
    if options.output in (None, "-"):
        click.echo(text, nl=False)
        return ExitCode.DONE
    write_project_table(path, result, text, output=str(options.output), force=options.force)
    click.echo(options.output)
    return ExitCode.DONE
