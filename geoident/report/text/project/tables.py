"""Several sections in words and tables, in the units of their cases."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geoident.model.project.project import Project
from geoident.model.results.findings import sentences_of
from geoident.model.results.many.project import (
    GIVEN_SCATTER,
    LAW,
    NO_SCATTER,
    SHARED,
    UNKNOWN_SCATTER,
    CommonParameter,
    ProjectResult,
    SectionParameter,
    SectionReading,
)
from geoident.report.text.layout import (
    TextTable,
    bullets,
    decimals,
    number,
    section,
    sections,
    sentence,
    shown_interval,
    with_unit,
)
from geoident.report.text.parameters import AS_PRIOR, NOT_DETERMINED
from geoident.units import in_unit, shown_unit

_STATUS = {
    "converged": "The search converged",
    "not-converged": "The search did not converge: the values are the best found so far",
    "not-determined": "The sections do not determine everything",
    "poor-fit": "The models do not fit the readings: parameters and bands are not to be relied on",
    "out-of-budget": "The search ran out of its budget: the values are the best found so far",
}
_MOST = 60
"""Rows of a table of readings on a terminal."""


def project_text(result: ProjectResult, *, title: str) -> str:
    """All of a result that fits a terminal.

    Args:
        result: what to show.
        title: the first line, such as its path.
    """
    return sections(
        f"{title}\n{head(result)}",
        section("Common to all sections", common_table(result).folded()),
        section("Laws", laws_table(result).folded()),
        section("Findings", bullets(sentences_of(result.findings))),
        section("Sections", sections_table(result).folded()),
        section(
            "Parameters of the sections (law; own fit; with all others)",
            parameters_table(result).folded(2),
        ),
        *(
            section(
                f"{one.name}: predicted readings",
                _few(bands_table([row for row in result.readings if row.section == one.name])),
            )
            for one in result.predicted
        ),
        section("Left out in turn", left_out_table(result).folded()),
        section("Notes", bullets(result.notes)),
        f"Cost: {result.counts.evaluations} evaluations, {result.counts.factorizations} "
        "factorizations",
    )


def plan_text(project: Project, readings: Sequence[int]) -> str:
    """What a project consists of.

    Args:
        project: what its file says.
        readings: number of them of each section.
    """
    predicted = len(project.sections) - len(project.fitted)
    lines = [
        f"{len(project.fitted)} sections to fit, {predicted} to predict",
        f"shared: {', '.join(project.shared) or 'nothing'}",
    ]
    lines += [f"law: {law.parameter} = {law.text} (scatter: {law.scatter.kind})"
              for law in project.laws]  # fmt: skip
    units = {c.name: (c.unit, c.dimension) for c in project.covariates}
    rows = []
    for one, count in zip(project.sections, readings, strict=True):
        known = [
            f"{name} {number(in_unit(value, *units[name]))} {shown_unit(*units[name])}".rstrip()
            for name, value in one.covariates.items()
        ]
        role = "predicted" if one.predicted else ""
        rows.append([one.name, one.case, ", ".join(known), str(count), role])
    table = TextTable(["section", "case", "covariates", "readings", ""], rows, right="lllr")
    return "\n".join([*lines, "", table.text])


def project_summary(result: ProjectResult) -> str:
    """The outcome in a few lines, for the end of a run."""
    parts = (
        head(result),
        common_table(result).text,
        laws_table(result).text,
        bullets(sentences_of(result.findings)),
    )
    return "\n".join(part for part in parts if part)


def head(result: ProjectResult) -> str:
    """How the search ended, and how well the readings are met."""
    sentences = [f"{_STATUS.get(result.status, result.status)}. {result.reason}"]
    fitted, predicted = len(result.fitted), len(result.predicted)
    count = sum(one.readings for one in result.fitted)
    words = f"{count} readings of {fitted} sections"
    words += f"; {predicted} more predicted" if predicted else ""
    scale = "" if math.isnan(result.misfit) else (
        f" The residuals are {number(result.misfit, 3)} times as large as their errors explain."
    )  # fmt: skip
    sentences.append(f"{words}; misfit {number(result.objective)}.{scale}")
    return "\n".join(sentence(text) for text in sentences)


def common_table(result: ProjectResult) -> TextTable:
    """Shared parameters and constants of laws."""
    rows = []
    for one in result.common:
        value, interval = _value(one.value, one.lower95, one.upper95, one.unit, one.dimension,
                                 known=one)  # fmt: skip
        what = "shared" if one.kind == SHARED else f"law of {one.law}"
        unit = shown_unit(one.unit, one.dimension)
        rows.append([one.name, what, value, interval, unit, "at bound" if one.at_bound else ""])
    return TextTable(["name", "of", "value", "95 % interval", "unit", ""], rows, right="llrr")


def laws_table(result: ProjectResult) -> TextTable:
    """The laws and the scatter about them."""
    rows = []
    for law in result.laws:
        scatter, interval = law.words(law.scatter), ""
        if law.state == UNKNOWN_SCATTER:
            scatter = NOT_DETERMINED
        elif law.state == NO_SCATTER:
            scatter = "none"
        elif law.state == GIVEN_SCATTER:
            scatter += " (given)"
        else:
            interval = f"{law.words(law.lower95)} to {law.words(law.upper95)}"
        rows.append([law.parameter, law.formula, scatter, interval])
    return TextTable(["parameter", "law", "scatter", "95 % interval"], rows, right="llrr")


def sections_table(result: ProjectResult) -> TextTable:
    """The sections: what is known of each, readings, misfit, whether it is of the same ground."""
    heads = {
        row.covariate: with_unit(row.covariate, row.unit, row.dimension)
        for row in result.covariates
    }
    known = {
        (row.section, row.covariate): number(in_unit(row.value, row.unit, row.dimension))
        for row in result.covariates
    }
    rows = []
    for one in result.sections:
        cells = [known.get((one.name, name), "-") for name in heads]
        rows.append(
            [one.name, *cells, str(one.readings), number(one.misfit, 2), chance(one.outlying),
             "predicted" if one.predicted else ""]
        )  # fmt: skip
    header = ["section", *heads.values(), "readings", "misfit", "as far off", ""]
    return TextTable(header, rows, right="l" + "r" * (len(header) - 2))


def chance(probability: float) -> str:
    """A probability in per cent.

    >>> chance(0.25), chance(1e-7)
    ('25 %', '< 0.01 %')
    """
    if math.isnan(probability):
        return "-"
    return f"{100 * probability:.2g} %" if probability >= 1e-4 else "< 0.01 %"


def parameters_table(result: ProjectResult) -> TextTable:
    """What the laws say of each section, what it says by itself, and what all say together."""
    rows = []
    for row in result.parameters:
        if row.kind == SHARED:
            continue
        of = row.unit, row.dimension
        law = _joined(row.law, row.law_lower95, row.law_upper95, *of) if row.kind == LAW else "-"
        alone = _joined(row.alone, row.alone_lower95, row.alone_upper95, *of)
        value, interval = _value(row.value, row.lower95, row.upper95, *of, known=row)
        shrunk = "-" if math.isnan(row.shrinkage) else f"{100 * row.shrinkage:.0f} %"
        rows.append(
            [row.parameter, row.section, shown_unit(*of) or "-", law, alone,
             f"{value} ({interval})" if interval else value, shrunk,
             "at bound" if row.at_bound else ""]
        )  # fmt: skip
    header = ["parameter", "section", "unit", "law", "own fit", "with all", "shrinkage", ""]
    return TextTable(header, rows, right="lllrrrr")


def bands_table(rows: Sequence[SectionReading]) -> TextTable:
    """Readings with their bands, and whether they lie inside."""
    cells = []
    for row in rows:
        of = row.unit, row.dimension
        value, interval = shown_interval(row.computed, row.lower95, row.upper95, *of)
        read = decimals(in_unit(row.measured, *of), len(value.partition(".")[2]))
        verdict = "" if not row.judged else "inside" if row.inside else "OUTSIDE"
        cells.append([row.gauge, row.stage, shown_unit(*of), value, interval, read, verdict])
    header = ["gauge", "stage", "unit", "expected", "95 % band", "read", ""]
    return TextTable(header, cells, right="lllrrr")


def left_out_table(result: ProjectResult) -> TextTable:
    """Each section as all others predict it."""
    rows = []
    for one in result.fitted:
        judged = [r for r in result.left_out_readings if r.section == one.name]
        inside = f"{sum(row.inside for row in judged)} of {len(judged)}" if judged else "-"
        for row in result.left_out_parameters:
            if row.section != one.name or row.kind != LAW:
                continue
            of = row.unit, row.dimension
            predicted = _joined(row.value, row.lower95, row.upper95, *of)
            alone = _joined(row.alone, row.alone_lower95, row.alone_upper95, *of)
            cells = [one.name, row.parameter, shown_unit(*of) or "-", predicted, alone, inside]
            rows.append(cells)
    header = ["section", "parameter", "unit", "predicted by others", "own fit", "readings inside"]
    return TextTable(header, rows, right="lllrrr")


def _value(
    value: float,
    low: float,
    high: float,
    unit: str,
    dimension: str,
    *,
    known: CommonParameter | SectionParameter,
) -> tuple[str, str]:
    """A value and its interval in the unit in which people see it."""
    if not known.determined:
        return AS_PRIOR if known.from_prior else NOT_DETERMINED, ""
    return shown_interval(value, low, high, unit, dimension)


def _joined(value: float, low: float, high: float, unit: str, dimension: str) -> str:
    text, interval = shown_interval(value, low, high, unit, dimension)
    return f"{text} ({interval})" if interval else text


def _few(table: TextTable) -> str:
    """The first rows of a table, and how many more there are."""
    text = TextTable(table.header, table.rows[:_MOST], table.right).folded(2)
    left = len(table.rows) - _MOST
    return f"{text}\n... and {left} more" if left > 0 else text
