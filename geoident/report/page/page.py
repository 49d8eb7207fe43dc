"""The report: one page that holds everything and loads nothing.

The same results give the same page, byte for byte: there is no time of day in it but that of the
results. Words and tables come from `report.text`, figures from `report.drawing`; here they are put
together as HTML.
"""

from __future__ import annotations

from dataclasses import replace

from geoident.io.text.yaml_writer import compact_text
from geoident.model.results.head import NO_HEAD, ReportHead
from geoident.model.results.plan import GaugePlan
from geoident.model.results.result import Labelled, Result
from geoident.model.results.sections import section_uses
from geoident.report.drawing.album import Album, album, comparison
from geoident.report.drawing.model.figure import model_pictures
from geoident.report.drawing.opening import opening_pictures
from geoident.report.drawing.style import Picture, svg_files
from geoident.report.page import in_service
from geoident.report.page.blocks import Block, Draw, Figures, PagePart, TitledTable, section
from geoident.report.page.headed import headed_page
from geoident.report.page.html import Html, joined, table, tag
from geoident.report.text import (
    accuracies,
    alarms,
    backtest,
    decisions,
    extent,
    interfaces,
    left_out,
    plan,
    posterior,
    rivals,
    safety,
    structures,
    trough,
    updates,
    varied,
    yielding,
)
from geoident.report.text import in_service as words
from geoident.report.text.case import case_entries, case_title, of_tests
from geoident.report.text.errors import model_error, surface
from geoident.report.text.gauges import few_of, read_or_predicted, reading_table, unit_title
from geoident.report.text.inputs.construction import construction_table, load_texts
from geoident.report.text.inputs.materials import ground_sentences, materials_table
from geoident.report.text.inputs.numbers import ShownNumbers, entries
from geoident.report.text.inputs.structures import (
    interfaces_table,
    structures_table,
    supports_table,
)
from geoident.report.text.layout import TextTable, number
from geoident.report.text.parameters import compared_parameters, parameter_table
from geoident.report.text.residuals import (
    OUTLIER,
    has_unexplained,
    in_sd_note,
    influence_table,
    influence_title,
    outliers,
)
from geoident.report.text.result import compared_outcomes, counts_text, outcome_sentences, warnings

_MOST_OUTLIERS = 20

_SMALL = ("one-to-one", "correlation")
"""Figures that find room beside each other."""

_MOST_RUNS = 4
"""Results of a comparison up to which each has figures of its own."""


def report_page(
    results: Labelled, head: ReportHead = NO_HEAD, *, logo: bytes = b"", draw: Draw = svg_files
) -> str:
    """The report of one result, or of several with a comparison first.

    Args:
        results: labels (such as file names) and results.
        head: what it says of itself.
        logo: content of the file of the logo.
        draw: makes the figures.
    """
    if len(results) == 1:
        ((label, result),) = results
        title = case_title(result) or label
        sections = _parts(result)
    else:
        title = "Comparison of " + ", ".join(label for label, _ in results)
        sections = _compared(results)
    origins = [(one.provenance.created, one.provenance.versions) for _, one in results]
    return headed_page(title, origins, sections, draw, head, logo)


def _compared(results: Labelled) -> tuple[PagePart, ...]:
    """What several results say side by side; of each alone, what is not said so."""
    few = len(results) <= _MOST_RUNS
    runs = [_run(n, label, result, few=few) for n, (label, result) in enumerate(results, 1)]
    return (
        section("Outcomes", TitledTable("Outcomes", compared_outcomes(results))),
        section(
            "Parameters side by side",
            TitledTable("Parameters with their 95 % intervals", compared_parameters(results)),
            Figures(comparison(results)),
        ),
        PagePart("Each result", (), tuple(run for run in runs if run)),
        PagePart("Provenance", (), _provenances(results), appendix=True),
    )


def _run(number: int, label: str, result: Result, *, few: bool) -> PagePart:
    """What one of several results says."""
    title = case_title(result)
    every = album(result, prefix=f"{number}-").all if few else ()
    kept = tuple(p for p in every if p.name.endswith(("-overview", "-residuals")))
    body = section(
        f"{label}: {title}" if title else label,
        tag("p", " ".join(outcome_sentences(result))),
        _warnings(result),
        Figures(kept),
    )
    return replace(body, name=f"result-{number}")


def _provenances(results: Labelled) -> tuple[PagePart, ...]:
    return tuple(
        replace(section(label, _provenance(result)), name=f"provenance-{number}")
        for number, (label, result) in enumerate(results, start=1)
    )


def _parts(result: Result) -> tuple[PagePart, ...]:
    """All sections of one result."""
    if result.plan is not None:
        return _plan(result, result.plan)
    pictures = album(result)
    # figures for those who want to know how the answer was found, and what pairs say better
    pairs = any(p.name == "pairs" for p in pictures.parameters)
    names = {"history", "correlation"} if pairs else {"history"}
    search = tuple(p for p in pictures.quality if p.name in names)
    fit = [p for p in pictures.quality if p not in search]
    ends = result.at_ends
    tested, backtested = _backtest(result), result.kind == "backtest"
    readings = reading_table(result)
    return (
        section("Status", *in_service.status(result))
        or section(
            "Summary",
            tag("p", " ".join(outcome_sentences(result)), class_="lead"),
            _warnings(result),
            Figures(pictures.overview),
        ),
        _model(result, pictures),
        section(
            "Parameters",
            TitledTable("Parameters", parameter_table(result.parameters)),
            Figures(pictures.parameters),
        ),
        section(varied.TITLE, TitledTable(varied.TITLE, varied.varied_table(result.varied))),
        section(posterior.TITLE, *_posterior(result)),
        section(
            accuracies.TITLE,
            TitledTable(accuracies.TITLE, accuracies.accuracies_table(result.accuracies)),
        ),
        section(rivals.MODELS_TITLE, *_models(result)),
        section(model_error.TITLE, _paragraph(model_error.model_error_text(result.model_error))),
        section(surface.TITLE, *_surface(result)),
        section(rivals.TITLE, TitledTable(rivals.TITLE, rivals.rivals_table(result))),
        section(
            left_out.TITLE, TitledTable(left_out.TITLE, left_out.left_out_table(result.left_out))
        ),
        section(words.TITLE, *in_service.effects(result)),
        section("Changes", *in_service.changed(result)),
        section(words.later_title(result), *in_service.later(result)),
        section(words.POWER_TITLE, *in_service.power(result)),
        section(
            alarms.NAME,
            TitledTable(alarms.NAME, alarms.alarm_table(result)),
            TitledTable(alarms.BY_STAGE, alarms.stage_table(result)),
            _paragraph(alarms.alarm_note(result), class_="note"),
        ),
        section(
            decisions.NAME,
            TitledTable(decisions.NAME, decisions.decision_table(result)),
            TitledTable(decisions.TELLING, decisions.telling_table(result)),
            _paragraph(decisions.NOTE if result.telling else "", class_="note"),
        ),
        section(safety.NAME, *_safety(result, pictures)),
        section(trough.NAME, *_troughs(result)),
        section(updates.TITLE, *_updates(result), Figures(pictures.updates)),
        section("Gauges", Figures(tuple(p for p in pictures.readings if p.name != "signs"))),
        section(
            "Displacements and stresses",
            Figures(tuple(p for p in pictures.fields if not (result.safety and _fails(p)))),
        ),
        section(
            "How well it fits",
            _outliers(result) if pictures.quality else Html(""),
            *_influence(result),
            Figures(tuple(sorted(fit, key=lambda p: p.name not in _SMALL))),
        ),
        section(extent.NAME, TitledTable(extent.UNITS, extent.extent_table(ends.yielded))),
        section(yielding.TITLE, *_yield_planes(ends)),
        section(structures.NAME, *_strength(result), Figures(pictures.structures)),
        section(
            backtest.TITLE, *(tested if backtested else tested[:1]), Figures(pictures.backtest)
        ),
        section(
            "All readings",
            TitledTable(
                unit_title("Readings", result.gauges, few_of(int(read_or_predicted(result).sum()))),
                readings,
            ),
            _paragraph(
                in_sd_note(result, predictions=True) if readings.rows else "", class_="note"
            ),
            appendix=True,
        ),
        section(
            "Readings outside of their bands",
            TitledTable("Readings outside of their 95 % bands", words.outside_table(result)),
            appendix=True,
        ),
        section("Predictions tested", *(() if backtested else tested), appendix=True),
        section("Course of the search", Figures(search), appendix=True),
        section(
            f"All {structures.NAME.lower()}",
            *(
                TitledTable(title, structures.force_table(ends.members, per_metre=linings))
                for title, linings in (
                    (structures.LININGS_TITLE, True),
                    (structures.BARS_TITLE, False),
                )
            ),
            TitledTable(structures.SHELLS_TITLE, structures.shell_table(ends.shells)),
            TitledTable(interfaces.TITLE, interfaces.interface_table(ends.interfaces)),
            appendix=True,
        ),
        section(
            "Reactions of supports",
            *(
                TitledTable(structures.REACTIONS_TITLE, one)
                for one in structures.reaction_tables_by_stage(ends.reactions)
            ),
            appendix=True,
        ),
        section("Notes", joined([tag("p", note) for note in result.notes if note]), appendix=True),
        section("Provenance", _provenance(result), appendix=True),
        section("Case file", *_case(result), appendix=True),
    )


def _plan(result: Result, chosen: GaugePlan) -> tuple[PagePart, ...]:
    """All sections of a plan of gauges."""
    pictures = (*model_pictures(result), *opening_pictures(result)[:1])
    return (
        section(
            "Summary",
            tag("p", " ".join(outcome_sentences(result)), class_="lead"),
            Figures(pictures),
        ),
        section(
            plan.NAME,
            TitledTable(plan.NAME, plan.gauge_table(chosen)),
            TitledTable(plan.TARGETS, plan.target_table(chosen)),
            tag("p", plan.NOTE, class_="note"),
        ),
        section("Parameters", TitledTable("Parameters", parameter_table(result.parameters))),
        section("Notes", joined([tag("p", note) for note in result.notes])),
        section("Provenance", _provenance(result), appendix=True),
        section("Case file, with the gauges to take", *_case(result), appendix=True),
    )


def _model(result: Result, pictures: Album) -> PagePart:
    """What was computed: ground, construction, structures, supports, and what is positive.

    Tables go before figures, since they fill what is left of a printed page.
    """
    case = case_entries(result.case_resolved)
    numbers = ShownNumbers(entries(case, "parameters"), result.parameters)
    materials = TitledTable(
        "Materials, identified constants with 95 % intervals", materials_table(case, numbers)
    )
    if of_tests(result):
        return section("Model", materials)
    sentences = [tag("p", text) for text in ground_sentences(case, numbers)]
    if result.in_service:
        loads = load_texts(entries(case, "loads"), numbers)
        sentences += [tag("p", f"Load {text}.") for text in loads]
    return section(
        "Model",
        materials,
        joined(sentences),
        TitledTable("Construction", construction_table(case, numbers)),
        TitledTable("Structures", structures_table(case, numbers)),
        TitledTable("Interfaces", interfaces_table(case, numbers)),
        TitledTable("Supports", supports_table(case, numbers)),
        Figures((*pictures.model, *(p for p in pictures.readings if p.name == "signs"))),
    )


def _paragraph(text: str, **attributes: str) -> Html:
    """A paragraph; nothing of nothing."""
    return tag("p", text, **attributes) if text else Html("")


def _surface(result: Result) -> tuple[Block, ...]:
    """The leave-one-out error of the runs, and its table."""
    if result.surface is None:
        return ()
    words = tag("p", surface.surface_words(result.surface))
    return words, TitledTable(surface.TITLE, surface.surface_table(result.surface))


def _posterior(result: Result) -> tuple[Block, ...]:
    """How reliable the draws are, and their table."""
    if result.posterior is None:
        return ()
    cost = tag("p", posterior.cost_sentence(result.posterior))
    return cost, TitledTable("Posterior", posterior.posterior_table(result))


def _models(result: Result) -> tuple[Block, ...]:
    compared = result.comparison
    if compared is None:
        return ()
    remarks = tag("ul", *(tag("li", text) for text in compared.sentences))
    models = TitledTable(rivals.MODELS_TITLE, rivals.models_table(compared))
    return models, remarks, tag("p", rivals.MODELS_LEGEND)


def _warnings(result: Result) -> Html:
    sentences = warnings(result)
    return (
        tag("div", *(tag("p", text) for text in sentences), class_="warn")
        if sentences
        else Html("")
    )


def _outliers(result: Result) -> Html:
    """The readings that stand out, in words."""
    readings = outliers(result)
    left = "unexplained residual" if has_unexplained(result, predictions=True) else "residual"
    if not readings:
        return tag("p", f"No {left} exceeds {OUTLIER:g} standard deviations.")
    items = [
        f"{o.channel}, {o.stage}: {o.residual:+.1f} standard deviations"
        f"{'' if o.used else ' (not used)'}"
        for o in readings[:_MOST_OUTLIERS]
    ]
    if len(readings) > _MOST_OUTLIERS:
        items.append(f"and {len(readings) - _MOST_OUTLIERS} more, see the table of readings")
    words = (
        f"{left.capitalize()}s (measured minus computed) beyond {OUTLIER:g} standard deviations:"
    )
    return joined([tag("p", words), tag("ul", *(tag("li", item) for item in items))])


def _influence(result: Result) -> tuple[Block, ...]:
    """The most influential readings."""
    influence = influence_table(result)
    if not influence.rows:
        return ()
    note = (
        "Leverage: share of its own fitted value that the reading decides, 0 to 1. Changes most, "
        "by sd: the parameter that the reading moves most, in standard deviations of the parameter."
    )
    title = influence_title(result.diagnostics).replace("\n", ". ")
    return TitledTable(title, influence), tag("p", note, class_="note")


def _fails(picture: Picture) -> bool:
    """Whether a figure shows a mechanism."""
    return picture.name.endswith("mechanism")


def _safety(result: Result, pictures: Album) -> tuple[Block, ...]:
    """Factors of safety, what is to be known of each, and the mechanism of the smallest."""
    if not result.safety:
        return ()
    names = result.parameters.names
    words = [tag("p", " ".join(safety.stage_sentences(one, names))) for one in result.safety]
    return (
        TitledTable(safety.NAME, safety.safety_table(result.safety)),
        joined(words),
        Figures(tuple(p for p in pictures.fields if _fails(p))),
    )


def _troughs(result: Result) -> tuple[Block, ...]:
    """Troughs over tunnels, and what the columns of their table mean."""
    table = trough.trough_table(result)
    if not table.rows:
        return ()
    return TitledTable(trough.NAME, table), _paragraph(trough.trough_note(table), class_="note")


def _updates(result: Result) -> tuple[Block, ...]:
    """What the updates judged, and what the last one did."""
    table = updates.updates_table(result)
    if not table.rows:
        return ()
    return (
        tag("p", updates.update_sentence(result)),
        TitledTable(updates.TITLE, table),
        tag("p", updates.NOTE, class_="note"),
        TitledTable(updates.JUDGED_TITLE, updates.judged_table(result)),
        TitledTable(updates.PARAMETERS_TITLE, updates.parameters_table(result)),
    )


def _strength(result: Result) -> tuple[Block, ...]:
    """Where the strength of linings is used most, as far as the case gives it."""
    table = structures.strength_table(section_uses(result.members, result.shells))
    if not table.rows:
        return ()
    note = tag("p", structures.STRENGTH_NOTE, class_="note")
    return TitledTable("Strength of linings, where most of it is used", table), note


def _yield_planes(result: Result) -> tuple[Block, ...]:
    """What kind of answer identified yield limits are, and what their planes do."""
    certificate = result.certificate
    if certificate is None:
        return ()
    words = tag("p", " ".join(yielding.certificate_sentences(certificate)))
    return words, TitledTable(yielding.TITLE, yielding.plane_table(certificate))


def _backtest(result: Result) -> tuple[Block, ...]:
    """How predictions of stages that were read came true, in tables."""
    predictions = result.backtest
    if predictions is None or not predictions.steps:
        return ()
    if result.kind != "backtest":
        tested = backtest.tested_words(predictions)
        words = f"{tested[0].upper()}{tested[1:]}, predicted from the readings of those before."
        return tag("p", words), TitledTable("Predictions", backtest.prediction_table(result))
    horizons = backtest.horizons_table(predictions)
    ahead = f"{backtest.ERRORS_TITLE}: further ahead, last fitted > predicted stage"
    return (
        TitledTable("Fits of the readings up to each stage", backtest.fits_table(result)),
        TitledTable("Predictions against later readings", backtest.scores_table(predictions)),
        *([TitledTable(backtest.HORIZONS_TITLE, horizons)] if horizons.rows else []),
        TitledTable(f"{backtest.ERRORS_TITLE}: next stage", backtest.errors_table(result)),
        TitledTable(ahead, backtest.errors_table(result, ahead=False)),
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
        ("fingerprint of the result", _hash(result.fingerprint)),
        *([("made from the fit", origin.fit_file)] if origin.fit_file else []),
    ]
    return table(TextTable(("item", "value"), rows))


def _hash(text: str) -> Html:
    return tag("span", text or "-", class_="hash")


def _case(result: Result) -> tuple[Html, ...]:
    text, entries_of = result.case_resolved, case_entries(result.case_resolved)
    if entries_of:
        text = compact_text(entries_of)
    return (tag("p", "With defaults and overrides."), tag("pre", text)) if text else ()
