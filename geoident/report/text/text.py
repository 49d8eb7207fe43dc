"""Results as plain text tables, for people at a terminal.

Pure functions of a result. Numbers stand in the units in which the user wrote them; readings in mm.
What is not determined is said in words, never shown as a number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geoident.model.certificate import Certificate
from geoident.model.parameter import Parameter
from geoident.model.result import Counts, GaugeTable, Grid, Iteration, ParameterTable, Result
from geoident.model.summary import Identifiability
from geoident.report.text.certificate import TITLE as CERTIFICATE
from geoident.report.text.certificate import certificate_text, least_text
from geoident.report.text.influence import influence_text, influence_title
from geoident.report.text.layout import (
    bullets,
    decimals,
    number,
    section,
    sections,
    sentence,
    table,
)
from geoident.report.text.members import TITLE, members_text
from geoident.report.text.quantities import in_unit, prior_in_unit, shown_unit

NOT_DETERMINED = "not determined"
AS_PRIOR = "as its prior"


def result_text(result: Result, *, title: str = "") -> str:
    """All of a result that fits a terminal.

    Args:
        result: what to show.
        title: the first line, such as its path.
    """
    return sections(
        "\n".join(part for part in (title, head(result)) if part),
        section("Parameters", parameters_text(result.parameters, result.certificate)),
        section("Findings", bullets(result.findings)),
        section(CERTIFICATE, certificate_text(result.certificate)),
        section(_fit_title(result), fit_text(result)),
        section(influence_title(result), influence_text(result)),
        section("Predictions (mm, 95 % band)", predictions_text(result)),
        section(TITLE, members_text(result.members)),
        section("Scan", grid_text(result)),
        section("Notes", bullets(result.notes)),
        cost(result.counts),
    )


def plan_text(case: str, plan: Identifiability) -> str:
    """What planned gauges could determine, at the start values."""
    return sections(
        f"{case}: {plan.readings} planned readings",
        section("Parameters at their start values, as the gauges could know them",
                parameters_text(plan.parameters)),
        section("Findings", bullets(plan.findings)),
    )  # fmt: skip


def summary_text(result: Result) -> str:
    """The outcome in a few lines, for the end of a run."""
    return "\n".join(
        part
        for part in (
            head(result),
            parameters_text(result.parameters, result.certificate),
            bullets(result.findings),
        )
        if part
    )


def head(result: Result) -> str:
    """How it ended, by which method and why."""
    method = f" by {result.method}" if result.method and result.kind != "predict" else ""
    reason = f": {result.reason}" if result.reason else ""
    return sentence(f"{result.status}{method}{reason}")


def parameters_text(parameters: ParameterTable, proof: Certificate | None = None) -> str:
    """One line for each parameter: value, 95 % interval, unit, and what else is to be known."""
    rows = [_parameter_row(parameters, i, proof) for i in range(len(parameters.names))]
    if not rows:
        return ""
    return table(["name", "value", "95 % interval", "unit", "remarks"], rows, right="lrl")


def _parameter_row(parameters: ParameterTable, i: int, proof: Certificate | None) -> list[str]:
    unit, dimension = parameters.units[i], parameters.dimensions[i]
    value, low, high = (
        number(in_unit(float(column[i]), unit, dimension))
        for column in (parameters.values, parameters.lower95, parameters.upper95)
    )
    interval = "" if low == "-" else f"{low} .. {high}"
    if not parameters.determined[i]:
        value, interval = (AS_PRIOR if parameters.priors[i] else NOT_DETERMINED), ""
    shown = shown_unit(unit, dimension)
    return [parameters.names[i], value, interval, shown, _remarks(parameters, i, proof)]


def _remarks(parameters: ParameterTable, i: int, proof: Certificate | None) -> str:
    remarks = [text] if (text := least_text(proof, parameters, i)) else []
    if parameters.at_bound[i]:
        remarks.append(f"at {_bound(parameters, i)} bound")
    if parameters.priors[i]:
        text = prior_in_unit(parameters.priors[i], parameters.units[i], parameters.dimensions[i])
        remarks.append(f"prior {text}")
    return ", ".join(remarks)


def _bound(parameters: ParameterTable, i: int) -> str:
    value = parameters.values[i]
    nearer_lower = abs(value - parameters.lower[i]) <= abs(value - parameters.upper[i])
    return "lower" if nearer_lower else "upper"


def _fit_title(result: Result) -> str:
    used = np.count_nonzero(result.gauges.used)
    phi = "" if math.isnan(result.objective) else f", discrepancy {number(result.objective)}"
    return f"Readings (mm; {used} used{phi})"


def fit_text(result: Result) -> str:
    """Measured and computed readings, without those that stand among the predictions."""
    gauges = result.gauges
    shown = np.isfinite(gauges.measured)
    if result.prediction is not None:
        shown &= gauges.used | ~np.isfinite(result.prediction.mean)
    rows = [
        [
            gauges.channels[i],
            gauges.stages[j],
            *_comparison(result, i, j),
            _use(gauges, i, j),
        ]
        for j, i in np.argwhere(shown.T)
    ]
    if not rows:
        return ""
    header = ["gauge", "stage", "measured", "computed", "residual", "in sd", ""]
    return table(header, rows, right="llrrrrl")


def _use(gauges: GaugeTable, i: int, j: int) -> str:
    if gauges.bad[i, j]:
        return "bad"
    return "" if gauges.used[i, j] else "not used"


def _comparison(result: Result, i: int, j: int) -> list[str]:
    gauges = result.gauges
    residual = float(gauges.measured[i, j] - gauges.computed[i, j])
    measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
    in_sd = residual / float(gauges.sd[i, j])
    lengths = [in_mm(length, result) for length in (measured, computed, residual)]
    return [*lengths, decimals(in_sd, 1)]


def in_mm(value: float, result: Result) -> str:
    """A length in m as millimetres, with a decimal more than the best gauge can read."""
    known = result.gauges.sd[result.gauges.sd > 0.0]
    best = float(known.min()) if known.size else 1e-4
    return decimals(1e3 * value, min(6, max(2, 1 - math.floor(math.log10(1e3 * best) + 1e-9))))


def predictions_text(result: Result) -> str:
    """Predicted readings with their bands, and the readings where there are any."""
    prediction, gauges = result.prediction, result.gauges
    if prediction is None:
        return ""
    rows = []
    for j, i in np.argwhere(np.isfinite(prediction.mean).T):
        low, high = float(prediction.lower95[i, j]), float(prediction.upper95[i, j])
        known = math.isfinite(low) and math.isfinite(high)
        cells = (prediction.mean[i, j], low, high) if known else (math.nan,) * 3
        measured = float(gauges.measured[i, j])
        inside = _mark(measured, low, high) if known else NOT_DETERMINED
        texts = [in_mm(float(cell), result) for cell in (*cells, measured)]
        rows.append([gauges.channels[i], gauges.stages[j], *texts, inside])
    header = ["gauge", "stage", "predicted", "from", "to", "measured", ""]
    return table(header, rows, right="llrrrrl")


def _mark(measured: float, low: float, high: float) -> str:
    if math.isnan(measured):
        return ""
    return "inside" if low <= measured <= high else "outside"


def grid_text(result: Result) -> str:
    """A scan: the table over one parameter, the extent over two."""
    grid = result.grid
    if grid is None:
        return ""
    units = [_unit_of(result.parameters, name) for name in grid.names]
    return _line_text(grid, units[0]) if len(grid.names) == 1 else _plane_text(grid, units)


def _unit_of(parameters: ParameterTable, name: str) -> tuple[str, str]:
    i = parameters.names.index(name)
    return parameters.units[i], parameters.dimensions[i]


def _line_text(grid: Grid, unit: tuple[str, str]) -> str:
    rows = [
        [number(in_unit(float(value), *unit)), _discrepancy(float(phi))]
        for value, phi in zip(grid.axes[0], grid.objective, strict=True)
    ]
    return table([_with_unit(grid.names[0], unit[0]), "discrepancy"], rows, right="rr")


def _plane_text(grid: Grid, units: Sequence[tuple[str, str]]) -> str:
    rows = [
        [
            name,
            number(in_unit(float(axis.min()), *unit)),
            number(in_unit(float(axis.max()), *unit)),
            unit[0],
            str(axis.size),
        ]
        for name, axis, unit in zip(grid.names, grid.axes, units, strict=True)
    ]
    finite = grid.objective[np.isfinite(grid.objective)]
    extent = (
        f"Discrepancy from {number(float(finite.min()))} to {number(float(finite.max()))}"
        f" over {grid.objective.size} points; the values are in the result file."
        if finite.size
        else "The model has no solution at any point."
    )
    return table(["axis", "from", "to", "unit", "points"], rows, right="lrrlr") + "\n" + extent


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def _discrepancy(phi: float) -> str:
    return "no solution" if math.isinf(phi) else number(phi, 6)


def cost(counts: Counts) -> str:
    """What it cost."""
    return (
        f"Cost: {counts.evaluations} evaluations, {counts.factorizations} factorizations,"
        f" {counts.solves} solves"
    )


def iteration_text(iteration: Iteration, parameters: Sequence[Parameter]) -> str:
    """One step of an identifier on one line."""
    values = ", ".join(
        f"{q.name} {number(in_unit(float(value), q.unit, q.dimension))}"
        + (f" {unit}" if (unit := shown_unit(q.unit, q.dimension)) else "")
        for q, value in zip(parameters, iteration.values, strict=False)
    )
    note = f" {iteration.note}," if iteration.note else ""
    return (
        f"{iteration.method} {iteration.number}:{note} discrepancy"
        f" {number(iteration.objective, 6)} ({values})"
    )
