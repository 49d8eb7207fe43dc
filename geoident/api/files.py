"""Results in files: read again, as a page, for other programs, and side by side."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import partial

from geoident.api.calling import AnyPath, needed, spoken
from geoident.api.campaigns import CampaignResult
from geoident.api.projects import ProjectFit, read_project
from geoident.api.results import ModelChoice, ResultFile
from geoident.api.runs import path_of
from geoident.errors import UsageError
from geoident.io.result.file import read_result as read_file
from geoident.io.result.project import is_project_result
from geoident.model.results.head import ReportHead
from geoident.report.text.csv_tables import csv_tables, csv_text
from geoident.workflow.compare import compare as run_comparison
from geoident.workflow.export import Export, export_folder, export_texts, export_vtkhdf, export_vtu
from geoident.workflow.page_of_many import kind_of_many, write_page_of_many
from geoident.workflow.report import (
    cases_of,
    files_read,
    head_of,
    page_path,
    read_logo,
    read_results,
    write_page,
)

_FORMATS = ("csv", "vtu", "vtkhdf")


@spoken
def compare(*results: ResultFile | AnyPath) -> ModelChoice:
    """Say which of several models of the same readings these ask for.

    Args:
        results: what `fit` found with each, or the paths of the results; two at least.

    Raises:
        InputError: one of them is no fit, has no evidence, or is of other readings.
        UsageError: there are fewer than two.
    """
    if len(results) < 2:
        msg = "Two results at least are needed: compare(one, other)."
        raise UsageError(msg)
    return ModelChoice(run_comparison([path_of(result) for result in results]))


@spoken
def report(
    *results: ResultFile | ProjectFit | CampaignResult | AnyPath,
    output: AnyPath | None = None,
    force: bool = False,
    head: Mapping[str, str] | None = None,
) -> str:
    """Write the report: one page that opens in any browser, prints, and needs no other file.

    Args:
        results: one, or several for a page that compares them; or one project, or one campaign
            (or the path of its folder).
        output: file or existing folder of the page; beside the first result if None, in the folder
            of a campaign.
        force: replace any file of that name; an earlier page of the same case, as it was made,
            gives way without.
        head: what the head of the page says, in place of ``report`` in the case: ``title``,
            ``project``, ``client``, ``author``, ``revision``, ``date``, ``logo`` (a path). The head
            of a project or a campaign says this alone.

    Returns:
        The path of the page.

    Raises:
        InputError: a result is missing or damaged.
        MissingExtra: matplotlib is not installed.
        OutputError: the page cannot be written, or another file of that name is there.
        UsageError: no result is given, or a project or a campaign together with others.
    """
    if not results:
        msg = "A report needs a result: report(result)."
        raise UsageError(msg)
    needed("matplotlib", extra="report", what="a report")
    from geoident.report.page.many import page_of_many  # noqa: PLC0415
    from geoident.report.page.page import report_page  # noqa: PLC0415

    paths = [path_of(result) for result in results]
    asked, given = None if output is None else os.fspath(output), _head(head or {})
    if kind_of_many(paths):
        page = partial(page_of_many, head=given, logo=read_logo(given))
        return write_page_of_many(paths[0], asked, force=force, logo=given.logo, render=page)
    place = page_path(paths, output=asked)
    read = read_results(paths)
    report_head = head_of(paths, read, given)
    inputs = files_read(paths, read)
    inputs = (*inputs, report_head.logo) if report_head.logo else inputs
    render = partial(report_page, head=report_head, logo=read_logo(report_head))
    return write_page(
        read, place, cases=cases_of(paths, read), overwrite=force, inputs=inputs, render=render
    )


def _head(given: Mapping[str, str]) -> ReportHead:
    """The head of a page as a caller gives it."""
    known = [field.name for field in fields(ReportHead)]
    for key in given:
        if key not in known:
            msg = f"A report has no '{key}' in its head: it has {', '.join(known)}."
            raise UsageError(msg)
    return ReportHead(**given)


@spoken
def export(
    result: ResultFile | ProjectFit | AnyPath,
    formats: str | Sequence[str] = "csv",
    *,
    output: AnyPath | None = None,
    force: bool = False,
) -> tuple[str, ...]:
    """Write a result for spreadsheets (``csv``) and for ParaView (``vtu``, ``vtkhdf``).

    Of a project there are tables alone.

    Args:
        result: what a call found, or the path of a result.
        formats: one of them, or several.
        output: folder of the files, made if it is missing; ``RESULT.export`` if None.
        force: replace any files of the same names; earlier ones of the same case, as they were
            made, give way without.

    Returns:
        The paths of the files.

    Raises:
        InputError: the result is missing or damaged, or holds no fields for ParaView.
        OutputError: a file exists or cannot be written.
        UsageError: there is no such format, or a project has none of it.
    """
    wanted = (formats,) if isinstance(formats, str) else tuple(dict.fromkeys(formats))
    unknown = [name for name in wanted if name not in _FORMATS]
    if unknown:
        msg = f"There is no format {unknown[0]!r}; there are {', '.join(_FORMATS)}."
        raise UsageError(msg)
    path = path_of(result)
    if is_project_result(path):
        if wanted != ("csv",):
            raise UsageError(f"{path} is the result of several sections: formats='csv' is all.")
        return read_project(path).export(output, force=force)
    data = read_file(path)
    folder = export_folder(path, None if output is None else os.fspath(output))
    files = Export(path, data, folder, force)
    return tuple(file for name in wanted for file in _exported(name, files))


def _exported(name: str, files: Export) -> tuple[str, ...]:
    if name == "csv":
        texts = {name: csv_text(table) for name, table in csv_tables(files.result).items()}
        return export_texts(files, texts)
    return export_vtu(files) if name == "vtu" else export_vtkhdf(files)
