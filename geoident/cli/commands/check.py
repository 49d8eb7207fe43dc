"""``geoident check``."""

from __future__ import annotations

from importlib.util import find_spec

import click

from geoident.cli.error_boundary import each, failures_as_json
from geoident.cli.options import (
    Arguments,
    Options,
    Steps,
    for_one,
    line,
    on_result,
    overrides,
    takes,
)

EPILOG = """\b
Examples:
  geoident check case.yaml
  geoident check cases/*.yaml -q
  geoident check case.yaml --set mesh.file=fine.msh --json
  geoident check case.yaml --identifiability
  geoident check case.yaml --mesh-error
  geoident check case.fit.h5 --mesh-error --json
  geoident check case.yaml --picture case.svg
  geoident check project.yaml
"""

_SUFFIXES = (".svg", ".png", ".pdf")


_UNREAD = "geoident.cases without readings"
"""Of the context of a command: the cases of which there is nothing to fit yet."""

_UNTRUSTED = "geoident.cases that run what is not trusted yet"
"""Of the context of a command: the cases that the next command asks about."""


def _next(arguments: Arguments, options: Options) -> Steps:
    """A fit; where there are no readings yet, what tells whether the gauges will do."""
    changes = overrides(options)
    meta = click.get_current_context().meta
    unread, untrusted = meta.get(_UNREAD, ()), meta.get(_UNTRUSTED, ())

    def steps(case: str) -> Steps:
        if arguments["mesh_error"] and case.endswith(".h5"):
            return on_result(case)
        if case not in unread:
            return (line("fit", case, *changes, *(["--trust"] if case in untrusted else [])),)
        if arguments["identifiability"]:
            return line("simulate", case, *changes), "put readings into the case, and fit it"
        return line("check", case, *changes, "--identifiability"), line("simulate", case, *changes)

    return for_one(arguments["cases"], steps)


def _note(case: str, kind: str) -> None:
    """Keep that a case is one of `_UNREAD` or `_UNTRUSTED`, for what is said at the end."""
    meta = click.get_current_context().meta
    meta[kind] = (*meta.get(kind, ()), case)


@click.command(epilog=EPILOG)
@click.argument("cases", nargs=-1, required=True, metavar="CASE...", type=click.Path())
@click.option(
    "--identifiability",
    is_flag=True,
    help="Compute what the planned gauges can determine; no readings needed.",
)
@click.option(
    "--picture",
    metavar="FILE",
    type=click.Path(),
    help="Draw mesh, stages, supports and gauges into FILE.svg, .png or .pdf.",
)
@click.option(
    "--mesh-error",
    is_flag=True,
    help="Halve every edge of the mesh and report how much of each reading's accuracy is lost to "
    "mesh error.",
)
@takes("overrides", "solver", "force", "as_json", "trust", after=_next)
def command(
    cases: tuple[str, ...],
    identifiability: bool,
    picture: str | None,
    mesh_error: bool,
    options: Options,
) -> int:
    """Report everything that is wrong with a case, before computing.

    Prints a summary of the case: groups, stages, gauges, and which readings are used. With
    --identifiability it solves the model once, at the start values, and prints the 95 % interval to
    which each parameter could be known if every gauge were read at every stage of the fit, and
    which parameters the readings could not separate. Where stages last, a list of readings says
    instead which gauge is read when; its values may be missing. With --mesh-error it solves the
    model on the mesh and on one whose edges are halved, at the start values or those of a result
    CASE.fit.h5.

    A project (several sections of one ground) is checked with the cases of all its sections.
    """
    from geoident.io.project.head import is_project

    if (identifiability or mesh_error or picture) and any(is_project(case) for case in cases):
        message = "--identifiability, --mesh-error and --picture take cases, not projects."
        raise click.UsageError(message)
    if identifiability and mesh_error:
        raise click.UsageError("--identifiability and --mesh-error cannot be combined.")
    if picture is not None:
        _refuse_picture(cases, picture, identifiability or mesh_error)
    if mesh_error:
        return each(cases, lambda case: _mesh_error(case, options))
    if identifiability:
        return each(cases, lambda case: _identifiability(case, options))
    return each(cases, lambda case: _check(case, picture, options))


def _refuse_picture(cases: tuple[str, ...], picture: str, identifiability: bool) -> None:
    """Raise a usage error where a picture cannot be drawn."""
    if len(cases) > 1 or identifiability:
        message = "--picture takes one case, and no --identifiability or --mesh-error."
        raise click.UsageError(message)
    if not picture.lower().endswith(_SUFFIXES):
        message = f"--picture {picture}: the name must end in {', '.join(_SUFFIXES)}."
        raise click.UsageError(message)
    if find_spec("matplotlib") is None:
        raise click.UsageError('Pictures need matplotlib: pip install "geoident[report]".')


def _identifiability(case: str, options: Options) -> int:
    from geoident.report.text.json import dumps, identifiability_object
    from geoident.report.text.result import plan_text
    from geoident.workflow.identifiability import identifiability

    with failures_as_json(case, options):
        plan = identifiability(case, overrides=options.overrides, solver=options.solver)
    if not plan.read:
        _note(case, _UNREAD)
    if options.as_json:
        click.echo(dumps(identifiability_object(case, plan)))
    elif not options.quiet:
        click.echo(plan_text(case, plan))
    return 0


def _mesh_error(case: str, options: Options) -> int:
    from geoident.report.text.errors.mesh_error import mesh_error_object, mesh_error_text
    from geoident.report.text.json import dumps
    from geoident.workflow.mesh_error import check_mesh_error

    with failures_as_json(case, options):
        done = check_mesh_error(case, overrides=options.overrides, solver=options.solver)
    if options.as_json:
        click.echo(dumps(mesh_error_object(case, done.table, done.sentence)))
    elif not options.quiet:
        click.echo(mesh_error_text(case, done.table, done.sentence))
    return 0


def _check(case: str, picture: str | None, options: Options) -> int:
    """Check a case or a project."""
    from geoident.io.project.head import is_project

    if is_project(case):
        from geoident.cli.project import check_one_project

        return check_one_project(case, options)
    with failures_as_json(case, options):
        from geoident.report.text.case import case_text
        from geoident.report.text.json import dumps, summary_object
        from geoident.workflow.check import check

        checked = check(case, overrides=options.overrides, solver=options.solver)
        if picture is not None and checked.mesh is None:
            message = f"--picture {picture}: the case has no mesh, so nothing to draw."
            raise click.UsageError(message)
    if not checked.case.readings:
        _note(case, _UNREAD)
    if checked.untrusted:
        _note(case, _UNTRUSTED)
    if options.as_json:
        click.echo(dumps(summary_object(checked.summary)))
    elif not options.quiet:
        click.echo(case_text(checked.summary))
    if picture is not None:
        from geoident.report.drawing.model.figure import case_picture
        from geoident.workflow.running.remade import write_remade

        assert checked.mesh is not None
        drawn = case_picture(checked.case, checked.mesh, picture.rpartition(".")[2].lower())
        made = {picture: drawn}
        write_remade(made, cases=[case], force=options.force, inputs=checked.files_read)
        if not options.as_json and not options.quiet:
            click.echo(f"\nPicture: {picture}")
    return 0
