"""How material axes and weak planes lie in the ground: from the keys of a section to a frame.

And which parameters are such angles, with the turn after which the ground is the same again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import hypot, isclose, pi

from geoident.io.schema.section import Context, SectionFaults
from geoident.io.schema.values import CaseNumber, scalar_of
from geoident.model.case import KeyPath
from geoident.model.ground import Attitude, Axes, Vector3
from geoident.model.parameter import Parameter, Scalar

_MOST_SLANT = 0.02  # cosine between axes that still pass for perpendicular, about one degree
_TOWARDS_X = Scalar(pi / 2)

TURNS = {"dip": pi, "dip_direction": 2 * pi, "rotation": pi, "azimuth": pi}
"""Keys of angles, and the turn (rad) after which they mean the same: axes have no front and back,
but a dip direction has."""

_MOST_TURNS = 12

ATTITUDE_OR_AXES = "dip dip_direction? rotation?", "axis_1 axis_2"
"""Ways to say where three axes point."""


def with_periods(
    parameters: Sequence[Parameter], ties: Iterable[tuple[KeyPath, CaseNumber]]
) -> tuple[Parameter, ...]:
    """Parameters that know after which turn they mean the same ground.

    A parameter that is anything else besides an angle of axes has no such turn.

    Args:
        parameters: of the case.
        ties: where a parameter stands in the case, path of the key and what is written there.
    """
    ties = list(ties)
    return tuple(_oriented(parameter, ties) for parameter in parameters)


def _oriented(parameter: Parameter, ties: Sequence[tuple[KeyPath, CaseNumber]]) -> Parameter:
    places = [(path, given.factor) for path, given in ties if given.parameter == parameter.name]
    if not places or any(path[-1] not in TURNS or factor == 0.0 for path, factor in places):
        return parameter
    period = _common([TURNS[str(path[-1])] / abs(factor) for path, factor in places])
    mirrors = {_strike_of(path, factor, ties) for path, factor in places}
    mirror = mirrors.pop() if len(mirrors) == 1 else None
    return replace(parameter, period=period, mirror=mirror)


def _common(periods: Sequence[float]) -> float | None:
    """The smallest turn that is a multiple of all; None if there is no small one."""
    for turns in range(1, _MOST_TURNS + 1):
        shares = [turns * periods[0] / period for period in periods]
        if all(isclose(share, round(share), rel_tol=1e-9) and share > 0.5 for share in shares):
            return turns * periods[0]
    return None


def _strike_of(
    path: KeyPath, factor: float, ties: Sequence[tuple[KeyPath, CaseNumber]]
) -> tuple[str, float] | None:
    """The parameter of the dip direction beside a dip, with half a turn of it."""
    if path[-1] != "dip":
        return None
    beside = (*path[:-1], "dip_direction")
    for other, given in ties:
        if other == beside and given.parameter is not None and given.factor != 0.0:
            return given.parameter, pi / abs(given.factor)
    return None


def attitude(
    context: Context,
    dip: CaseNumber | None,
    direction: CaseNumber | None,
    rotation: CaseNumber | None = None,
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
    dip: CaseNumber | None,
    direction: CaseNumber | None,
    normal: Sequence[CaseNumber] | None,
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


def refuse_no_direction(key: str, given: list[CaseNumber] | None, faults: SectionFaults) -> None:
    """A fault where a vector has no direction.

    Args:
        key: where it is written, in its section.
        given: the vector, if there is one.
        faults: takes the fault.
    """
    if given is not None and not any(x.factor for x in given):
        message = "the direction has length zero"
        faults.add((key,), "zero-direction", message, "Write a vector such as [0, 1].")


def axes_along(context: Context, first: Sequence[CaseNumber], second: Sequence[CaseNumber]) -> Axes:
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


def _unit_vector(context: Context, given: Sequence[CaseNumber]) -> Vector3:
    """A vector of length one; (0, 0, 1) with a fault where there is none."""
    numbers = [number.factor for number in given]
    if len(numbers) not in {context.dim, 3}:
        expected = "2 or 3" if context.dim == 2 else "3"
        message = f"found {len(numbers)} components; expected {expected}"
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
