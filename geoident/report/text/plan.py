"""A plan of gauges in words and tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from geoident.model.results.columns import ROW
from geoident.model.results.plan import GaugePlan, PlannedGauge, PlanTarget
from geoident.model.results.result import Result
from geoident.report.text.layout import TextTable, number, sentence
from geoident.report.text.rows import attributes, objects
from geoident.units import in_unit, shown_unit

NAME = "Gauges to take"
TARGETS = "What is to be known (standard deviations)"
OTHERS = "Other candidates"
COURSE = "Standard deviation once all is read up to a stage"
NOTE = (
    "Adds: part of the variance left by the gauges of the case that falls once the gauge is read "
    "beside those above it; of other candidates, beside all of the plan. Alone: part that falls if "
    "it is the only one. If it fails: by how much the standard deviation of what is to be known "
    "grows. Of a limit the variance is that of whether it is passed; settled: the chance that the "
    "readings leave a probability below 5 % or above 95 %."
)
_MOST_OTHERS = 5
_MOST_STAGES = 6


def plan_parts(plan: GaugePlan | None, stages: Sequence[str]) -> tuple[str, ...]:
    """For a terminal: all tables, of the other candidates the best."""
    if plan is None:
        return ()
    course = course_table(plan, stages)
    others = others_table(plan)
    few = TextTable(others.header, others.rows[:_MOST_OTHERS], others.right)
    return (
        gauge_table(plan).folded(1),
        *((f"{OTHERS}, the best of {len(others.rows)}\n{few.folded(1)}",) if others.rows else ()),
        f"{TARGETS}\n{target_table(plan).folded(1)}",
        *((f"{COURSE}\n{course.folded(2)}",) if len(course.header) <= _MOST_STAGES + 2 else ()),
        sentence(NOTE),
    )


def gauge_table(plan: GaugePlan) -> TextTable:
    """The gauges to take, the one that tells most first."""
    header = ("gauge", "kind", "cost", "adds", "alone", "if it fails", "tells most at")
    rows = [
        [*_of(one), _percent(one.alone), f"+{_percent(one.loss)}", one.stages]
        for one in plan.chosen
    ]
    return TextTable(header, rows, right="llrrrrl")


def others_table(plan: GaugePlan) -> TextTable:
    """The candidates that were not chosen, the best first."""
    rows = [[*_of(one), _percent(one.alone)] for one in plan.gauges if not one.rank]
    return TextTable(("gauge", "kind", "cost", "adds", "alone"), rows, right="llrrr")


def _of(one: PlannedGauge) -> list[str]:
    return [one.gauge, one.kind, f"{one.cost:g}", _percent(one.adds)]


def target_table(plan: GaugePlan) -> TextTable:
    """How well each target is known now, with the gauges of the case, and with the plan."""
    rows = []
    for one in plan.targets:
        known = [number(_in(one, x), 3) for x in (one.sd, one.sd_case, one.sd_plan)]
        ratios = [_percent(x) for x in (one.least_ratio, one.largest_ratio)]
        limit = [_percent(x) for x in (one.probability, one.settled_case, one.settled_plan)]
        expected, unit = number(_in(one, one.expected)), shown_unit(one.unit, one.dimension)
        between = ratios[0] if ratios[0] == ratios[1] else " to ".join(ratios)
        rows.append([one.text, unit, expected, *known, between, *limit])
    header = (
        "for", "unit", "expected", "sd now", "with the case", "with the plan", "left, over draws",
        "beyond", "settled by the case", "by the plan",
    )  # fmt: skip
    table = TextTable(header, rows, right="llrrrrrrrr")
    return table if any(np.isfinite(one.probability) for one in plan.targets) else _cut(table, 7)


def _cut(table: TextTable, count: int) -> TextTable:
    rows = [row[:count] for row in table.rows]
    return TextTable(table.header[:count], rows, table.right[:count])


def course_table(plan: GaugePlan, stages: Sequence[str]) -> TextTable:
    """The standard deviation of each target after each stage."""
    course = np.array([one.by_stage for one in plan.targets])
    shown = [j for j in range(len(stages)) if np.isfinite(course[:, j]).any()]
    rows = [
        [one.text, shown_unit(one.unit, one.dimension),
         *(number(_in(one, float(one.by_stage[j])), 3) for j in shown)]
        for one in plan.targets
    ]  # fmt: skip
    header = ("for", "unit", *(stages[j] for j in shown))
    return TextTable(header, rows, right="ll" + "r" * len(shown))


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


def plan_object(result: Result) -> dict[str, Any] | None:
    """The plan for programs, SI."""
    plan = result.plan
    if plan is None:
        return None
    targets = [
        {
            **entry,
            "by_stage": {
                stage: float(sd)
                for stage, sd in zip(result.gauges.stages, one.by_stage, strict=True)
                if np.isfinite(sd)
            },
        }
        for entry, one in zip(objects(plan.targets, ROW), plan.targets, strict=True)
    ]
    gauges = objects(plan.gauges, ROW)
    return {**attributes(plan), "cost": plan.cost, "targets": targets, "gauges": gauges}


def _in(one: PlanTarget, value: float) -> float:
    return in_unit(value, one.unit, one.dimension)


def _percent(part: float) -> str:
    return "-" if np.isnan(part) else f"{number(100.0 * part, 2)} %"
