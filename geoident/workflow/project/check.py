"""``geoident check`` of a project: everything that can be wrong with its sections, too."""

from __future__ import annotations

from geoident.errors import InputError
from geoident.model.project.project import Project
from geoident.model.results.summary import CaseSummary
from geoident.workflow.check import check
from geoident.workflow.project.plan import read_sections
from geoident.workflow.running.run_table import in_order, read_each


def check_project(path: str, *, solver: str = "auto") -> tuple[Project, tuple[CaseSummary, ...]]:
    """Read a project, and set up every section, solving nothing.

    Args:
        path: of the project.
        solver: name of the sparse solver, or ``auto``.

    Returns:
        What its file says, and what the case of each section amounts to.

    Raises:
        InputError: with the faults of the project and of all its sections.
        ModelError: a model moves freely somewhere.
    """
    project, _ = read_sections(path)
    checked, faults = read_each(
        project.sections,
        lambda section: check(section.case, overrides=section.overrides, solver=solver),
    )
    if faults:
        raise InputError(in_order(faults))
    return project, tuple(report.summary for _, report in checked)
