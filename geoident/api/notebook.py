"""What a notebook shows of cases and results, as HTML without scripts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from geoident.errors import MissingExtra
from geoident.model.case import Case
from geoident.model.parameter import Parameter
from geoident.model.results.result import Result
from geoident.report.page.html import Html, joined, table, tag
from geoident.report.text.case import case_title
from geoident.report.text.layout import TextTable, number
from geoident.report.text.parameters import parameter_table
from geoident.report.text.result import outcome_sentences, warnings
from geoident.units import in_unit, shown_unit

if TYPE_CHECKING:
    from geoident.api.plots import Plots


def result_html(result: Result, *, title: str, plots: Plots) -> Html:
    """The outcome in words, what must not be overlooked, the parameters, and one figure.

    Args:
        result: what to show.
        title: where it stands, for a result whose case has no title.
        plots: its figures.
    """
    shown = result.for_people
    warned = warnings(shown)
    return joined(
        [
            tag("p", tag("b", case_title(shown) or title)),
            tag("p", " ".join(outcome_sentences(shown))),
            tag("ul", *(tag("li", text) for text in warned)) if warned else Html(""),
            table(parameter_table(shown.parameters)),
            _figure(plots),
        ]
    )


def _figure(plots: Plots) -> Html:
    """The overview, or the first figure of parameters where there is none."""
    try:
        names = plots.names()
    except MissingExtra as error:
        return tag("p", str(error))
    wanted = [name for name in ("overview", "scan", "parameters") if name in names]
    return Html(plots.named(wanted[0])._repr_html_()) if wanted else Html("")


def case_line(case: Case) -> str:
    """A case in a few words: its title, and how much of what there is."""
    counts = (
        (len(case.stages), "stage"),
        (len(case.channels), "channel"),
        (len(case.readings), "reading"),
        (len(case.parameters), "parameter"),
    )
    amounts = ", ".join(f"{n} {word}{'s' * (n != 1)}" for n, word in counts)
    return f"{case.title}, {amounts}" if case.title else amounts


def case_html(case: Case, path: str) -> Html:
    """A case: what it consists of, and its parameters.

    Args:
        case: the case.
        path: of its file.
    """
    rows = [
        ["file", path],
        ["analysis", case.analysis.value],
        ["mesh", Path(case.mesh_file).name if case.mesh_file else "none: closed form"],
        ["materials", ", ".join(case.materials)],
        ["stages", ", ".join(case.stage_names)],
        ["gauges", ", ".join(dict.fromkeys(channel.gauge for channel in case.channels))],
        ["readings", str(len(case.readings))],
    ]
    parameters = [_parameter(parameter) for parameter in case.parameters]
    header = ("parameter", "unit", "start", "bounds")
    return joined(
        [
            tag("p", tag("b", case.title or path)),
            table(TextTable(("", ""), rows)),
            table(TextTable(header, parameters, right="llrr")),
        ]
    )


def _parameter(parameter: Parameter) -> list[str]:
    unit = parameter.unit, parameter.dimension
    start, lower, upper = (
        number(in_unit(value, *unit)) for value in (parameter.start, *_bounds(parameter))
    )
    return [parameter.name, shown_unit(*unit) or "-", start, f"{lower} to {upper}"]


def _bounds(parameter: Parameter) -> tuple[float, float]:
    return parameter.lower, parameter.upper
