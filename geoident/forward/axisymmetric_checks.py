"""What an axisymmetric case must satisfy: all of it turns about the axis x = 0.

Stress in the section has the components rr, zz, tt, rz, which the case names xx, yy, zz, xy. A
stress that does not depend on the direction in plan has rr = tt and rz = 0: with rr and tt that
differ by a constant, equilibrium along r, d rr/dr + (rr - tt)/r + d rz/dz = 0, fails on the axis;
and such stresses as an x and a y of their own in plan turn the section into a three-dimensional
problem. The in-situ models are therefore held to equal horizontal stresses and no shear.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoident.errors import Fault, Location
from geoident.fem.kinematics import AXISYMMETRIC
from geoident.forward.actions.supports import load_keys
from geoident.forward.in_situ.stress import in_situ_models
from geoident.forward.stages import CaseOnMesh, element_number
from geoident.model.actions import Seismic
from geoident.model.case import Analysis, Case, KeyPath
from geoident.model.in_situ import InSitu
from geoident.model.mesh import Mesh

_SHOWN = 10  # numbers in a message: enough to find the place
_SOLID = "model it as a solid"


def revolution_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Faults of what is not symmetric about the axis."""
    case = on_mesh.case
    if case.analysis is not Analysis.AXISYMMETRIC:
        return []
    return [
        *_radius_faults(on_mesh.mesh),
        *_gravity_faults(case),
        *_seismic_faults(case),
        *(
            fault
            for path, model in in_situ_models(case)
            for fault in _stress_faults(case, path, model)
        ),
    ]


def _radius_faults(mesh: Mesh) -> list[Fault]:
    """Elements across the axis."""
    radius = np.where(AXISYMMETRIC.on_axis(mesh.points), 0.0, mesh.points[:, 0])
    lowest = np.concatenate([radius[block.nodes].min(axis=1) for block in mesh.blocks])
    beyond = np.flatnonzero(lowest < 0)
    if not len(beyond):
        return []
    numbers = ", ".join(str(element_number(mesh, int(e))) for e in beyond[:_SHOWN])
    more = f" and {len(beyond) - _SHOWN} more" if len(beyond) > _SHOWN else ""
    message = (
        f"elements {numbers}{more} have negative radii x, down to {lowest.min():.6g} m: the axis "
        "of an axisymmetric analysis is x = 0"
    )
    hint = "mesh one half of the section, at x >= 0, with y along the axis"
    return [Fault("negative-radius", message, hint, Location(mesh.file))]


def _gravity_faults(case: Case) -> list[Fault]:
    if case.gravity is None or case.gravity[0] == 0:
        return []
    message = "gravity has a part across the axis, which is not axisymmetric"
    return [_fault(case, ("gravity",), message, f"let it act along y, or {_SOLID}")]


def _seismic_faults(case: Case) -> list[Fault]:
    message = "shaking across the axis is not axisymmetric"
    return [
        _fault(case, path, message, f"set its x to 0, or {_SOLID}")
        for path, load in load_keys(case)
        if isinstance(load, Seismic) and (load.factors[0].factor or load.factors[0].parameter)
    ]


def _stress_faults(case: Case, path: KeyPath, model: InSitu) -> Iterator[Fault]:
    """Horizontal stresses that differ, and shear."""
    if not model.has_equal_ratios:
        message = "the horizontal in-situ stresses of an axisymmetric analysis are equal (rr = tt)"
        yield _fault(case, (*path, "K0"), message, f"give one K0, or {_SOLID}")
    for key, components in model.tensors.items():
        where = (*path, key) if key else path
        xx, _, zz, xy, _, _ = components
        if xx != zz:
            message = (
                "xx (radial) and zz (hoop) of the in-situ stress differ: on the axis every "
                "horizontal direction is radial and hoop alike, so nothing could balance them"
            )
            yield _fault(case, (*where, "zz"), message, f"write the same for both, or {_SOLID}")
        if xy.factor:
            message = (
                "xy (rz) of the in-situ stress is not zero: shear on the axis has no direction"
            )
            yield _fault(case, (*where, "xy"), message, f"remove it, or {_SOLID}")


def _fault(case: Case, path: KeyPath, message: str, hint: str) -> Fault:
    return case.source.fault(path, "not-axisymmetric", message, hint)
