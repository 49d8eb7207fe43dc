"""What a case amounts to, as plain text."""

from __future__ import annotations

from geoident.model.summary import CaseSummary, GroupSummary, StageSummary
from geoident.report.layout import bullets, number, section, sections, sentence, table


def summary_text(summary: CaseSummary) -> str:
    """A case that was checked."""
    return sections(
        _head(summary),
        section("Groups", _groups(summary.groups)),
        section("Stages", _stages(summary.stages)),
        section("Gauges", _gauges(summary)),
        _readings(summary),
        section("Notes", bullets(summary.notes)),
    )


def _head(summary: CaseSummary) -> str:
    parameters = ", ".join(summary.parameters) or "none"
    lines = [
        f"{summary.case}: {summary.title}" if summary.title else summary.case,
        f"{summary.analysis}, {summary.nodes} nodes, {summary.elements} elements ({summary.mesh})",
        f"parameters {parameters}; method {' + '.join(summary.methods)}",
    ]
    return "\n".join(sentence(line) for line in lines)


def _groups(groups: tuple[GroupSummary, ...]) -> str:
    rows = [[g.name, str(g.elements), g.material or "absent"] for g in groups]
    return table(["name", "elements", "material at the start"], rows, right="lr") if rows else ""


def _stages(stages: tuple[StageSummary, ...]) -> str:
    rows = [[s.name, str(s.dofs), str(s.used), _events(s)] for s in stages]
    header = ["name", "unknowns", "readings", "what happens"]
    return table(header, rows, right="lrrl") if rows else ""


def _events(stage: StageSummary) -> str:
    events = [f"builds on {stage.base}"] if stage.base else []
    events += [f"-{name}" for name in stage.leaves]
    events += [f"+{name}: {material}" for name, material in stage.enters]
    events += [f"{name} becomes {material}" for name, material in stage.changes]
    events += [f"load {name}" for name in stage.loads]
    events += [f"end of load {name}" for name in stage.removed]
    events += [f"temperature of {name}" for name in stage.warmed]
    events += ["water in the pores"] if stage.water else []
    return ", ".join(events)


def _gauges(summary: CaseSummary) -> str:
    rows = [
        [g.name, g.kind, g.zero, number(1e3 * g.accuracy), str(g.used), str(g.unused)]
        for g in summary.gauges
    ]
    header = ["name", "kind", "zero", "accuracy mm", "used", "not used"]
    return table(header, rows, right="lllrrr") if rows else ""


def _readings(summary: CaseSummary) -> str:
    lines = [f"Readings: {summary.used} used"]
    lines += [f"  {count} not used: {reason}" for reason, count in summary.unused]
    return "\n".join(lines)
