"""Strain points of the ground and members of structures in one array (theory 14.1).

A member is one more strain point: its strain (of an axis, a curvature) and its force stand in the
place of the first component, the others are zero, and its weight is its volume. So what holds for
sums over strain points holds for ground with walls, bolts and struts in it as it stands.
"""

from __future__ import annotations

import numpy as np

from geoident.forward.analysis.systems import StageSystem, StageSystems
from geoident.forward.stages import Index, numbers
from geoident.model.arrays import Floats


class AnalysisPoints:
    """Strain points of the ground, then the members.

    Args:
        systems: of the analysis.

    Attributes:
        n_strain: components s of a strain.
        n_ground: strain points of the ground.
        n_points: all of them.
        volume: (n_points,) volumes, and weights of members.
    """

    def __init__(self, systems: StageSystems) -> None:
        self._ground, self._structures = systems.discretization.points, systems.structures
        self.n_strain, self.n_ground = self._ground.n_strain, self._ground.n_points
        self.n_points = self.n_ground + self._structures.n_rows
        self.volume = np.concatenate([self._ground.volume, self._structures.weight])

    def joined(self, ground: Floats, members: Floats) -> Floats:
        """(s, n_points, k) of stresses (s, n_ground, k) and forces (n_rows, k), or strains."""
        if not len(members):
            return ground
        more = np.zeros((self.n_strain, *members.shape))
        more[0] = members
        return np.concatenate([ground, more], axis=1)

    def strain(self, u: Floats, points: Index | None = None) -> Floats:
        """Strains (s, q, k) of displacements (n_dofs, k).

        Args:
            u: (n_dofs, k) displacements.
            points: (q,) some points of the ground, or some members, ascending; None: all of both.
        """
        if points is None:
            return self.joined(self._ground.strain(u), self._structures.strain(u))
        wanted = numbers(points, self.n_points)
        if not len(wanted) or wanted[0] < self.n_ground:
            return self._ground.strain(u, points)
        strain = np.zeros((self.n_strain, len(wanted), u.shape[1]))
        strain[0] = self._structures.strain(u)[wanted - self.n_ground]
        return strain

    def forces(self, stress: Floats, system: StageSystem) -> Floats:
        """Nodal forces (n_dofs, k) of stresses (s, n_points, k) in a stage.

        Args:
            stress: (s, n_points, k), zero at members that do not stand.
            system: of the stage; stresses of absent ground do not count.
        """
        forces = self._ground.forces(stress[:, : self.n_ground], system.volume)
        if self.n_points > self.n_ground:
            forces += self._structures.nodal_forces(stress[0, self.n_ground :])
        return forces
