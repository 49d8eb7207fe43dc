"""A result in words: tables for a terminal, sentences for the page.

Pure functions of a result. Numbers stand in the units in which the user wrote them, readings in
those of their channels. What is not determined is said in words, never shown as a number.
"""

from __future__ import annotations

import math

import numpy as np

from geoident.model.results.costs import Counts
from geoident.model.results.findings import sentences_of
from geoident.model.results.result import Labelled, Result
from geoident.model.results.sections import section_uses
from geoident.model.results.summary import Identifiability
from geoident.report.text import (
    accuracies,
    alarms,
    backtest,
    decisions,
    extent,
    in_service,
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
from geoident.report.text.errors import model_error, surface
from geoident.report.text.gauges import fit_table, fit_title, prediction_table, prediction_title
from geoident.report.text.layout import (
    TextTable,
    bullets,
    decimals,
    number,
    section,
    sections,
    sentence,
)
from geoident.report.text.parameters import (
    AS_PRIOR,
    NOT_DETERMINED,
    grid_text,
    nearer_bound,
    parameters_text,
    unknown_words,
    value_sentence,
)
from geoident.report.text.residuals import (
    OUTLIER,
    in_sd_note,
    influence_table,
    influence_title,
    outliers,
    rms,
    scored,
    shares_errors,
)

_STATUS = {
    "converged": "The search converged",
    "not-converged": "The search did not converge: the values are the best found so far",
    "not-determined": "The readings do not determine all parameters",
    "poor-fit": "The model does not fit the readings: parameters and bands are not to be relied on",
    "out-of-budget": "The search ran out of its budget: the values are the best found so far",
    "done": "The computation is complete",
    "bands-fail": "Later readings do not lie inside the bands as they should",
}

_UNHAPPY = ("not-converged", "not-determined", "poor-fit", "out-of-budget", "bands-fail")


def result_text(result: Result, *, title: str = "") -> str:
    """All of a result that fits a terminal.

    Args:
        result: what to show.
        title: the first line, such as its path.
    """
    result = result.for_people
    ends = result.at_ends
    return sections(
        "\n".join(part for part in (title, head(result)) if part),
        _parameters(result),
        section(varied.TITLE, varied.varied_text(result.varied)),
        section(accuracies.TITLE, accuracies.accuracies_table(result.accuracies).text),
        section(model_error.TITLE, sentence(model_error.model_error_text(result.model_error))),
        section(
            surface.TITLE,
            surface.surface_table(result.surface).text,
            sentence(surface.surface_words(result.surface)),
        ),
        section("Findings", bullets(sentences_of(result.findings))),
        section(updates.TITLE, *updates.parts(result)),
        section(rivals.MODELS_TITLE, *rivals.models_parts(result.comparison)),
        section(rivals.TITLE, rivals.rivals_table(result).text),
        section(yielding.TITLE, yielding.certificate_text(ends.certificate)),
        *in_service.parts(result),
        section(fit_title(result), *_fit_parts(result)),
        section(influence_title(result.diagnostics), influence_table(result).text),
        section(left_out.TITLE, left_out.left_out_table(result.left_out).text),
        section(prediction_title(result), prediction_table(result).text),
        section(alarms.NAME, *alarms.alarm_parts(result)),
        section(plan.NAME, *plan.plan_parts(result.plan)),
        section(decisions.NAME, *decisions.decision_parts(result)),
        section(safety.NAME, *safety.parts(result)),
        section(trough.NAME, *_troughs(result)),
        section(structures.TITLE, structures.force_table(ends.members).text),
        section(structures.SHELLS_TITLE, structures.shell_table(ends.shells).text),
        section(interfaces.TITLE, interfaces.interface_table(ends.interfaces).text),
        section(structures.REACTIONS_TITLE, structures.reaction_table(ends.reactions).text),
        section(extent.TITLE, extent.extent_table(ends.yielded).text),
        section("Scan", grid_text(result)),
        backtest.backtest_text(result),
        section("Notes", bullets(result.notes)),
        f"Cost: {counts_text(result.counts)}" if result.counts.evaluations else "",
    )


def summary_text(result: Result) -> str:
    """The outcome in a few lines, for the end of a run."""
    result = result.for_people
    parts = (
        head(result),
        _parameters_in_words(result) if result.plan is None else "",
        section(f"{in_service.TITLE}:", in_service.effects_table(result).text),
        section(f"{in_service.later_title(result)}:", in_service.judged_table(result).text),
        section(f"{in_service.POWER_TITLE}:", in_service.power_table(result).text),
        section(f"{varied.TITLE}:", varied.varied_text(result.varied)),
        section(f"{rivals.MODELS_TITLE}:", *rivals.models_parts(result.comparison)),
        section(f"{accuracies.TITLE}:", accuracies.accuracies_table(result.accuracies).text),
        backtest.backtest_text(result) if result.kind == "backtest" else "",
        section(f"{left_out.TITLE}:", left_out.left_out_table(result.left_out).text),
        *(
            (plan.gauge_table(result.plan).text, plan.target_table(result.plan).folded(1))
            if result.plan is not None
            else ()
        ),
        sentence(_model_error(result)),
        sentence(extent.extent_sentence(result.yielded)),
        sentence(updates.update_sentence(result)),
        bullets(sentences_of(result.findings)),
    )
    return "\n".join(part for part in parts if part)


def _model_error(result: Result) -> str:
    """How well the model describes the ground, unless a finding says it."""
    error = result.model_error
    found = any(finding.kind == "model-error" for finding in result.findings)
    return "" if error is None or found else error.sentence


def _fit_parts(result: Result) -> tuple[str, ...]:
    """The table of the readings of the fit, and what its residuals are divided by."""
    table = fit_table(result).text
    return (table, sentence(in_sd_note(result))) if table else ()


def _troughs(result: Result) -> tuple[str, ...]:
    """The table of troughs, and what its columns mean."""
    table = trough.trough_table(result)
    return (table.filled.text, sentence(trough.trough_note(table))) if table.rows else ()


def _parameters_in_words(result: Result) -> str:
    """The parameters with their intervals; of a sample the table of its draws."""
    if result.posterior is not None:
        return posterior.posterior_table(result).text
    return parameters_text(result.parameters, result.certificate)


def _parameters(result: Result) -> str:
    """The parameters under a heading, and how reliable draws of them are."""
    estimates = _parameters_in_words(result)
    if result.posterior is None:
        return section("Parameters", estimates)
    return section(posterior.TITLE, estimates, sentence(posterior.cost_sentence(result.posterior)))


_ALONE = (
    "These intervals follow from the stated accuracies alone. A fit also estimates the errors of "
    "the model and of the mesh, which make the intervals wider."
)


def plan_text(case: str, plan: Identifiability) -> str:
    """What planned gauges could determine, at the start values."""
    where = ", those that the case lists, each at its date" if plan.listed else ""
    return sections(
        f"{case}: {plan.readings} planned readings{where}",
        section("Parameters at their start values, with the intervals to expect",
                parameters_text(plan.parameters), sentence(_ALONE)),
        section("Findings", bullets(sentences_of(plan.findings))),
    )  # fmt: skip


def head(result: Result) -> str:
    """How it ended, by which method and why."""
    method = f" by {result.method}" if result.method and result.kind != "predict" else ""
    reason = f": {result.reason}" if result.reason else ""
    return sentence(f"{result.status}{method}{reason}")


def counts_text(counts: Counts) -> str:
    """What it cost."""
    steps = f" in {counts.iterations} iterations" if counts.iterations else ""
    return (
        f"{counts.evaluations} evaluations, {counts.factorizations} factorizations,"
        f" {counts.solves} solves{steps}"
    )


def outcome_sentences(result: Result) -> list[str]:
    """The outcome in a few sentences."""
    if result.plan is not None:
        return plan.plan_sentences(result.plan)
    return [
        *_identified(result),
        *(safety.stage_sentences(one, result.parameters.names)[0] for one in result.safety),
        *_values(result),
        *_fit(result),
        *filter(None, [_model_error(result)]),
        *_predicted(result),
        *filter(
            None,
            [
                trough.trough_sentence(result),
                structures.strength_sentence(section_uses(result.members, result.shells)),
                alarms.alarm_sentence(result),
            ],
        ),
    ]


def _identified(result: Result) -> list[str]:
    n, used = len(result.parameters.names), int(result.gauges.used.sum())
    status = _STATUS.get(result.status, result.status)
    if result.kind == "backtest":
        return [f"{status}. {result.reason}"]
    if result.in_service:
        return in_service.outcome_sentences(result)
    if result.kind != "fit" or not used:
        return [f"{status}."]
    stages = [
        result.gauges.stages[stage] for stage in np.flatnonzero(result.gauges.used.any(axis=0))
    ]
    during = stages[0] if len(stages) == 1 else f"{stages[0]} to {stages[-1]}"
    what = "1 parameter was" if n == 1 else f"{n} parameters were"
    return [f"{what} identified from {used} readings ({during}) by {result.method}.", f"{status}."]


def _values(result: Result) -> list[str]:
    parameters = result.parameters
    known = np.flatnonzero(parameters.determined)
    unknown: dict[str, list[str]] = {}
    for i in np.flatnonzero(~parameters.determined).tolist():
        unknown.setdefault(unknown_words(parameters, i), []).append(parameters.names[i])
    sentences = (
        ["; ".join(value_sentence(parameters, int(i)) for i in known) + "."] if len(known) else []
    )
    if NOT_DETERMINED in unknown:
        sentences.append(f"The readings do not determine {', '.join(unknown[NOT_DETERMINED])}.")
    if AS_PRIOR in unknown:
        names = unknown[AS_PRIOR]
        whose = "is known only from its prior" if len(names) == 1 else "are known only from priors"
        sentences.append(f"{', '.join(names)} {whose}.")
    return sentences


def _fit(result: Result) -> list[str]:
    spread = rms(result)
    if math.isnan(spread):
        return []
    far = sum(outlier.used for outlier in outliers(result))
    count = {0: "no reading exceeds", 1: "one reading exceeds"}.get(far, f"{far} readings exceed")
    if result.kind == "backtest":
        return [
            f"The root mean square of the errors of the predictions of the next stage is "
            f"{_size(spread)} of their standard deviations (about 1 if the bands are right); "
            f"{count} {OUTLIER:g} standard deviations."
        ]
    left = "the unexplained residuals" if shares_errors(result) else "the residuals"
    return [
        f"The root mean square of {left} is {_size(spread)} of their standard deviations "
        f"(about 1 if {_what_is_assumed(result)}); "
        f"{count} {OUTLIER:g} standard deviations."
    ]


def _what_is_assumed(result: Result) -> str:
    if result.model_error is not None:
        return "the accuracies and the model error are right"
    return "the accuracies are right"


def _size(spread: float) -> str:
    return f"{spread:.2f}" if spread < 1000.0 else number(spread)


def _predicted(result: Result) -> list[str]:
    inside, total = scored(result)
    if not total:
        return []
    return [f"{inside} of {total} predicted readings lie within their 95 % bands."]


def warnings(result: Result) -> list[str]:
    """What an engineer must not overlook: how it ended, and what is not determined."""
    table = result.parameters
    named = {finding.subject for finding in result.findings if finding.kind == "at-bound"}
    on_bound = [i for i in np.flatnonzero(table.at_bound).tolist() if table.names[i] not in named]
    return [
        *([result.reason] if result.status in _UNHAPPY and result.reason else []),
        *sentences_of(result.findings),
        *(f"{table.names[i]} lies on its {nearer_bound(table, i)} bound." for i in on_bound),
    ]


def compared_outcomes(results: Labelled) -> TextTable:
    """How several results (with their labels) ended, side by side."""
    rows = []
    for label, result in results:
        inside, total = scored(result)
        rows.append(
            [
                label,
                result.kind,
                result.status,
                result.method or "-",
                number(result.objective),
                str(int(result.gauges.used.sum())),
                decimals(rms(result), 2),
                f"{inside} of {total}" if total else "-",
            ]
        )
    header = (
        "result",
        "command",
        "status",
        "method",
        "misfit",
        "readings used",
        "rms residual (sd)",
        "in 95 % band",
    )
    return TextTable(header, rows, right="llllrrrr")
