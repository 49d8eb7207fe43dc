"""The report: one page that holds everything and loads nothing.

The same results give the same page, byte for byte: there is no time of day in it but that of the
results. Words and tables come from `report.text`, figures from `report.drawing`; here they are put
together as HTML.
"""

from __future__ import annotations

from collections.abc import Sequence

from geoident.model.results.result import Labelled, Result
from geoident.report.drawing.album import album, comparison
from geoident.report.drawing.style import Picture, image
from geoident.report.page.html import Html, joined, page, table, tag
from geoident.report.page.svg import figure_element
from geoident.report.text import (
    accuracies,
    backtest,
    model_error,
    posterior,
    rivals,
    structures,
    varied,
    yielding,
)
from geoident.report.text.case import case_title
from geoident.report.text.gauges import (
    OUTLIER,
    in_sd_note,
    influence_table,
    influence_title,
    outliers,
    reading_table,
    unit_title,
)
from geoident.report.text.layout import TextTable, number
from geoident.report.text.parameters import compared_parameters, parameter_table
from geoident.report.text.result import compared_outcomes, counts_text, outcome_sentences, warnings

_MOST_OUTLIERS = 20


def report_page(results: Labelled) -> str:
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


def _compared(results: Labelled) -> tuple[Html, ...]:
    links = [
        tag("li", tag("a", label, href=f"#result-{number}"))
        for number, (label, _) in enumerate(results, start=1)
    ]
    return (
        tag("nav", tag("ul", *links)),
        tag("h2", "Outcomes"),
        table(compared_outcomes(results)),
        tag("h2", "Parameters side by side"),
        tag("p", "Values with their 95 % intervals.", class_="note"),
        table(compared_parameters(results)),
        _figures(comparison(results)),
    )


def _result_section(number: int, label: str, result: Result) -> Html:
    title = case_title(result)
    heading = f"Result {number}: {label}" + (f" ({title})" if title else "")
    parts = _parts(result, prefix=f"{number}-")
    return tag("section", tag("h1", heading), *parts, id=f"result-{number}")


def _parts(result: Result, *, prefix: str) -> tuple[Html, ...]:
    """All sections of one result."""
    pictures = album(result, prefix=prefix)
    return (
        tag("p", " ".join(outcome_sentences(result)), class_="lead"),
        _warnings(result),
        _figures((*pictures.model, *pictures.overview)),
        _section(
            "Parameters", table(parameter_table(result.parameters)), _figures(pictures.parameters)
        ),
        _section(varied.TITLE, table(varied.varied_table(result.varied))),
        _section(posterior.TITLE, *_posterior(result)),
        _section(accuracies.TITLE, table(accuracies.accuracies_table(result.accuracies))),
        _section(rivals.MODELS_TITLE, *_models(result)),
        _section(model_error.TITLE, _model_error(result)),
        _section(rivals.TITLE, table(rivals.rivals_table(result))),
        _section("Gauges", _figures(pictures.readings)),
        _section("Displacements and stresses", _figures(pictures.fields)),
        _section(
            "How well it fits",
            _outliers(result) if pictures.quality else "",
            _influence(result),
            _figures(pictures.quality),
        ),
        _section(yielding.TITLE, _yield_planes(result)),
        _section(unit_title("Readings", result.gauges), *_readings(result)),
        _section(
            structures.TITLE,
            _figures(pictures.structures),
            table(structures.force_table(result.members)),
        ),
        _section(backtest.TITLE, *_backtest(result), _figures(pictures.backtest)),
        _section("Notes", joined([tag("p", note) for note in result.notes if note])),
        _section("Provenance", _provenance(result), _case(result)),
    )


def _model_error(result: Result) -> Html:
    text = model_error.model_error_text(result.model_error)
    return tag("p", text) if text else Html("")


def _posterior(result: Result) -> tuple[str, ...]:
    """How far the draws are to be believed, and their table."""
    if result.posterior is None:
        return ()
    said = tag("p", posterior.cost_sentence(result.posterior))
    return said, table(posterior.posterior_table(result))


def _section(title: str, *parts: str) -> Html:
    """A heading and what stands under it; nothing if that is nothing."""
    body = [part for part in parts if part]
    return tag("section", tag("h2", title), joined(body, "\n")) if body else Html("")


def _readings(result: Result) -> tuple[Html, ...]:
    """Every reading, and what its residual is divided by."""
    found = table(reading_table(result))
    return (found, tag("p", in_sd_note(result), class_="note")) if found else ()


def _models(result: Result) -> tuple[Html, ...]:
    found = result.comparison
    if found is None:
        return ()
    said = tag("ul", *(tag("li", text) for text in found.sentences))
    return table(rivals.models_table(found)), said, tag("p", rivals.MODELS_LEGEND)


def _figures(pictures: Sequence[Picture]) -> Html:
    return joined([_figure(picture) for picture in pictures], "\n")


def _figure(picture: Picture) -> Html:
    svg = image(picture, "svg")
    return figure_element(svg, name=picture.name, title=picture.title, caption=picture.caption)


def _warnings(result: Result) -> Html:
    said = warnings(result)
    return tag("div", *(tag("p", text) for text in said), class_="warn") if said else Html("")


def _outliers(result: Result) -> Html:
    """The readings that stand out, in words."""
    found = outliers(result)
    if not found:
        return tag("p", f"No residual exceeds {OUTLIER:g} standard deviations.")
    items = [
        f"{o.channel}, {o.stage}: {o.residual:+.1f} standard deviations"
        f"{'' if o.used else ' (not used)'}"
        for o in found[:_MOST_OUTLIERS]
    ]
    if len(found) > _MOST_OUTLIERS:
        items.append(f"and {len(found) - _MOST_OUTLIERS} more, see the table of readings")
    words = f"Residuals (measured minus computed) beyond {OUTLIER:g} standard deviations:"
    return joined([tag("p", words), tag("ul", *(tag("li", item) for item in items))])


def _influence(result: Result) -> Html:
    """The most influential readings."""
    title = influence_title(result.diagnostics).replace("\n", ". ")
    found = table(influence_table(result), caption=title)
    note = (
        "Leverage: share of its own fitted value that the reading decides, 0 to 1. Changes most, "
        "by sd: the parameter that the reading moves most, in standard deviations of the parameter."
    )
    return joined([found, tag("p", note, class_="note")]) if found else found


def _yield_planes(result: Result) -> Html:
    """What kind of answer identified yield limits are, and what their planes do."""
    found = result.certificate
    if found is None:
        return Html("")
    said = tag("p", " ".join(yielding.certificate_sentences(found)))
    return joined([said, table(yielding.plane_table(found))])


def _backtest(result: Result) -> tuple[Html, ...]:
    """How predictions of stages that were read came true, in tables."""
    found = result.backtest
    if found is None or not found.steps:
        return ()
    if result.kind != "backtest":
        words = "The last fitted stage, predicted from the readings of those before it."
        return tag("p", words), table(backtest.prediction_table(result))
    return (
        table(backtest.fits_table(result), caption="Fits of the readings up to each stage"),
        table(backtest.scores_table(found), caption="Predictions against later readings"),
        table(backtest.errors_table(result), caption=f"{backtest.ERRORS_TITLE}: next stage"),
        table(
            backtest.errors_table(result, ahead=False),
            caption=f"{backtest.ERRORS_TITLE}: further ahead, last fitted > predicted stage",
        ),
    )


def _provenance(result: Result) -> Html:
    """Where the result comes from, so that it can be made again."""
    origin = result.provenance
    rows = [
        ("command", f"geoident {origin.command}"),
        ("case", origin.case_file),
        ("result written", origin.created),
        ("seed", str(origin.seed)),
        ("status", f"{result.status} (exit code {int(result.exit_code)})"),
        ("why it ended", result.reason or "-"),
        ("misfit", number(result.objective)),
        ("cost", counts_text(result.counts)),
        ("versions", ", ".join(f"{name} {text}" for name, text in sorted(origin.versions.items()))),
        ("SHA-256 of the case", _hash(origin.case_sha256)),
        ("SHA-256 of the mesh", _hash(origin.mesh_sha256)),
        ("SHA-256 of the readings", _hash(origin.readings_sha256)),
        ("identity of the result", _hash(origin.identity)),
    ]
    return table(TextTable(("item", "value"), rows))


def _hash(text: str) -> Html:
    return tag("span", text or "-", class_="hash")


def _case(result: Result) -> Html:
    if not result.case_resolved:
        return Html("")
    return joined(
        [tag("h3", "The case, with defaults and overrides"), tag("pre", result.case_resolved)]
    )
