"""Yield surfaces of a material: from their sections to the model, and whether they are possible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot

from pydantic import BaseModel

from geoident.io.case.frames import FrameBuilder
from geoident.io.case.parameters import ParameterSection
from geoident.io.case.values import Given
from geoident.io.case.yield_schema import (
    DruckerPragerSection,
    MohrCoulombSection,
    PlanesSection,
    TrescaSection,
    WeakPlaneSection,
    YieldPlaneSection,
    YieldSection,
)
from geoident.io.text.faults import Faults
from geoident.model.case import KeyPath
from geoident.model.ground import Elastic, Isotropic
from geoident.model.parameter import Scalar
from geoident.model.yielding import (
    DruckerPrager,
    Fit,
    GivenPlanes,
    MohrCoulomb,
    WeakPlane,
    YieldPlane,
    YieldSurface,
    yield_breach,
)

_COMPONENTS = {2: ([0, 1, 3], [0, 1, 2, 3]), 3: ([0, 1, 2, 3, 4, 5],)}
_STRESSES = ("xx", "yy", "zz", "xy", "yz", "xz")
_ROUNDED = 2e-3  # what lengths of normals written with three digits may differ from one
_SAME = 1e-6
_FEWEST: Mapping[type, tuple[int, int]] = {
    TrescaSection: (4, 48),
    MohrCoulombSection: (4, 48),
    DruckerPragerSection: (6, 10),
    WeakPlaneSection: (4, 4),
}
"""Numbers of planes to begin with, in a section and in a solid."""

Sections = Sequence[tuple[KeyPath, YieldSection]]


def build_yields(
    path: KeyPath, given: object, elastic: Elastic, dim: int, faults: Faults
) -> tuple[YieldSurface, ...]:
    """The yield surfaces of a material.

    Args:
        path: of its key `yield`.
        given: what stands there: nothing, a section, or a list of them.
        elastic: its elasticity.
        dim: dimensions of the mesh.
        faults: where what cannot be is noted.
    """
    sections = surfaces_at(path, given)
    surfaces = tuple(_Builder(place, dim, faults).build(section) for place, section in sections)
    _check_smooth(sections, elastic, dim, faults)
    return surfaces


def surfaces_at(path: KeyPath, given: object) -> Sections:
    """The sections of yield surfaces under a key `yield`, each with its own path."""
    if isinstance(given, list):
        return [((*path, n), section) for n, section in enumerate(given)]
    return [] if given is None else [(path, given)]  # type: ignore[list-item]


def check_strengths(
    sections: Sections,
    surfaces: Sequence[YieldSurface],
    parameters: Mapping[str, ParameterSection],
    faults: Faults,
) -> None:
    """Note strengths that are inadmissible as given, or at the start of the parameters.

    Args:
        sections: surfaces as they are written, with their keys.
        surfaces: the same surfaces, built.
        parameters: with their starts.
        faults: takes what is wrong.
    """
    starts = {name: p.start for name, p in parameters.items()}
    values = {name: start.factor for name, start in starts.items()}
    for (path, section), surface in zip(sections, surfaces, strict=True):
        ties = [number for number in _numbers(section) if number.parameter is not None]
        known = [t for t in ties if t.parameter in starts]
        if len(known) < len(ties) or any(
            starts[t.parameter or ""].dimension != t.dimension for t in known
        ):
            continue  # a fault by itself
        found = yield_breach(surface, values)
        if found is None:
            continue
        key = "strength" if getattr(section, "strength", None) else found.constant
        given: Given = getattr(section, key)
        message, hint = f"'{given.text}': {found.limit}", "Correct the number or its unit."
        if given.parameter is not None:
            message = f"'{given.text}' is {found.shown} at the start; {found.limit}"
            hint = f"Change the start of {given.parameter}."
        faults.add((*path, key), "out-of-range", message, hint)


def _numbers(section: BaseModel) -> list[Given]:
    values = [getattr(section, name) for name in type(section).model_fields]
    return [value for value in values if isinstance(value, Given)]


def _check_smooth(sections: Sections, elastic: Elastic, dim: int, faults: Faults) -> None:
    """The smooth surface is a law of principal stresses, which go with no other directions."""
    planes = 16 if dim == 2 else 96
    for path, section in sections:
        if not isinstance(section, TrescaSection | MohrCoulombSection) or section.planes:
            continue
        hint = f"Add 'planes: {planes}' to it."
        if len(sections) > 1:
            message = "a smooth surface stands alone; here another one holds as well"
            faults.add(path, "smooth-surface", message, hint)
        elif not isinstance(elastic, Isotropic):
            message = "a smooth surface goes with isotropic elasticity only"
            faults.add(path, "smooth-surface", message, hint)


class _Builder:
    """One yield surface on its way from its section to the model."""

    def __init__(self, path: KeyPath, dim: int, faults: Faults) -> None:
        self.path = path
        self.dim = dim
        self.faults = faults

    def build(self, section: YieldSection) -> YieldSurface:
        if isinstance(section, PlanesSection):
            return self._given(section)
        self._check_count(section)
        if isinstance(section, DruckerPragerSection):
            return DruckerPrager(
                section.cohesion.scalar,
                section.friction.scalar,
                section.match,
                _scalar(section.tension),
                section.planes,
                section.fit or "best",
            )
        if isinstance(section, WeakPlaneSection):
            return self._weak(section)
        return self._coulomb(section)

    def _coulomb(self, section: TrescaSection | MohrCoulombSection) -> MohrCoulomb:
        fit = self._fit(section)
        if isinstance(section, TrescaSection):
            strength = section.strength or section.cohesion
            assert strength is not None
            tension = _scalar(section.tension)
            return MohrCoulomb(strength.scalar, Scalar(0.0), None, tension, section.planes, fit)
        if section.dilation is not None and section.planes is not None:
            message = "planes flow along their normals, with the angle of friction as dilation"
            hint = "Leave out 'dilation', or 'planes' for the smooth surface."
            self.faults.add((*self.path, "dilation"), "dilation", message, hint)
        return MohrCoulomb(
            section.cohesion.scalar,
            section.friction.scalar,
            _scalar(section.dilation),
            _scalar(section.tension),
            section.planes,
            fit,
        )

    def _fit(self, section: TrescaSection | MohrCoulombSection) -> Fit:
        if section.fit is not None and section.planes is None:
            message = "'fit' says how planes lie to the smooth surface; there are none"
            hint = "Add 'planes: 16', or leave out 'fit'."
            self.faults.add((*self.path, "fit"), "no-planes", message, hint)
        return section.fit or "best"

    def _weak(self, section: WeakPlaneSection) -> WeakPlane:
        frames = FrameBuilder(self.path, self.dim, self.faults)
        frame = (
            frames.attitude(section.dip, section.dip_direction)
            if section.normal is None
            else frames.about(section.normal)
        )
        strengths = section.cohesion.scalar, section.friction.scalar, _scalar(section.tension)
        return WeakPlane(frame, *strengths, section.planes)

    def _check_count(
        self, section: TrescaSection | MohrCoulombSection | DruckerPragerSection | WeakPlaneSection
    ) -> None:
        """Too few planes, or a polygon that is not its own mirror image."""
        planes, kind = section.planes, type(section)
        if planes is None or (kind is WeakPlaneSection and self.dim == 2):
            return
        fewest = _FEWEST[kind][self.dim - 2]
        polygon = kind is WeakPlaneSection or (kind is not DruckerPragerSection and self.dim == 2)
        if planes >= fewest and not (polygon and planes % 2):
            return
        expected = f"{'an even number ' if polygon else 'a number '}from {fewest} on"
        message = f"found {planes}; {expected} is expected"
        hint = f"Write 'planes: {max(fewest, planes + planes % 2)}'."
        self.faults.add((*self.path, "planes"), "number-of-planes", message, hint)

    def _given(self, section: PlanesSection) -> GivenPlanes:
        planes = [
            YieldPlane(
                plane.name or f"plane {n}",
                self._normal((*self.path, "planes", n - 1, "normal"), plane),
                plane.distance.scalar,
            )
            for n, plane in enumerate(section.planes, start=1)
        ]
        self._check_different(planes)
        return GivenPlanes(tuple(planes), _scalar(section.hardening) or Scalar(0.0))

    def _normal(self, path: KeyPath, plane: YieldPlaneSection) -> tuple[float, ...]:
        """Its six components; zeros with a fault where it is none."""
        numbers = [number.factor for number in plane.normal]
        ways = _COMPONENTS[self.dim]
        places = next((way for way in ways if len(way) == len(numbers)), None)
        full = [0.0] * 6
        if places is None:
            expected = " or ".join(str(len(way)) for way in ways)
            message = f"found {len(numbers)} components; {expected} expected"
            hint = f"They are of {', or '.join(', '.join(_STRESSES[k] for k in w) for w in ways)}."
            self.faults.add(path, "wrong-dimension", message, hint)
            return tuple(full)
        length = hypot(*numbers)
        if length == 0:
            self.faults.add(
                path, "zero-direction", "the normal has length zero", "Write a unit normal."
            )
            return tuple(full)
        unit = [number / length for number in numbers]
        if abs(length - 1) > _ROUNDED:
            message = f"the normal has length {length:.4g}; a unit normal is expected"
            hint = f"Write '[{', '.join(f'{x:.6g}' for x in unit)}]', and the distance along it."
            self.faults.add(path, "not-unit", message, hint)
        for place, number in zip(places, unit, strict=True):
            full[place] = number
        return tuple(full)

    def _check_different(self, planes: Sequence[YieldPlane]) -> None:
        """Two planes of one normal, of which only one can count, and names used twice."""
        for n, plane in enumerate(planes):
            for m, other in enumerate(planes[:n]):
                if any(plane.normal) and _near(plane.normal, other.normal):
                    path = (*self.path, "planes", n, "normal")
                    message = f"planes {m + 1} and {n + 1} have the same normal"
                    hint = "Keep the one with the smaller distance; the other has no effect."
                    self.faults.add(path, "same-normal", message, hint)
                if plane.name == other.name:
                    path = (*self.path, "planes", n, "name")
                    message = f"planes {m + 1} and {n + 1} have the same name '{plane.name}'"
                    self.faults.add(path, "same-name", message, "Rename one.")


def _near(one: Sequence[float], other: Sequence[float]) -> bool:
    return hypot(*(a - b for a, b in zip(one, other, strict=True))) < _SAME


def _scalar(given: Given | None) -> Scalar | None:
    return None if given is None else given.scalar
