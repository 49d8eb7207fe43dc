"""Rotations of beams: tilt meters on walls and linings.

With the curvatures k_1 and k_2 at the ends of the piece that holds the place and psi the rotation
of its chord, the rotation of the cubic beam at the part xi of its length L is

    theta = psi - L (2 k_1 + k_2) / 6 + L (k_1 xi + (k_2 - k_1) xi^2 / 2)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.fem.structures import Members, section_forces
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.on_structures import NOT_STANDING, PlaceOnBeam, standing
from geoident.forward.gauges.placement import Placed
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import Channel


class BeamTilts(Observable):
    """Rotations of beams, rad, in which the top leans towards the direction of the channel.

    Args:
        channels: what is read, each of one beam.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self._channels = channels
        self._operator: sp.csr_array | None = None

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """The rotations as sums of displacements."""
        return LinearRows(u=self._sums(state))

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, rad."""
        return np.asarray(self._sums(state) @ state.end.u)

    def _sums(self, state: AnalysisState) -> sp.csr_array:
        """(g, n_dofs) what displacements are multiplied with; no parameter is in it."""
        if self._operator is None:
            rows = sp.lil_array((len(self._channels), len(state.end.u)))
            for row, channel in enumerate(self._channels):
                dofs, weights = _tilt(state.structures.part(channel.structure).members, channel)
                rows[row, dofs] = weights
            self._operator = sp.csr_array(rows)
        return self._operator


def _tilt(members: Members, channel: Channel) -> tuple[Ints, Floats]:
    """What unit displacements of the nodes of a beam turn it by: numbers (k,), and rad/m (k,)."""
    assert members.nodes is not None
    place = PlaceOnBeam.nearest(members.ends, channel)
    dofs = np.unique(members.operator.indices).astype(np.int64)
    bent = section_forces(members, members.operator[:, dofs].toarray())  # of unit stiffness
    tilts = []
    for piece, xi in zip(place.pieces, place.along, strict=True):
        length = members.length[piece]
        (x1, y1), (x2, y2) = members.ends[piece]
        first, second = (2 * node + np.arange(2)[:, None] == dofs for node in members.nodes[piece])
        moved = second.astype(np.float64) - first
        psi = np.array([y1 - y2, x2 - x1]) @ moved / length**2
        k1, k2 = bent.bent_first[piece], bent.bent_second[piece]
        tilts.append(psi + length * (k1 * xi + (k2 - k1) * xi**2 / 2 - (2 * k1 + k2) / 6))
    return dofs, np.asarray(-np.sign(channel.direction[0]) * np.mean(tilts, axis=0))


def tilts_of_beams(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the rotation of a beam, while it stands."""
    readable, faults = standing(channels, on_mesh)
    return Placed(BeamTilts(channels), readable, faults=faults, unreadable=NOT_STANDING)
