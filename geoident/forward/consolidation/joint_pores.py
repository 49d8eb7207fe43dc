"""Interfaces beside consolidating ground: their water in the equations of flow (theory 18.8).

The pressure in an interface is that of the side that consolidates, or the mean of both; between
ground and a beam it is that of the ground. With B_n the openings of its points, w their areas, N_1
and N_2 the shapes of the pressures of the ground on both sides,

    Q += B_n^T w N ,     H += (N_1 - N_2)^T w k / (gamma_w l) (N_1 - N_2) ,

so that the interface carries effective tractions, takes up water as it opens, and lets it through
where it is permeable, as ground of the length l does: a ten-thousandth of the size of its faces,
so that the pressures of both sides are one. A shorter l only adds rounding. Beside ground that
drains at once the pressure of the other side is given.

Water that flows through a beam does so once, from the ground on one side to that on the other, and
it does so before the beam is built.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.forward.structures.interfaces import InterfacePart
from geoident.forward.structures.members import StructureMembers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, ParameterPoint

_LENGTH = 1e-4
"""Length of ground through which water flows across a permeable interface, in sizes of a face."""

Terms = list[tuple[Dual, sp.csr_array]]
"""Matrices of unit properties, each times a number."""


class JointPores:
    """The water in interfaces.

    Args:
        on_mesh: the case on its mesh.
        joints: the interfaces.
    """

    def __init__(self, on_mesh: CaseOnMesh, joints: Sequence[StructureMembers]) -> None:
        self._case, self._group_of = on_mesh.case, on_mesh.sequence.group_of
        self._joints = [(one, one.joint) for one in joints if one.joint is not None]
        self._dim = on_mesh.mesh.dim

    def parts(
        self, state: ConstructionState, groups: Sequence[int], weight: Dual, point: ParameterPoint
    ) -> tuple[Terms, Terms]:
        """What interfaces add to Q (n_dofs, n_nodes) and to H (n_nodes, n_nodes).

        Args:
            state: what is there.
            groups: that consolidate.
            weight: unit weight of the water, N/m3.
            point: the parameters.
        """
        coupling: Terms = []
        flow: Terms = []
        for part, joint in self._joints:
            wet, points = self._wet(joint, groups), joint.points
            if not joint.stands(state) or not wet.any():
                continue
            coupling.append((point.constant(1.0), self._coupling(part, joint, wet)))
            both = np.flatnonzero(wet.all(axis=1) & points.touches[:, 0])
            if not _flows(joint, state) or not len(both):
                continue
            across = (points.sides[0] - points.sides[1])[both]
            areas = sp.diags_array(part.members.weight[both] / (_LENGTH * points.size))
            leak = sp.csr_array(across.T @ areas @ across)
            for group in joint.groups:
                hydraulic = self._case.materials[state.materials[group]].hydraulic
                assert hydraulic is not None  # of a group that consolidates
                along = point.number(hydraulic.permeability[0])
                flow.append(((along / weight).times(0.5), leak))
        return coupling, flow

    def push(
        self, ends: Sequence[StructureMembers], groups: Sequence[int], pressures: Floats
    ) -> Floats:
        """Forces (n_dofs, k) of pressures (n_nodes, k) in some interfaces.

        Args:
            ends: the interfaces.
            groups: that consolidate.
            pressures: of the ground, Pa.
        """
        forces = np.zeros((len(pressures) * self._dim, pressures.shape[1]))
        for part in ends:
            assert part.joint is not None
            forces += self._coupling(part, part.joint, self._wet(part.joint, groups)) @ pressures
        return forces

    def _coupling(self, part: StructureMembers, joint: InterfacePart, wet: Bools) -> sp.csr_array:
        """B_n^T w N (n_dofs, n_nodes) of an interface."""
        points, m = joint.points, len(joint.points.face)
        wet = wet & points.touches
        shares = wet / np.maximum(wet.sum(axis=1), 1)[:, None]
        inside = sum(
            sp.diags_array(share) @ side for share, side in zip(shares.T, points.sides, strict=True)
        )
        area = sp.diags_array(part.members.weight[:m])
        return sp.csr_array(part.members.operator[:m].T @ area @ inside)

    def open_nodes(self, state: ConstructionState, groups: Sequence[int]) -> Ints:
        """Nodes (k,) of consolidating ground beside permeable interfaces with ground that drains.

        Args:
            state: what is there.
            groups: that consolidate.
        """
        nodes = [np.empty(0, dtype=np.int64)]
        for _, joint in self._joints:
            drains = [
                group
                for group in joint.groups
                if group in state.materials
                and self._case.materials[state.materials[group]].hydraulic is None
            ]
            if not _flows(joint, state) or not joint.stands(state) or not drains:
                continue
            wet = self._wet(joint, groups)
            for k, side in enumerate(joint.points.sides):
                beside = wet[:, k] & np.isin(self._groups(joint)[:, 1 - k], drains)
                nodes.append(side[np.flatnonzero(beside)].indices.astype(np.int64))
        return np.unique(np.concatenate(nodes))

    def _groups(self, joint: InterfacePart) -> Ints:
        """(m, 2) the groups of the ground on both sides of its points."""
        return np.asarray(self._group_of[joint.points.elements])

    def _wet(self, joint: InterfacePart, groups: Sequence[int]) -> Bools:
        """(m, 2) on which sides of its points ground consolidates."""
        return np.isin(self._groups(joint), groups)


def _flows(joint: InterfacePart, state: ConstructionState) -> bool:
    """Whether water flows across an interface: also where a wall is still to be built."""
    return joint.given.permeable or not joint.is_limited(state)
