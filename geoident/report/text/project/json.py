"""Several sections as one object for other programs; SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from geoident.model.project.project import Project
from geoident.model.results.many.project import ProjectResult


def project_object(result: ProjectResult, *, project: str, output: str) -> dict[str, Any]:
    """The result of several sections.

    Args:
        result: what was found.
        project: path of the project, as seen from here.
        output: path of the result file.
    """
    return {
        "project": project,
        "kind": "fit",
        "status": result.status,
        "exit_code": result.exit_code,
        "reason": result.reason,
        "output": output,
        "objective": result.objective,
        "misfit": result.misfit,
        "common": {row.pop("name"): row for row in _rows(result.common)},
        "laws": {row.pop("parameter"): row for row in _rows(result.laws)},
        "sections": [
            {
                **asdict(one),
                "covariates": {
                    row.covariate: row.value for row in result.covariates if row.section == one.name
                },
            }
            for one in result.sections
        ],
        "parameters": _rows(result.parameters),
        "readings": _rows(result.readings),
        "left_out": {
            "parameters": _rows(result.left_out_parameters),
            "readings": _rows(result.left_out_readings),
        },
        "findings": _rows(result.findings),
        "notes": result.notes,
        "counts": asdict(result.counts),
    }


def plan_object(project: Project, readings: Sequence[int]) -> dict[str, Any]:
    """What a project consists of.

    Args:
        project: what its file says.
        readings: number of them of each section.
    """
    return {
        "shared": project.shared,
        "laws": {
            law.parameter: {"formula": law.text, "scatter": law.scatter.kind}
            for law in project.laws
        },
        "sections": [
            {
                "name": section.name,
                "case": section.case,
                "covariates": section.covariates,
                "predicted": section.predicted,
                "readings": count,
            }
            for section, count in zip(project.sections, readings, strict=True)
        ],
    }


def _rows(rows: Sequence[Any]) -> list[dict[str, Any]]:
    return [asdict(row) for row in rows]
