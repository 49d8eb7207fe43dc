"""Result files: HDF5, one group a table, described in docs/result_file.md.

Everything that identifies a result stands in the attributes of the root group. A file appears under
its name only when it is complete (`geoident.io.text.atomic`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py

from geoident.errors import InputError
from geoident.io.result import posterior, reduced, vtkhdf
from geoident.io.result.hdf5 import (
    TableReader,
    TableWriter,
    hdf5_input,
    hdf5_output,
    refusal,
    texts,
)
from geoident.io.result.records import read_record, write_record
from geoident.io.text.atomic import atomic_output
from geoident.model.results.columns import Record, Slot, column, slots
from geoident.model.results.result import Diagnostics, GaugeTable, Grid, Result, fingerprint
from geoident.model.results.varied import FieldEstimate
from geoident.model.results.yielded import Mechanism
from geoident.units import DIMENSIONS, si_unit

FORMAT = "geoident-result/2"
PROJECT_FORMAT = "geoident-project-result/1"
"""The format of results of several sections, see `geoident.io.result.project`."""

_MECHANISM, _VARIED, _GRID = "mechanism", "fields", "grid"


class ResultIdentity(Record):
    """What tells whether an existing result is up to date.

    Args:
        identity: hash of everything that it depends on.
        kind: the command that wrote it.
        status: how it ended.
        exit_code: of the command.
        case_file: path of its case as seen from the folder of the result.
        seconds: that it took to compute; infinite where that is unknown.
        objective: its misfit.
        stamp: see `geoident.model.results.result.Provenance`.
        fit_file: likewise.
        fit_fingerprint: likewise.
        contents: names of its groups, with spaces between them.
    """

    identity: str
    kind: str
    status: str
    exit_code: int
    case_file: str
    seconds: float = column(default=math.inf, optional=True)
    objective: float = column(default=math.nan, optional=True)
    stamp: str = column(default="", optional=True)
    fit_file: str = column(default="", optional=True)
    fit_fingerprint: str = column(default="", optional=True)
    contents: str = column(default="", optional=True)

    @property
    def fingerprint(self) -> str:
        """See `geoident.model.results.result.Result.fingerprint`."""
        return fingerprint(self.identity, self.status, self.objective)


def write_result(
    result: Result, path: str | Path, *, overwrite: bool, inputs: Sequence[str] = ()
) -> tuple[str, ...]:
    """Writes a result, and beside it a sidecar for ParaView if it has fields.

    The sidecar is put in place first: a complete result always has its sidecar.

    Args:
        result: what to write.
        path: the result file; the sidecar has the suffix ``.vtkhdf`` in place of ``.h5``.
        overwrite: replace an existing file.
        inputs: paths of what the command has read, which are never replaced.

    Returns:
        The paths written, the result first.

    Raises:
        OutputError: a file exists or cannot be written; the result is then as it was before.
    """
    sidecar = vtkhdf.sidecar_path(path)
    with atomic_output(path, overwrite=overwrite, inputs=inputs) as temporary:
        small = result.fields is None and result.reduced is None and result.posterior is None
        with hdf5_output(temporary, small=small) as file:
            _write(file, result)
        if sidecar and result.fields is not None:
            _write_sidecar(sidecar, Path(path).name, overwrite=overwrite, inputs=inputs)
    if sidecar is None or result.fields is None:
        _drop_sidecar(sidecar, Path(path).name)
        return (str(path),)
    return (str(path), str(sidecar))


def _write_sidecar(sidecar: Path, name: str, *, overwrite: bool, inputs: Sequence[str]) -> None:
    """Writes the sidecar; one that points to this result already may be replaced anyway."""
    own = vtkhdf.sidecar_target(sidecar) == name
    with atomic_output(sidecar, overwrite=overwrite or own, inputs=inputs) as temporary:
        vtkhdf.write_sidecar(temporary, name)


def _drop_sidecar(sidecar: Path | None, name: str) -> None:
    """Removes the sidecar of the result that was replaced by one without fields."""
    if sidecar is not None and vtkhdf.sidecar_target(sidecar) == name:
        with suppress(OSError):
            sidecar.unlink()


def _write(file: h5py.File, result: Result) -> None:
    file.attrs["format"] = FORMAT
    units = {"gauge": _reading_unit(result.gauges)}
    more = [*_wide_diagnostics(result)]
    write_record(file, result, labels=result.labels, units=units, more=more)
    if result.grid is not None:
        _write_grid(file, result.grid)
    if result.varied:
        _write_varied(file, result.varied)
    if result.posterior is not None:
        posterior.write_posterior(file, result.posterior, result.parameters)
    if result.reduced is not None:
        reduced.write_reduced(file, result.reduced)
    if result.fields is not None:
        times = result.gauges.series_times
        vtkhdf.write_fields(file, result.fields, result.varied, result.mechanism, times)
        if result.mechanism is not None:
            write_record(file, result.mechanism, _MECHANISM, labels={}, units={})
    file.attrs["contents"] = " ".join(sorted(file))


def _reading_unit(table: GaugeTable) -> str:
    """The SI unit of all readings; where they have several, where to find it."""
    units = {si_unit(name) for name in table.dimensions} or {"m"}
    return units.pop() if len(units) == 1 else "SI, see /gauges/unit"


def _wide_diagnostics(result: Result) -> Iterator[tuple[Slot, Any]]:
    """The columns of the diagnostics by channel and stage, for who wants tables; not read."""
    if result.diagnostics is not None:
        wide = result.diagnostics.wide(result.gauges)
        for slot in slots(Diagnostics):
            if slot.axes:
                axes = ("gauge", "stage", *slot.axes[1:])
                yield replace(slot, group="diagnostics", axes=axes), slot.get(wide)


def _write_grid(file: h5py.File, grid: Grid) -> None:
    """Writes ``/grid``: the axes under the names of their parameters, and ``objective``."""
    names = [_axis_name(name) for name in grid.names]
    out = TableWriter(file, _GRID, dict(zip(names, grid.axes, strict=True)))
    out.group.attrs.create("parameters", texts(grid.names), dtype=h5py.string_dtype())
    out.add("objective", grid.objective, *names)


def _read_grid(file: h5py.File) -> Grid:
    group = TableReader(file, _GRID)
    names = group.attribute_texts("parameters")
    axes = tuple(group.array(_axis_name(name), "f") for name in names)
    return Grid(names, axes, group.floats("objective", *(len(axis) for axis in axes)))


def _axis_name(parameter: str) -> str:
    """Name of the dataset of an axis, which must not be that of the discrepancy."""
    return f"{parameter}_" if parameter == "objective" else parameter


def _write_varied(file: h5py.File, estimates: Sequence[FieldEstimate]) -> None:
    """Writes ``/fields``, a group for each; ``sd`` and ``prior_sd`` are of the logarithm."""
    group = file.create_group(_VARIED)
    group.attrs.create("names", texts([one.name for one in estimates]), dtype=h5py.string_dtype())
    for number, one in enumerate(estimates):
        units = {"field": DIMENSIONS.get(one.dimension, "")}
        write_record(group, one, str(number), labels={}, units=units)


def _read_varied(file: h5py.File) -> tuple[FieldEstimate, ...]:
    group = TableReader(file, _VARIED)
    count = len(group.attribute_texts("names"))
    return tuple(read_record(group.group, FieldEstimate, str(k)) for k in range(count))


def read_identity(path: str | Path) -> ResultIdentity | None:
    """What identifies an existing result; None if there is none, or it is not readable as one."""
    try:
        with hdf5_input(path) as file:
            if file.attrs.get("format") != PROJECT_FORMAT:
                _refuse_unknown_format(file, path)
            return read_record(file, ResultIdentity)
    except InputError:
        return None


def read_result(path: str | Path) -> Result:
    """Reads back all that `write_result` wrote.

    Raises:
        InputError: no such file, not a result, of a version this program does not know, truncated
            or damaged; it says which piece is missing.
    """
    with hdf5_input(path) as file:
        _refuse_unknown_format(file, path)
        return _read(file)


def _refuse_unknown_format(file: h5py.File, path: str | Path) -> None:
    stored = file.attrs.get("format")
    if stored == FORMAT:
        return
    target = vtkhdf.sidecar_target(path)
    if target is not None:
        hint = f"this is the sidecar for ParaView; the result is {target}"
        raise refusal(path, "not-a-result", "not a result of geoident", hint)
    if stored == PROJECT_FORMAT:
        hint = "geoident show and geoident report read it; give one of a case here"
        raise refusal(path, "not-a-result", "the result of several sections, not of a case", hint)
    if not isinstance(stored, str) or not stored.startswith("geoident-result/"):
        hint = "give the path of a result file, such as CASE.fit.h5"
        raise refusal(path, "not-a-result", "an HDF5 file, but not a result of geoident", hint)
    hint = "read it with the version of geoident that wrote it, or run the command again"
    message = f"format {stored!r} is not known; expected {FORMAT!r}"
    raise refusal(path, "unknown-format", message, hint)


def _read(file: h5py.File) -> Result:
    contents = TableReader(file, "").attribute("contents", str).split()
    names, gauges = TableReader(file, "parameters"), TableReader(file, "gauges")
    sizes = {"parameter": names.size("parameter"), "other": names.size("other")}
    sizes |= {axis: gauges.size(axis) for axis in ("gauge", "stage")}
    fields = vtkhdf.read_fields(file) if vtkhdf.GROUP in contents else None
    mechanism = None
    if fields is not None and _MECHANISM in contents:
        mesh = fields.mesh
        of_mesh = {"node": mesh.n_nodes, "element": mesh.n_elements, "component": mesh.dim}
        mechanism = read_record(file, Mechanism, _MECHANISM, sizes=of_mesh, mesh=mesh)
    result = read_record(
        file,
        Result,
        sizes=sizes,
        fields=fields,
        mechanism=mechanism,
        grid=_read_grid(file) if _GRID in contents else None,
        posterior=posterior.read_posterior(file) if posterior.GROUP in contents else None,
        reduced=reduced.read_reduced(file) if reduced.GROUP in contents else None,
        varied=_read_varied(file) if _VARIED in contents else (),
    )
    _refuse_contradictions(result, file.filename)
    return result


def _refuse_contradictions(result: Result, path: str) -> None:
    """Refuse a file whose tables do not go together.

    Raises:
        InputError: a value is no number, or a table names what another does not have.
    """
    table, gauges = result.parameters, result.gauges
    message = ""
    for name, value in zip(table.names, table.values, strict=True):
        if not math.isfinite(value):
            message = f"damaged: the value of the parameter {name!r} is not a finite number"
    unknown = {*gauges.readings.channel} - {*gauges.channels}
    unknown = unknown or {*gauges.readings.stage} - {*gauges.stages}
    if unknown:
        message = f"/readings speaks of '{min(unknown)}', which /gauges does not have"
    steps = () if result.backtest is None else result.backtest.steps
    if not {step.last for step in steps} <= {*range(len(gauges.stages))}:
        message = "/backtest/last names a stage that is not there"
    if message:
        raise refusal(path, "damaged-result", message)
