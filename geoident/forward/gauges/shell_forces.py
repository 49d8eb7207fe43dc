"""Normal forces and moments of shells at a point, per metre (`fem.shells`).

A face of the mesh gives the mean of each force over it: in it the forces cancel with which the
nodes of quadratic elements load a shell unevenly. From the middle of the face that holds the point
its value goes on to the point with the gradient that fits the faces around it best.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.location import REACH, format_point
from geoident.fem.shells import ShellMembers
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.on_structures import NOT_STANDING, standing
from geoident.forward.gauges.placement import Placed
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.placing import placed, present_throughout
from geoident.model.arrays import Bools, Floats
from geoident.model.gauges import SHELL_FORCES, Channel
from geoident.model.structures import Shell


@dataclass(frozen=True)
class PlaceOnShell:
    """A place on a shell.

    Args:
        faces: (n_faces,) weights of the forces of its faces in those at the place.
        sign: of moments: -1 where the inside is not that of the normals.
        away: distance of the place from the point that was asked for, in parts of a face.
        point: (3,) the place, m.
        side_known: whether it is known which side is the inside.
    """

    faces: Floats
    sign: float
    away: float
    point: Floats
    side_known: bool

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
        feet = _feet(corners, point)
        apart = np.linalg.norm(feet - point, axis=1)
        best = int(apart.argmin())
        own, frame = int(members.triangles.face[best]), members.frames[best]
        at_own = members.nodes[members.triangles.face == own]
        touching = np.isin(members.nodes, at_own).any(axis=1)
        near = np.unique(members.triangles.face[touching])
        # The gradient is that of a plane through the faces around in the mean, not through this
        # face: beside an edge its curvature along the edge would lean the plane across it.
        places = (members.centres[near] - members.centres[own]) @ frame[:2].T
        reach = (feet[best] - members.centres[own]) @ frame[:2].T
        weights = np.zeros(len(members.area))
        weights[near] = reach @ np.linalg.pinv(places - places.mean(axis=0), rcond=1e-6)
        weights[own] += 1.0
        sign = 1.0
        if channel.towards is not None:
            inwards = frame[2] @ (np.array(channel.towards) - feet[best])
            sign = -1.0 if inwards < 0.0 else 1.0
        size = float(np.sqrt(members.area[own]))
        known = channel.towards is not None or bool(members.side_known[own])
        return cls(weights, sign, float(apart[best]) / size, feet[best], known)


class ShellReadings(Observable):
    """Forces of shells, linear in the forces q of their rows.

    Args:
        channels: what is read, each of one shell.
        rows: of each channel the sums (n_rows,) over the rows of its shell.
    """

    def __init__(self, channels: Sequence[Channel], rows: Sequence[sp.csr_array]) -> None:
        self._channels, self._rows = channels, rows

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """The sums themselves."""
        return LinearRows(members=self._matrix(state))

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, N/m and N."""
        return np.asarray(self._matrix(state) @ state.end.members)

    def _matrix(self, state: AnalysisState) -> sp.csr_array:
        """(g, n_rows) by the rows of all structures."""
        shape, rows = (1, len(state.end.members)), []
        for channel, row in zip(self._channels, self._rows, strict=True):
            at = row.indices + state.structures.part(channel.structure).rows.start
            rows.append(sp.csr_array((row.data, at, row.indptr), shape=shape))
        return sp.csr_array(sp.vstack(rows))


def shell_forces(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read forces of shells, while these stand."""
    readable, faults = standing(channels, on_mesh)
    shells: dict[str, ShellMembers] = {}
    rows = []
    for channel in channels:
        shell, name = on_mesh.case.structures[channel.structure], channel.structure
        present = present_throughout(on_mesh.sequence, name)
        assert isinstance(shell, Shell)
        if present is None:
            continue
        if name not in shells:
            members = placed(on_mesh, name, present)
            assert isinstance(members, ShellMembers)
            shells[name] = members
        place = PlaceOnShell.nearest(on_mesh.mesh.points, shells[name], channel)
        faults = (*faults, *_faults(channel, place, on_mesh))
        number = SHELL_FORCES.index(channel.quantity)
        sign = place.sign if number >= 3 else -1.0 if channel.compression else 1.0
        rows.append(shells[name].force_row(number, sign * place.faces))
    return Placed(ShellReadings(channels, rows), readable, faults=faults, unreadable=NOT_STANDING)


def _faults(channel: Channel, place: PlaceOnShell, on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """What is wrong with the place of a channel."""
    of, asked = f"the structure '{channel.structure}'", format_point(channel.second)

    def fault(code: str, message: str, hint: str, *key: str) -> Fault:
        message = f"gauge '{channel.name}' {message}"
        return on_mesh.case.source.fault(
            (*channel.key, *key), code=code, message=message, hint=hint
        )

    if place.away > REACH:
        message = f"sits at {asked}, which is not on {of}; its nearest place is "
        message += f"{format_point(place.point)}, "
        message += f"{np.linalg.norm(place.point - np.array(channel.second)):.3g} m away"
        yield fault("not-on-structure", message, "correct the point or the structure", "point")
    elif channel.quantity.startswith("m") and not place.side_known:
        message = f"reads {of} at {asked}, where there is ground on both sides of it or on none: "
        message += "which side is its inside is not known"
        yield fault("which-side", message, "give 'towards': a point on the inside")


def _feet(corners: Floats, point: Floats) -> Floats:
    """The points (m, 3) of triangles with corners (m, 3, 3) that are nearest to a point (3,)."""
    edges = np.roll(corners, -1, axis=1) - corners
    to_point = point - corners
    along = (edges * to_point).sum(axis=2) / (edges**2).sum(axis=2)
    on_edges = corners + np.clip(along, 0.0, 1.0)[..., None] * edges
    away = np.linalg.norm(on_edges - point, axis=2)
    feet = np.take_along_axis(on_edges, away.argmin(axis=1)[:, None, None], axis=1)[:, 0]
    normal = np.cross(edges[:, 0], edges[:, 1])
    outside = (np.cross(edges, to_point) @ normal[:, :, None])[..., 0] < 0.0
    inner = ~outside.any(axis=1)
    height = (to_point[:, 0] * normal).sum(axis=1) / (normal**2).sum(axis=1)
    feet[inner] = point - height[inner, None] * normal[inner]
    return feet
