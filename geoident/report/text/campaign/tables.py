"""A campaign in words and tables: how its runs ended, their parameters, what failed and why."""

from __future__ import annotations

import math
from collections import Counter

from geoident.model.results.many.campaign import SAME_MISFIT, CampaignTable, RunParameter, RunRecord
from geoident.report.text.layout import (
    TextTable,
    number,
    section,
    sections,
    sentence,
    shown_interval,
    with_unit,
)
from geoident.units import in_unit

_MOST_ROWS = 200
"""Rows of a table for people; ``runs.csv`` has all."""

_SLOWEST = 3
_NAMED = 5
"""Runs that a sentence names."""


def campaign_text(table: CampaignTable, *, title: str) -> str:
    """A campaign for a terminal.

    Args:
        table: its runs.
        title: above it.
    """
    return sections(
        title,
        "\n".join(sentence(text) for text in outcome_sentences(table)),
        section("Failed runs", failed_table(table).folded()),
        section("Runs", runs_table(table).folded()),
    )


def outcome_sentences(table: CampaignTable) -> list[str]:
    """How the runs ended, in a few sentences."""
    done = sum(run.finished for run in table.runs)
    counted = Counter(run.status for run in table.runs).most_common()
    statuses = ", ".join(f"{count} {status}" for status, count in counted) or "none has ended"
    sentences = [table.outdated] if table.outdated else []
    sentences.append(f"{done} of {table.total} runs done ({statuses}).")
    left = table.total - len(table.runs)
    if left:
        sentences.append(f"{left} runs have not ended; the same command continues with them.")
    if table.failed:
        named = ", ".join(run.name for run in table.failed[:_NAMED])
        more = f" and {len(table.failed) - _NAMED} more" if len(table.failed) > _NAMED else ""
        sentences.append(f"Failed: {named}{more}.")
    if best := best_runs(table):
        names = [run.name for run in best]
        if len(names) > _NAMED:
            names = [*names[:_NAMED], f"{len(names) - _NAMED} more"]
        named = " and ".join([*([", ".join(names[:-1])] if names[1:] else []), names[-1]])
        have = f"The run {named} has" if len(best) == 1 else f"The runs {named} have"
        sentences.append(f"{have} the least misfit, {number(best[0].objective)}.")
    took = [run for run in table.runs if math.isfinite(run.seconds)]
    if took:
        slow = sorted(took, key=lambda run: -run.seconds)[:_SLOWEST]
        words = ", ".join(f"{run.name} ({seconds_text(run.seconds)})" for run in slow)
        spent = seconds_text(sum(run.seconds for run in took))
        sentences.append(f"Computed in {spent} of process time; slowest: {words}.")
    return sentences


def seconds_text(seconds: float) -> str:
    """A time for people.

    >>> seconds_text(0.0214), seconds_text(75), seconds_text(7300)
    ('0.02 s', '75 s', '122 min')
    """
    if seconds < 10.0:
        return f"{seconds:.2f} s"
    return f"{seconds:.0f} s" if seconds < 600.0 else f"{seconds / 60:.0f} min"


def best_runs(table: CampaignTable) -> tuple[RunRecord, ...]:
    """The runs with the least misfit: several where they have it to five digits."""
    known = [run for run in table.runs if run.finished and math.isfinite(run.objective)]
    least = min((run.objective for run in known), default=0.0)
    return tuple(run for run in known if run.objective <= least + SAME_MISFIT * abs(least))


def runs_table(table: CampaignTable) -> TextTable:
    """The runs with what varies and what came out."""
    names = table.parameter_names if table.command in ("fit", "scan") else ()
    known = {p.name: p for run in table.runs for p in run.parameters}
    heads = [with_unit(name, known[name].unit, known[name].dimension) for name in names]
    misfit = any(math.isfinite(run.objective) for run in table.runs)
    header = ["run", *table.paths, "status", *(["misfit"] if misfit else []), *heads]
    rows = []
    for run in table.runs[:_MOST_ROWS]:
        own = {p.name: p for p in run.parameters}
        row = [run.name, *(dict(run.settings).get(path) or "-" for path in table.paths)]
        row += [run.status, *([number(run.objective)] if misfit else [])]
        rows.append([*row, *(_value_text(own.get(name)) for name in names)])
    right = "l" * (len(table.paths) + 2) + "r" * (len(header) - len(table.paths) - 2)
    return TextTable(header, rows, right=right)


def runs_left_out(table: CampaignTable) -> str:
    """That the table shows only the first runs; empty where it shows all."""
    if len(table.runs) <= _MOST_ROWS:
        return ""
    return f"The first {_MOST_ROWS} of {len(table.runs)} runs; runs.csv has all."


def _value_text(parameter: RunParameter | None) -> str:
    if parameter is None:
        return "-"
    one = parameter
    if not math.isfinite(one.upper95 - one.lower95):
        return number(in_unit(one.value, one.unit, one.dimension))
    value, interval = shown_interval(one.value, one.lower95, one.upper95, one.unit, one.dimension)
    return f"{value} ({interval})"


def failed_table(table: CampaignTable) -> TextTable:
    """Runs without a result, and why."""
    rows = [
        [run.name, run.status, " ".join(run.reason.split())] for run in table.failed[:_MOST_ROWS]
    ]
    return TextTable(["run", "status", "why"], rows)
