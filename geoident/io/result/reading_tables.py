"""The readings of a result file: the long table, and the wide views of it.

``/readings`` has one entry a reading (axis ``reading``): ``channel``, ``gauge``, ``stage``,
``time``, ``value``, ``sd``, ``used``, ``bad``, ``reason``, ``computed``, ``residual``,
``dimension``, ``unit``; of a fit also its influence and its ``sensitivity``; where readings share
errors also ``own_sd``, what each has by itself, and ``epochs``, the days of a mean. Values are in
the SI unit that stands in ``unit``. ``/gauges`` and ``/diagnostics`` hold the same by channel and
stage, for who wants tables; they are written and, since format 2, not read.

A file of format 1 has only the wide tables: one reading a channel and stage, without its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, refusal
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import PARTS, ErrorParts, ReadingTable
from geoident.model.results.result import DIAGNOSTIC_COLUMNS, AccuracyTable, Diagnostics, GaugeTable
from geoident.units import DIMENSIONS

ACCURACIES = "accuracies"

_FLOATS = ("time", "value", "sd", "computed")


def write_readings(
    file: h5py.File, gauges: GaugeTable, found: Diagnostics | None, names: Sequence[str]
) -> None:
    """Writes ``/readings``.

    Args:
        file: the result.
        gauges: with the k readings.
        found: the influence of each of them, or None.
        names: of the n parameters.
    """
    table = gauges.readings
    dimension = dict(zip(gauges.channels, gauges.dimensions, strict=True))
    dimensions = [dimension.get(channel, "") for channel in table.channel]
    axes: dict[str, Sequence[str] | Ints] = {
        "reading": np.arange(len(table), dtype=np.int64),
        "parameter": tuple(names),
    }
    out = TableWriter(file, "readings", axes)
    for name in ("channel", "gauge", "stage", "reason"):
        out.add(name, getattr(table, name), "reading")
    if table.note:
        out.add("note", table.note, "reading")
    for name in _FLOATS:
        unit = "s since 1970-01-01" if name == "time" else ""
        out.add(name, getattr(table, name), "reading", unit=unit)
    out.add("residual", table.value - table.computed, "reading")
    out.add("used", table.used, "reading")
    out.add("bad", table.bad, "reading")
    out.add("dimension", dimensions, "reading")
    out.add("unit", [DIMENSIONS.get(name, "") for name in dimensions], "reading")
    if table.own_sd is not None:
        out.add("own_sd", table.own_sd, "reading")
    if table.epochs is not None:
        out.add("epochs", table.epochs, "reading")
    if table.sensitivity is not None:
        out.add("sensitivity", table.sensitivity, "reading", "parameter")
    if found is not None:
        for name in DIAGNOSTIC_COLUMNS:
            out.add(name, getattr(found, name), "reading")
        out.add("influence", found.influence, "reading", "parameter")


def read_readings(file: h5py.File, n: int) -> ReadingTable:
    """The readings; n is the number of parameters."""
    group = TableReader(file, "readings")
    channel = group.texts("channel")
    k = len(channel)
    columns: dict[str, Any] = {name: group.floats(name, k) for name in _FLOATS}
    return ReadingTable(
        channel=channel,
        gauge=group.texts("gauge", k),
        stage=group.texts("stage", k),
        reason=group.texts("reason", k),
        used=group.bools("used", k),
        bad=group.bools("bad", k),
        sensitivity=group.floats("sensitivity", k, n) if "sensitivity" in group else None,
        own_sd=group.floats("own_sd", k) if "own_sd" in group else None,
        epochs=group.ints("epochs", k) if "epochs" in group else None,
        note=group.texts("note", k) if "note" in group else (),
        **columns,
    )


def write_gauges(file: h5py.File, table: GaugeTable) -> None:
    """Writes ``/gauges``. ``residual`` is measured minus computed.

    ``instrument`` is the gauge to which a channel belongs, ``unit`` the SI unit of its readings,
    ``display_unit`` the one in which people want to see them. Where readings share errors,
    ``error_sd`` has the standard deviations that these are made of, ``along`` per root of a metre.

    Args:
        file: the result.
        table: channels and readings.
    """
    axes: dict[str, Sequence[str] | Ints] = {
        "gauge": table.channels,
        "stage": table.stages,
        "end": ("first", "second"),
        "axis": ("x", "y", "z")[: table.first.shape[1]],
    }
    if any(table.errors):
        axes["error_part"] = PARTS
    if any(parts is not None and parts.surface for parts in table.errors):
        axes[_SOURCES] = np.arange(_surface_errors(table).shape[2])
    out = TableWriter(file, "gauges", axes)
    unit = reading_unit(table)
    out.add("measured", table.measured, "gauge", "stage", unit=unit)
    out.add("computed", table.computed, "gauge", "stage", unit=unit)
    out.add("residual", table.measured - table.computed, "gauge", "stage", unit=unit)
    out.add("sd", table.sd, "gauge", "stage", unit=unit)
    out.add("used", table.used, "gauge", "stage")
    out.add("bad", table.bad, "gauge", "stage")
    out.add("instrument", table.gauges, "gauge")
    out.add("dimension", table.dimensions, "gauge")
    out.add("unit", [DIMENSIONS.get(name, "") for name in table.dimensions], "gauge")
    out.add("display_unit", table.units, "gauge")
    out.add("accuracy", table.accuracy, "gauge", unit=unit)
    if any(table.errors):
        out.add("error_sd", _sizes(table.errors), "gauge", "error_part", unit=unit)
        surveyed = [0.0 if e is None else e.zero_surveyed for e in table.errors]
        out.add("zero_surveyed", np.array(surveyed), "gauge")
        out.add("survey", ["" if e is None else e.survey for e in table.errors], "gauge")
    if any(parts is not None and parts.mesh for parts in table.errors):
        for name, values in zip(_OF_MESH, _mesh_errors(table), strict=True):
            out.add(name, values, "gauge", "stage", unit=unit)
    if _SOURCES in axes:
        found = _surface_errors(table)
        out.add("surface_error", found, "gauge", "stage", _SOURCES, unit=unit)
    points = np.stack([table.first, table.second], axis=1)
    out.add("points", points, "gauge", "end", "axis", unit="m")


_SOURCES = "surface_error_source"
_OF_MESH = ("mesh_error", "mesh_doubt")


def _mesh_errors(table: GaugeTable) -> tuple[Floats, Floats]:
    """(n_channels, n_stages) errors of the mesh that count in the covariance, and their doubts."""
    error, doubt = np.zeros((2, len(table.channels), len(table.stages)))
    for i, parts in enumerate(table.errors):
        for stage, size, uncertain in parts.mesh if parts is not None else ():
            if stage in table.stages:
                at = i, table.stages.index(stage)
                error[at], doubt[at] = size, uncertain
    return error, doubt


def _surface_errors(table: GaugeTable) -> Floats:
    """(n_channels, n_stages, k) errors of response surfaces: sizes of the k that are shared."""
    rows = [
        (i, stage, sizes)
        for i, parts in enumerate(table.errors)
        for stage, sizes in (parts.surface if parts is not None else ())
        if stage in table.stages
    ]
    found = np.zeros((len(table.channels), len(table.stages), max(len(r[2]) for r in rows)))
    for i, stage, sizes in rows:
        found[i, table.stages.index(stage), : len(sizes)] = sizes
    return found


_FORMER_DOUBT = 0.5
"""Of errors by the mesh, in results that do not say it."""


def _sizes(errors: Sequence[ErrorParts | None]) -> Floats:
    """(n_channels, parts) standard deviations; NaN where readings share nothing."""
    rows = [[np.nan if e is None else getattr(e, part) for part in PARTS] for e in errors]
    return np.array(rows, dtype=np.float64)


def _errors(group: TableReader, m: int) -> tuple[ErrorParts | None, ...]:
    """What `_sizes` wrote of m channels."""
    if "error_sd" not in group:
        return ()
    sizes, surveys = group.floats("error_sd", m, len(PARTS)), group.texts("survey", m)
    zeros = group.floats("zero_surveyed", m).tolist()
    stages = group.texts("stage")
    shape = m, len(stages)
    mesh = group.floats("mesh_error", *shape) if "mesh_error" in group else np.zeros(shape)
    doubt = group.floats("mesh_doubt", *shape) if "mesh_doubt" in group else _FORMER_DOUBT * mesh
    surface = _read_surface(group, *shape)
    found: list[ErrorParts | None] = []
    rows = zip(sizes.tolist(), surveys, zeros, mesh.tolist(), doubt.tolist(), surface, strict=True)
    for row, survey, zero, of_mesh, of_doubt, of_surface in rows:
        parts: dict[str, Any] = dict(zip(PARTS, row, strict=True))
        known = not np.isnan(row[0])
        each = zip(stages, of_mesh, of_doubt, strict=True)
        by_stage = tuple((s, e, d) for s, e, d in each if e or d)
        parts |= {"survey": survey, "zero_surveyed": zero, "mesh": by_stage}
        here = tuple((s, tuple(row)) for s, row in zip(stages, of_surface, strict=True) if any(row))
        found.append(ErrorParts(**parts, surface=here) if known else None)
    return tuple(found)


def _read_surface(group: TableReader, m: int, stages: int) -> list[list[list[float]]]:
    """What `_surface_errors` wrote of m channels."""
    if "surface_error" not in group:
        return [[[]] * stages] * m
    k = len(group.array(_SOURCES, "iu"))
    found: list[list[list[float]]] = group.floats("surface_error", m, stages, k).tolist()
    return found


def reading_unit(table: GaugeTable) -> str:
    """The SI unit of all readings; where they have several, where to find it."""
    units = {DIMENSIONS.get(name, "") for name in table.dimensions} or {"m"}
    return units.pop() if len(units) == 1 else "SI, see /gauges/unit"


def read_gauges(file: h5py.File, n: int) -> GaugeTable:
    """Channels and readings; n is the number of parameters.

    Raises:
        InputError: readings of a channel or stage that is not there.
    """
    group = TableReader(file, "gauges")
    channels = _channels(group)
    m = len(channels["channels"])
    readings = read_readings(file, n)
    unknown = {*readings.channel} - {*channels["channels"]} or {*readings.stage} - {
        *channels["stages"]
    }
    if unknown:
        message = f"/readings speaks of '{min(unknown)}', which /gauges does not have"
        raise refusal(file.filename, "damaged-result", message)
    return GaugeTable(
        **channels,
        readings=readings,
        gauges=group.texts("instrument", m),
        dimensions=group.texts("dimension", m),
        units=group.texts("display_unit", m),
        accuracy=group.floats("accuracy", m),
        errors=_errors(group, m),
    )


def _channels(group: TableReader) -> dict[str, Any]:
    """What both formats hold of a `GaugeTable` in the same way."""
    channels, stages = group.texts("gauge"), group.texts("stage")
    points = group.floats("points", len(channels), 2, len(group.texts("axis")))
    return {
        "channels": channels,
        "stages": stages,
        "computed": group.floats("computed", len(channels), len(stages)),
        "first": points[:, 0].copy(),
        "second": points[:, 1].copy(),
    }


_OF_ALL = ("misfit", "above", "below")
"""Attributes of ``/diagnostics`` that older files lack."""


def write_diagnostics(
    file: h5py.File, found: Diagnostics, gauges: GaugeTable, names: Sequence[str]
) -> None:
    """Writes ``/diagnostics``, dimensionless; its attributes hold what is said of all.

    Args:
        file: the result.
        found: the influence of each reading.
        gauges: with the readings.
        names: of the n parameters.
    """
    wide = found.wide(gauges)
    axes = {"gauge": gauges.channels, "stage": gauges.stages, "parameter": tuple(names)}
    out = TableWriter(file, "diagnostics", axes)
    for name in DIAGNOSTIC_COLUMNS:
        out.add(name, getattr(wide, name), "gauge", "stage")
    out.add("influence", wide.influence, "gauge", "stage", "parameter")
    out.group.attrs["loss"] = found.loss
    out.group.attrs["weighted_squares"] = np.float64(found.squares)
    for name in ("scale", *_OF_ALL):
        out.group.attrs[name] = np.float64(getattr(found, name))


def read_diagnostics(file: h5py.File, n: int) -> Diagnostics:
    """The influence of each reading; n is the number of parameters."""
    table = TableReader(file, "readings")
    return _diagnostics(file, table, (len(table.texts("channel")),), n, at=...)


def _diagnostics(
    file: h5py.File, table: TableReader, shape: tuple[int, ...], n: int, *, at: Any
) -> Diagnostics:
    """The columns of a table of some shape, at an index of it."""
    about = TableReader(file, "diagnostics")
    found = Diagnostics(
        loss=about.attribute("loss", str),
        squares=about.attribute("weighted_squares", float),
        scale=about.attribute("scale", float),
        influence=table.floats("influence", *shape, n)[at],
        **{name: table.floats(name, *shape)[at] for name in DIAGNOSTIC_COLUMNS},
    )
    known = [name for name in _OF_ALL if name in about.group.attrs]
    of_all: dict[str, Any] = {name: about.attribute(name, float) for name in known}
    return replace(found, **of_all)


def write_accuracies(file: h5py.File, table: AccuracyTable) -> None:
    """Writes ``/accuracies``: what was estimated of the errors, one component of variance a row.

    Args:
        file: the result.
        table: standard deviations in SI, or factors of what was stated (no part, dimensionless).
    """
    axes: dict[str, Any] = {"component": table.names}
    if len(table.odds):
        axes |= {"reading": np.arange(len(table.of_reading)), "point": np.arange(len(table.odds))}
    out = TableWriter(file, ACCURACIES, axes)
    for name in ("values", "lower95", "upper95"):
        out.add(name, getattr(table, name), "component")
    for name in ("parts", "dimensions", "units"):
        out.add(name, getattr(table, name), "component")
    if len(table.odds):
        out.add("of_reading", table.of_reading, "reading")
        out.add("points", table.points, "point", "component")
        for name in ("odds", "flat"):
            out.add(name, getattr(table, name), "point")


def read_accuracies(file: h5py.File) -> AccuracyTable:
    """What was estimated of the errors."""
    group = TableReader(file, ACCURACIES)
    names = group.texts("component")
    c = len(names)
    possible: dict[str, Any] = {}
    if "points" in group:  # not in files of earlier versions
        m, readings = (len(group.array(axis, "iu")) for axis in ("point", "reading"))
        possible = {name: group.floats(name, m) for name in ("odds", "flat")}
        possible["points"] = group.floats("points", m, c)
        possible["of_reading"] = group.ints("of_reading", readings)
    return AccuracyTable(
        names=names,
        values=group.floats("values", c),
        lower95=group.floats("lower95", c),
        upper95=group.floats("upper95", c),
        parts=group.texts("parts", c),
        dimensions=group.texts("dimensions", c),
        units=group.texts("units", c),
        **possible,
    )


# Format 1: wide tables alone


def long_table(
    channels: Sequence[str],
    stages: Sequence[str],
    measured: Floats,
    *,
    sd: Floats,
    used: Bools,
    bad: Bools,
    computed: Floats,
    sensitivity: Floats | None = None,
) -> ReadingTable:
    """The k readings of a wide table, stage by stage: one a channel and stage, times unknown.

    Args:
        channels: names; a gauge of several has them as ``gauge.anchor``.
        stages: names.
        measured: (n_channels, n_stages) SI; NaN where there is no reading.
        sd: (n_channels, n_stages) SI.
        used: (n_channels, n_stages) it took part in the identification.
        bad: (n_channels, n_stages) it is known to be wrong.
        computed: (n_channels, n_stages) SI.
        sensitivity: (n_channels, n_stages, n) or None.
    """
    places = np.argwhere(np.isfinite(measured).T)[:, ::-1]
    at = tuple(places.T)
    names = tuple(channels[i] for i in places[:, 0])
    return ReadingTable(
        channel=names,
        gauge=tuple(name.partition(".")[0] for name in names),
        stage=tuple(stages[j] for j in places[:, 1]),
        time=np.full(len(places), np.nan),
        value=measured[at],
        sd=sd[at],
        used=used[at],
        bad=bad[at],
        reason=tuple(_why(bool(u), bool(b)) for u, b in zip(used[at], bad[at], strict=True)),
        computed=computed[at],
        sensitivity=None if sensitivity is None else sensitivity[at],
    )


def _why(used: bool, bad: bool) -> str:
    return "" if used else "flagged as bad: see the notes" if bad else "see the notes"


def gauges_of_wide(file: h5py.File, sensitivity: Floats | None) -> GaugeTable:
    """The gauges of a file of format 1: all read lengths.

    Args:
        file: the result.
        sensitivity: (n_channels, n_stages, n) of the same file, or None.
    """
    group = TableReader(file, "gauges")
    channels = _channels(group)
    names, computed = channels["channels"], channels["computed"]
    shape = computed.shape
    readings = long_table(
        names,
        channels["stages"],
        group.floats("measured", *shape),
        sd=group.floats("sd", *shape),
        used=group.bools("used", *shape),
        bad=group.bools("bad", *shape),
        computed=computed,
        sensitivity=sensitivity,
    )
    return GaugeTable(
        **channels,
        readings=readings,
        gauges=tuple(name.partition(".")[0] for name in names),
        dimensions=("length",) * len(names),
        units=("mm",) * len(names),
        accuracy=np.full(len(names), np.nan),
    )


def diagnostics_of_wide(file: h5py.File, gauges: GaugeTable, n: int) -> Diagnostics:
    """The diagnostics of a file of format 1, one a channel and stage.

    Args:
        file: the result.
        gauges: its channels and readings.
        n: number of parameters.
    """
    places = [gauges.place(k) for k in range(len(gauges.readings))]
    at = tuple(np.array(places, dtype=np.int64).reshape(-1, 2).T)
    return _diagnostics(file, TableReader(file, "diagnostics"), gauges.computed.shape, n, at=at)
