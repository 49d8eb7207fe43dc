"""Forces and strains of structures: load cells, strain gauges on bars and beams.

A bar (bolt, strut, anchor) bears one axial force, a grouted one another at each of its places. A
pile that bends has M there, positive with tension on the side of the point `towards`, Q = dM/ds
with s from head to toe, and the strain N/EA + y M/EI of the fibre on that side or the other. A
beam bears at a place along it, s the length of
arc with the inside of the beam to the right,

    N                       axial force, from the piece that holds the place (of a shell along
                            its meridian)
    M                       bending moment, linear between the ends of the piece (see
                            `forward.structures.end_moments`), positive with tension on the inside
    Q = dM/ds               shear force

and the strain of a fibre at a distance y from the axis, y counted to the inside, is N/EA + y M/EI
(of a shell that of the meridian, e_s + y k_s).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.on_structures import NOT_STANDING, PlaceOnBeam, standing
from geoident.forward.gauges.placement import Placed
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.grouted import (
    across_moments,
    axes_of,
    bar_share,
    place_along,
)
from geoident.forward.structures.members import StructureMembers, rigidities
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.gauges import Channel
from geoident.model.structures import Bars, Beam, GroutedBars


class MemberReadings(Observable):
    """Forces and strains of structures, SI.

    Displacements alone do not give them: EA(p) stands between.

    Args:
        channels: what is read, each of one structure.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = channels
        self._places: dict[str, PlaceOnBeam] = {}

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """What a unit of every member force adds to the values."""
        n_rows = len(state.end.members)
        columns = np.hstack([np.zeros((n_rows, 1)), np.eye(n_rows)])
        end = replace(state.end, members=columns)
        units = replace(state, end=end, point=ParameterPoint(state.point.values, ()))
        return LinearRows(members=sp.csr_array(self.values(units)[:, 1:]))

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI."""
        rows = [self._read(channel, state) for channel in self._channels]
        return np.array(rows).reshape(len(rows), state.end.members.shape[1])

    def _read(self, channel: Channel, state: AnalysisState) -> Floats:
        part, forces = state.structures.part(channel.structure), state.end.members
        if isinstance(part.structure, Beam):
            if channel.name not in self._places:
                self._places[channel.name] = PlaceOnBeam.nearest(part.members.ends, channel)
            value = _of_beam(part, self._places[channel.name], channel, forces, state.point)
        else:
            assert isinstance(part.structure, Bars)
            if channel.quantity in _BENDS:
                return _of_pile(part, channel, state)
            by = bar_share(part.structure, state.point)  # one bar bears its share
            if channel.kind != "load-cell":
                by = 1.0 / rigidities(part.structure, state.point)[0]
            value = scaled(_of_bar(part, channel, forces), by)
        return -value if channel.compression else value


def _of_bar(part: StructureMembers, channel: Channel, forces: Floats) -> Floats:
    """N of a bar, (1 + n + k,), as the analysis carries it: per metre, or of the whole turn.

    Of a grouted bar that at a place: linear in each piece, with the force of the grout as slope.
    """
    first, bars = part.rows.start, part.structure
    if not isinstance(bars, GroutedBars):
        return np.asarray(forces[first + channel.member])
    place = place_along(bars, channel.member, channel.second)
    piece = first + channel.member * bars.pieces + place.piece
    slope = forces[piece + len(part.members)]
    return np.asarray(forces[piece] + (place.part - 0.5) * place.length * slope)


_BENDS = ("M", "Q", "inside", "outside")


def _of_pile(part: StructureMembers, channel: Channel, state: AnalysisState) -> Floats:
    """M or Q of one pile at a place, or the strain of a fibre, (1 + n + k,)."""
    bends, pile = state.structures.bending_of(part), part.structure
    assert isinstance(pile, GroutedBars)
    assert bends is not None
    assert channel.towards is not None
    place = place_along(pile, channel.member, channel.second)
    axes = axes_of(pile, channel.member)[1:]
    side = axes @ (np.array(channel.towards) - place.point)  # of the tension, as M counts
    # M = EI v'' has tension where v is negative
    bent = -side / np.linalg.norm(side)
    at = across_moments(pile, state.end.members[bends.rows])[:, channel.member]
    first, second = np.tensordot(bent, at[:, place.piece : place.piece + 2], axes=1)
    share = bar_share(pile, state.point)
    if channel.quantity == "Q":
        return scaled((second - first) / place.length, share)
    moment = (1.0 - place.part) * first + place.part * second
    if channel.quantity == "M":
        return scaled(moment, share)
    if channel.fibre is not None:
        y = state.point.constant(channel.fibre)
    else:
        assert pile.diameter is not None  # `on_structures` refuses a pile without
        y = state.point.number(pile.diameter).times(0.5)
    EA, EI = (rigidities(one, state.point)[0] for one in (pile, bends.structure))
    axial = scaled(_of_bar(part, channel, state.end.members), 1.0 / EA)
    bend = scaled(moment, y / EI)
    return axial + bend if channel.quantity == "inside" else axial - bend


def _of_beam(
    part: StructureMembers,
    place: PlaceOnBeam,
    channel: Channel,
    forces: Floats,
    point: ParameterPoint,
) -> Floats:
    """A force or a fibre strain of a beam, (1 + n + k,)."""
    beam, section = part.structure, part.section_forces(forces)
    assert isinstance(beam, Beam)

    def bending(first: Floats, second: Floats) -> Floats:
        """A moment or curvature, linear along the pieces, with the sign of the inside."""
        along = place.along[:, None]
        moment = (1.0 - along) * first[place.pieces] + along * second[place.pieces]
        return np.asarray((place.turned[:, None] * moment).mean(axis=0))

    if channel.kind == "load-cell" and channel.quantity == "M":
        return bending(section.first, section.second)
    if channel.kind == "load-cell":
        force = section.axial if channel.quantity == "N" else section.shear
        return np.asarray(force[place.pieces].mean(axis=0))
    EA, EI = rigidities(beam, point)
    strain = scaled(section.stretch[place.pieces].mean(axis=0), 1.0 / EA)
    if channel.quantity == "axis":
        return strain
    if channel.fibre is not None:
        y = point.constant(channel.fibre)
    else:
        assert beam.thickness is not None  # `on_structures` refuses a beam without
        y = point.number(beam.thickness).times(0.5)
    bent = scaled(bending(section.bent_first, section.bent_second), y / EI)
    return strain + bent if channel.quantity == "inside" else strain - bent


def scaled(values: Floats, factor: Dual) -> Floats:
    """Values (1 + n + k,) times a number with n derivatives."""
    n = len(factor.columns)
    result = values * factor.value
    result[:n] = (Dual(values[:n]) * factor).columns
    return np.asarray(result)


def member_readings(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read forces and strains of structures, while these stand."""
    readable, faults = standing(channels, on_mesh)
    return Placed(MemberReadings(channels), readable, faults=faults, unreadable=NOT_STANDING)
