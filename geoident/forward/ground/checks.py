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
from geoident.model.ground import Anisotropic, Elastic, elastic_scalars
from geoident.model.parameter import Parameter, Scalar, Values

_NEGLIGIBLE = 1e-9  # of the largest modulus: rounding of turned axes is 1e-16 of it
_OUT_OF_PLANE = tuple(f"c{i}{j}" for i in range(1, 5) for j in (5, 6))
_KEYS = ("dip_direction", "rotation", "normal", "axis_1", "dip")


def section_faults(case: Case) -> list[Fault]:
    """Materials under which the section of a case would not stay in its plane."""
    if case.analysis is Analysis.SOLID:
        return []
    known = [m for m in case.materials.values() if _is_known(case, m.elastic)]
    faults = [_fault(case, material) for material in known]
    return [fault for fault in faults if fault is not None]


def _is_known(case: Case, elastic: Elastic) -> bool:
    """Whether all parameters of a material are there: in a faulty case some may be missing."""
    ties = {name for number in elastic_scalars(elastic).values() for name in number.parameters}
    return ties <= case.start.keys()


def _fault(case: Case, material: Material) -> Fault | None:
    if isinstance(material.elastic, Anisotropic):
        return _entry_fault(case, material.name, material.elastic)
    for values in trials(case.parameters):
        E = _section_moduli(material.elastic, values)
        largest = np.abs(E).max()
        if np.abs(E[np.ix_(_strains(case.analysis), (4, 5))]).max() > _NEGLIGIBLE * largest:
            return _oblique(case, material.name)
        if case.analysis is Analysis.AXISYMMETRIC and np.abs(E[:3, 3]).max() > (
            _NEGLIGIBLE * largest
        ):
            return _dipping(case, material.name)
    return None


def _section_moduli(elastic: Elastic, values: Values) -> Floats:
    """E (6, 6) in the axes of a section, Pa."""
    return elastic_matrix(elastic, ParameterPoint(values, ()), section=True).value


def trials(parameters: tuple[Parameter, ...]) -> list[Values]:
    """The start values, and others near by: what holds at both is no coincidence."""
    start = {p.name: p.start for p in parameters}
    moved = {
        p.name: p.start * (1 + 0.01 * n) + (0.1 + 0.01 * n) * (p.dimension == "angle")
        for n, p in enumerate(parameters, start=1)
    }
    return [start, moved]


def _strains(analysis: Analysis) -> list[int]:
    """Strains that the section has; a plane one has no strain zz."""
    return [0, 1, 3] if analysis is Analysis.PLANE_STRAIN else [0, 1, 2, 3]


def _entry_fault(case: Case, name: str, elastic: Anisotropic) -> Fault | None:
    rows = {i + 1 for i in _strains(case.analysis)}
    negligible = _NEGLIGIBLE * np.abs(_section_moduli(elastic, case.start)).max()
    for entry in _OUT_OF_PLANE:
        scalar = elastic.entries.get(entry, Scalar(0.0))
        if int(entry[1]) in rows and (scalar.parameter or abs(scalar.factor) > negligible):
            message = f"{entry} of '{name}' couples strains of the section with shear out of it"
            return _refuse(case, ("materials", name, entry), message, "leave it out")
    return None


def _oblique(case: Case, name: str) -> Fault:
    message = (
        f"the strata or axes of '{name}' are oblique to the section, or may turn so in the fit"
    )
    return _refuse(case, _key(case, name), message, "give a strike normal or parallel to it")


def _dipping(case: Case, name: str) -> Fault:
    message = f"strata of '{name}' that dip are not the same all around the axis"
    hint = "Use 'dip: 0 deg', or analysis: solid."
    return case.source.fault(_key(case, name), code="antiplane", message=message, hint=hint)


def _refuse(case: Case, path: KeyPath, message: str, remedy: str) -> Fault:
    message += ", so the ground would also move out of the plane"
    hint = f"Use analysis: solid, or {remedy}."
    return case.source.fault(path, code="antiplane", message=message, hint=hint)


def _key(case: Case, name: str) -> KeyPath:
    """The first key written that turns the material."""
    paths = [("materials", name, key) for key in _KEYS]
    return next((path for path in paths if path in case.source.positions), ("materials", name))
