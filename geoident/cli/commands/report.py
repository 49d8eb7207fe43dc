"""``geoident report``."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

import click

from geoident.cli.options import Arguments, OneOf, Options, Steps, takes
from geoident.errors import UsageError

if TYPE_CHECKING:
    from geoident.model.results.head import ReportHead
    from geoident.report.drawing.style import Progress

EPILOG = """\b
Examples:
  geoident report case.fit.h5
  geoident report case.fit.h5 -o report.html --figures figures --format pdf
  geoident report case.fit.h5 --no-page --figures . --format png
  geoident report start-a.h5 start-b.h5 -o comparison.html
  geoident report campaign.batch
  geoident report case.fit.h5 --client "Ground AG" --logo logo.svg
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    if arguments["no_page"]:
        return (f"look at the figures in {shlex.quote(arguments['folder'])}",)
    return ("open the page in a browser, which also prints it to PDF",)


@click.command(epilog=EPILOG)
@click.argument("results", nargs=-1, required=True, metavar="RESULT...")
@click.option("--figures", "folder", metavar="DIR", help="Write the figures as files as well.")
@click.option(
    "--format",
    "suffixes",
    type=OneOf(["svg", "png", "pdf"]),
    multiple=True,
    help="Format of these files; may be repeated.  [default: svg]",
)
@click.option("--no-page", is_flag=True, help="Only the figures.")
@click.option("--title", metavar="TEXT", default="", help="In place of the title of the case.")
@click.option("--project", metavar="TEXT", default="", help="Project, in the head of the page.")
@click.option("--client", metavar="TEXT", default="", help="For whom the report is made.")
@click.option("--author", metavar="TEXT", default="", help="Who made it.")
@click.option("--revision", metavar="TEXT", default="", help="Its revision.")
@click.option("--date", metavar="TEXT", default="", help="Its date, as printed.")
@click.option("--logo", metavar="FILE", default="", help="Logo in the head: .png or .svg.")
@takes("output", "force", after=_next)
def command(
    results: tuple[str, ...],
    folder: str | None,
    suffixes: tuple[str, ...],
    no_page: bool,
    options: Options,
    **head: str,
) -> int:
    """Write the report: one page that opens in any browser, prints, and needs no other file.

    Parameters with intervals and what is not determined, gauges measured, computed and predicted,
    displacements, stresses, residuals, and the provenance. Several results make one
    page that compares them. The page is CASE.fit.html beside the result. The same results give the
    same page. After another fit it replaces the earlier page of the case; a file that was
    edited, or that geoident did not make, is replaced only with --force.

    For a campaign (its folder CAMPAIGN.batch) the page report.html in it shows what varied and the
    parameters against the misfit, failed runs and why, and a table of all.

    For a project (several sections of one ground) it shows the laws and sections, the fit of each
    section alone and with all others, and the predictions.

    Its head is that of `report` in the case (project, client, author, revision, date, logo), which
    may be written after the fit; flags override it. Of a campaign or a project it is that of flags.

    Needs matplotlib: pip install "geoident[report]".
    """
    from geoident.model.results.head import ReportHead
    from geoident.workflow.page_of_many import kind_of_many

    _require_sense(folder, suffixes, no_page=no_page, output=options.output)
    if kind := kind_of_many(results):
        if folder is not None:
            raise UsageError(f"A {kind} has a page, and no figures beside it: drop --figures.")
        _require_matplotlib()
        click.echo(_page_of_many(results[0], options, ReportHead(**head)))
        return 0
    if no_page and any(head.values()):
        raise UsageError("The head is that of the page, which --no-page leaves out.")
    if find_spec("matplotlib") is None:
        _require_matplotlib()
    report_head = ReportHead(**head)
    written = _written(
        results, folder, suffixes, no_page=no_page, options=options, head=report_head
    )
    for path in written:
        click.echo(path)
    return 0


def _written(
    results: tuple[str, ...],
    folder: str | None,
    suffixes: tuple[str, ...],
    *,
    no_page: bool,
    options: Options,
    head: ReportHead,
) -> tuple[str, ...]:
    """Write the page and the figures; their paths."""
    from geoident.workflow.report import (
        cases_of,
        files_read,
        head_of,
        page_path,
        read_logo,
        read_results,
        write_figures,
        write_page,
    )

    place = "" if no_page else page_path(results, output=options.output)
    read = read_results(results)
    _require_matplotlib()
    from geoident.report.drawing.album import figure_files
    from geoident.report.drawing.style import svg_files
    from geoident.report.page.page import report_page

    inputs, cases = files_read(results, read), cases_of(results, read)
    written: tuple[str, ...] = ()
    if place:
        report_head = head_of(results, read, head)
        inputs = (*inputs, report_head.logo) if report_head.logo else inputs
        with _progress(options) as progress:
            draw = partial(svg_files, progress=progress)
            render = partial(report_page, head=report_head, logo=read_logo(report_head), draw=draw)
            page = write_page(
                read, place, cases=cases, overwrite=options.force, inputs=inputs, render=render
            )
        written += (page,)
    if folder is not None:
        with _progress(options) as progress:
            written += write_figures(
                read,
                folder,
                cases=cases,
                overwrite=options.force,
                inputs=inputs,
                draw=lambda labelled: figure_files(labelled, suffixes or ("svg",), progress),
            )
    return written


@contextmanager
def _progress(options: Options) -> Iterator[Progress]:
    """Shows on a terminal meanwhile which figure is drawn."""
    from geoident.cli.terminal import Terminal

    terminal = Terminal(options)
    with terminal.live("drawing figures"):
        yield terminal.part


def _require_sense(
    folder: str | None, suffixes: tuple[str, ...], *, no_page: bool, output: str | None
) -> None:
    if no_page and folder is None:
        raise UsageError("--no-page leaves nothing to write: add --figures DIR.")
    if no_page and output is not None:
        raise UsageError("-o names the page, which --no-page leaves out: drop one of them.")
    if suffixes and folder is None:
        raise UsageError("--format is that of the figures: add --figures DIR.")


def _require_matplotlib() -> None:
    try:
        import matplotlib.figure  # noqa: F401 - and with it all that is drawn
    except ModuleNotFoundError as error:
        if error.name != "matplotlib":
            raise
        msg = 'reports need matplotlib: pip install "geoident[report]"'
        raise UsageError(msg) from error


def _page_of_many(path: str, options: Options, report_head: ReportHead) -> str:
    """The page of a campaign or a project, beside its runs or its result."""
    from geoident.report.drawing.style import svg_files
    from geoident.report.page.many import page_of_many
    from geoident.workflow.page_of_many import write_page_of_many
    from geoident.workflow.report import read_logo

    with _progress(options) as progress:
        draw = partial(svg_files, progress=progress)
        render = partial(page_of_many, head=report_head, logo=read_logo(report_head), draw=draw)
        return write_page_of_many(
            path, options.output, force=options.force, logo=report_head.logo, render=render
        )
