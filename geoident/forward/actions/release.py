"""Partial release: what an excavation leaves behind of the support that the ground gave.

Ahead of a tunnel's section the face still carries part of the stress; a plane analysis says so by
a fraction lambda that is released, the rest being held until the lining stands (Panet's
convergence-confinement method). When a group g leaves, it takes with it the nodal forces

    H_g = f_g - C_g^T V sigma

on the ground that stays: what acted on itself (weight, edges, water) less its stress. As long as
only lambda is released, (1 - lambda) H_g goes on acting as external force. So nothing moves for
lambda = 0, and lambda = 1 is the usual excavation. H_g is linear in the stress; its derivatives
travel in the same columns, and lambda may be a parameter, or follow from the distance to the face
(`openings.advance`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from geoident.forward.actions.forces import Actions
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Release
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint

UnreleasedForces = Mapping[int, Floats]
"""Group that left with part of its stress held to the nodal forces H_g, (n_dofs, 1 + n + k)."""


class ReleasedParts(Protocol):
    """Says how much of its stress a group releases, where that is given or the distance to a face.

    See `openings.advance`.
    """

    def part(self, release: Release, point: ParameterPoint, stage: str) -> Dual:
        """The part of the stress (), 0 to 1, that is released.

        Args:
            release: what the case says of it.
            point: the parameters.
            stage: at which, for messages.

        Raises:
            ModelError: the ground has no reaction curve that would tell.
        """


class PartialRelease:
    """The forces H_g of every group that left with part of its stress held.

    Args:
        on_mesh: the case on its mesh.
        actions: what acts on a group itself.
        parts: how much of the stress is released.
    """

    def __init__(self, on_mesh: CaseOnMesh, actions: Actions, parts: ReleasedParts) -> None:
        self._sequence, self._discretization = on_mesh.sequence, on_mesh.discretization
        self._actions = actions
        self._parts = parts

    def part(self, state: int, group: int, point: ParameterPoint) -> Dual:
        """The part () of the stress of a group that is released at a state.

        Args:
            state: number of the state.
            group: index of the group, of which something is said there.
            point: the parameters.

        Raises:
            ModelError: the ground has no reaction curve, by which a distance to the face says it.
        """
        at = self._sequence.states[state]
        return self._parts.part(at.release[group], point, at.name)

    def unreleased(
        self, state: int, before: UnreleasedForces, stress: Floats, point: ParameterPoint
    ) -> UnreleasedForces:
        """The forces H_g that count at a state.

        Args:
            state: index of the state.
            before: those of the state on which it builds.
            stress: (n_strain, n_points, 1 + n + k) before anything leaves.
            point: the parameters.
        """
        current = self._sequence.states[state]
        unreleased = {g: h for g, h in before.items() if g in current.release}
        points = self._discretization.points
        for group in current.release.keys() & current.leaving:
            volume, own = np.zeros(points.n_points), self._discretization.points_of[group]
            volume[own] = points.volume[own]
            support = -points.forces(stress, volume)
            carried = self._actions.carried(current.base, {group}, point)
            support[:, : carried.shape[1]] += carried
            unreleased[group] = support
        return unreleased

    def forces(
        self, state: int, unreleased: UnreleasedForces, point: ParameterPoint
    ) -> Floats | float:
        """What is still held at a state, (n_dofs, 1 + n + k); 0 if there is nothing.

        Args:
            state: number of the state.
            unreleased: the forces H_g of the groups that left.
            point: the parameters.

        Raises:
            ModelError: see `part`.
        """
        total: Floats | float = 0.0
        for group, support in unreleased.items():
            fraction = self.part(state, group, point).columns
            part = (1.0 - fraction[0]) * support
            part[:, 1 : point.n_columns] -= support[:, :1] * fraction[1:]
            total = total + part
        return total
