"""Water at rest in interfaces: it pushes their sides apart, so that tractions are effective.

With B_n the openings of the points, w their areas and p the pressure of the water there, the forces

    f = B_n^T w p ,     t = t' - n p

act on the two sides, and the interface carries t', as the skeleton of ground with water in its
pores carries effective stress. Where both sides have the same pressure p balances that in their
pores; beside ground without it is uplift.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from geoident.forward.actions.forces import ForcePart
from geoident.forward.in_situ.water import PorePressure, is_wet
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.forward.structures.members import StructureMembers, Structures
from geoident.model.actions import Water
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint


class JointWater:
    """What water at rest does in interfaces.

    Args:
        on_mesh: the case on its mesh.
        structures: the interfaces among them.
    """

    def __init__(self, on_mesh: CaseOnMesh, structures: Structures) -> None:
        self._on_mesh, self._structures = on_mesh, structures
        self._pressures: dict[tuple[str, Water], PorePressure] = {}

    def parts(self, state: ConstructionState) -> Iterator[ForcePart]:
        """What the water in interfaces does at a state: a name, its forces (n_dofs, 1 + n)."""
        wet = self._in(state, self._structures.joints)
        if wet and state.water is not None:
            yield "the pressure of the water in interfaces", partial(self._forces, wet, state.water)

    def support(
        self,
        state: ConstructionState,
        parts: Sequence[StructureMembers],
        members: Floats,
        point: ParameterPoint,
    ) -> Floats:
        """What some interfaces and their water do to the ground, (n_dofs, 1 + n + k) N.

        Args:
            state: in which they stand.
            parts: the interfaces.
            members: (n_rows, 1 + n + k) forces in structures, Pa.
            point: the parameters.
        """
        rows = np.zeros_like(members)
        for part in parts:
            rows[part.rows] = members[part.rows]
        forces = -self._structures.nodal_forces(rows)
        wet = self._in(state, parts)
        if wet and state.water is not None:
            forces[:, : point.n_columns] += self._forces(wet, state.water, point)
        return forces

    def _in(
        self, state: ConstructionState, parts: Sequence[StructureMembers]
    ) -> list[StructureMembers]:
        """Those of some interfaces that have water in them at a state."""
        water = state.water
        if water is None:
            return []
        return [one for one in parts if one.stands(state) and self._has(one, water)]

    def _has(self, part: StructureMembers, water: Water) -> bool:
        """Whether water is in an interface: named, or in the pores of a side."""
        assert part.joint is not None
        named = water.groups is not None and part.joint.interface in water.groups
        return named or bool(self._wet(water, np.array(part.joint.beside)).any())

    def _wet(self, water: Water, groups: Ints) -> Bools:
        return is_wet(water, groups, self._on_mesh.sequence.groups)

    def _forces(
        self, parts: Sequence[StructureMembers], water: Water, point: ParameterPoint
    ) -> Floats:
        """B_n^T w p (n_dofs, 1 + n) of some interfaces."""
        rows = np.zeros((self._structures.n_rows, point.n_columns))
        for part in parts:
            assert part.joint is not None
            pressure = part.joint.points.mean @ self._at_places(part, water, point)
            rows[part.rows.start : part.rows.start + len(pressure)] = pressure
        return self._structures.nodal_forces(rows)

    def _at_places(self, part: StructureMembers, water: Water, point: ParameterPoint) -> Floats:
        """Pressure (k, 1 + n) at the places of an interface, Pa."""
        assert part.joint is not None
        key = part.name, water
        if key not in self._pressures:
            places = part.joint.points.places
            self._pressures[key] = PorePressure(water, self._on_mesh.mesh, places)
        shape = len(part.joint.points.places), point.n_columns
        return np.broadcast_to(self._pressures[key].at(point).columns, shape)

    def made_effective(self, part: StructureMembers, point: ParameterPoint) -> Floats:
        """What the water of the virgin state adds to tractions of the stress on the first side.

        That is total where the ground there is dry, and effective where it is wet; tractions are
        effective where the interface has water, and beside a beam total where it has none.

        Args:
            part: an interface that stands then.
            point: the parameters.

        Returns:
            (n_rows of the part, 1 + n) Pa.
        """
        assert part.joint is not None
        points, water = part.joint.points, self._on_mesh.case.water
        added = np.zeros((len(part.members.weight), point.n_columns))
        if water is not None:
            wet = self._wet(water, self._on_mesh.sequence.group_of[points.beside])
            change = np.where(wet, 0.0, 1.0) - (not self._has(part, water))
            pressure = points.mean @ (change[:, None] * self._at_places(part, water, point))
            added[: len(pressure)] = pressure
        return added
