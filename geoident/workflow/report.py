"""``geoident report``: results as a page and as figures, in files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

from geoident.io.case.report import read_report_head
from geoident.io.result.file import read_result
from geoident.io.text.atomic import make_folder, refuse_inputs
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES
from geoident.model.results.head import ReportHead
from geoident.model.results.result import Labelled, Result
from geoident.workflow.running.remade import place_of_page, write_remade
from geoident.workflow.running.result_files import case_path, files_of_result, with_outdated

COMPARISON = "comparison.html"
"""Name of the page of several results."""

_MOST_LOGO = 2_000_000


def read_results(paths: Sequence[str]) -> Labelled:
    """Results with labels to tell them apart: names of files, or paths where these are the same.

    Raises:
        InputError: one of them is missing or damaged.
    """
    names = [Path(path).name.removesuffix(".h5") for path in paths]
    labels = names if len(set(names)) == len(names) else [Path(path).as_posix() for path in paths]
    return tuple(
        (label, with_outdated(read_result(path), path)[0].for_people)
        for label, path in zip(labels, paths, strict=True)
    )


def page_path(paths: Sequence[str], *, output: str | None) -> str:
    """Where the page goes.

    Args:
        paths: of the results.
        output: a file, an existing folder, or None for beside the first result.

    Raises:
        UsageError: it would go to stdout.
        OutputError: it is one of the results.

    >>> page_path(["cases/cavern/case.fit.h5"], output=None)
    'cases/cavern/case.fit.html'
    """
    first = Path(paths[0])
    name = f"{first.name.removesuffix('.h5')}.html" if len(paths) == 1 else COMPARISON
    place = place_of_page(output, first.with_name(name))
    refuse_inputs(place.as_posix(), paths)
    return place.as_posix()


def head_of(paths: Sequence[str], results: Labelled, stated: ReportHead) -> ReportHead:
    """The head of a report: as given, else as the cases say.

    A case is read where it stands today, since its head may be written after the fit without asking
    for another; as the result holds it where it stands no more. Of several cases counts what they
    agree on.

    Args:
        paths: of the results.
        results: the same, with their labels.
        stated: what stands above the cases.

    Raises:
        InputError: what a case says of its report is wrong.
    """
    heads = [_head(path, result) for path, (_, result) in zip(paths, results, strict=True)]
    agreed = {
        field.name: values.pop()
        for field in fields(ReportHead)
        if len(values := {getattr(head, field.name) for head in heads}) == 1
    }
    return stated.over(ReportHead(**agreed))


def _head(path: str, result: Result) -> ReportHead:
    """What the case of a result says of its report."""
    case = case_path(path, result.provenance.case_file)
    if not Path(case).is_file():
        return read_report_head(result.case_text, case)
    return read_report_head(decode(read_bytes(case, limit=MAX_BYTES, what="case"), case), case)


def read_logo(head: ReportHead) -> bytes:
    """The content of the file of the logo; empty where there is none.

    Raises:
        InputError: it cannot be read, or is larger than 2 MB.
    """
    return read_bytes(head.logo, limit=_MOST_LOGO, what="logo") if head.logo else b""


def files_read(paths: Sequence[str], results: Labelled) -> tuple[str, ...]:
    """Paths of results, of their cases, and of the files that these name.

    Args:
        paths: of the results.
        results: the same, with their labels.
    """
    pairs = zip(paths, results, strict=True)
    return tuple(name for path, (_, one) in pairs for name in files_of_result(one, path))


def cases_of(paths: Sequence[str], results: Labelled) -> tuple[str, ...]:
    """Paths of the cases that results were made from.

    Args:
        paths: of the results.
        results: the same, with their labels.
    """
    pairs = zip(paths, results, strict=True)
    return tuple(case_path(path, one.provenance.case_file) for path, (_, one) in pairs)


def write_page(
    results: Labelled,
    path: str,
    *,
    cases: Sequence[str],
    overwrite: bool,
    inputs: Sequence[str],
    render: Callable[[Labelled], str],
) -> str:
    """Write the report of results; the path comes back. An earlier one of the case gives way.

    Args:
        results: labels and results.
        path: of the page.
        cases: see `cases_of`.
        overwrite: replace another file.
        inputs: see `files_read`; none of them is replaced.
        render: makes the page.
    """
    refuse_inputs(path, inputs)
    page = {path: render(results).encode()}
    write_remade(page, cases=cases, force=overwrite, inputs=inputs, form="html")
    return path


def write_figures(
    results: Labelled,
    folder: str,
    *,
    cases: Sequence[str],
    overwrite: bool,
    inputs: Sequence[str],
    draw: Callable[[Labelled], Mapping[str, bytes]],
) -> tuple[str, ...]:
    """Write all figures of results into a folder, which is made if it is missing.

    Args:
        results: labels and results.
        folder: where to put them.
        cases: see `cases_of`.
        overwrite: replace other files.
        inputs: see `files_read`; none of them is replaced.
        draw: makes the figures: name of the file to its bytes.

    Raises:
        OutputError: the folder cannot be made, or a file exists that is not to be replaced.
    """
    make_folder(folder)
    drawn = {(Path(folder) / name).as_posix(): figure for name, figure in draw(results).items()}
    write_remade(drawn, cases=cases, force=overwrite, inputs=inputs)
    return tuple(drawn)
