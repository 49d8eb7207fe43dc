"""Forces and strains of structures: load cells, strain gauges on bars and beams, cells on linings.

A bar (bolt, strut, anchor) bears one axial force. A beam bears at a place along it, s the length of
arc with the inside of the beam to the right,

    N                       axial force, from the piece that holds the place (of a shell along
                            its meridian)
    M                       bending moment, linear between the ends of the piece (see
                            `forward.structures.end_moments`), positive with tension on the inside
    Q = dM/ds               shear force

and the strain of a fibre at a distance y from the axis, y counted to the inside, is N/EA + y M/EI
(of a shell that of the meridian, e_s + y k_s).
The inside is the side without ground, or that of the point ``towards``. Where pieces meet in a
place, they count equally.

Forces of structures are zero when they are built, or the prestress then, so these channels read
values unless the case gives a zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.location import REACH, Site, format_point
from geoident.fem.structures import section_forces
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.observation import AnalysisState
from geoident.forward.gauges.placement import Placed, unbroken
from geoident.forward.gauges.stress import Spots, StressReadings, readers_of
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.members import StructureMembers, rigidities
from geoident.forward.structures.placing import facing_balance, present_throughout, straight_pieces
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.gauges import Channel
from geoident.model.structures import Bars, Beam, Structure
from geoident.units import with_article

DIMENSIONS = {"N": "line load", "Q": "line load", "M": "moment per length"}
"""Of the forces of a beam, per metre; the force of a bar is that of one bar."""

BENDING = ("M", "inside", "outside")
"""What cannot be read without knowing which side is the inside."""

_TOGETHER = 32
"""Unit motions that are looked at together."""

_EQUALLY_NEAR = 1e-6
"""Difference of distances, in parts of a piece, below which two pieces are equally near."""


class MemberReadings:
    """Forces and strains of structures, SI.

    Args:
        channels: what is read, each of one structure.
    """

    rows = None  # EA(p) stands between the displacements and the force

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = channels
        self._places: dict[str, _PlaceOnBeam] = {}

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """What a unit of every member force adds to the values.

        Args:
            state: of which nothing counts.
            wanted: (g,) which of the channels.
        """
        n_rows = len(state.end.members)
        columns = np.hstack([np.zeros((n_rows, 1)), np.eye(n_rows)])
        end = replace(state.end, members=columns)
        units = replace(state, end=end, point=ParameterPoint(state.point.values, ()))
        return LinearRows(members=sp.csr_array(self.values(units)[:, 1:]))

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI."""
        rows = [self._read(channel, state) for channel in self._channels]
        return np.array(rows).reshape(len(rows), state.end.members.shape[1])

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """None: there are no principal values."""
        return ()

    def _read(self, channel: Channel, state: AnalysisState) -> Floats:
        part, forces = state.structures.part(channel.structure), state.end.members
        if isinstance(part.structure, Bars):
            if channel.kind == "load-cell":
                force = state.structures.bar(part.name, channel.member, forces, state.point)
                return -force if channel.compression else force
            smeared = forces[part.rows.start + channel.member]
            axial, _ = rigidities(part.structure, state.point)
            return _scaled(smeared, 1.0 / axial)
        if channel.name not in self._places:
            found_place = nearest(part.members.ends, np.array(channel.second))
            self._places[channel.name] = found_place.seen_from(channel.towards)
        force = _of_beam(part, self._places[channel.name], channel, forces, state.point)
        return -force if channel.compression else force


@dataclass(frozen=True)
class _PlaceOnBeam:
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

    def seen_from(self, towards: tuple[float, ...] | None) -> _PlaceOnBeam:
        """The same with the inside on the side of a point (dim,), m, or as the pieces have it."""
        if towards is None:
            return self
        side = self.normals @ (np.array(towards) - self.point)
        return replace(self, turned=np.where(side < 0, -1.0, 1.0))


def nearest(ends: Floats, point: Floats) -> _PlaceOnBeam:
    """Where the pieces of a beam come nearest to a point.

    Args:
        ends: (n, 2, 2) of the pieces, m.
        point: (2,) m.
    """
    span = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(span, axis=1)
    along = np.clip(((point - ends[:, 0]) * span).sum(axis=1) / length**2, 0.0, 1.0)
    foot = ends[:, 0] + along[:, None] * span
    distance = np.linalg.norm(foot - point, axis=1)
    best = int(distance.argmin())
    at = np.linalg.norm(foot - foot[best], axis=1) <= _EQUALLY_NEAR * length[best]
    here = np.flatnonzero(at)
    normals = np.stack([span[here, 1], -span[here, 0]], axis=1) / length[here, None]
    ones = np.ones(len(here))
    return _PlaceOnBeam(
        here, along[here], ones, foot[best], float(distance[best]), normals, length[here]
    )


class BeamTilts:
    """Rotations of beams, rad, in which the top leans towards the direction of the channel.

    With the curvatures k_1 and k_2 at the ends of the piece that holds the place and psi the
    rotation of its chord, the rotation of the cubic beam at the part xi of its length L is

        theta = psi - L (2 k_1 + k_2) / 6 + L (k_1 xi + (k_2 - k_1) xi^2 / 2)

    Args:
        channels: what is read, each of one beam.
    """

    rows = None  # rotations of beams are no unknowns

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = channels
        self._linear: LinearRows | None = None

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """What a unit motion of every node of the beams adds to the values; found once."""
        if self._linear is None:
            members = {
                c.structure: state.structures.part(c.structure).members for c in self._channels
            }
            moved = [np.unique(m.operator.indices) for m in members.values()]
            dofs = np.unique(np.concatenate([np.empty(0, np.int64), *moved]))
            rows = sp.lil_array((len(self._channels), len(state.end.u)))
            for start in range(0, len(dofs), _TOGETHER):
                some = dofs[start : start + _TOGETHER]
                u = np.zeros((len(state.end.u), 1 + len(some)))
                u[some, 1 + np.arange(len(some))] = 1.0
                units = replace(state, end=replace(state.end, u=u))
                rows[:, some] = self.values(units)[:, 1:]
            self._linear = LinearRows(u=sp.csr_array(rows))
        return self._linear

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, rad."""
        rows = [self._read(channel, state) for channel in self._channels]
        return np.array(rows).reshape(len(rows), state.end.u.shape[1])

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """None: there are no principal values."""
        return ()

    def _read(self, channel: Channel, state: AnalysisState) -> Floats:
        members = state.structures.part(channel.structure).members
        place = nearest(members.ends, np.array(channel.second))
        bent = section_forces(members, members.operator @ state.end.u)  # of unit stiffness
        assert members.nodes is not None
        tilts = []
        for piece, xi in zip(place.pieces, place.along, strict=True):
            first, second = (state.end.u.reshape(-1, 2, state.end.u.shape[1])[node]
                             for node in members.nodes[piece])  # fmt: skip
            length = members.length[piece]
            (x1, y1), (x2, y2) = members.ends[piece]
            psi = np.array([y1 - y2, x2 - x1]) @ (second - first) / length**2
            k1, k2 = bent.bent_first[piece], bent.bent_second[piece]
            tilts.append(psi + length * (k1 * xi + (k2 - k1) * xi**2 / 2 - (2 * k1 + k2) / 6))
        return np.asarray(-np.sign(channel.direction[0]) * np.mean(tilts, axis=0))


def tilts_of_beams(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the rotation of a beam, while it stands."""
    faults = [fault for channel in channels for fault in _faults(channel, on_mesh)]
    readable = [_present(channel, on_mesh) for channel in channels]
    when = np.array(readable, bool).reshape(-1, len(on_mesh.sequence.states))
    return Placed(BeamTilts(channels), when, faults=tuple(faults), unreadable=_NOT_THERE)


def _of_beam(
    part: StructureMembers,
    place: _PlaceOnBeam,
    channel: Channel,
    members: Floats,
    point: ParameterPoint,
) -> Floats:
    """A force or a fibre strain of a beam, (1 + n + k,)."""
    assert isinstance(part.structure, Beam)
    section = part.section_forces(members)
    if channel.kind == "load-cell" and channel.quantity != "M":
        forces = section.axial if channel.quantity == "N" else section.shear
        return np.asarray(forces[place.pieces].mean(axis=0))
    if channel.kind == "load-cell":
        return _between(place, section.first, section.second)
    axial, bending = rigidities(part.structure, point)
    strain = _scaled(section.stretch[place.pieces].mean(axis=0), 1.0 / axial)
    if channel.quantity == "axis":
        return strain
    distance = _fibre_distance(part.structure, channel, point)
    bent = _scaled(_between(place, section.bent_first, section.bent_second), distance / bending)
    return strain + bent if channel.quantity == "inside" else strain - bent


def _between(place: _PlaceOnBeam, first: Floats, second: Floats) -> Floats:
    """A moment (k,) at a place, linear along its pieces, with the sign of the inside."""
    along = place.along[:, None]
    there = (1.0 - along) * first[place.pieces] + along * second[place.pieces]
    return np.asarray((place.turned[:, None] * there).mean(axis=0))


def _fibre_distance(beam: Beam, channel: Channel, point: ParameterPoint) -> Dual:
    """Of a fibre from the axis of a beam, m."""
    if channel.fibre is not None:
        return point.constant(channel.fibre)
    if beam.thickness is None:
        msg = "a beam without thickness has no inner and outer fibre"
        raise ValueError(msg)
    return point.number(beam.thickness).times(0.5)


def _scaled(values: Floats, factor: Dual) -> Floats:
    """Values (1 + n + k,) times a number with n derivatives."""
    n = len(factor.columns)
    result = values * factor.value
    result[:n] = (Dual(values[:n]) * factor).columns
    return np.asarray(result)


def member_readings(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read forces and strains of structures, while these stand."""
    faults = [fault for channel in channels for fault in _faults(channel, on_mesh)]
    readable = [_present(channel, on_mesh) for channel in channels]
    when = np.array(readable, bool).reshape(-1, len(on_mesh.sequence.states))
    return Placed(MemberReadings(channels), when, faults=tuple(faults), unreadable=_NOT_THERE)


_NOT_THERE = "its structure does not stand then"


def pressures_on_beams(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read what the ground presses on a beam, normal to it, while it stands."""
    faults = [fault for channel in channels for fault in _faults(channel, on_mesh)]
    present = np.array([_present(channel, on_mesh) for channel in channels])
    when = present.reshape(-1, len(on_mesh.sequence.states))
    if faults:
        nothing = StressReadings([], Spots.of([], on_mesh).water(on_mesh))
        return Placed(nothing, when, faults=tuple(faults), unreadable=_NOT_THERE)
    turned, sites = zip(*(_facing(channel, on_mesh) for channel in channels), strict=True)
    spots = Spots.of(turned, on_mesh, sites)
    observable = StressReadings(readers_of(spots, on_mesh), spots.water(on_mesh))
    return Placed(observable, spots.readable & when, spots.snapped, spots.faults, _NOT_THERE)


def _facing(channel: Channel, on_mesh: CaseOnMesh) -> tuple[Channel, tuple[Site, ...]]:
    """The channel at its place on the beam with the normal there, and the ground that presses."""
    mesh, name = on_mesh.mesh, channel.structure
    present = present_throughout(on_mesh.sequence, name)
    _, place, inside = _place(channel, on_mesh)
    foot = tuple(map(float, place.point))
    sites = on_mesh.locator.sites(foot)
    nodes = {site.element: mesh.points[site.nodes].mean(axis=0) for site in sites}
    behind = tuple(
        site
        for site in sites
        if present is not None
        and present[site.element]
        and (nodes[site.element] - place.point) @ inside < 0.0
    )
    return replace(channel, second=foot, direction=tuple(map(float, inside)), towards=None), behind


def _place(channel: Channel, on_mesh: CaseOnMesh) -> tuple[Ints, _PlaceOnBeam, Floats]:
    """Pieces (n, 2) of a beam, the place of a channel on it, and the unit vector to its inside."""
    mesh, structure = on_mesh.mesh, on_mesh.case.structures[channel.structure]
    assert isinstance(structure, Beam)
    edges = straight_pieces(mesh, structure.group)
    place = nearest(mesh.points[edges], np.array(channel.second))
    if channel.towards is not None:
        place = place.seen_from(channel.towards)
    else:
        present = present_throughout(on_mesh.sequence, channel.structure)
        if present is not None:
            balance = facing_balance(mesh, edges[place.pieces], present)
            place = replace(place, turned=np.where(balance < 0, -1.0, 1.0))
    inside = (place.turned[:, None] * place.normals).mean(axis=0)
    return edges, place, inside / np.linalg.norm(inside)


def _present(channel: Channel, on_mesh: CaseOnMesh) -> Bools:
    """(n_states,) when a channel on a structure can be read: while it stands, since its zero."""
    sequence = on_mesh.sequence
    stands = np.array([channel.structure in state.structures for state in sequence.states])
    if not channel.is_zeroed:
        return stands
    return unbroken(sequence, on_mesh.case.zero_of(channel), stands)


def _faults(channel: Channel, on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """What is wrong with a channel on a structure that the case has."""
    structure = on_mesh.case.structures[channel.structure]
    named = f"gauge '{channel.name}'"
    of = f"the structure '{channel.structure}'"
    states = on_mesh.sequence.states

    def fault(code: str, message: str, hint: str, *key: str) -> Fault:
        place = (*channel.key, *key)
        return on_mesh.case.source.fault(place, code=code, message=message, hint=hint)

    present = [state.name for state in states if channel.structure in state.structures]
    if not present:
        message = f"{named} sits on {of}, which no stage builds"
        yield fault("structure-never-built", message, f"add 'build: [{channel.structure}]'")
        return
    if channel.is_zeroed and channel.zero not in present:
        message = (
            f"{named} reads zero at stage '{channel.zero}', at which {of} does not stand; "
            f"it stands at: {', '.join(present)}"
        )
        hint = "zero it at one of these stages"
        if channel.kind != "tilt":
            hint += ", or remove 'zero' to read what there is since then"
        yield fault("zero-before-structure", message, hint, "zero")
    if isinstance(structure, Bars):
        yield from _bar_faults(channel, structure, fault, named, of)
    else:
        yield from _beam_faults(channel, structure, on_mesh, fault, named, of)
    wanted = _dimension(channel, structure)
    if channel.dimension != wanted:
        what = "of one bar" if isinstance(structure, Bars) else "of a beam, per metre"
        message = (
            f"{named} reads {_QUANTITIES[channel.quantity]} {what}: {with_article(wanted)}; its "
            f"accuracy is {with_article(channel.dimension)}"
        )
        hint = f"write the accuracy as {with_article(wanted)}"
        yield fault("unit", message, hint, "accuracy")


_QUANTITIES = {
    "N": "the axial force",
    "M": "the bending moment",
    "Q": "the shear force",
    "": "the strain",
    "axis": "the strain",
    "inside": "the strain",
    "outside": "the strain",
}
"""What a channel on a structure reads, by its quantity."""

_BY_KIND = {"pressure-cell": "pressure", "tilt": "angle"}
"""Kinds that read the same of every structure."""

_MakesFault = Callable[..., Fault]


def _dimension(channel: Channel, structure: Structure) -> str:
    """The dimension of what a channel reads of a structure."""
    if channel.kind == "strain":
        return "strain"
    if channel.kind in _BY_KIND:
        return _BY_KIND[channel.kind]
    return "force" if isinstance(structure, Bars) else DIMENSIONS[channel.quantity]


def _bar_faults(
    channel: Channel, structure: Bars, fault: _MakesFault, named: str, of: str
) -> Iterator[Fault]:
    count = len(structure.ends)
    if channel.kind == "pressure-cell":
        message = f"{named} reads a pressure on {of}, whose bars the ground does not press on"
        yield fault("wrong-structure", message, "name a beam, or give a point and a normal")
    elif channel.kind == "tilt":
        message = f"{named} reads a rotation of {of}, whose bars have none of their own"
        yield fault("wrong-structure", message, "name a beam, or give the two points of 'between'")
    elif channel.quantity not in ("N", "", "axis"):
        message = f"{named} reads '{channel.quantity}' of {of}; its bars bear only N"
        yield fault("wrong-structure", message, "remove the key, or name a beam")
    elif channel.member >= count:
        message = f"{named} sits on bar {channel.member + 1} of {of}, which has {count}"
        yield fault("no-such-bar", message, "correct 'bar'; they count from 1", "bar")


def _beam_faults(
    channel: Channel,
    beam: Beam,
    on_mesh: CaseOnMesh,
    fault: _MakesFault,
    named: str,
    of: str,
) -> Iterator[Fault]:
    asked = format_point(channel.second)
    edges, place, _ = _place(channel, on_mesh)
    if place.distance > REACH * place.lengths.max():
        message = (
            f"{named} sits at {asked}, which is not on {of}; its nearest place is "
            f"{format_point(place.point)}, {place.distance:.3g} m away"
        )
        yield fault("not-on-structure", message, "correct the point or the structure", "point")
        return
    bends = channel.kind == "pressure-cell" or channel.quantity in BENDING
    present = present_throughout(on_mesh.sequence, channel.structure)
    if bends and channel.towards is None and present is not None:
        balance = facing_balance(on_mesh.mesh, edges[place.pieces], present)
        if not balance.all():
            message = (
                f"{named} reads {of} at {asked}, where there is ground on both sides of it or on "
                "none: which side is its inside is not known"
            )
            yield fault("which-side", message, "give 'towards': a point on the inside")
    if channel.quantity in ("inside", "outside") and not (beam.thickness or channel.fibre):
        message = f"{named} reads a fibre of {of}, whose thickness is not given"
        yield fault("no-thickness", message, "give 'depth': its distance from the axis of the beam")
