"""The group ``/opening`` of a result: the ground reaction of an opening in closed form."""

from __future__ import annotations

from typing import Any

import h5py

from geoident.io.result.hdf5 import TableReader, TableWriter
from geoident.model.results.opening import GroundReaction

GROUP = "opening"
_ON_CURVE = {"displacement": "m", "plastic_radius": "m"}
_OF_STAGES = {"stage_pressure": "Pa", "stage_displacement": "m", "stage_plastic_radius": "m"}


def write_reaction(file: h5py.File, found: GroundReaction) -> None:
    """Writes ``/opening``: pressures and stresses positive in compression, motions inwards.

    Args:
        file: the result.
        found: the reaction.
    """
    axes: dict[str, Any] = {
        "axis": ("x", "y"),
        "component": ("xx", "yy", "zz", "xy"),
        "pressure": found.pressure,
        "stage": found.stages,
        "radii": found.radii,
    }
    out = TableWriter(file, GROUP, axes)
    out.group["pressure"].attrs["unit"] = "Pa"
    out.group["radii"].attrs["unit"] = "m"
    out.group.attrs["radius"] = float(found.radius)
    out.group.attrs["critical"] = float(found.critical)
    out.add("centre", found.centre, "axis", unit="m")
    out.add("in_situ", found.in_situ, "component", unit="Pa")
    for name, unit in _ON_CURVE.items():
        out.add(name, getattr(found, name), "pressure", unit=unit)
    for name, unit in _OF_STAGES.items():
        out.add(name, getattr(found, name), "stage", unit=unit)
    for name in ("radial", "hoop"):
        out.add(name, getattr(found, name), "stage", "radii", unit="Pa")


def read_reaction(file: h5py.File) -> GroundReaction:
    """The reaction as it was written."""
    group = TableReader(file, GROUP)
    pressure, radii = group.array("pressure", "f"), group.array("radii", "f")
    stages = group.texts("stage")
    k, s, m = len(pressure), len(stages), len(radii)
    found: dict[str, Any] = {name: group.floats(name, k) for name in _ON_CURVE}
    found |= {name: group.floats(name, s) for name in _OF_STAGES}
    found |= {name: group.floats(name, s, m) for name in ("radial", "hoop")}
    return GroundReaction(
        centre=group.floats("centre", len(group.texts("axis"))),
        radius=group.attribute("radius", float),
        in_situ=group.floats("in_situ", len(group.texts("component"))),
        critical=group.attribute("critical", float),
        pressure=pressure,
        stages=stages,
        radii=radii,
        **found,
    )
