"""Materials of a case: from their sections to the model, and whether they are possible."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, pi

from geoident.io.case_schema import CaseSection
from geoident.io.case_values import Given
from geoident.io.faults import Faults
from geoident.io.material_schema import (
    AnisotropicSection,
    IsotropicSection,
    MaterialSection,
    OrthotropicSection,
    TransverselyIsotropicSection,
)
from geoident.model.admissible import breach
from geoident.model.case import Analysis, KeyPath, Material
from geoident.model.elastic import (
    ENTRIES,
    Anisotropic,
    Attitude,
    Axes,
    Elastic,
    Frame,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    Vector3,
)
from geoident.model.parameter import Scalar

_MOST_SLANT = 0.02  # cosine between axes that still pass for perpendicular, about one degree
_TOWARDS_X = Scalar(pi / 2)
_ENGINEERING = ("E_p", "nu_p", "E_n", "nu_np", "G_np")
_LOVE = ("A", "C", "F", "L", "N")
_THREE_AXES = ("E_1", "E_2", "E_3", "nu_12", "nu_13", "nu_23", "G_12", "G_13", "G_23")


def build_materials(section: CaseSection, faults: Faults) -> dict[str, Material]:
    """The materials; what they cannot be, at the start of the parameters, is noted as a fault."""
    dim = Analysis(section.analysis).dim
    materials = {}
    for name, given in section.materials.items():
        elastic = _Builder(("materials", name), dim, faults).build(given)
        materials[name] = _material(name, elastic, given)
        _check_start(("materials", name), elastic, section, given, faults)
    return materials


def _material(name: str, elastic: Elastic, section: MaterialSection) -> Material:
    none = Scalar(0.0)
    density, expansion = _scalar(section.density), _scalar(section.expansion)
    return Material(name, elastic, density or none, expansion or none)


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
            frame = _axes_about(self._vector("normal", section.normal))
        else:
            frame = self._attitude(section.dip, section.dip_direction)
        if section.E_p is not None:
            return TransverselyIsotropic(**_named(section, _ENGINEERING), frame=frame)
        return LoveModuli(**_named(section, _LOVE), frame=frame)

    def _orthotropic(self, section: OrthotropicSection) -> Elastic:
        frame: Frame
        if section.axis_1 is not None and section.axis_2 is not None:
            frame = self._axes(section.axis_1, section.axis_2)
        else:
            frame = self._attitude(section.dip, section.dip_direction, section.rotation)
        return Orthotropic(**_named(section, _THREE_AXES), frame=frame)

    def _anisotropic(self, section: AnisotropicSection) -> Elastic:
        entries = {name: _scalar(getattr(section, name)) for name in ENTRIES}
        for name in ("c55", "c66"):
            if self.dim == 3 and entries[name] is None:
                message = f"'{name}' is missing; a solid needs it"
                self.faults.add(self.path, "missing-key", message, f"Add '{name}: ...'.", key=True)
        return Anisotropic({name: scalar for name, scalar in entries.items() if scalar})

    def _attitude(
        self, dip: Given | None, direction: Given | None, rotation: Given | None = None
    ) -> Attitude:
        flat = dip is None or (dip.parameter is None and dip.factor == 0)
        if self.dim == 3 and direction is None and not flat:
            message = "the direction of the dip is missing; a solid needs it"
            hint = "Add 'dip_direction: ...', the azimuth of the line of dip."
            self.faults.add(self.path, "missing-key", message, hint, key=True)
        default = _TOWARDS_X if self.dim == 2 else Scalar(0.0)
        return Attitude(
            _scalar(dip) or Scalar(0.0),
            _scalar(direction) or default,
            _scalar(rotation) or Scalar(0.0),
        )

    def _axes(self, first: Sequence[Given], second: Sequence[Given]) -> Axes:
        one, two = self._vector("axis_1", first), self._vector("axis_2", second)
        slant = sum(a * b for a, b in zip(one, two, strict=True))
        if abs(slant) > _MOST_SLANT:
            message = "axis_1 and axis_2 are not at a right angle to each other"
            hint = f"Their cosine is {slant:.3g}; a right angle has 0."
            self.faults.add((*self.path, "axis_2"), "not-perpendicular", message, hint)
            return _axes_about(one)
        upright = _unit(tuple(b - slant * a for a, b in zip(one, two, strict=True)))
        return Axes(one, upright)

    def _vector(self, key: str, given: Sequence[Given]) -> Vector3:
        """A vector of length one; (0, 0, 1) with a fault where there is none."""
        numbers = [number.factor for number in given]
        path = (*self.path, key)
        if len(numbers) not in {self.dim, 3}:
            expected = "2 or 3" if self.dim == 2 else "3"
            message = f"found {len(numbers)} components; {expected} expected"
            self.faults.add(path, "wrong-dimension", message)
        elif not any(numbers):
            self.faults.add(path, "zero-direction", "the direction has length zero")
        else:
            return _unit((*numbers, 0.0)[:3])
        return (0.0, 0.0, 1.0)


def _named(section: MaterialSection, names: Sequence[str]) -> dict[str, Scalar]:
    """Numbers of a section, which has made sure of them, by name."""
    return {name: getattr(section, name).scalar for name in names}


def _unit(vector: Sequence[float]) -> Vector3:
    length = hypot(*vector)
    x, y, z = (component / length for component in vector)
    return x, y, z


def _axes_about(normal: Vector3) -> Axes:
    """Axes 1, 2 and the given axis 3: 1 and 2 are any two in the plane of the strata."""
    x, y, z = normal
    smallest = min(range(3), key=lambda k: abs(normal[k]))
    cross = [(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)][smallest]
    first = _unit(cross)
    a, b, c = first
    return Axes(first, (y * c - z * b, z * a - x * c, x * b - y * a))
