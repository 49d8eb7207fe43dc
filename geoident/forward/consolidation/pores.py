"""Pores of a case on its mesh: where water has a pressure of its own when, and its matrices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from geoident.fem.consolidation import PoreMatrices, pore_matrices
from geoident.fem.solvers.quasi_definite import QuasiDefinite
from geoident.forward.actions.supports import group_nodes
from geoident.forward.consolidation.joint_pores import JointPores
from geoident.forward.in_situ.water import FacePressure, PorePressure, is_wet
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.forward.structures.members import StructureMembers
from geoident.forward.summed import Summed, summed
from geoident.model.actions import WATER, Water, WaterPressure
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import nodes_in, rows_in
from geoident.model.parameter import Scalar


@dataclass(frozen=True)
class PoreSystem:
    """Pressures of one state.

    Args:
        groups: indices of the groups with water that takes time to leave.
        nodes: (n_p,) nodes with a pressure, ascending.
        given: (n_nodes,) where it is given: drained faces, and ground that drains at once.
    """

    groups: tuple[int, ...]
    nodes: Ints
    given: Bools


@dataclass(frozen=True)
class PoreOperators:
    """Q, S and H of a state at some parameters."""

    coupling: Summed
    storage: Summed
    flow: Summed


class Pores:
    """The pores of a case; what depends on no parameter is made once, when it is needed.

    Args:
        on_mesh: the case on its mesh.
        definite: prepares a positive definite matrix (n, n) of unknowns at nodes (n,).
        joints: the interfaces.
    """

    def __init__(
        self,
        on_mesh: CaseOnMesh,
        definite: Callable[[sp.csr_array, Ints], QuasiDefinite],
        joints: Sequence[StructureMembers],
    ) -> None:
        self._on_mesh, self._case = on_mesh, on_mesh.case
        self._joints = JointPores(on_mesh, joints)
        self._definite = definite
        self._sequence = on_mesh.sequence
        self._matrices: dict[int, PoreMatrices] = {}
        self._systems: dict[int, PoreSystem] = {}

    def consolidates(self, state: ConstructionState) -> bool:
        """Whether time passes in which water leaves ground of a state."""
        return state.lasts is not None and any(
            self._case.materials[name].consolidates for name in state.materials.values()
        )

    def __getitem__(self, state: int) -> PoreSystem:
        if state not in self._systems:
            self._systems[state] = self._prepare(state)
        return self._systems[state]

    def operators(self, state: int, point: ParameterPoint) -> PoreOperators:
        """The matrices of a state, (n_dofs, n_nodes) and (n_nodes, n_nodes)."""
        current = self._sequence.states[state]
        weight = point.number(unit_weight(current.water))
        coupling, storage, flow = [], [], []
        for group in self[state].groups:
            hydraulic = self._case.materials[current.materials[group]].hydraulic
            assert hydraulic is not None  # of a group that consolidates
            matrices = self._of_group(group)
            coupling.append((point.number(hydraulic.biot), matrices.coupling))
            storage.append((hydraulic.stored(point), matrices.storage))
            numbers = hydraulic.permeability
            for j, matrix in enumerate(matrices.flow):
                along = point.number(numbers[j if len(numbers) > 1 else 0])
                flow.append((along / weight, matrix))
            taken = hydraulic.taken(len(matrices.flow), point)
            if taken is not None:  # pressure times its shapes, as in what is stored
                flow.append((taken / weight, matrices.storage))
        of_joints = self._joints.parts(current, self[state].groups, weight, point)
        coupling += of_joints[0]
        flow += of_joints[1]
        n_nodes, n_dofs = self._on_mesh.mesh.n_nodes, self._on_mesh.discretization.n_dofs
        square = (n_nodes, n_nodes)
        return PoreOperators(
            summed(coupling, (n_dofs, n_nodes)), summed(storage, square), summed(flow, square)
        )

    def given(self, state: int, point: ParameterPoint) -> Floats:
        """Pressures (n_nodes, 1 + n) where they are given, in excess of those at rest, Pa."""
        pressures = np.zeros((self._on_mesh.mesh.n_nodes, point.n_columns))
        current = self._sequence.states[state]
        for name, drained in current.drained.items():
            if drained.head is not None:
                nodes = np.intersect1d(drained_nodes(self._on_mesh, name), self[state].nodes)
                pressures[nodes] = self._of_head(drained.head, current.water, nodes).at(point)
        return pressures

    def steady(self, state: int, given: Floats, point: ParameterPoint) -> Floats:
        """Pressures (n_nodes, 1 + n) of the flow between given ones that never ends, Pa.

        Ground that has no way to where they are given has none in excess.

        Args:
            state: number of the state.
            given: (n_nodes, 1 + n) where they are given, Pa.
            point: the parameters.
        """
        pressures, system = given.copy(), self[state]
        if not given.any():
            return pressures
        flow = self.operators(state, point).flow
        _, piece = connected_components(flow.value)
        drained = np.isin(piece, piece[system.given])
        nodes = system.nodes[drained[system.nodes] & ~system.given[system.nodes]]
        H = sp.csr_array(flow.value[nodes][:, nodes])
        matrices = self._definite(H, nodes)
        factor = matrices.factor(0.0)
        pressures[nodes, :1] = -factor.solve((flow.value @ pressures[:, :1])[nodes])
        if point.names:
            pressures[nodes, 1:] = -factor.solve(flow.at(pressures)[nodes, 1:])
        return pressures

    def at_rest(self, state: int, nodes: Ints, point: ParameterPoint) -> Floats:
        """Pressure (m, 1 + n) of the water at rest at some nodes of consolidating ground, Pa."""
        current, mesh = self._sequence.states[state], self._on_mesh.mesh
        if current.water is None:
            return np.zeros((len(nodes), point.n_columns))
        groups = np.array(self[state].groups)
        wet = groups[is_wet(current.water, groups, self._sequence.groups)]
        filled = np.isin(
            nodes, np.concatenate([nodes[:0], *(self._of_group(g).nodes for g in wet)])
        )
        pressure = PorePressure(current.water, mesh, mesh.points[nodes]).at(point).columns
        return np.where(filled[:, None], pressure, 0.0)

    def push(self, state: int, group: int, pressures: Floats, point: ParameterPoint) -> Floats:
        """Forces (n_dofs, k) of pressures (n_nodes, k) in a group that is there at a state."""
        material = self._case.materials[self._sequence.states[state].materials[group]]
        if not material.consolidates or material.hydraulic is None:
            return np.zeros((self._on_mesh.discretization.n_dofs, pressures.shape[1]))
        coupling = self._of_group(group).coupling
        part = [(point.number(material.hydraulic.biot), coupling)]
        return summed(part, coupling.shape).at(pressures)

    def push_through(
        self, state: int, joints: Sequence[StructureMembers], pressures: Floats
    ) -> Floats:
        """Forces (n_dofs, k) of pressures (n_nodes, k) in some interfaces at a state."""
        return self._joints.push(joints, self[state].groups, pressures)

    def _of_head(self, head: Scalar, water: Water | None, nodes: Ints) -> _Excess:
        return _Excess(self._on_mesh, head, water, self._on_mesh.mesh.points[nodes])

    def _of_group(self, group: int) -> PoreMatrices:
        if group not in self._matrices:
            mesh, discretization = self._on_mesh.mesh, self._on_mesh.discretization
            self._matrices[group] = pore_matrices(
                mesh,
                discretization.geometries,
                discretization.kinematics,
                self._sequence.elements(group),
            )
        return self._matrices[group]

    def _prepare(self, state: int) -> PoreSystem:
        current, mesh = self._sequence.states[state], self._on_mesh.mesh
        groups, at_once = [], np.zeros(len(self._sequence.groups), dtype=bool)
        for group, name in current.materials.items():
            hydraulic = self._case.materials[name].hydraulic
            if hydraulic is None:
                at_once[group] = True
            elif not hydraulic.impervious:
                groups.append(group)
        given = np.zeros(mesh.n_nodes, dtype=bool)
        given[nodes_in(mesh.blocks, at_once[self._sequence.group_of])] = True
        for name in current.drained:
            given[drained_nodes(self._on_mesh, name)] = True
        given[self._joints.open_nodes(current, groups)] = True
        corners = [self._of_group(group).nodes for group in groups]
        nodes = np.unique(np.concatenate([np.empty(0, np.int64), *corners]))
        there = np.zeros(mesh.n_nodes, dtype=bool)
        there[nodes] = True
        return PoreSystem(tuple(groups), nodes, given & there)


class _Excess:
    """Pressure of a head, in excess of that of the water at rest, at positions (m, dim)."""

    def __init__(
        self, on_mesh: CaseOnMesh, head: Scalar, water: Water | None, positions: Floats
    ) -> None:
        self._there = FacePressure(WaterPressure("", head, unit_weight(water)), positions)
        self._rest = None if water is None else PorePressure(water, on_mesh.mesh, positions)

    def at(self, point: ParameterPoint) -> Floats:
        """(m, 1 + n) Pa."""
        there = self._there.at(point)
        return (there if self._rest is None else there - self._rest.at(point)).columns


def drained_nodes(on_mesh: CaseOnMesh, name: str) -> Ints:
    """Nodes (k,) of a drained group: of faces on an interface those on both of its sides."""
    mesh, original = on_mesh.mesh, on_mesh.original
    nodes = [group_nodes(mesh, name)]
    if original is None or name not in mesh.facet_groups:
        return nodes[0]
    own = {
        frozenset(face)
        for block, rows in rows_in(mesh.facets, mesh.facet_groups[name])
        for face in original[block.nodes[rows]].tolist()
    }
    for part in chain(*on_mesh.joints.values()):
        drained = [frozenset(face) in own for face in original[part.first].tolist()]
        nodes += [part.first[drained].ravel(), part.second[drained].ravel()]
    return np.unique(np.concatenate(nodes))


def unit_weight(water: Water | None) -> Scalar:
    """That of the water of a state, N/m3."""
    return WATER if water is None else water.unit_weight
