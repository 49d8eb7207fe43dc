"""How material axes and weak planes lie in the ground: from the keys of a section to a frame."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, pi

from geoident.io.schema.section import Context
from geoident.io.schema.values import Given, scalar_of
from geoident.model.ground import Attitude, Axes, Vector3
from geoident.model.parameter import Scalar

_MOST_SLANT = 0.02  # cosine between axes that still pass for perpendicular, about one degree
_TOWARDS_X = Scalar(pi / 2)


def attitude(
    context: Context, dip: Given | None, direction: Given | None, rotation: Given | None = None
) -> Attitude:
    """A frame by angles; a solid without direction of the dip is noted as a fault.

    Args:
        context: of the section.
        dip: its key `dip`.
        direction: its key `dip_direction`.
        rotation: its key `rotation`.
    """
    flat = dip is None or (dip.parameter is None and dip.factor == 0)
    if context.dim == 3 and direction is None and not flat:
        message = "the direction of the dip is missing; a solid needs it"
        hint = "Add 'dip_direction: ...', the azimuth of the line of dip."
        context.refuse("missing-key", message, hint, key=True)
    default = _TOWARDS_X if context.dim == 2 else Scalar(0.0)
    return Attitude(
        scalar_of(dip) or Scalar(0.0),
        scalar_of(direction) or default,
        scalar_of(rotation) or Scalar(0.0),
    )


def strata(
    context: Context,
    dip: Given | None,
    direction: Given | None,
    normal: Sequence[Given] | None,
) -> Attitude | Axes:
    """A frame by angles, or by the normal if there is one.

    Args:
        context: of the section.
        dip: its key `dip`.
        direction: its key `dip_direction`.
        normal: (2,) or (3,) its key `normal`: axes 1 and 2 are any two in its plane.
    """
    if normal is None:
        return attitude(context, dip, direction)
    return _axes_about(_unit_vector(context.at("normal"), normal))


def axes_along(context: Context, first: Sequence[Given], second: Sequence[Given]) -> Axes:
    """A frame by two vectors; a fault if they are not perpendicular.

    Args:
        context: of the section.
        first: (2,) or (3,) its key `axis_1`.
        second: (2,) or (3,) its key `axis_2`.
    """
    one, two = _unit_vector(context.at("axis_1"), first), _unit_vector(context.at("axis_2"), second)
    slant = sum(a * b for a, b in zip(one, two, strict=True))
    if abs(slant) > _MOST_SLANT:
        message = "axis_1 and axis_2 are not at a right angle to each other"
        hint = f"Their cosine is {slant:.3g}; a right angle has 0."
        context.at("axis_2").refuse("not-perpendicular", message, hint)
        return _axes_about(one)
    upright = _unit(tuple(b - slant * a for a, b in zip(one, two, strict=True)))
    return Axes(one, upright)


def _unit_vector(context: Context, given: Sequence[Given]) -> Vector3:
    """A vector of length one; (0, 0, 1) with a fault where there is none."""
    numbers = [number.factor for number in given]
    if len(numbers) not in {context.dim, 3}:
        expected = "2 or 3" if context.dim == 2 else "3"
        message = f"found {len(numbers)} components; {expected} expected"
        context.refuse("wrong-dimension", message)
    elif not any(numbers):
        context.refuse("zero-direction", "the direction has length zero")
    else:
        return _unit((*numbers, 0.0)[:3])
    return (0.0, 0.0, 1.0)


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
