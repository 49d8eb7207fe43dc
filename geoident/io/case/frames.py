"""How material axes and weak planes lie in the ground: from the keys of a section to a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi

from geoident.io.case.values import Given
from geoident.io.text.faults import Faults
from geoident.model.case import KeyPath
from geoident.model.ground import Attitude, Axes, Vector3
from geoident.model.parameter import Scalar

_MOST_SLANT = 0.02  # cosine between axes that still pass for perpendicular, about one degree
_TOWARDS_X = Scalar(pi / 2)


@dataclass(frozen=True)
class FrameBuilder:
    """Makes the frames of one section; what they cannot be is noted as a fault.

    Args:
        path: of the section.
        dim: dimensions of the mesh.
        faults: where to note.
    """

    path: KeyPath
    dim: int
    faults: Faults

    def attitude(
        self, dip: Given | None, direction: Given | None, rotation: Given | None = None
    ) -> Attitude:
        """A frame by angles.

        Args:
            dip: from the horizontal; None for none.
            direction: azimuth of the line of dip; None where a section says it.
            rotation: about the normal; None for none.
        """
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

    def axes(self, first: Sequence[Given], second: Sequence[Given]) -> Axes:
        """A frame by two vectors, `axis_1` and `axis_2`."""
        one, two = self._vector("axis_1", first), self._vector("axis_2", second)
        slant = sum(a * b for a, b in zip(one, two, strict=True))
        if abs(slant) > _MOST_SLANT:
            message = "axis_1 and axis_2 are not at a right angle to each other"
            hint = f"Their cosine is {slant:.3g}; a right angle has 0."
            self.faults.add((*self.path, "axis_2"), "not-perpendicular", message, hint)
            return _axes_about(one)
        upright = _unit(tuple(b - slant * a for a, b in zip(one, two, strict=True)))
        return Axes(one, upright)

    def about(self, normal: Sequence[Given]) -> Axes:
        """A frame by the key `normal`: axes 1 and 2 are any two in its plane."""
        return _axes_about(self._vector("normal", normal))

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


def _scalar(given: Given | None) -> Scalar | None:
    return None if given is None else given.scalar


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
