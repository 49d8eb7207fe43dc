"""The report: one page that holds everything and loads nothing.

The same results give the same page, byte for byte: there is no time of day in it but that of the
results.
"""

from __future__ import annotations

from collections.abc import Sequence

from geoident.model.result import Result
from geoident.report.drawing.style import Picture, image
from geoident.report.page import sentences as text
from geoident.report.page.figures import album, comparison
from geoident.report.page.html import Html, joined, page, tag
from geoident.report.page.svg import figure_element
from geoident.report.text.case import case_title
from geoident.report.text.certificate import TITLE as CERTIFICATE
from geoident.report.text.members import TITLE


def report_page(results: Sequence[tuple[str, Result]]) -> str:
    """The report of one result, or of several with a comparison first.

    Args:
        results: labels (such as file names) and results.
    """
    if len(results) == 1:
        ((label, result),) = results
        title = case_title(result) or label
        return page(f"{title} - geoident", tag("h1", title), *_parts(result, prefix=""))
    title = "Comparison of " + ", ".join(label for label, _ in results)
    parts = [_result_section(number, *each) for number, each in enumerate(results, start=1)]
    return page(f"{title} - geoident", tag("h1", title), *_compared(results), *parts)


def _compared(results: Sequence[tuple[str, Result]]) -> tuple[Html, ...]:
    links = [
        tag("li", tag("a", label, href=f"#result-{number}"))
        for number, (label, _) in enumerate(results, start=1)
    ]
    return (
        tag("nav", tag("ul", *links)),
        tag("h2", "Outcomes"),
        text.compared_outcomes(results),
        tag("h2", "Parameters side by side"),
        tag("p", "Values with their 95 % intervals.", class_="note"),
        text.compared_parameters(results),
        _figures(comparison(results)),
    )


def _result_section(number: int, label: str, result: Result) -> Html:
    title = case_title(result)
    heading = f"Result {number}: {label}" + (f" ({title})" if title else "")
    return tag(
        "section",
        tag("h1", heading),
        *_parts(result, prefix=f"{number}-"),
        id=f"result-{number}",
    )


def _parts(result: Result, *, prefix: str) -> tuple[Html, ...]:
    """All sections of one result."""
    pictures = album(result, prefix=prefix)
    return (
        text.summary(result),
        text.warnings(result),
        _figures(pictures.overview),
        _section(
            "Parameters", text.parameter_table(result.parameters), _figures(pictures.parameters)
        ),
        _section("Gauges", _figures(pictures.readings)),
        _section("Displacements and stresses", _figures(pictures.fields)),
        _section(
            "How well it fits",
            text.outlier_list(result) if pictures.quality else "",
            text.influence_table(result),
            _figures(pictures.quality),
        ),
        _section(CERTIFICATE, text.certificate_table(result)),
        _section("Readings (mm)", text.reading_table(result)),
        _section(TITLE, text.structure_table(result)),
        _section("Notes", joined([tag("p", note) for note in result.notes if note])),
        _section("Where this comes from", text.provenance_table(result), _case(result)),
    )


def _section(title: str, *parts: str) -> Html:
    """A heading and what stands under it; nothing if that is nothing."""
    body = [part for part in parts if part]
    return tag("section", tag("h2", title), joined(body, "\n")) if body else Html("")


def _figures(pictures: Sequence[Picture]) -> Html:
    return joined([_figure(picture) for picture in pictures], "\n")


def _figure(picture: Picture) -> Html:
    svg = image(picture, "svg")
    return figure_element(svg, name=picture.name, title=picture.title, caption=picture.caption)


def _case(result: Result) -> Html:
    if not result.case_resolved:
        return Html("")
    return joined(
        [tag("h3", "The case, with defaults and overrides"), tag("pre", result.case_resolved)]
    )
