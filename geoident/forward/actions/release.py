"""Partial release: what an excavation leaves behind of the support that the ground gave.

Ahead of a tunnel's section the face still carries part of the stress; a plane analysis says so by
a fraction lambda that is released, the rest being held until the lining stands (Panet's
convergence-confinement method). When a group g leaves, it takes with it the nodal forces

    H_g = f_g - C_g^T V sigma

on the ground that stays: what acted on itself (weight, edges, water) less its stress. As long as
only lambda is released, (1 - lambda) H_g goes on acting as external force. So nothing moves for
lambda = 0, and lambda = 1 is the usual excavation. H_g is linear in the stress; its derivatives
travel in the same columns, and lambda may be a parameter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from geoident.forward.actions.forces import Actions
from geoident.forward.ground.elasticity import Values
from geoident.forward.march.discretization import StageSystems
from geoident.forward.stages import Timeline
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.dual import ParameterPoint


class PartialRelease:
    """Keeps the forces H_g of every group that left with part of its stress held.

    A stage finds those of the stage on which it builds, so load cases that branch need no copies.
    """

    def __init__(self, timeline: Timeline, systems: StageSystems, actions: Actions) -> None:
        self._timeline = timeline
        self._systems = systems
        self._actions = actions
        self._held: dict[int, Mapping[int, Floats]] = {0: {}}

    def forces(self, state: int, stress: Floats, values: Values, names: Sequence[str]) -> Floats:
        """Held forces (n_dofs, 1 + n + k) of a state.

        Args:
            state: index of the state.
            stress: (n_strain, n_points, 1 + n + k) before anything leaves.
            values: parameter values.
            names: the parameters to differentiate by.
        """
        current = self._timeline.states[state]
        held = {g: h for g, h in self._held[current.base].items() if g in current.release}
        for group in current.release.keys() & current.left:
            support = -self._stress_forces(group, stress)
            carried = self._actions.carried(current.base, {group}, values, names)
            support[:, : carried.shape[1]] += carried
            held[group] = support
        self._held[state] = held
        return self._still_held(state, ParameterPoint(values, names), stress.shape[2])

    def _stress_forces(self, group: int, stress: Floats) -> Floats:
        """C_g^T V sigma, (n_dofs, 1 + n + k)."""
        points = self._systems.points
        volume = np.zeros(points.n_points)
        mine = self._systems.points_of[group]
        volume[mine] = points.volume[mine]
        return points.forces(stress, volume)

    def _still_held(self, state: int, point: ParameterPoint, n_columns: int) -> Floats:
        total = np.zeros((self._systems.points.compatibility.shape[1], n_columns))
        release = self._timeline.states[state].release
        for group, support in self._held[state].items():
            fraction = point.number(release[group]).columns
            total += (1.0 - fraction[0]) * support
            total[:, 1 : point.n_columns] -= support[:, :1] * fraction[1:]
        return total


def affine_obstacle(case: Case, free: frozenset[str]) -> str | None:
    """Why the held forces are not affine in the free parameters, or None if they are."""
    for stage in case.stages:
        for group, fraction in stage.release.items():
            if fraction.parameter in free:
                return f"{fraction.parameter}, the released part of '{group}', multiplies stresses"
    return None
