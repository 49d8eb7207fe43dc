"""Several sections of one ground from Python: a project is fitted, and what was found of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from geoident.api.calling import AnyPath, Progress, control, spoken
from geoident.api.result_handle import ResultHandle
from geoident.api.tables import ResultTable
from geoident.io.result.project import read_project_result
from geoident.io.text.wording import did_you_mean
from geoident.model.results.many.project import (
    CommonParameter,
    LawEstimate,
    ProjectResult,
    SectionEnd,
    SectionParameter,
    SectionReading,
)
from geoident.report.page.html import joined, table, tag
from geoident.report.text.csv_tables import csv_text
from geoident.report.text.project.spreadsheet import project_tables
from geoident.report.text.project.tables import common_table, laws_table, project_summary
from geoident.workflow.programs.trust import decided_by, trusting
from geoident.workflow.project.export import export_project
from geoident.workflow.project.plan import ProjectRequest, plan_project
from geoident.workflow.project.run import fit_project as run_project

_OfName = TypeVar("_OfName")


@dataclass(frozen=True)
class SectionFit:
    """What was found of a section, with all others or predicted from them; SI.

    Args:
        end: its readings and how well they are met.
        parameters: name to estimate, with the law there and what the section says by itself.
        readings: measured and computed, with 95 % bands of those that took no part.
    """

    end: SectionEnd
    parameters: Mapping[str, SectionParameter]
    readings: tuple[SectionReading, ...]

    @property
    def predicted(self) -> bool:
        """It took no part in the fit."""
        return self.end.predicted


@dataclass(frozen=True, repr=False)
class ProjectFit(ResultHandle[ProjectResult]):
    """What `fit_project` found: what the sections share, their laws, and each of them.

    Args:
        data: all that was found, SI.
        path: of the result file.
        up_to_date: it stood there already and was not computed again.
    """

    @property
    def common(self) -> Mapping[str, CommonParameter]:
        """Shared parameters and constants of laws by name, SI, with 95 % intervals."""
        return ByName({one.name: one for one in self.data.common}, "common parameter")

    @property
    def laws(self) -> Mapping[str, LawEstimate]:
        """Parameter to its law and the scatter of the sections about it."""
        return ByName({law.parameter: law for law in self.data.laws}, "law")

    @cached_property
    def sections(self) -> Mapping[str, SectionFit]:
        """The sections by name, also those that are predicted."""
        sections, data = {}, self.data
        for one in data.sections:
            own = {row.parameter: row for row in data.of(one.name)}
            read = tuple(row for row in data.readings if row.section == one.name)
            sections[one.name] = SectionFit(one, own, read)
        return ByName(sections, "section")

    @cached_property
    def left_out(self) -> Mapping[str, SectionFit]:
        """Each fitted section as the others predict it; empty without ``leave_one_out``."""
        left_out, data = {}, self.data
        for one in data.fitted:
            own = {r.parameter: r for r in data.left_out_parameters if r.section == one.name}
            read = tuple(row for row in data.left_out_readings if row.section == one.name)
            if own:
                left_out[one.name] = SectionFit(one, own, read)
        return ByName(left_out, "section that was left out")

    @cached_property
    def tables(self) -> Mapping[str, ResultTable]:
        """All tables by name, in the units of the cases: those that ``geoident export`` writes."""
        tables = project_tables(self.data)
        return {name: ResultTable(one.header, one.rows) for name, one in tables.items()}

    @spoken
    def export(self, output: AnyPath | None = None, *, force: bool = False) -> tuple[str, ...]:
        """Write all tables as CSV.

        Args:
            output: folder of the files, made if it is missing; ``RESULT.export`` if None.
            force: replace any files of the same names.

        Returns:
            The paths of the files.

        Raises:
            OutputError: a file exists or cannot be written.
        """
        texts = {name: csv_text(one) for name, one in project_tables(self.data).items()}
        place = None if output is None else os.fspath(output)
        return export_project(self.path, self.data, texts, output=place, force=force)

    def __str__(self) -> str:
        return project_summary(self.data)

    def __repr__(self) -> str:
        count = f"{len(self.data.fitted)} sections"
        return f"ProjectFit({Path(self.path).name}: {self.status}; {count})"

    def _repr_html_(self) -> str:
        findings = tag("ul", *(tag("li", text) for text in self.findings))
        return joined([table(common_table(self.data)), table(laws_table(self.data)), findings])


class ByName(Mapping[str, _OfName]):
    """What a project has several of, by name.

    Args:
        items: they.
        kind: what they are, for messages.
    """

    def __init__(self, items: Mapping[str, _OfName], kind: str) -> None:
        self._items, self._kind = dict(items), kind

    def __getitem__(self, name: str) -> _OfName:
        if name not in self._items:
            message = f"there is no {self._kind} '{name}'. {did_you_mean(name, self._items)}"
            raise KeyError(message.strip())
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)


@spoken
def fit_project(
    project: AnyPath,
    *,
    leave_one_out: bool = False,
    output: AnyPath | None = None,
    jobs: int | None = None,
    max_time: float | None = None,
    force: bool = False,
    fresh: bool = False,
    trust: bool = False,
    progress: Progress | None = None,
    cluster: AnyPath | None = None,
) -> ProjectFit:
    """Fit several sections of one ground together, as a project file says.

    Sections that the project leaves out are predicted, with 95 % bands. A result of the same input
    is kept and comes back at once; a call that is interrupted goes on by the same call.

    Args:
        project: path of the file that names the sections.
        leave_one_out: predict each section from the others, too.
        output: file or existing folder of the result; ``PROJECT.fit.h5`` beside the file if None.
        jobs: how many sections to compute at a time; None for the cores there are.
        max_time: seconds after which the search ends with what it has.
        force: overwrite a result of other input.
        fresh: compute again what is up to date.
        trust: programs and functions that cases of sections name as their models may be run;
            remembered.
        progress: is told of every iteration.
        cluster: in place of processes of this machine: address of a scheduler of dask, ``local``,
            or the path of a cluster file.

    Raises:
        InputError: the project or the case of a section is wrong, with all faults; or nobody has
            said that what a case names may be run.
        ModelError: the model of a section has no solution.
        OutputError: the result cannot be written, or would replace one of other input.
    """
    request = ProjectRequest(
        case=os.fspath(project),
        output=None if output is None else os.fspath(output),
        leave_one_out=leave_one_out,
        jobs=jobs,
        force=force,
        fresh=fresh,
    )
    job = plan_project(request)
    with decided_by(trusting(trust=trust)):
        fit = run_project(job, control(progress, max_time, jobs, cluster))
    return ProjectFit(fit.result, fit.paths[0], fit.up_to_date)


@spoken
def read_project(path: AnyPath) -> ProjectFit:
    """Read the result of several sections that `fit_project` or the command has written.

    Args:
        path: of the result.

    Raises:
        InputError: the file is missing, damaged, or no such result.
    """
    file = os.fspath(path)
    return ProjectFit(read_project_result(file), file, up_to_date=True)
