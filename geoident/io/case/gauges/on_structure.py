"""Gauges on structures: the channel of one, and its place on the beam or the bar that it names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from geoident.io.case.gauges.gauge import GaugeBase, Motion, subtract, unit_vector
from geoident.io.schema.section import Context
from geoident.io.schema.values import CaseNumber
from geoident.model.arrays import Floats, Vector
from geoident.model.gauges import SHELL_FORCES, Channel
from geoident.model.structures import (
    Bars,
    Beam,
    GroutedBars,
    OpeningSupport,
    Piles,
    Shell,
    Structure,
    Struts,
)

TOWARDS = "A point on the inside of the beam or shell; needed where ground is on both sides of it."


def on_structure(
    section: GaugeBase,
    name: str,
    point: list[CaseNumber] | None,
    bar: int | None,
    towards: list[CaseNumber] | None,
    context: Context,
    direction: Vector | None = None,
    **given: Any,
) -> Channel:
    """The channel of a gauge on some structure; the place on a bar is found later.

    Args:
        section: of the gauge.
        name: of the gauge.
        point: on the structure, if it is given by a point.
        bar: number of the bar, from 1, if it is given by that.
        towards: the point on the inside, if it is given.
        context: where the gauge is written.
        direction: along which a strain of a shell is read.
        given: see `GaugeBase.make_channel`.
    """
    place = None if point is None else context.at("point").vector(point)
    inside = None if towards is None else context.at("towards").vector(towards)
    member = 0 if bar is None else bar - 1
    point_or_none = place or (0.0,) * context.dim
    motion = Motion(None, point_or_none, direction or (0.0,) * context.dim)
    own = {"quantity": "", "member": member, "towards": inside, **given}
    return section.make_channel(name, name, motion, context.path, **own)


def on_structures(
    channels: Sequence[Channel],
    sections: Mapping[str, GaugeBase],
    structures: Mapping[str, Structure],
    context: Context,
) -> Iterator[Channel]:
    """Channels with the places that their structures give them; none, with a fault, without place.

    A bar gives its ends, and a strut that compression counts.

    Args:
        channels: of all gauges.
        sections: gauge to its section.
        structures: of the case.
        context: of the key `gauges`.
    """
    for channel in channels:
        structure = structures.get(channel.structure)
        if structure is None:
            if not channel.structure:
                yield channel
            continue  # an unknown structure is a fault of its own (`references`)
        section, place = sections[channel.gauge], context.at(channel.gauge)
        if isinstance(structure, OpeningSupport):
            message = f"'{channel.structure}' supports an opening in closed form, which gives "
            message += "displacements only"
            hint = "Gauges on structures need a mesh with a beam or bars."
            place.refuse("wrong-structure", message, hint)
        elif isinstance(structure, Shell) or channel.quantity in SHELL_FORCES:
            if _is_of_shell(channel, section, structure, place):
                yield channel
        elif isinstance(structure, Beam):
            if getattr(section, "point", None) is None:
                message = f"'{channel.structure}' is a beam; where on it is missing"
                place.refuse("missing-key", message, "Add 'point'.", key=True)
            elif channel.kind == "bar-displacement":
                message = f"'{channel.structure}' is a beam, which moves with the ground"
                place.at("structure").refuse("wrong-structure", message, "Name grouted bars.")
            elif getattr(section, "bar", None) is not None:
                message = f"'{channel.structure}' is a beam, which has no bars"
                place.at("bar").refuse("wrong-structure", message, "Remove it.", key=True)
            elif getattr(section, "direction", None) is not None:
                message = f"'{channel.structure}' is a beam, which strains along itself"
                place.at("direction").refuse("wrong-structure", message, "Remove it.", key=True)
            else:
                yield channel
        elif (on_bar := _on_bar(channel, section, structure, place)) is not None:
            yield on_bar


def _is_of_shell(
    channel: Channel, section: GaugeBase, structure: Structure, place: Context
) -> bool:
    """Whether a channel reads a force of a shell at a point; a fault where it does not."""
    name = channel.structure
    if not isinstance(structure, Shell):
        message = f"'{name}' is no shell, whose {channel.quantity} is read"
        place.at("quantity").refuse("wrong-structure", message, "Of beams N, M or Q, of bars N.")
    elif channel.kind == "load-cell" and channel.quantity not in SHELL_FORCES:
        message = f"'{name}' is a shell, whose quantities are {', '.join(SHELL_FORCES)}"
        hint = "Add 'quantity: n_22', the normal force along axis 2."
        place.refuse("wrong-structure", message, hint, key=True)
    elif getattr(section, "point", None) is None:
        message = f"'{name}' is a shell; where on it is missing"
        place.refuse("missing-key", message, "Add 'point'.", key=True)
    elif getattr(section, "bar", None) is not None:
        message = f"'{name}' is a shell, which has no bars"
        place.at("bar").refuse("wrong-structure", message, "Remove it.", key=True)
    elif channel.kind == "strain" and getattr(section, "direction", None) is None:
        message = f"'{name}' is a shell; along which direction its strain is read is missing"
        place.refuse("missing-key", message, "Add 'direction: [0, 0, 1]'.", key=True)
    else:
        return True
    return False


_BENT = ("M", "Q", "inside", "outside")
"""Quantities of what bends."""


def _on_bar(channel: Channel, section: GaugeBase, bars: Bars, place: Context) -> Channel | None:
    """A channel on one of some bars; None, with a fault, where it is not known on which."""
    count, bar = len(bars.ends), getattr(section, "bar", None)
    name = channel.structure
    if isinstance(bars, GroutedBars) and bar is None and getattr(section, "point", None):
        bar = 1 + int(np.argmin([_off(channel.second, ends) for ends in bars.ends]))
        channel = replace(channel, member=bar - 1)
    if channel.kind == "pressure-cell":
        message = f"'{name}' are bars, on which the ground does not press"
        place.at("on").refuse("wrong-structure", message, "Name a beam, or give 'normal'.")
    elif channel.kind == "bar-displacement" and not isinstance(bars, GroutedBars):
        message = f"'{name}' are bars that are held at their ends, where they move with the ground"
        hint = "Add 'k_grout' to the bolts, or read the displacement of the ground."
        place.at("structure").refuse("wrong-structure", message, hint)
    elif not isinstance(bars, GroutedBars) and getattr(section, "point", None) is not None:
        message = f"'{name}' are bars, whose force is the same along each"
        hint = "Remove 'point', and say with 'bar' which of them."
        place.at("point").refuse("wrong-structure", message, hint, key=True)
    elif channel.quantity in _BENT and not bars.bends:
        what = channel.quantity if channel.kind == "load-cell" else "moments"
        key, hint = "quantity", "Correct it, or name a beam."
        if channel.kind == "strain":
            key, hint = "fibre", "Remove it, or name a beam."
        if isinstance(bars, Piles):
            hint = "Give the piles 'k_lateral', or correct it."
        message = f"'{name}' are bars, which bear no {what}; expected N"
        place.at(key).refuse("wrong-structure", message, hint)
    elif channel.quantity in _BENT and channel.towards is None:
        message = f"{channel.quantity} of a pile has no sign without 'towards'"
        hint = "Add 'towards': a point on the side whose tension counts positive."
        place.refuse("missing-key", message, hint, key=True)
    elif bar is None and count > 1:
        message = f"'{name}' has {count} bars; which of them is missing"
        place.refuse("missing-key", message, "Add 'bar: 1', counted from 1.", key=True)
    elif bar is not None and bar > count:
        message = f"there is no bar {bar}; '{name}' has {count}"
        place.at("bar").refuse("no-such-bar", message, "They count from 1.")
    else:
        first, second = bars.ends[channel.member]
        if isinstance(bars, GroutedBars):
            return _on_grouted(channel, section, bars, place)
        counts = getattr(section, "sign", None)
        pushed = isinstance(bars, Struts) if counts is None else counts == "compression"
        return replace(
            channel,
            first=first,
            second=second,
            direction=unit_vector(subtract(second, first)),
            compression=pushed and channel.kind == "load-cell",
        )
    return None


def _on_line(point: Vector, start: Floats, along: Floats) -> bool:
    away = np.subtract(point, start)
    return bool(np.linalg.norm(away - (away @ along) * along) <= _OFF_BAR * np.linalg.norm(away))


def _off(point: Vector, ends: tuple[Vector, Vector]) -> float:
    """Distance of a point from a bar, m."""
    head, along = np.array(ends[0]), np.subtract(ends[1], ends[0])
    part = np.clip(np.subtract(point, head) @ along / (along @ along), 0.0, 1.0)
    return float(np.linalg.norm(head + part * along - point))


_OFF_BAR = 1e-3
"""Distance from a bar, in parts of its length, that is no longer on it."""


def _on_grouted(
    channel: Channel, section: GaugeBase, bars: GroutedBars, place: Context
) -> Channel | None:
    """A channel at a place of a grouted bar; None, with a fault, where that is not on it."""
    head, toe = np.array(bars.ends[channel.member])
    along, length = (toe - head) / np.linalg.norm(toe - head), float(np.linalg.norm(toe - head))
    at, given = bars.free, getattr(section, "point", None)
    if given is not None:
        at = float((channel.second - head) @ along)
        off = _off(channel.second, bars.ends[channel.member])
        if off > _OFF_BAR * length:
            message = f"the point lies {off:.3g} m off bar {channel.member + 1} of the structure "
            message += f"'{channel.structure}'"
            hint = "Give a point of the straight line between its ends."
            place.at("point").refuse("off-bar", message, hint, key=True)
            return None
    pushed = getattr(section, "sign", None) == "compression"
    if channel.towards is not None and _on_line(channel.towards, head, along):
        message = "the point lies on the line of the pile: it tells no side"
        place.at("towards").refuse("off-bar", message, "Give one beside it.", key=True)
        return None
    way = getattr(section, "positive", None) if channel.kind == "bar-displacement" else None
    inwards = isinstance(bars, Piles) if way is None else way == "in"
    moves = along if inwards else -along
    if channel.kind == "bar-displacement" and any(channel.direction):
        moves = np.array(channel.direction)
        if not bars.bends:
            message = f"'{channel.structure}' move along themselves only"
            hint = "Remove it; 'positive' says which motion counts."
            hint = "Remove it, or give the piles 'k_lateral'." if isinstance(bars, Piles) else hint
            place.at("direction").refuse("wrong-structure", message, hint, key=True)
            return None
    return replace(
        channel,
        first=None,
        second=tuple((head + at * along).tolist()),
        direction=tuple(moves.tolist()),
        compression=pushed and channel.kind == "load-cell",
    )
