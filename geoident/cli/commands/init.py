"""``geoident init``."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from geoident.cli.options import Arguments, OneOf, Options, Steps, line, takes
from geoident.io.docs.templates import TEMPLATES

_WIDTH = max(map(len, TEMPLATES)) + 2

EPILOG = """\b
Examples:
  geoident init
  geoident init my-tunnel --template tunnel
  geoident init my-site --from site.msh

\b
Templates:
""" + "\n".join(f"  {name:<{_WIDTH}}{about}" for name, about in TEMPLATES.items())


def _next(arguments: Arguments, options: Options) -> Steps:
    if arguments["listed"]:
        return (line("init", "DIR", "--template", "NAME"),)
    case = str(Path(arguments["folder"]) / "case.yaml")
    if arguments["mesh"] is not None:
        return f"replace every FILL_IN in {shlex.quote(case)}", line("check", case)
    return line("check", case), line("fit", case)


@click.command(epilog=EPILOG)
@click.argument("folder", metavar="[DIR]", default=".", type=click.Path())
@click.option(
    "--template",
    type=OneOf(list(TEMPLATES)),
    metavar="NAME",
    help="Template to start from, of those below; cavern by default.",
)
@click.option(
    "--from", "mesh", metavar="MESH", type=click.Path(), help="Start from a mesh of your own."
)
@click.option("--list", "listed", is_flag=True, help="List the templates, and write nothing.")
@click.option("--schema", is_flag=True, help="Also the JSON schema by which editors complete keys.")
@takes("force", after=_next)
def command(
    folder: str,
    template: str | None,
    mesh: str | None,
    listed: bool,
    schema: bool,
    options: Options,
) -> int:
    """Write a commented case with mesh and readings that can be fitted at once.

    With --from, write the case for a mesh of your own: its groups, extents and numbers of elements
    are filled in, and what only you know is marked FILL_IN. Prints the paths of the files.
    """
    if listed:
        for name, about in TEMPLATES.items():
            click.echo(f"{name:<{_WIDTH}}{about}")
        return 0
    from geoident.workflow.init import init_from_mesh, init_template

    if mesh is not None and template is not None:
        raise click.UsageError("--template and --from exclude each other.")
    if mesh is not None:
        files = init_from_mesh(mesh, folder, force=options.force, schema=schema)
    else:
        name = template or next(iter(TEMPLATES))
        files = init_template(name, folder, force=options.force, schema=schema)
    for file in files:
        click.echo(file)
    return 0
