"""Cases from files, texts and mappings; what they amount to, and what their gauges would read."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geoident.api.calling import AnyPath, needed, spoken
from geoident.api.notebook import case_html, case_line
from geoident.api.plots import Drawing
from geoident.api.tables import ResultTable
from geoident.errors import InputError, Location, UsageError
from geoident.forward.external.program import ProgramModel
from geoident.io.campaign.file import read_campaign
from geoident.io.cluster.file import read_cluster
from geoident.io.docs.templates import TEMPLATES
from geoident.io.text.head import said_format
from geoident.model.case import Case
from geoident.model.gauges import Reading
from geoident.model.results.summary import CaseSummary
from geoident.report.page.html import Html, tag
from geoident.report.text.case import case_text
from geoident.report.text.gauges import readings_csv
from geoident.units import in_unit, shown_unit, si_unit
from geoident.workflow.check import Checked
from geoident.workflow.check import check as run_check
from geoident.workflow.init import init_template
from geoident.workflow.programs.trust import decided_by, trusting
from geoident.workflow.programs.workplace import trusted
from geoident.workflow.running.jobs import NO_READINGS, build_model, load_inputs
from geoident.workflow.running.remade import write_readings
from geoident.workflow.simulate import ComputedBy, Noise, Outputs, Simulated
from geoident.workflow.simulate import simulate as run_simulation

if TYPE_CHECKING:
    import pandas as pd

CaseValues = Mapping[str, object]
"""Path of a key of a case to its value: a text, a number, a list, a mapping, or None."""


@dataclass(frozen=True, repr=False)
class CaseFile:
    """A case that was read and is right, as far as that can be told without its mesh.

    Args:
        path: of the file, or where it would stand.
        overrides: texts ``path=value`` that replace values of the file.
        case: what it says, in SI units.
        text: of a case that stands in no file; None for one that does.
    """

    path: str
    overrides: tuple[str, ...]
    case: Case
    text: str | None = field(default=None)

    @property
    def title(self) -> str:
        """The title of the case."""
        return self.case.title

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages, in their order."""
        return tuple(stage.name for stage in self.case.stages)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels of all gauges."""
        return tuple(channel.name for channel in self.case.channels)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.case.parameters)

    @spoken
    def with_values(self, values: CaseValues) -> CaseFile:
        """The same case with other values, such as ``{"materials.rock.nu": 0.3}``.

        The file stays as it is. Results of the varied case are other results: give each an
        ``output`` of its own.

        Args:
            values: path of a key to its value, such as ``"parameters.E.start"`` to ``"20 GPa"``, or
                ``"stages[1].name"``; a value with a dimension is a text with its unit. Texts,
                numbers, lists and mappings are those of Python; None takes a parameter out.

        Raises:
            InputError: with all faults of the case with these values.
        """
        return _loaded(self.path, (*self.overrides, *_overrides(values)), self.text)

    def __repr__(self) -> str:
        changed = f"; with {', '.join(self.overrides)}" if self.overrides else ""
        return f"CaseFile({Path(self.path).as_posix()}: {case_line(self.case)}{changed})"

    def _repr_html_(self) -> str:
        return case_html(self.case, self.path)


@spoken
def load_case(
    path: AnyPath,
    overrides: CaseValues | None = None,
    *,
    content: str | Mapping[str, Any] | None = None,
) -> CaseFile:
    """Read a case and its readings; the mesh is not opened before it is needed.

    Args:
        path: of the case.
        overrides: values in place of those of the file, such as
            ``{"parameters.E_rock.start": "20 GPa"}``; see `CaseFile.with_values`.
        content: what the file says, as a text or as a mapping of its keys, for a case that stands
            in no file. ``path`` is then where it would stand: files that it names are looked for
            from there, and results go there.

    Raises:
        InputError: with all faults of the case.
    """
    text = content if isinstance(content, str) or content is None else _written(content)
    try:
        return _loaded(os.fspath(path), _overrides(overrides or {}), text)
    except InputError as error:
        if content is None or isinstance(content, str):
            raise
        raise InputError(  # lines of a text that nobody has seen
            replace(fault, location=Location(fault.location.file)) for fault in error.faults
        ) from error


@spoken
def trust(case: CaseFile | AnyPath) -> None:
    """Say that the program or function that a case names as its model may be run.

    It is remembered in the folder of its runs, for this user on this machine, until a file of the
    model changes. Without it such a case is refused, since a case may come from anywhere. The same
    holds for what a cluster file or a campaign gives to a scheduler or a queue system.

    Args:
        case: as loaded, or its path; or the path of a cluster file or of a campaign.

    Raises:
        InputError: with all faults of the case.
        UsageError: it names nothing that is run.
    """
    origin = origin_of(case)
    format_text = said_format(origin.path) if origin.text is None else ""
    if format_text.startswith(("geoident-cluster/", "geoident-campaign/")):
        of_campaign = format_text.startswith("geoident-campaign/")
        cluster = read_campaign(origin.path).cluster if of_campaign else read_cluster(origin.path)
        if cluster is None or cluster.local:
            raise UsageError(f"{origin.path} names no scheduler and no queue system.")
        with decided_by(trusting(trust=True)):
            trusted(cluster)
        return
    overrides = (*origin.overrides, NO_READINGS)
    inputs = load_inputs(origin.path, overrides=overrides, text=origin.text)
    model = build_model(inputs) if inputs.case.elsewhere is not None else None
    if not isinstance(model, ProgramModel):
        raise UsageError(
            f"{origin.path} runs nothing: its 'model' is neither a program nor a function."
        )
    with decided_by(trusting(trust=True)):
        model.runs.require_trust()


@spoken
def init(folder: AnyPath, template: str = "cavern", *, force: bool = False) -> CaseFile:
    """Write a small case that runs, with its mesh and its readings, and load it.

    Args:
        folder: where to write; made if it is missing.
        template: ``cavern``, ``tunnel``, ``twin-tunnels``, ``squeezing``, ``dam`` or ``opening``.
        force: replace files of the same names.

    Raises:
        UsageError: there is no such template.
        OutputError: files of these names exist, or cannot be written.
    """
    if template not in TEMPLATES:
        msg = f"There is no template {template!r}; there are {', '.join(TEMPLATES)}."
        raise UsageError(msg)
    return load_case(init_template(template, os.fspath(folder), force=force)[0])


@dataclass(frozen=True)
class CaseSource:
    """Where a case is read from, which a run does by itself.

    Args:
        path: of the file, or where it would stand.
        overrides: texts ``path=value``.
        text: of a case that stands in no file.
    """

    path: str
    overrides: tuple[str, ...] = ()
    text: str | None = None


def origin_of(case: CaseFile | AnyPath) -> CaseSource:
    """Where a case is read from: one that was loaded, or a path."""
    if isinstance(case, CaseFile):
        return CaseSource(case.path, case.overrides, case.text)
    return CaseSource(os.fspath(case))


def _loaded(path: str, overrides: tuple[str, ...], text: str | None) -> CaseFile:
    return CaseFile(path, overrides, load_inputs(path, overrides=overrides, text=text).case, text)


def _overrides(values: CaseValues) -> tuple[str, ...]:
    return tuple(f"{key}={_value(value)}" for key, value in values.items())


_BARE = re.compile(r"(?!(?:null|Null|NULL|~)$)[\w$](?:[\w$ .,/%^*+-]*[\w%])?")
"""Texts that stand in a case without quotes."""


def _value(value: object) -> str:
    """A value as it may be written in a case.

    >>> _value("20 GPa"), _value("a: b"), _value(2e7), _value(None), _value((1, 2))
    ('20 GPa', '"a: b"', '20000000', 'null', '[1, 2]')
    """
    if isinstance(value, str) and _BARE.fullmatch(value):
        return value
    if isinstance(value, float):
        return repr(float(value)).removesuffix(".0")
    return json.dumps(value, default=_plain, ensure_ascii=False)


def _written(content: Mapping[str, Any]) -> str:
    return json.dumps(dict(content), default=_plain, ensure_ascii=False, indent=1)


def _plain(value: object) -> object:
    """What JSON does not know: numbers and arrays of numpy, paths, other mappings."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return str(value)


@dataclass(frozen=True, repr=False)
class CheckResult:
    """A case in which nothing wrong was found, and what it amounts to.

    Args:
        data: case, mesh and summary.
    """

    data: Checked

    @property
    def summary(self) -> CaseSummary:
        """Groups, stages, gauges, readings and costs."""
        return self.data.summary

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what was noticed, none of which is an error."""
        return self.data.summary.notes

    @cached_property
    def plot(self) -> CasePlots:
        """The figure of the model, as axes of matplotlib."""
        return CasePlots(self.data)

    def __str__(self) -> str:
        return case_text(self.summary)

    def __repr__(self) -> str:
        summary = self.summary
        size = f"{summary.nodes} nodes, {summary.elements} elements" if summary.nodes else "no mesh"
        name = summary.title or summary.case
        return f"CheckResult({name}: valid; {size}, {summary.used} readings used)"

    def _repr_html_(self) -> str:
        return tag("pre", str(self))


class CasePlots:
    """The figure of a case that was checked.

    Args:
        checked: the case with its mesh.
    """

    def __init__(self, checked: Checked) -> None:
        self._checked = checked

    @spoken
    def model(self) -> Drawing:
        """Mesh, materials, stages, supports and gauges.

        Raises:
            MissingExtra: matplotlib is not installed.
            UsageError: the case has no mesh.
        """
        needed("matplotlib", extra="report", what="a figure")
        from geoident.report.drawing.model.figure import model_picture  # noqa: PLC0415

        if self._checked.mesh is None:
            msg = "The case has no mesh, so there is nothing to draw."
            raise UsageError(msg)
        return Drawing.of([model_picture(self._checked.case, self._checked.mesh)])


@spoken
def check(case: CaseFile | AnyPath, *, solver: str = "auto") -> CheckResult:
    """Find everything that is wrong with a case and its mesh, before computing.

    Args:
        case: as loaded, or its path.
        solver: name of the sparse solver, or ``auto``.

    Returns:
        What the case amounts to, in which nothing wrong was found.

    Raises:
        InputError: with all faults that are found in one go.
        ModelError: the model moves freely somewhere, or the virgin ground cannot bear its stress.
        UsageError: there is no such solver.
    """
    origin = origin_of(case)
    return CheckResult(
        run_check(origin.path, overrides=origin.overrides, solver=solver, text=origin.text)
    )


@dataclass(frozen=True, repr=False)
class SimulationResult:
    """Readings of the model at the start values of the parameters.

    Args:
        data: the case and the readings, SI.
    """

    data: Simulated

    @property
    def readings(self) -> tuple[Reading, ...]:
        """All of them, stage by stage, SI."""
        return self.data.readings

    @property
    def note(self) -> str:
        """Whose the readings are, where a reduced model was asked; empty else."""
        return self.data.note

    @property
    def csv(self) -> str:
        """Lines ``gauge,stage,value,unit``, which a case takes as its readings."""
        return readings_csv(self.data.readings, self.data.case.channels)

    def to_frame(self, *, si: bool = False) -> pd.DataFrame:
        """The readings as a ``pandas.DataFrame``, one row each: channel, stage, value, unit.

        Args:
            si: SI units in place of those of the case.

        Raises:
            MissingExtra: pandas is not installed.
        """
        frame = needed("pandas", extra="notebook", what="to_frame").DataFrame
        table = self._table(si=si)
        return frame({name: table.column(name) for name in table.header})

    @spoken
    def write(self, path: AnyPath, *, force: bool = False) -> str:
        """Write the readings into a file that a case takes; its path comes back.

        Args:
            path: of the file.
            force: replace any file; simulated readings of the same case are kept beside without.

        Raises:
            OutputError: another file is there, it is an input of the case, or cannot be written.
        """
        file, data = os.fspath(path), self.data
        write_readings(self.csv, file, case=data.path, force=force, inputs=data.files_read)
        return file

    def _table(self, *, si: bool = False) -> ResultTable:
        channels = {channel.name: channel for channel in self.data.case.channels}
        rows = []
        for reading in self.readings:
            channel = channels[reading.channel]
            unit = si_unit(channel.dimension) if si else channel.unit
            value = np.nan if reading.value is None else reading.value
            shown = in_unit(value, unit, channel.dimension)
            rows.append((channel.name, reading.stage, shown, shown_unit(unit, channel.dimension)))
        return ResultTable(("channel", "stage", "value", "unit"), tuple(rows))

    def __str__(self) -> str:
        return self.csv

    def __repr__(self) -> str:
        stages = dict.fromkeys(reading.stage for reading in self.readings)
        return f"SimulationResult({len(self.readings)} readings, {len(stages)} stages)"

    def _repr_html_(self) -> Html:
        return Html(self._table()._repr_html_())


@spoken
def simulate(
    case: CaseFile | AnyPath,
    *,
    noise: bool = False,
    draw: bool = False,
    seed: int = 0,
    solver: str = "auto",
    reduced: AnyPath | None = None,
    fields: AnyPath | None = None,
    force: bool = False,
) -> SimulationResult:
    """Compute what the gauges would read at the start values of the parameters.

    Other values of the parameters are those of a varied case:
    ``simulate(case.with_values({"parameters.E.start": "12 GPa"}))``.

    Args:
        case: as loaded, or its path; it needs no readings.
        noise: add Gaussian noise of the accuracy of each gauge, and what its readings share.
        draw: draw what varies from place to place (fields); else fields have their means.
        seed: of the noise and of what is drawn.
        solver: name of the sparse solver, or ``auto``.
        reduced: result of a fit that keeps a reduced model (``fit.reduced: keep``), which answers
            where it is estimated to be close enough; `SimulationResult.note` says whether it did.
        fields: file for displacements and stresses of all states, such as ``case.vtkhdf``.
        force: replace what stands there.

    Raises:
        InputError: with all faults of the case; or the reduced model is of another case.
        ModelError: the model has no solution at the start values.
        UsageError: there is no such solver, or there are no fields to write.
        OutputError: something stands in the place of the file, or it cannot be written.
    """
    origin = origin_of(case)
    simulation = run_simulation(
        origin.path,
        overrides=origin.overrides,
        noise=Noise.ACCURACY if noise else Noise.NONE,
        draw=draw,
        seed=seed,
        by=ComputedBy(solver, None if reduced is None else os.fspath(reduced)),
        to=Outputs(fields=None if fields is None else os.fspath(fields), force=force),
        text=origin.text,
    )
    return SimulationResult(simulation)
