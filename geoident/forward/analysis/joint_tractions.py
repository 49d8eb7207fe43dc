"""Tractions on interfaces in the virgin state: those of the in-situ stress on their faces.

They are effective where water is in the interface (`JointWater.made_effective`).
"""

from __future__ import annotations

import numpy as np

from geoident.forward.in_situ.stress import InSituStress, StressPlaces
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.joint_water import JointWater
from geoident.forward.structures.members import StructureMembers, Structures
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint


class JointTractions:
    """Tractions of the interfaces that stand in the virgin state, with their derivatives.

    Args:
        on_mesh: the case on its mesh.
        structures: the interfaces among them.
    """

    def __init__(self, on_mesh: CaseOnMesh, structures: Structures) -> None:
        self._n_rows = structures.n_rows
        self._parts: list[tuple[StructureMembers, InSituStress]] = []
        self._water = JointWater(on_mesh, structures)
        for part in structures.joints:
            if part.joint is not None and part.stands(on_mesh.sequence.states[0]):
                points = part.joint.points
                groups = on_mesh.sequence.group_of[points.beside]
                places = StressPlaces(points.places, groups, points.beside)
                self._parts.append((part, InSituStress(on_mesh, places)))

    def columns(self, point: ParameterPoint) -> Floats:
        """Forces q (n_rows, 1 + n) of all structures in the virgin state, Pa."""
        forces = np.zeros((self._n_rows, point.n_columns))
        for part, stress in self._parts:
            assert part.joint is not None
            forces[part.rows] = part.joint.points.tractions(stress.columns(point))
            forces[part.rows] += self._water.made_effective(part, point)
        return forces
