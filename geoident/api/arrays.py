"""A result as one labelled data set of xarray, SI."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from geoident.api.calling import needed
from geoident.api.tables import dates_of
from geoident.model.results.columns import columns
from geoident.model.results.result import Result
from geoident.units import si_unit

if TYPE_CHECKING:
    import xarray as xr

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")
Variable = tuple[tuple[str, ...], Any]
"""Names of the dimensions of an array, and the array."""


def dataset(result: Result) -> xr.Dataset:
    """All arrays of a result under the names of their dimensions.

    Args:
        result: what was found.

    Raises:
        MissingExtra: xarray is not installed.
    """
    xarray = needed("xarray", extra="notebook", what="to_xarray")
    shown = result.for_people
    variables: dict[str, Variable] = {}
    for part in (_readings, _parameters, _predictions, _fields, _scan, _draws):
        variables |= dict(part(shown))
    data: xr.Dataset = xarray.Dataset(
        {name: (dims, _plain(values)) for name, (dims, values) in variables.items()},
        coords=_coordinates(shown),
        attrs={
            "kind": shown.kind,
            "status": shown.status,
            "reason": shown.reason,
            "method": shown.method,
            "objective": float(shown.objective),
            "case_file": shown.provenance.case_file,
            "created": shown.provenance.created,
            "units": "SI; those of readings and parameters are coordinates",
        },
    )
    for name, unit in {"displacement": "m", "stress": "Pa", "points": "m"}.items():
        if name in data:
            data[name].attrs["units"] = unit
    return data


def _plain(values: Any) -> Any:
    """Texts as objects, so that xarray keeps names of any length as they are."""
    array = np.asarray(values)
    return array.astype(object) if array.dtype.kind == "U" else array


def _coordinates(result: Result) -> dict[str, Variable]:
    gauges, table = result.gauges, result.parameters
    coordinates: dict[str, Variable] = {
        "channel": (("channel",), _names(gauges.channels)),
        "stage": (("stage",), _names(gauges.stages)),
        "gauge": (("channel",), _names(gauges.gauges)),
        "reading_unit": (("channel",), _names([si_unit(d) for d in gauges.dimensions])),
        "parameter": (("parameter",), _names(table.names)),
        "parameter_unit": (("parameter",), _names([si_unit(d) for d in table.dimensions])),
        "parameter_2": (("parameter_2",), _names(table.names)),
    }
    dates = dates_of(result)
    if dates is not None:
        coordinates["date"] = ("stage",), dates
    if result.fields is not None:
        states = ("virgin", *gauges.stages)[: len(result.fields.present)]
        coordinates["state"] = ("state",), _names(states)
        coordinates["axis"] = ("axis",), _names("xyz"[: result.fields.mesh.dim])
        coordinates["component"] = ("component",), _names(COMPONENTS)
    if result.grid is not None:
        for name, axis in zip(result.grid.names, result.grid.axes, strict=True):
            coordinates[name] = (name,), axis
    return coordinates


def _names(names: Any) -> Any:
    return np.array(list(names), dtype=object)


def _readings(result: Result) -> Iterator[tuple[str, Variable]]:
    table, both = result.gauges, ("channel", "stage")
    for name in ("measured", "computed", "sd", "used", "bad"):
        yield name, (both, getattr(table, name))
    if result.sensitivity is not None:
        yield "sensitivity", ((*both, "parameter"), result.sensitivity)


_DIMENSIONS = {"gauge": "channel", "other": "parameter_2"}
"""Axis of the result file to the dimension here, where they differ."""


def _parameters(result: Result) -> Iterator[tuple[str, Variable]]:
    yield from _columns(result.parameters)


def _predictions(result: Result) -> Iterator[tuple[str, Variable]]:
    if result.prediction is not None:
        yield from _columns(result.prediction)


def _columns(record: Any) -> Iterator[tuple[str, Variable]]:
    """The arrays of a record that are not the labels of an axis."""
    for one in columns(type(record)):
        labels = one.axes in ((), (one.name,))
        values = getattr(record, one.field)
        if labels or values is None or one.of is not None or "xarray" in one.hidden:
            continue
        if one.known:
            values = np.where(getattr(record, one.known), values, np.nan)
        dims = tuple(_DIMENSIONS.get(axis, axis) for axis in one.axes)
        yield one.array or one.title, (dims, values)


def _fields(result: Result) -> Iterator[tuple[str, Variable]]:
    fields = result.fields
    if fields is None:
        return
    yield "points", (("node", "axis"), fields.mesh.points)
    yield "displacement", (("state", "node", "axis"), fields.displacement)
    yield "stress", (("state", "element", "component"), fields.stress)
    yield "present", (("state", "element"), fields.present)
    yield "yielded", (("state", "element"), fields.yielded)
    if fields.temperature is not None:
        yield "temperature", (("state", "node"), fields.temperature)
    if result.mechanism is not None:
        yield "mechanism", (("node", "axis"), result.mechanism.velocity)
        yield "mechanism_shear", (("element",), result.mechanism.shear)


def _scan(result: Result) -> Iterator[tuple[str, Variable]]:
    if result.grid is not None:
        yield "misfit", (result.grid.names, result.grid.objective)


def _draws(result: Result) -> Iterator[tuple[str, Variable]]:
    if result.posterior is not None:
        yield "draws", (("draw", "parameter"), result.posterior.flat)
