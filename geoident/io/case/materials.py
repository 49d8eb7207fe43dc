"""Materials of a case: from their sections to the model, and whether they are possible."""

from __future__ import annotations

from collections.abc import Sequence

from geoident.io.case.frames import FrameBuilder
from geoident.io.case.material_schema import (
    AnisotropicSection,
    IsotropicSection,
    MaterialSection,
    OrthotropicSection,
    TransverselyIsotropicSection,
)
from geoident.io.case.schema import CaseSection
from geoident.io.case.values import Given
from geoident.io.case.yielding import build_yields, check_strengths, surfaces_at
from geoident.io.text.faults import Faults
from geoident.model.case import Analysis, KeyPath, Material
from geoident.model.ground import (
    ENTRIES,
    Anisotropic,
    Elastic,
    Frame,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    breach,
)
from geoident.model.parameter import Scalar
from geoident.model.yielding import YieldSurface

_ENGINEERING = ("E_p", "nu_p", "E_n", "nu_np", "G_np")
_LOVE = ("A", "C", "F", "L", "N")
_THREE_AXES = ("E_1", "E_2", "E_3", "nu_12", "nu_13", "nu_23", "G_12", "G_13", "G_23")


def build_materials(section: CaseSection, faults: Faults) -> dict[str, Material]:
    """The materials; what they cannot be, at the start of the parameters, is noted as a fault."""
    dim = Analysis(section.analysis).dim
    materials = {}
    for name, given in section.materials.items():
        elastic = _Builder(("materials", name), dim, faults).build(given)
        path = ("materials", name, "yield")
        yields = build_yields(path, given.yields, elastic, dim, faults)
        materials[name] = _material(name, elastic, yields, given)
        _check_start(("materials", name), elastic, section, given, faults)
        check_strengths(surfaces_at(path, given.yields), yields, section.parameters, faults)
    return materials


def _material(
    name: str, elastic: Elastic, yields: tuple[YieldSurface, ...], section: MaterialSection
) -> Material:
    none = Scalar(0.0)
    density, expansion = _scalar(section.density), _scalar(section.expansion)
    return Material(name, elastic, density or none, expansion or none, yields)


def _scalar(given: Given | None) -> Scalar | None:
    return None if given is None else given.scalar


def _check_start(
    path: KeyPath,
    elastic: Elastic,
    section: CaseSection,
    material: MaterialSection,
    faults: Faults,
) -> None:
    """Note a constant that is inadmissible at the start of the parameters."""
    ties = [given for given in _numbers(material) if given.parameter is not None]
    starts = {name: p.start for name, p in section.parameters.items()}
    if any(t.parameter not in starts or starts[t.parameter].dimension != t.dimension for t in ties):
        return  # a tie to nothing, or to another dimension, is a fault by itself
    found = breach(elastic, {name: start.factor for name, start in starts.items()})
    if found is None:
        return
    given: Given = getattr(material, found.constant)
    moved = sorted({t.parameter for t in ties if t.parameter and t.dimension != "angle"})
    if given.parameter is not None:
        message = f"'{given.text}' is {found.value:g} at the start; {found.limit}"
        hint = f"Change the start of {given.parameter}."
    else:
        message = f"'{given.text}' makes the stiffness indefinite; {found.limit}"
        hint = f"Change it, or the start of {', '.join(moved)}." if moved else ""
    faults.add((*path, found.constant), "out-of-range", message, hint)


def _numbers(section: MaterialSection) -> list[Given]:
    """The numbers of a section."""
    values = [getattr(section, name) for name in type(section).model_fields]
    return [value for value in values if isinstance(value, Given)]


class _Builder:
    """One material on its way from its section to its elasticity."""

    def __init__(self, path: KeyPath, dim: int, faults: Faults) -> None:
        self.path = path
        self.dim = dim
        self.faults = faults
        self.frames = FrameBuilder(path, dim, faults)

    def build(self, section: MaterialSection) -> Elastic:
        if isinstance(section, IsotropicSection):
            return Isotropic(*map(_scalar, (section.E, section.nu, section.K, section.G)))
        if isinstance(section, TransverselyIsotropicSection):
            return self._strata(section)
        if isinstance(section, OrthotropicSection):
            return self._orthotropic(section)
        return self._anisotropic(section)

    def _strata(self, section: TransverselyIsotropicSection) -> Elastic:
        frame: Frame
        if section.normal is not None:
            frame = self.frames.about(section.normal)
        else:
            frame = self.frames.attitude(section.dip, section.dip_direction)
        if section.E_p is not None:
            return TransverselyIsotropic(**_named(section, _ENGINEERING), frame=frame)
        return LoveModuli(**_named(section, _LOVE), frame=frame)

    def _orthotropic(self, section: OrthotropicSection) -> Elastic:
        frame: Frame
        if section.axis_1 is not None and section.axis_2 is not None:
            frame = self.frames.axes(section.axis_1, section.axis_2)
        else:
            frame = self.frames.attitude(section.dip, section.dip_direction, section.rotation)
        return Orthotropic(**_named(section, _THREE_AXES), frame=frame)

    def _anisotropic(self, section: AnisotropicSection) -> Elastic:
        entries = {name: _scalar(getattr(section, name)) for name in ENTRIES}
        for name in ("c55", "c66"):
            if self.dim == 3 and entries[name] is None:
                message = f"'{name}' is missing; a solid needs it"
                self.faults.add(self.path, "missing-key", message, f"Add '{name}: ...'.", key=True)
        return Anisotropic({name: scalar for name, scalar in entries.items() if scalar})


def _named(section: MaterialSection, names: Sequence[str]) -> dict[str, Scalar]:
    """Numbers of a section, which has made sure of them, by name."""
    return {name: getattr(section, name).scalar for name in names}
