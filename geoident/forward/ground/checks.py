"""Whether the ground of a plane or axisymmetric section can stay in its plane.

Strains of the section must cause no stress yz or xz: those would push the ground out of the plane,
and the analysis has no unknowns for that. Strata that strike obliquely to a section do it. Shear in
the plane of an axisymmetric section may couple with its normal strains only if the material is the
same all around the axis; strata that dip are not.
"""

from __future__ import annotations

import numpy as np

from geoident.errors import Fault
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.model.arrays import Floats
from geoident.model.case import Analysis, Case, KeyPath, Material
from geoident.model.dual import ParameterPoint
from geoident.model.ground import Anisotropic, elastic_scalars
from geoident.model.parameter import Parameter, Scalar, Values

_NEGLIGIBLE = 1e-9  # of the largest modulus: rounding of turned axes is 1e-16 of it
_OUT_OF_PLANE = tuple(f"c{i}{j}" for i in range(1, 5) for j in (5, 6))
_KEYS = ("dip_direction", "rotation", "normal", "axis_1", "dip")


def section_faults(case: Case) -> list[Fault]:
    """Materials under which the section of a case would not stay in its plane."""
    if case.analysis is Analysis.SOLID:
        return []
    faults = []
    for material in case.materials.values():
        ties = {n for s in elastic_scalars(material.elastic).values() for n in s.parameters}
        if ties <= case.start.keys():  # in a case that is faulty otherwise some may be missing
            anisotropic = isinstance(material.elastic, Anisotropic)
            faults.append(_entry_fault(case, material) if anisotropic else _fault(case, material))
    return [fault for fault in faults if fault is not None]


def _fault(case: Case, material: Material) -> Fault | None:
    """Strata or axes that are oblique to the section, or that dip about an axis of revolution."""
    paths = [("materials", material.name, key) for key in _KEYS]
    written = (path for path in paths if case.source.has(path))
    path: KeyPath = next(written, ("materials", material.name))
    for values in trials(case.parameters):
        E = np.abs(_moduli(material, values))
        negligible = _NEGLIGIBLE * E.max()
        if E[np.ix_(_strains(case), (4, 5))].max() > negligible:
            message = (
                f"the strata or axes of '{material.name}' are oblique to the section, or may turn "
                "so in the fit"
            )
            return _out_of_plane(case, path, message, "give a strike normal or parallel to it")
        if case.analysis is Analysis.AXISYMMETRIC and E[:3, 3].max() > negligible:
            message = f"strata of '{material.name}' that dip are not the same all around the axis"
            hint = "Use 'dip: 0 deg', or analysis: solid."
            return case.source.fault(path, "antiplane", message, hint)
    return None


def _entry_fault(case: Case, material: Material) -> Fault | None:
    """The first entry that couples strains of the section with shear out of it."""
    elastic, name = material.elastic, material.name
    assert isinstance(elastic, Anisotropic)
    negligible = _NEGLIGIBLE * np.abs(_moduli(material, case.start)).max()
    for entry in _OUT_OF_PLANE:
        scalar = elastic.entries.get(entry, Scalar(0.0))
        coupled = scalar.parameter or abs(scalar.factor) > negligible
        if coupled and int(entry[1]) - 1 in _strains(case):
            message = f"{entry} of '{name}' couples strains of the section with shear out of it"
            return _out_of_plane(case, ("materials", name, entry), message, "leave it out")
    return None


def _moduli(material: Material, values: Values) -> Floats:
    """E (6, 6) in the axes of a section, Pa."""
    return elastic_matrix(material.elastic, ParameterPoint(values, ()), section=True).value


def trials(parameters: tuple[Parameter, ...]) -> list[Values]:
    """The start values, and others near by: what holds at both is no coincidence."""
    start = {p.name: p.start for p in parameters}
    moved = {
        p.name: p.start * (1 + 0.01 * n) + (0.1 + 0.01 * n) * (p.dimension == "angle")
        for n, p in enumerate(parameters, start=1)
    }
    return [start, moved]


def _strains(case: Case) -> list[int]:
    """Strains that the section has; a plane one has no strain zz."""
    return [0, 1, 3] if case.analysis is Analysis.PLANE_STRAIN else [0, 1, 2, 3]


def _out_of_plane(case: Case, path: KeyPath, message: str, remedy: str) -> Fault:
    message += ", so the ground would also move out of the plane"
    hint = f"Use analysis: solid, or {remedy}."
    return case.source.fault(path, "antiplane", message, hint)
