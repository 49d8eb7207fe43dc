"""What several sections tell, and what they do not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from geoident.identify.hierarchical.error_sizes import AccuracyOff
from geoident.io.text.wording import listing
from geoident.model.gauges import Channel
from geoident.model.project.project import ProjectSection
from geoident.model.results.findings import Finding
from geoident.model.results.many.project import (
    UNKNOWN_SCATTER,
    ZERO,
    LawEstimate,
    ProjectResult,
    SectionReading,
)
from geoident.units import in_unit, shown_unit

UNLIKELY = 0.01
"""Probability, of any of the sections, below which one is said to be of other ground."""

NO_MISTAKES: Mapping[str, Sequence[Finding]] = MappingProxyType({})

_POOR = 1e-3
_LEAST = 1.5
"""Residuals by their errors from which on a section is named."""

_BAD_BANDS = 0.85
_FEW = 10


def findings(
    result: ProjectResult,
    gaps: Sequence[Finding],
    mistakes: Mapping[str, Sequence[Finding]] = NO_MISTAKES,
) -> tuple[Finding, ...]:
    """What is to be known of a result.

    Args:
        result: without findings.
        gaps: what the sections together do not determine.
        mistakes: name of a section to those that its own fit shows.
    """
    return (
        *(
            Finding(one.kind, f"{name}, {one.subject}", f"{name}: {one.sentence}", one.numbers)
            for name, of_section in mistakes.items()
            for one in of_section
        ),
        *gaps,
        *(one for law in result.laws for one in _of_scatter(law)),
        *_of_sections(result),
        *_of_bands(result.left_out_readings, "left out in turn"),
        *_of_bands([r for r in result.readings if r.section in _predicted(result)], "predicted"),
    )


def _predicted(result: ProjectResult) -> set[str]:
    return {section.name for section in result.predicted}


def _of_scatter(law: LawEstimate) -> Iterator[Finding]:
    if law.state == ZERO:
        yield Finding(
            "law-scatter",
            law.parameter,
            f"The sections do not show that {law.parameter} scatters about its law; up to "
            f"{law.words(law.upper95)} is possible (95 %).",
        )
    elif law.state == UNKNOWN_SCATTER:
        yield Finding(
            "law-scatter",
            law.parameter,
            f"How far {law.parameter} scatters about its law is not determined: there are too few "
            "sections for it, or they see too little. More sections, fewer constants, or a given "
            "scatter help; what is predicted has wide bands.",
        )


def _of_sections(result: ProjectResult) -> Iterator[Finding]:
    judged = [s for s in result.fitted if s.outlying == s.outlying]
    for section in judged:
        if section.outlying < UNLIKELY / len(judged):
            yield Finding(
                "misfit",
                section.name,
                f"The section {section.name} does not fit what all others tell of it (of the same "
                f"ground, one in {_one_in(section.outlying)} would be as far off): its ground, its "
                f"case or its readings differ.{_off(result, section.name)}",
                {"probability": section.outlying},
            )
    for section in result.fitted:
        if section.above < _POOR and section.misfit >= _LEAST:
            yield Finding(
                "misfit",
                section.name,
                f"The model of {section.name} does not fit its readings: the residuals are "
                f"{section.misfit:.2g} times as large as their errors explain.",
                {"misfit": section.misfit, "probability": section.above},
            )


def _one_in(probability: float) -> str:
    if probability < 1e-6:
        return "more than a million"
    return f"{float(f'{1.0 / probability:.2g}'):,.0f}".replace(",", " ")


def _off(result: ProjectResult, name: str) -> str:
    """By how much the own fit of a section is off its laws."""
    parts = []
    for row in result.of(name):
        if row.law == row.law and row.alone == row.alone and row.law != 0.0:
            parts.append(f"its own fit gives {row.alone / row.law:.2g} times the {row.parameter} "
                        "of the law")  # fmt: skip
    return f" Of {name}, {' and '.join(parts)}." if parts else ""


def _of_bands(rows: Sequence[SectionReading], which: str) -> Iterator[Finding]:
    judged = [row for row in rows if row.judged]
    if not judged:
        return
    inside = sum(row.inside for row in judged)
    sections = len({row.section for row in judged})
    text = f"Of {len(judged)} readings of {sections} sections that were {which}, {inside} "
    text += f"({100 * inside / len(judged):.0f} %) lie within their 95 % bands"
    if len(judged) >= _FEW and inside < _BAD_BANDS * len(judged):
        text += ": the law, or the models, miss something that differs between sections"
    numbers = {"inside": float(inside), "readings": float(len(judged))}
    yield Finding("bands", "", f"{text}.", numbers)


def accuracy_finding(
    section: ProjectSection, channels: Sequence[Channel], off: AccuracyOff
) -> Finding:
    """That the gauges of a section are not as accurate as its case states.

    Args:
        section: of the project.
        channels: of its readings.
        off: by how much.
    """
    factor = off.factor
    gauges: dict[str, list[str]] = {}
    for gauge, channel in {channel.gauge: channel for channel in channels}.items():
        size = in_unit(factor * channel.accuracy, channel.unit, channel.dimension)
        unit = shown_unit(channel.unit, channel.dimension)
        gauges.setdefault(f"'accuracy: {size:.1g} {unit}'", []).append(gauge)
    lines = listing([f"{line} for {listing(names)}" for line, names in gauges.items()])
    times, which = (factor, "less") if factor > 1.0 else (1.0 / factor, "more")
    or_model = ""
    if off.or_model and factor > 1.0:
        or_model = " (or its model is further from its ground than those of the others)"
    return Finding(
        "accuracy",
        section.name,
        f"The readings of {section.name} are about {times:.1g} times {which} accurate than its "
        f"case states, beside what all sections together tell{or_model}: so the section counts too "
        f"{'much' if factor > 1.0 else 'little'} in all that they share. Look at the unit and the "
        f"instrument of its accuracies; write {lines} in {section.case}.",
        {"factor": factor},
    )
