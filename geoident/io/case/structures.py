"""Structural parts of a case: from their sections to the model, and whether they can be built."""

from __future__ import annotations

from geoident.io.case.gauges import vector
from geoident.io.case.schema import CaseSection
from geoident.io.case.structure_schema import BeamSection, BoltSection
from geoident.io.case.values import Given
from geoident.io.text.faults import Faults
from geoident.model.case import Analysis, KeyPath
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Bolts, Structure

Ends = tuple[tuple[float, ...], tuple[float, ...]]


def build_structures(section: CaseSection, faults: Faults) -> dict[str, Structure]:
    """Linings and bolts by name; what the kind of analysis does not allow is noted as a fault."""
    analysis = Analysis(section.analysis)
    structures: dict[str, Structure] = {}
    for name, given in section.structures.items():
        path: KeyPath = ("structures", name)
        if isinstance(given, BeamSection):
            if analysis is not Analysis.PLANE_STRAIN:
                _refuse(path, "beams", "plane-strain", analysis, faults)
            structures[name] = _beam(given)
        else:
            _check_spacing(given, path, analysis, faults)
            structures[name] = _bolts(given, path, analysis.dim, faults)
    return structures


def _beam(given: BeamSection) -> Beam:
    return Beam(
        given.on,
        E=_scalar(given.E),
        thickness=_scalar(given.thickness),
        nu=_scalar(given.nu),
        EA=_scalar(given.EA),
        EI=_scalar(given.EI),
        clamped_on=tuple(given.clamped_on),
    )


def _bolts(given: BoltSection, path: KeyPath, dim: int, faults: Faults) -> Bolts:
    ends = tuple(_ends(pair, (*path, "ends", n), dim, faults) for n, pair in enumerate(given.ends))
    return Bolts(
        ends, _scalar(given.spacing), _scalar(given.E), _scalar(given.diameter), _scalar(given.EA)
    )


def _ends(pair: list[list[Given]], path: KeyPath, dim: int, faults: Faults) -> Ends:
    first, second = (
        vector(point, dim, (*path, k), faults, what="the end") or () for k, point in enumerate(pair)
    )
    return first, second


def _scalar(given: Given | None) -> Scalar | None:
    return None if given is None else given.scalar


def _check_spacing(given: BoltSection, path: KeyPath, analysis: Analysis, faults: Faults) -> None:
    if analysis is Analysis.AXISYMMETRIC:
        _refuse(path, "bolts", "plane-strain or solid", analysis, faults)
    elif analysis is Analysis.PLANE_STRAIN and given.spacing is None:
        message = "'spacing' is missing: the distance between bolts out of plane"
        faults.add(path, "missing-key", message, "Add 'spacing: 1.5 m'.", key=True)
    elif analysis is Analysis.SOLID and given.spacing is not None:
        message = "'spacing' in a solid, where every bolt stands for itself"
        hint = "Remove it, and list all bolts under 'ends'."
        faults.add((*path, "spacing"), "wrong-dimension", message, hint, key=True)


def _refuse(path: KeyPath, what: str, where: str, analysis: Analysis, faults: Faults) -> None:
    message = f"{what} in {analysis.value} analysis; they stand in {where} analysis only"
    hint = "Model it by elements: a group with a material, placed by 'install'."
    faults.add((*path, "kind"), "wrong-analysis", message, hint)
