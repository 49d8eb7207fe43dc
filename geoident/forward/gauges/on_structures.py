"""Gauges on structures: their place on a beam, when they can be read, and what is wrong with them.

The inside of a beam is the side without ground, or that of the point ``towards``. Where pieces of
it meet in a place, they count equally.

Forces of structures are zero when they are built, or the prestress then, so gauges on them read
values unless the case gives a zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import REACH, format_point
from geoident.fem.structures import straight_pieces
from geoident.forward.gauges.placement import unbroken
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.placing import facing_balance, present_throughout
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import SHELL_FORCES, Channel
from geoident.model.structures import Bars, Beam, Shell, Structure, ages
from geoident.units import with_article

NOT_STANDING = "its structure does not stand then"

_EQUALLY_NEAR = 1e-6
"""Difference of distances, in parts of a piece, below which two pieces are equally near."""


@dataclass(frozen=True)
class PlaceOnBeam:
    """A place on a beam.

    Args:
        pieces: (k,) that meet there.
        along: (k,) how far along each, from 0 to 1.
        turned: (k,) 1, or -1 where the inside is to the left of the piece.
        point: (dim,) on the beam, m.
        distance: from the point that was asked for, m.
        normals: (k, dim) unit vectors to the right of the pieces.
        lengths: (k,) of the pieces, m.
    """

    pieces: Ints
    along: Floats
    turned: Floats
    point: Floats
    distance: float
    normals: Floats
    lengths: Floats

    @classmethod
    def nearest(cls, ends: Floats, channel: Channel) -> PlaceOnBeam:
        """Where the pieces of a beam come nearest to the point of a channel.

        The inside is to the right of the pieces, or on the side of the point ``towards``.

        Args:
            ends: (n, 2, 2) of the pieces, m.
            channel: on the beam.
        """
        point = np.array(channel.second)
        span = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(span, axis=1)
        along = np.clip(((point - ends[:, 0]) * span).sum(axis=1) / length**2, 0.0, 1.0)
        foot = ends[:, 0] + along[:, None] * span
        distance = np.linalg.norm(foot - point, axis=1)
        best = int(distance.argmin())
        apart = np.linalg.norm(foot - foot[best], axis=1)
        near = np.flatnonzero(apart <= _EQUALLY_NEAR * length[best])
        normals = np.stack([span[near, 1], -span[near, 0]], axis=1) / length[near, None]
        turned = np.ones(len(near))
        if channel.towards is not None:
            turned[normals @ (np.array(channel.towards) - foot[best]) < 0.0] = -1.0
        return cls(
            near, along[near], turned, foot[best], float(distance[best]), normals, length[near]
        )

    @property
    def inside(self) -> Floats:
        """(dim,) unit vector to the inside, the mean of the pieces."""
        mean = (self.turned[:, None] * self.normals).mean(axis=0)
        return np.asarray(mean / np.linalg.norm(mean))


def place_on_beam(channel: Channel, on_mesh: CaseOnMesh) -> tuple[PlaceOnBeam, bool]:
    """The place of a channel on its beam, and whether it is known which side is the inside."""
    structure = on_mesh.case.structures[channel.structure]
    assert isinstance(structure, Beam)
    edges = straight_pieces(on_mesh.mesh, structure.group)
    place = PlaceOnBeam.nearest(on_mesh.mesh.points[edges], channel)
    present = present_throughout(on_mesh.sequence, channel.structure)
    if channel.towards is not None or present is None:
        return place, True
    balance = facing_balance(on_mesh, edges[place.pieces], present)
    return replace(place, turned=np.where(balance < 0, -1.0, 1.0)), bool(balance.all())


def standing(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> tuple[Bools, tuple[Fault, ...]]:
    """(g, n_states) when channels on structures can be read, and what is wrong with them.

    They are read while the structure stands, and since their zero.
    """
    sequence = on_mesh.sequence
    readable = np.zeros((len(channels), len(sequence.states)), dtype=bool)
    for row, channel in enumerate(channels):
        stands = np.array([channel.structure in state.structures for state in sequence.states])
        zero = on_mesh.case.zero_of(channel)
        readable[row] = unbroken(sequence, zero, stands) if channel.is_zeroed else stands
    faults = [fault for channel in channels for fault in _faults(channel, on_mesh)]
    return readable, tuple(faults)


def _faults(channel: Channel, on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """What is wrong with a channel on a structure that the case has."""
    structure = on_mesh.case.structures[channel.structure]
    named, of = f"gauge '{channel.name}'", f"the structure '{channel.structure}'"
    names = [s.name for s in on_mesh.sequence.states if channel.structure in s.structures]

    def fault(code: str, message: str, hint: str, *key: str) -> Fault:
        place = (*channel.key, *key)
        return on_mesh.case.source.fault(place, code, f"{named} {message}", hint)

    if not names:
        hint = f"add 'build: [{channel.structure}]'"
        yield fault("structure-never-built", f"sits on {of}, which no stage builds", hint)
        return
    if channel.is_zeroed and channel.zero not in names:
        message = (
            f"reads zero at stage '{channel.zero}', at which {of} does not stand; "
            f"it stands at: {', '.join(names)}"
        )
        hint = "zero it at one of these stages"
        if channel.kind not in ("tilt", "bar-displacement"):
            hint += ", or remove 'zero' to read what there is since then"
        yield fault("zero-before-structure", message, hint, "zero")
    fibre = channel.quantity in ("inside", "outside")
    if isinstance(structure, Bars):
        count = len(structure.ends)
        if channel.kind == "pressure-cell":
            message = f"reads a pressure on {of}, whose bars the ground does not press on"
            yield fault("wrong-structure", message, "name a beam, or give a point and a normal")
        elif channel.kind == "tilt":
            message = f"reads a rotation of {of}, whose bars have none of their own"
            hint = "name a beam, or give the two points of 'between'"
            yield fault("wrong-structure", message, hint)
        elif not structure.bends and channel.quantity not in ("N", "", "axis", "slip"):
            message = f"reads '{channel.quantity}' of {of}; its bars bear only N"
            yield fault("wrong-structure", message, "remove the key, or name a beam")
        elif channel.member >= count:
            message = f"sits on bar {channel.member + 1} of {of}, which has {count}"
            yield fault("no-such-bar", message, "correct 'bar'; they count from 1", "bar")
        elif fibre and not (structure.diameter or channel.fibre):
            message = f"reads a fibre of {of}, whose diameter is not given"
            yield fault("no-thickness", message, "give 'depth': its distance from the axis")
    elif isinstance(structure, Beam):
        asked = format_point(channel.second)
        place, side_known = place_on_beam(channel, on_mesh)
        on_beam = place.distance <= REACH * place.lengths.max()
        bends = fibre or channel.quantity == "M" or channel.kind == "pressure-cell"
        if not on_beam:
            message = (
                f"sits at {asked}, which is not on {of}; its nearest place is "
                f"{format_point(place.point)}, {place.distance:.3g} m away"
            )
            yield fault("not-on-structure", message, "correct the point or the structure", "point")
        if on_beam and bends and not side_known:
            message = (
                f"reads {of} at {asked}, where there is ground on both sides of it or on "
                "none: which side is its inside is not known"
            )
            yield fault("which-side", message, "give 'towards': a point on the inside")
        if on_beam and fibre and not (structure.thickness or channel.fibre):
            message = f"reads a fibre of {of}, whose thickness is not given"
            hint = "give 'depth': its distance from the axis of the beam"
            yield fault("no-thickness", message, hint)
    if channel.kind == "strain" and ages(structure):
        message = f"reads the strain of {of}, whose stiffness grows while it strains"
        hint = "read its force (kind: load-cell), or a displacement"
        yield fault("ageing", message, hint)
    wanted = _dimension(channel, structure)
    if channel.dimension != wanted:
        kind = "shell" if isinstance(structure, Shell) else "beam"
        what = "of one bar" if isinstance(structure, Bars) else f"of a {kind}, per metre"
        message = (
            f"reads {_QUANTITIES.get(channel.quantity, channel.quantity)} {what}: "
            f"{with_article(wanted)}; its accuracy is {with_article(channel.dimension)}"
        )
        yield fault("unit", message, f"write the accuracy as {with_article(wanted)}", "accuracy")


_QUANTITIES = {"N": "the axial force", "M": "the bending moment", "Q": "the shear force"} | (
    dict.fromkeys(("", "axis", "inside", "outside"), "the strain")
)
"""What a channel on a structure reads, by its quantity."""

_DIMENSIONS = {"N": "line load", "Q": "line load", "M": "moment per length"}
"""Of the forces of a beam, per metre; the force of a bar is that of one bar."""


def _dimension(channel: Channel, structure: Structure) -> str:
    """The dimension of what a channel reads of a structure."""
    same = {"strain": "strain", "pressure-cell": "pressure", "tilt": "angle"}
    same["bar-displacement"] = "length"
    if channel.kind in same:
        return same[channel.kind]
    if channel.quantity in SHELL_FORCES:
        return "moment per length" if channel.quantity.startswith("m") else "line load"
    if isinstance(structure, Bars):
        return "moment" if channel.quantity == "M" else "force"
    return _DIMENSIONS[channel.quantity]
