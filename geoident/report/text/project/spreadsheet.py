"""The result of several sections for spreadsheets: its tables, in the units of the cases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from geoident.model.results.columns import ROW
from geoident.model.results.many.project import ProjectResult, SectionReading
from geoident.report.text.csv_tables import csv_text
from geoident.report.text.rows import CsvRow, CsvTable, beside, headed, sheet
from geoident.units import in_unit, shown_unit

_COMMON = (
    "name", "kind", "unit", "value", "sd", "lower95", "upper95", "at_bound", "determined",
    "from_prior",
)  # fmt: skip
_LAWS = ("parameter", "formula", "scale", "scatter", "lower95", "upper95", "unit", "state")
_ENDS = ("predicted", "readings", "misfit", "above", "outlying", "alone")
_PARAMETERS = (
    "section", "parameter", "kind", "unit", "value", "sd", "lower95", "upper95", "alone",
    "alone_lower95", "alone_upper95", "law", "law_lower95", "law_upper95", "shrinkage", "at_bound",
    "determined", "from_prior",
)  # fmt: skip
_READINGS = (
    "section", "gauge", "stage", "unit", "measured", "sd", "used", "computed", "lower95", "upper95",
)  # fmt: skip


def project_tables(result: ProjectResult) -> dict[str, CsvTable]:
    """Name to table, those without rows left out.

    Args:
        result: of several sections.
    """
    common = [replace(one, kind=one.law or one.kind) for one in result.common]
    # the scatter of a logarithm is a number
    laws = [replace(law, unit="", dimension="") if law.scale == "log" else law
            for law in result.laws]  # fmt: skip
    tables = {
        "common": sheet(common, ROW, only=_COMMON),
        "laws": sheet(laws, ROW, only=_LAWS),
        "sections": _sections(result),
        "section-parameters": sheet(result.parameters, ROW, only=_PARAMETERS),
        "section-readings": _readings(result.readings),
        "law-curves": _curves(result),
        "left-out-parameters": sheet(result.left_out_parameters, ROW, only=_PARAMETERS),
        "left-out-readings": _readings(result.left_out_readings),
    }
    return {name: table for name, table in tables.items() if table.rows}


def project_csv(result: ProjectResult) -> str:
    """All tables one below the other, each under a line ``# NAME``."""
    tables = project_tables(result).items()
    return "\n".join(f"# {name}\n{csv_text(table)}" for name, table in tables)


def _sections(result: ProjectResult) -> CsvTable:
    known = {
        (row.section, row.covariate): in_unit(row.value, row.unit, row.dimension)
        for row in result.covariates
    }
    units = {row.covariate: (row.unit, row.dimension) for row in result.covariates}
    rows = [tuple(known.get((one.name, name), math.nan) for name in units)
            for one in result.sections]  # fmt: skip
    return beside(
        sheet(result.sections, ROW, only=("name", "case_file")),
        CsvTable(tuple(headed(name, *unit) for name, unit in units.items()), tuple(rows)),
        sheet(result.sections, ROW, only=_ENDS),
    )


def _readings(rows: Sequence[SectionReading]) -> CsvTable:
    inside: list[CsvRow] = [(row.inside if row.judged else "",) for row in rows]
    return beside(sheet(rows, ROW, only=_READINGS), CsvTable(("inside",), tuple(inside)))


def _curves(result: ProjectResult) -> CsvTable:
    header = ("parameter", "unit", "covariate", "covariate unit", "at", "value", "lower95",
              "upper95", "section lower95", "section upper95")  # fmt: skip
    laws = {law.parameter: (law.unit, law.dimension) for law in result.laws}
    known = {row.covariate: (row.unit, row.dimension) for row in result.covariates}
    rows: list[CsvRow] = []
    for point in result.points:
        of, along = laws[point.parameter], known[point.covariate]
        values = (point.value, point.lower95, point.upper95, point.section_lower95,
                  point.section_upper95)  # fmt: skip
        shown = [in_unit(x, *of) if math.isfinite(x) else math.nan for x in values]
        rows.append((point.parameter, shown_unit(*of), point.covariate, shown_unit(*along),
                     in_unit(point.at, *along), *shown))  # fmt: skip
    return CsvTable(header, tuple(rows))
