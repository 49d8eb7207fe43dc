"""A plan of gauges in words and tables."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from geoident.model.results.columns import ROW
from geoident.model.results.plan import GaugePlan, PlanTarget
from geoident.report.text.alarms import probable
from geoident.report.text.layout import TextTable, number, sentence
from geoident.report.text.rows import attributes, objects
from geoident.units import in_unit, shown_unit

NAME = "Gauges to take"
TARGETS = "What is to be known (standard deviations)"
NOTE = (
    "Adds: part of the variance left by the gauges of the case that falls once the gauge is read "
    "beside those above it; of those without a number, which are not taken, beside all that are. "
    "Alone: part that falls if it is the only one. If it fails: by how much the standard deviation "
    "of what is to be known grows. Of a limit the variance is that of whether it is passed; "
    "settled: the chance that the readings leave a probability below 5 % or above 95 %."
)
_MOST_OTHERS = 5


def plan_parts(plan: GaugePlan | None) -> tuple[str, ...]:
    """For a terminal: all tables, of the candidates that were not chosen the best."""
    if plan is None:
        return ()
    few = replace(plan, gauges=plan.gauges[: len(plan.chosen) + _MOST_OTHERS])
    return (
        gauge_table(few).folded(2),
        f"{TARGETS}\n{target_table(plan).folded(1)}",
        sentence(NOTE),
    )


def gauge_table(plan: GaugePlan) -> TextTable:
    """The gauges to take, the one that tells most first, then the others, the best first."""
    header = ("", "gauge", "kind", "cost", "adds", "alone", "if it fails", "tells most at")
    rows = [
        [str(one.rank or "-"), one.gauge, one.kind, f"{one.cost:g}", _percent(one.adds),
         _percent(one.alone), f"+{_percent(one.loss)}" if one.rank else "-", one.stages or "-"]
        for one in plan.gauges
    ]  # fmt: skip
    return TextTable(header, rows, right="lllrrrrl")


def target_table(plan: GaugePlan) -> TextTable:
    """How well each target is known now, with the gauges of the case, and with the plan."""
    rows = []
    for one in plan.targets:
        known = [number(_in(one, x), 3) for x in (one.sd, one.sd_case, one.sd_plan)]
        ratios = [_percent(x) for x in (one.least_ratio, one.largest_ratio)]
        limit = [probable(x) for x in (one.probability, one.settled_case, one.settled_plan)]
        expected, unit = number(_in(one, one.expected)), shown_unit(one.unit, one.dimension)
        between = ratios[0] if ratios[0] == ratios[1] else " to ".join(ratios)
        rows.append([one.text, unit, expected, *known, between, *limit])
    header = (
        "for", "unit", "expected", "sd now", "with the case", "with the plan", "left, over draws",
        "beyond", "settled by case", "settled by plan",
    )  # fmt: skip
    return TextTable(header, rows, right="llrrrrrrrr").filled


def plan_sentences(plan: GaugePlan) -> list[str]:
    """What the plan comes to, in a few sentences."""
    if not plan.chosen:
        return ["No candidate tells anything of what is to be known."]
    names = ", ".join(one.gauge for one in plan.chosen)
    sentences = [f"Take {names}: {plan.cost:g} of a budget of {plan.budget:g}."]
    for one in plan.targets:
        before, after = (number(_in(one, x), 3) for x in (one.sd_case, one.sd_plan))
        unit = shown_unit(one.unit, one.dimension)
        sentences.append(
            f"The standard deviation of {one.text} falls from {before} to {after} {unit}".rstrip()
            + "."
        )
    return sentences


def plan_object(plan: GaugePlan) -> dict[str, Any]:
    """The plan for programs, SI."""
    targets, gauges = objects(plan.targets, ROW), objects(plan.gauges, ROW)
    return {**attributes(plan), "cost": plan.cost, "targets": targets, "gauges": gauges}


def _in(one: PlanTarget, value: float) -> float:
    return in_unit(value, one.unit, one.dimension)


def _percent(part: float) -> str:
    return f"{number(100.0 * part, 2)} %"
