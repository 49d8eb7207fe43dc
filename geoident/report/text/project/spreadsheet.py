"""The result of several sections for spreadsheets: its tables, in the units of the cases."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geoident.model.results.many.project import (
    LawEstimate,
    ProjectResult,
    SectionParameter,
    SectionReading,
)
from geoident.report.text.csv_tables import csv_text
from geoident.report.text.rows import CsvCell, CsvRow, CsvTable
from geoident.units import in_unit, shown_unit

PROJECT_TABLES = ("common", "laws", "sections", "section-parameters", "section-readings",
                  "law-curves", "left-out-parameters", "left-out-readings")  # fmt: skip
"""Names of the tables."""

_INTERVAL = ("value", "lower95", "upper95")


def project_tables(result: ProjectResult) -> dict[str, CsvTable]:
    """Name to table, those without rows left out.

    Args:
        result: of several sections.
    """
    made = (
        _common(result),
        _laws(result),
        _sections(result),
        _parameters(result.parameters),
        _readings(result.readings),
        _curves(result),
        _parameters(result.left_out_parameters),
        _readings(result.left_out_readings),
    )
    tables = zip(PROJECT_TABLES, made, strict=True)
    return {name: table for name, table in tables if table.rows}


def project_csv(result: ProjectResult) -> str:
    """All tables one below the other, each under a line ``# NAME``."""
    tables = project_tables(result).items()
    return "\n".join(f"# {name}\n{csv_text(table)}" for name, table in tables)


def _common(result: ProjectResult) -> CsvTable:
    header = ("name", "of", "unit", "value", "sd", "lower95", "upper95", "at_bound", "determined")
    rows: list[CsvRow] = [
        (
            one.name, one.law or one.kind, shown_unit(one.unit, one.dimension),
            *_shown((one.value, one.sd, one.lower95, one.upper95), one.unit, one.dimension,
                    determined=one.determined),
            one.at_bound, one.determined,
        )
        for one in result.common
    ]  # fmt: skip
    return CsvTable(header, tuple(rows))


def _laws(result: ProjectResult) -> CsvTable:
    header = ("parameter", "formula", "scale", "scatter", "lower95", "upper95", "unit", "state")
    return CsvTable(header, tuple(_law(law) for law in result.laws))


def _law(law: LawEstimate) -> CsvRow:
    sizes = [law.scatter, law.lower95, law.upper95]
    unit = ""
    if law.scale != "log":  # of the logarithm it is a number
        unit = shown_unit(law.unit, law.dimension)
        sizes = [in_unit(size, law.unit, law.dimension) for size in sizes]
    return (law.parameter, law.formula, law.scale, *sizes, unit, law.state)


def _sections(result: ProjectResult) -> CsvTable:
    units = {row.covariate: shown_unit(row.unit, row.dimension) for row in result.covariates}
    labels = [f"{name} [{unit}]" if unit else name for name, unit in units.items()]
    header = ("section", "case", *labels, "predicted", "readings", "misfit", "chance", "as_far_off",
              "alone")  # fmt: skip
    rows: list[CsvRow] = []
    for one in result.sections:
        known = {
            row.covariate: in_unit(row.value, row.unit, row.dimension)
            for row in result.covariates
            if row.section == one.name
        }
        covariates = [known.get(name, math.nan) for name in units]
        rows.append((one.name, one.case_file, *covariates, one.predicted, one.readings,
                     one.misfit, one.above, one.outlying, one.alone))  # fmt: skip
    return CsvTable(header, tuple(rows))


def _parameters(rows: Sequence[SectionParameter]) -> CsvTable:
    header = ("section", "parameter", "kind", "unit", "value", "sd", "lower95", "upper95",
              *(f"{who} {what}" for who in ("alone", "law") for what in _INTERVAL),
              "shrinkage", "at_bound", "determined")  # fmt: skip
    return CsvTable(header, tuple(_parameter(row) for row in rows))


def _parameter(row: SectionParameter) -> CsvRow:
    unit, dimension = row.unit, row.dimension
    own = (row.value, row.sd, row.lower95, row.upper95)
    others = (row.alone, row.alone_lower95, row.alone_upper95,
              row.law, row.law_lower95, row.law_upper95)  # fmt: skip
    return (
        row.section, row.parameter, row.kind, shown_unit(unit, dimension),
        *_shown(own, unit, dimension, determined=row.determined),
        *_shown(others, unit, dimension),
        row.shrinkage, row.at_bound, row.determined,
    )  # fmt: skip


def _readings(rows: Sequence[SectionReading]) -> CsvTable:
    header = ("section", "gauge", "stage", "unit", "measured", "sd", "used", "computed", "lower95",
              "upper95", "inside")  # fmt: skip
    return CsvTable(header, tuple(_reading(row) for row in rows))


def _reading(row: SectionReading) -> CsvRow:
    unit, dimension = row.unit, row.dimension
    inside: CsvCell = row.inside if row.judged else ""
    measured, sd, *computed = _shown(
        (row.measured, row.sd, row.computed, row.lower95, row.upper95), unit, dimension
    )
    return (
        row.section, row.gauge, row.stage, shown_unit(unit, dimension), measured, sd, row.used,
        *computed, inside,
    )  # fmt: skip


def _curves(result: ProjectResult) -> CsvTable:
    header = ("parameter", "unit", "covariate", "covariate unit", "at", *_INTERVAL,
              "section lower95", "section upper95")  # fmt: skip
    laws = {law.parameter: (law.unit, law.dimension) for law in result.laws}
    known = {row.covariate: (row.unit, row.dimension) for row in result.covariates}
    rows: list[CsvRow] = []
    for point in result.points:
        of, along = laws[point.parameter], known[point.covariate]
        values = (point.value, point.lower95, point.upper95, point.section_lower95,
                  point.section_upper95)  # fmt: skip
        rows.append((point.parameter, shown_unit(*of), point.covariate, shown_unit(*along),
                     in_unit(point.at, *along), *_shown(values, *of)))  # fmt: skip
    return CsvTable(header, tuple(rows))


def _shown(
    values: Sequence[float], unit: str, dimension: str, *, determined: bool = True
) -> list[float]:
    """Values in the unit in which people see them; infinite ends are not determined, so empty."""
    return [
        in_unit(value, unit, dimension) if determined and math.isfinite(value) else math.nan
        for value in values
    ]
