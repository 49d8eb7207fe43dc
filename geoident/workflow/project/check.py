"""``geoident check`` of a project: everything that can be wrong with its sections, too."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.errors import Fault, InputError
from geoident.model.project.project import Project
from geoident.model.results.summary import CaseSummary
from geoident.workflow.check import check
from geoident.workflow.project.plan import in_order, placed, read_sections


@dataclass(frozen=True)
class CheckedProject:
    """A project whose sections are right, each by itself and together.

    Args:
        project: what its file says.
        summaries: what the case of each section amounts to.
    """

    project: Project
    summaries: tuple[CaseSummary, ...]


def check_project(path: str, *, solver: str = "auto") -> CheckedProject:
    """Read a project, and set up every section, solving nothing.

    Args:
        path: of the project.
        solver: name of the sparse solver, or ``auto``.

    Raises:
        InputError: with the faults of the project and of all its sections.
        ModelError: a model moves freely somewhere.
    """
    project, _ = read_sections(path)
    summaries: list[CaseSummary] = []
    faults: list[Fault] = []
    for section in project.sections:
        try:
            found = check(section.case, overrides=section.overrides, solver=solver)
            summaries.append(found.summary)
        except InputError as error:
            faults += placed(error, section)
    if faults:
        raise InputError(in_order(faults))
    return CheckedProject(project, tuple(summaries))
