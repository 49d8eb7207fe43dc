"""In-situ stress of a case: from its section to the model."""

from __future__ import annotations

from geoident.io.case.in_situ_schema import (
    ConstantModel,
    GradientSection,
    HeimModel,
    InSituSection,
    ProfileModel,
    StressSection,
)
from geoident.io.case.values import Given
from geoident.io.text.faults import Faults
from geoident.model.case import KeyPath
from geoident.model.in_situ import (
    Components,
    ConstantStress,
    HeimStress,
    InSitu,
    ProfileStress,
    Surface,
)
from geoident.model.parameter import Scalar

_NAMES = ("xx", "yy", "zz", "xy", "yz", "xz")
_OUT_OF_PLANE = ("yz", "xz")
_HORIZONTAL = {2: ("xx", "zz"), 3: ("xx", "yy", "xy")}

_Model = ConstantModel | HeimModel | ProfileModel
_Parts = ConstantModel | StressSection | GradientSection


def build_in_situ(
    section: InSituSection | None, dim: int, faults: Faults
) -> tuple[InSitu | None, dict[str, InSitu]]:
    """The in-situ stress, and that of groups of their own.

    Args:
        section: what the case says, or None.
        dim: number of axes.
        faults: takes what is wrong.
    """
    if section is None:
        return None, {}
    path: KeyPath = ("in_situ",)
    zones = {
        name: _model(zone, (*path, "groups", name), dim, faults)
        for name, zone in section.groups.items()
    }
    return _model(section, path, dim, faults), zones


def surface_of(given: Given | str) -> Surface:
    """A level, or the name of a group."""
    return given if isinstance(given, str) else given.scalar


def _model(given: _Model, path: KeyPath, dim: int, faults: Faults) -> InSitu:
    if isinstance(given, ConstantModel):
        return ConstantStress(_components(given, path, dim, faults), held=given.held)
    if isinstance(given, HeimModel):
        return _heim(given, path, dim, faults)
    return ProfileStress(
        at_surface=_components(given.at_surface, (*path, "at_surface"), dim, faults),
        gradient=_components(given.gradient, (*path, "gradient"), dim, faults),
        surface=surface_of(given.surface),
        held=given.held,
    )


def _heim(given: HeimModel, path: KeyPath, dim: int, faults: Faults) -> HeimStress:
    if given.azimuth is not None and dim == 2:
        message = "a plane model has no azimuth"
        hint = "K0 acts along x, K0_across out of plane."
        faults.add((*path, "azimuth"), "wrong-dimension", message, hint, key=True)
    tectonic = None
    if given.tectonic is not None:
        place = (*path, "tectonic")
        tectonic = _components(given.tectonic, place, dim, faults)
        _require_horizontal(given.tectonic, place, dim, faults)
    return HeimStress(
        K0=given.K0.scalar,
        vertical=_scalar(given.vertical),
        unit_weight=_scalar(given.unit_weight),
        surface=None if given.surface is None else surface_of(given.surface),
        held=given.held,
        K0_across=_scalar(given.K0_across),
        azimuth=_scalar(given.azimuth),
        tectonic=tectonic,
    )


def _components(given: _Parts, path: KeyPath, dim: int, faults: Faults) -> Components:
    """The six components; those that a plane model does not have are faults."""
    if dim == 2:
        for name in _OUT_OF_PLANE:
            if getattr(given, name) is not None:
                message = f"a plane model has no stress {name}"
                faults.add((*path, name), "wrong-dimension", message, "Remove it.", key=True)
    xx, yy, zz, xy, yz, xz = (_scalar(getattr(given, name)) or Scalar(0.0) for name in _NAMES)
    return xx, yy, zz, xy, yz, xz


def _require_horizontal(given: StressSection, path: KeyPath, dim: int, faults: Faults) -> None:
    for name in _NAMES:
        plane = dim == 3 or name not in _OUT_OF_PLANE
        if plane and name not in _HORIZONTAL[dim] and getattr(given, name) is not None:
            message = f"{name} is not horizontal; {', '.join(_HORIZONTAL[dim])} are"
            hint = "Use 'model: profile' for stresses of any direction."
            faults.add((*path, name), "wrong-dimension", message, hint, key=True)


def _scalar(given: Given | None) -> Scalar | None:
    return None if given is None else given.scalar
