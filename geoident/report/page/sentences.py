"""The words and tables of the page, for engineers.

Units are those in which people wrote; what is not determined is said in words.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geoident.model.result import ParameterTable, Result
from geoident.report.page.html import Html, joined, table, tag
from geoident.report.text import certificate
from geoident.report.text.influence import HEADER, SIDES, influence_rows, influence_title
from geoident.report.text.layout import decimals, number
from geoident.report.text.members import HEADER as MEMBER_HEADER
from geoident.report.text.members import SIDES as MEMBER_SIDES
from geoident.report.text.members import extremes
from geoident.report.text.quantities import in_unit, prior_in_unit, shown_unit
from geoident.report.text.residuals import OUTLIER, outliers, rms, scored, standardized
from geoident.report.text.text import AS_PRIOR, NOT_DETERMINED, in_mm

_STATUS = {
    "converged": "The search converged",
    "not-converged": "The search did not converge: the values are the best found so far",
    "not-determined": "Not everything is determined by the readings",
    "out-of-budget": "The search ran out of its budget: the values are the best found so far",
    "done": "The computation is complete",
}


def summary(result: Result) -> Html:
    """The outcome in a few sentences."""
    sentences = [*_identified(result), *_values(result), *_fit(result), *_predicted(result)]
    return tag("p", " ".join(sentences), class_="lead")


def _identified(result: Result) -> list[str]:
    n, used = len(result.parameters.names), int(result.gauges.used.sum())
    status = _STATUS.get(result.status, result.status)
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
    known = [i for i in range(len(parameters.names)) if parameters.determined[i]]
    words = [_value_phrase(parameters, i) for i in known]
    unknown = [name for i, name in enumerate(parameters.names) if i not in known]
    said = ["; ".join(words) + "."] if words else []
    if unknown:
        said.append(f"The readings do not determine {', '.join(unknown)}.")
    return said


def _value_phrase(parameters: ParameterTable, i: int) -> str:
    value, low, high = _cells(parameters, i)
    unit = shown_unit(parameters.units[i], parameters.dimensions[i])
    interval = f" (95 %: {low} to {high})" if low != "-" else ""
    return f"{parameters.names[i]} = {value}{' ' + unit if unit else ''}{interval}"


def _fit(result: Result) -> list[str]:
    spread = rms(result)
    if math.isnan(spread):
        return []
    far = sum(outlier.used for outlier in outliers(result))
    count = {0: "none deviates", 1: "one deviates"}.get(far, f"{far} deviate")
    return [
        f"The readings that were used deviate from the computed ones by {spread:.2f} times their "
        f"standard deviation in the root mean square (about 1 if the accuracies are right); {count}"
        f" by more than {OUTLIER:g}."
    ]


def _predicted(result: Result) -> list[str]:
    inside, total = scored(result)
    if not total:
        return []
    return [f"Of {total} readings that were predicted, {inside} lie in their 95 % band."]


def warnings(result: Result) -> Html:
    """What an engineer must not overlook: how it ended, and what is not determined."""
    said = list(result.findings)
    if result.status in ("not-converged", "not-determined", "out-of-budget"):
        said.insert(0, result.reason)
    said += [
        f"{p} lies on its {side} bound."
        for p, side in _on_bounds(result.parameters)
        if not any(p in finding and "bound" in finding for finding in said)
    ]
    if not said:
        return Html("")
    return tag("div", *(tag("p", sentence) for sentence in said if sentence), class_="warn")


def _on_bounds(parameters: ParameterTable) -> list[tuple[str, str]]:
    return [
        (parameters.names[i], _nearer_bound(parameters, int(i)))
        for i in np.flatnonzero(parameters.at_bound)
    ]


def _nearer_bound(parameters: ParameterTable, i: int) -> str:
    value = parameters.values[i]
    near_lower = abs(value - parameters.lower[i]) <= abs(value - parameters.upper[i])
    return "lower" if near_lower else "upper"


def _cells(parameters: ParameterTable, i: int) -> tuple[str, str, str]:
    """Value and interval in the user's unit, in words where they are not determined."""
    if not parameters.determined[i]:
        return (AS_PRIOR if parameters.priors[i] else NOT_DETERMINED), "-", "-"
    unit = parameters.units[i], parameters.dimensions[i]
    value, low, high = (
        number(in_unit(float(column[i]), *unit))
        for column in (parameters.values, parameters.lower95, parameters.upper95)
    )
    return value, low, high


def parameter_table(parameters: ParameterTable) -> Html:
    """What was known of each parameter, and what is known now."""
    rows = [_parameter_row(parameters, i) for i in range(len(parameters.names))]
    header = ["parameter", "unit", "value", "95 % interval", "prior", "start", "bounds", "remark"]
    return table(header, rows, right="llrrrrrl")


def _parameter_row(parameters: ParameterTable, i: int) -> list[str]:
    unit = parameters.units[i], parameters.dimensions[i]
    value, low, high = _cells(parameters, i)
    start, lower, upper = (
        number(in_unit(float(column[i]), *unit))
        for column in (parameters.start, parameters.lower, parameters.upper)
    )
    prior = parameters.priors[i]
    return [
        parameters.names[i],
        shown_unit(*unit) or "-",
        value,
        f"{low} to {high}" if low != "-" else "-",
        prior_in_unit(prior, *unit).replace("+-", "±") if prior else "none",
        start,
        f"{lower} to {upper}",
        f"at its {_nearer_bound(parameters, i)} bound" if parameters.at_bound[i] else "",
    ]


def compared_parameters(results: Sequence[tuple[str, Result]]) -> Html:
    """The parameters of several results side by side."""
    tables = [result.parameters for _, result in results]
    names = list(dict.fromkeys(name for each in tables for name in each.names))
    rows = [_compared_row(name, tables) for name in names]
    header = ["parameter", "unit", *(label for label, _ in results)]
    return table(header, rows, right="ll" + "r" * len(results))


def _compared_row(name: str, tables: Sequence[ParameterTable]) -> list[str]:
    owner = next(each for each in tables if name in each.names)
    k = owner.names.index(name)
    cells = [_compared_cell(each, name) for each in tables]
    return [name, shown_unit(owner.units[k], owner.dimensions[k]) or "-", *cells]


def _compared_cell(parameters: ParameterTable, name: str) -> str:
    if name not in parameters.names:
        return "-"
    value, low, high = _cells(parameters, parameters.names.index(name))
    return f"{value} ({low} to {high})" if low != "-" else value


def compared_outcomes(results: Sequence[tuple[str, Result]]) -> Html:
    """How several results ended, side by side."""
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
    header = [
        "result",
        "command",
        "status",
        "method",
        "discrepancy",
        "readings used",
        "rms residual (sd)",
        "in 95 % band",
    ]
    return table(header, rows, right="llllrrrr")


def outlier_list(result: Result) -> Html:
    """The readings that stand out, in words."""
    found = outliers(result)
    if not found:
        return tag("p", f"No reading deviates by more than {OUTLIER:g} standard deviations.")
    items = [
        tag(
            "li",
            f"{o.channel}, {o.stage}: {o.residual:+.1f} standard deviations"
            f"{'' if o.used else ' (not used)'}",
        )
        for o in found[:20]
    ]
    more = [tag("li", f"and {len(found) - 20} more, see the table of readings")]
    return joined(
        [
            tag("p", f"Readings beyond {OUTLIER:g} standard deviations (measured minus computed):"),
            tag("ul", *items, *(more if len(found) > 20 else [])),
        ]
    )


def influence_table(result: Result) -> Html:
    """The readings that bear most on the answer."""
    title = influence_title(result).replace("\n", ". ")
    found = table(HEADER, influence_rows(result), right=SIDES, caption=title)
    note = (
        "Leverage: how far the reading decides alone, 0 to 1. Changes most, by sd: the parameter "
        "that would move most without the reading, in its standard deviations."
    )
    return joined([found, tag("p", note, class_="note")]) if found else found


def reading_table(result: Result) -> Html:
    """Every reading that is measured or predicted."""
    table_, prediction = result.gauges, result.prediction
    shown = np.isfinite(table_.measured)
    if prediction is not None:
        shown |= np.isfinite(prediction.mean)
    rows = [_reading_row(result, int(i), int(j)) for j, i in np.argwhere(shown.T)]
    header = ["gauge", "stage", "measured", "computed", "95 % band", "residual", "in sd", ""]
    return table(header, rows, right="llrrrrrl")


def certificate_table(result: Result) -> Html:
    """What kind of answer identified yield limits are, and what their planes do."""
    found = result.certificate
    if found is None:
        return Html("")
    said = tag("p", " ".join(certificate.sentences(found)))
    rows, right = certificate.plane_rows(found), certificate.sides(found)
    return joined([said, table(certificate.header(found), rows, right=right)])


def structure_table(result: Result) -> Html:
    """The extremes of the forces in linings and bolts."""
    rows = extremes(result.members)
    return table(MEMBER_HEADER, rows, right=MEMBER_SIDES) if rows else Html("")


def _reading_row(result: Result, i: int, j: int) -> list[str]:
    gauges, prediction = result.gauges, result.prediction
    predicted = (
        prediction is not None and np.isfinite(prediction.mean[i, j]) and not gauges.used[i, j]
    )
    determined = not predicted or (prediction is not None and np.isfinite(prediction.sd[i, j]))
    measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
    band = "-"
    if predicted and determined and prediction is not None:
        ends = (prediction.lower95[i, j], prediction.upper95[i, j])
        band = " to ".join(in_mm(float(end), result) for end in ends)
    state = "used" if gauges.used[i, j] else "predicted" if predicted else "not used"
    state = "known to be wrong" if gauges.bad[i, j] else state
    return [
        gauges.channels[i],
        gauges.stages[j],
        in_mm(measured, result),
        in_mm(computed, result) if determined else NOT_DETERMINED,
        band,
        in_mm(measured - computed, result) if determined else "-",
        decimals(float(standardized(result)[i, j]), 1),
        state,
    ]


def provenance_table(result: Result) -> Html:
    """Where the result comes from, so that it can be made again."""
    origin = result.provenance
    versions = ", ".join(f"{name} {text}" for name, text in sorted(origin.versions.items()))
    counts = result.counts
    rows = [
        ["command", f"geoident {origin.command}"],
        ["case", origin.case_file],
        ["result written", origin.created],
        ["seed", str(origin.seed)],
        ["status", f"{result.status} (exit code {int(result.exit_code)})"],
        ["why it ended", result.reason or "-"],
        ["discrepancy", number(result.objective)],
        [
            "cost",
            f"{counts.evaluations} evaluations, {counts.factorizations} factorizations, "
            f"{counts.solves} solves",
        ],
        ["versions", versions],
        ["SHA-256 of the case", tag("span", origin.case_sha256 or "-", class_="hash")],
        ["SHA-256 of the mesh", tag("span", origin.mesh_sha256 or "-", class_="hash")],
        ["SHA-256 of the readings", tag("span", origin.readings_sha256 or "-", class_="hash")],
        ["identity of the result", tag("span", origin.identity or "-", class_="hash")],
    ]
    return table(["item", "value"], rows)
