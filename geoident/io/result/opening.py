"""The groups ``/opening`` and ``/face``: ground reaction in closed form; an advancing face."""

from __future__ import annotations

from typing import Any

import h5py

from geoident.io.result.hdf5 import TableReader, TableWriter, text_attribute
from geoident.model.results.opening import FaceAdvance, GroundReaction

GROUP, FACE = "opening", "face"
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


def write_advance(file: h5py.File, found: FaceAdvance) -> None:
    """Writes ``/face``: the profile, and what distances to the face say of the stages.

    Args:
        file: the result.
        found: they.
    """
    out = TableWriter(file, FACE, {"distance": found.distance, "stage": found.stages})
    out.group["distance"].attrs["unit"] = "m"
    out.group.attrs["radius"] = float(found.radius)
    text_attribute(out.group.id, "profile", found.law)
    out.add("share", found.share, "distance")
    out.add("stage_distance", found.stage_distance, "stage", unit="m")
    for name in ("stage_share", "stage_released", "stage_zero"):
        out.add(name, getattr(found, name), "stage")


def read_advance(file: h5py.File) -> FaceAdvance:
    """What was written of a face."""
    group = TableReader(file, FACE)
    distance, stages = group.array("distance", "f"), group.texts("stage")
    s = len(stages)
    return FaceAdvance(
        law=group.attribute("profile", str),
        radius=group.attribute("radius", float),
        distance=distance,
        share=group.floats("share", len(distance)),
        stages=stages,
        stage_distance=group.floats("stage_distance", s),
        stage_share=group.floats("stage_share", s),
        stage_released=group.floats("stage_released", s),
        stage_zero=group.bools("stage_zero", s),
    )
