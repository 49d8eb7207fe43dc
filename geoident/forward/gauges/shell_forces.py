"""Normal forces and moments of shells at a point, per metre, strains, tilts (`fem.shells`).

A face of the mesh gives the mean of each force over it: in it the forces cancel with which the
nodes of quadratic elements load a shell unevenly. From the middle of the face that holds the point
its value goes on to the point with the gradient that fits the faces around it best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.location import REACH, format_point
from geoident.fem.shells import ShellMembers, nearest_triangle, rotation_nodes
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.member_forces import scaled
from geoident.forward.gauges.motion import RelativeDisplacements
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.on_structures import NOT_STANDING, standing
from geoident.forward.gauges.placement import Placed
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.members import rigidities
from geoident.forward.structures.placing import placed, present_throughout
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.gauges import SHELL_FORCES, Channel
from geoident.model.structures import Shell

_ALONG = 0.7
"""Part of the direction of a strain gauge that lies along its shell, at least."""


@dataclass(frozen=True)
class PlaceOnShell:
    """A place on a shell.

    Args:
        faces: (n_faces,) weights of the forces of its faces in those at the place.
        sign: of moments: -1 where the inside is not that of the normals.
        away: distance of the place from the point that was asked for, in parts of a face.
        point: (3,) the place, m.
        nodes, shapes: (3,) of the triangle that holds it, and their parts in what is there.
        side_known: whether it is known which side is the inside.
        axes: (2, 3) unit vectors 1 and 2 there.
        inside: (3,) unit vector to the inside.
    """

    faces: Floats
    sign: float
    away: float
    point: Floats
    nodes: Ints
    shapes: Floats
    side_known: bool
    axes: Floats
    inside: Floats

    @classmethod
    def nearest(cls, mesh_points: Floats, members: ShellMembers, channel: Channel) -> PlaceOnShell:
        """Where a shell comes nearest to the point of a channel.

        Args:
            mesh_points: (n_nodes, 3) m.
            members: the shell.
            channel: on it.
        """
        assert members.nodes is not None
        point, corners = np.array(channel.second), mesh_points[members.nodes]
        best, shapes = nearest_triangle(corners, point)
        foot = shapes @ corners[best]
        own, frame = int(members.triangles.face[best]), members.frames[best]
        at_own = members.nodes[members.triangles.face == own]
        touching = np.isin(members.nodes, at_own).any(axis=1)
        near = np.unique(members.triangles.face[touching])
        # The gradient is that of a plane through the faces around in the mean, not through this
        # face: beside an edge its curvature along the edge would lean the plane across it.
        places = (members.centres[near] - members.centres[own]) @ frame[:2].T
        reach = (foot - members.centres[own]) @ frame[:2].T
        weights = np.zeros(len(members.area))
        weights[near] = reach @ np.linalg.pinv(places - places.mean(axis=0), rcond=1e-6)
        weights[own] += 1.0
        sign = 1.0
        if channel.towards is not None:
            inwards = frame[2] @ (np.array(channel.towards) - foot)
            sign = -1.0 if inwards < 0.0 else 1.0
        size = float(np.sqrt(members.area[own]))
        known = channel.towards is not None or bool(members.side_known[own])
        away = float(np.linalg.norm(foot - point)) / size
        return cls(
            weights,
            sign,
            away,
            foot,
            members.nodes[best],
            shapes,
            known,
            frame[:2],
            sign * frame[2],
        )


@dataclass(frozen=True)
class _Term:
    """A part of a reading: a sum over the rows of a shell, times a number of it.

    Args:
        row: (1, n_rows) the sum.
        factor: the number, at parameter values; None for one.
    """

    row: sp.csr_array
    factor: Callable[[ParameterPoint], Dual] | None = None


class ShellReadings(Observable):
    """Forces and strains of shells, linear in the forces q of their rows.

    Args:
        channels: what is read, each of one shell.
        terms: of each channel, which add up.
    """

    def __init__(self, channels: Sequence[Channel], terms: Sequence[Sequence[_Term]]) -> None:
        self._channels, self._terms = channels, terms

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """The sums, with the numbers of the shells."""
        n_rows, rows = len(state.end.members), []
        point = ParameterPoint(state.point.values, ())
        for channel, terms in zip(self._channels, self._terms, strict=True):
            start = state.structures.part(channel.structure).rows.start
            data = [t.row.data * (t.factor(point).value if t.factor else 1.0) for t in terms]
            at = np.concatenate([t.row.indices for t in terms]) + start
            entries = np.concatenate(data), (np.zeros(len(at), dtype=np.int64), at)
            rows.append(sp.csr_array(entries, shape=(1, n_rows)))
        return LinearRows(members=sp.csr_array(sp.vstack(rows)))

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI."""
        read = []
        for channel, terms in zip(self._channels, self._terms, strict=True):
            forces = state.end.members[state.structures.part(channel.structure).rows]
            parts = [
                scaled((t.row @ forces)[0], t.factor(state.point)) if t.factor else t.row @ forces
                for t in terms
            ]
            read.append(sum(part.ravel() for part in parts))
        return np.array(read)


def shell_readings(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read forces and strains of shells, while these stand."""
    readable, faults = standing(channels, on_mesh)
    terms = []
    for channel in channels:
        shell = on_mesh.case.structures[channel.structure]
        found = place_on_shell(channel, on_mesh)
        assert isinstance(shell, Shell)
        if found is None:
            continue
        members, place = found
        faults = (*faults, *shell_faults(channel, place, on_mesh))
        made = _strain if channel.kind == "strain" else _force
        terms.append(made(channel, shell, members, place))
    return Placed(ShellReadings(channels, terms), readable, faults=faults, unreadable=NOT_STANDING)


def tilts_of_shells(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read how far the top of what is fixed to a shell leans, while it stands."""
    readable, faults = standing(channels, on_mesh)
    rows = sp.lil_array((len(channels), on_mesh.mesh.points.size))
    for row, channel in enumerate(channels):
        found = place_on_shell(channel, on_mesh)
        if found is None:
            continue
        place = found[1]
        faults = (*faults, *shell_faults(channel, place, on_mesh))
        about = np.cross((0.0, 0.0, 1.0), channel.direction)
        dofs = 3 * rotation_nodes(on_mesh.mesh, place.nodes)[:, None] + np.arange(3)
        rows[row, dofs.ravel()] = np.outer(place.shapes, about).ravel()
    observable = RelativeDisplacements(sp.csr_array(rows))
    return Placed(observable, readable, faults=faults, unreadable=NOT_STANDING)


def place_on_shell(
    channel: Channel, on_mesh: CaseOnMesh
) -> tuple[ShellMembers, PlaceOnShell] | None:
    """The shell of a channel and its place there; None where it is none, or never stands."""
    present = present_throughout(on_mesh.sequence, channel.structure)
    shell = on_mesh.case.structures[channel.structure]
    if present is None or not isinstance(shell, Shell):
        return None
    members = placed(on_mesh, channel.structure, present)
    assert isinstance(members, ShellMembers)
    return members, PlaceOnShell.nearest(on_mesh.mesh.points, members, channel)


def _force(
    channel: Channel, shell: Shell, members: ShellMembers, place: PlaceOnShell
) -> list[_Term]:
    """A force: n_11 is the sum and the difference of the rows, n_22 the one less the other."""
    bends, component = divmod(SHELL_FORCES.index(channel.quantity), 3)
    sign = place.sign if bends else -1.0 if channel.compression else 1.0
    parts = np.zeros((2, 3))
    parts[bends] = ((1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 0.0, 1.0))[component]
    return [_Term(members.row((sign * parts).ravel().tolist(), place.faces))]


def _strain(
    channel: Channel, shell: Shell, members: ShellMembers, place: PlaceOnShell
) -> list[_Term]:
    """The strain along the direction d of a fibre at a distance y from the middle, to the inside.

    With the angle a from axis 1 to d and the rigidities of the rows (`fem.shells`), of the membrane

        e = 1/2 (e_11 + e_22) + cos(2 a)/2 (e_11 - e_22) + sin(2 a)/2 g_12

    and y times that of the curvatures.
    """
    along = place.axes @ np.array(channel.direction)
    angle = np.arctan2(along[1], along[0])
    even, apart, shear = 0.5, 0.5 * float(np.cos(2 * angle)), 0.5 * float(np.sin(2 * angle))
    side = {"axis": 0.0, "inside": place.sign, "outside": -place.sign}[channel.quantity]

    def factor(rigidity: int, point: ParameterPoint) -> Dual:
        stiff = rigidities(shell, point)[rigidity]
        if rigidity < 2:
            return 1.0 / stiff
        if channel.fibre is not None:
            return point.constant(channel.fibre * side) / stiff
        return point.number(shell.thickness).times(0.5 * side) / stiff

    rows = ((even, 0, 0, 0, 0, 0), (0, apart, shear, 0, 0, 0),
            (0, 0, 0, even, 0, 0), (0, 0, 0, 0, apart, shear))  # fmt: skip
    return [
        _Term(members.row(parts, place.faces), partial(factor, number))
        for number, parts in enumerate(rows)
        if any(parts) and (side or number < 2)
    ]


def shell_faults(channel: Channel, place: PlaceOnShell, on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """What is wrong with the place of a channel."""
    of, asked = f"the structure '{channel.structure}'", format_point(channel.second)

    def fault(code: str, message: str, hint: str, *key: str) -> Fault:
        message = f"gauge '{channel.name}' {message}"
        return on_mesh.case.source.fault((*channel.key, *key), code, message, hint)

    if place.away > REACH:
        message = f"sits at {asked}, which is not on {of}; its nearest place is "
        message += f"{format_point(place.point)}, "
        message += f"{np.linalg.norm(place.point - np.array(channel.second)):.3g} m away"
        yield fault("not-on-structure", message, "correct the point or the structure", "point")
        return
    across = float(np.linalg.norm(place.axes @ np.array(channel.direction)))
    if channel.kind == "strain" and across < _ALONG:
        message = f"reads a strain across {of} at {asked}, which has none"
        yield fault("direction-across", message, "give a direction along it", "direction")
    sided = channel.kind == "pressure-cell" or channel.quantity in ("inside", "outside")
    if (sided or channel.quantity.startswith("m")) and not place.side_known:
        message = f"reads {of} at {asked}, where there is ground on both sides of it or on none: "
        message += "which side is its inside is not known"
        yield fault("which-side", message, "give 'towards': a point on the inside")
