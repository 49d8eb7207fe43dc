"""The equations of the stages, prepared: patterns, orders, symbolic factorizations."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from types import MappingProxyType

import numpy as np
import scipy.sparse as sp

from geoident.fem.elasticity import Moduli, UniformModuli
from geoident.fem.location import format_point
from geoident.fem.solvers import Solver
from geoident.fem.solvers.direct import (
    LowerPattern,
    SolverCounts,
    SymbolicFactorization,
    UnknownPlaces,
)
from geoident.fem.solvers.factor_cost import FactorCost
from geoident.fem.solvers.ordering import nested_dissection
from geoident.fem.solvers.quasi_definite import QuasiDefinite
from geoident.fem.stiffness import (
    GroupBlocks,
    StiffnessPattern,
    free_dofs,
    group_blocks,
    node_graph,
    nodes_on_edges,
    stiffness_pattern,
)
from geoident.fem.tangent import PointBlocks, PointwiseStiffness, TangentPattern
from geoident.forward.actions.supports import fixed_dofs
from geoident.forward.of_mesh import OfMesh
from geoident.forward.stages import CaseOnMesh, ConstructionState, Index, as_index, numbers
from geoident.forward.structures.members import Structures
from geoident.forward.structures.strain_points import MemberPoints
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh, and_inner, nodes_in
from geoident.model.parameter import Values

SystemKey = tuple[frozenset[int], int]
"""Groups and structures that are there, and a number of the degrees of freedom that are fixed."""


@dataclass(frozen=True)
class StageSystem:
    """The equations of one state.

    Args:
        present: (n_points,) strain points that are there.
        touched: (n_dofs,) degrees of freedom of nodes that are there.
        volume: (n_points,) V, zero where absent.
        points_of: material name to its strain points.
        groups: indices of the present groups and keys of the structures that stand.
        key: they, and the number of what is fixed: states of one key have one pattern.
        dofs: (n,) degree of freedom of each unknown, in elimination order.
        make_pattern: makes the pattern, which is large and which not every command needs.
    """

    present: Bools
    touched: Bools
    volume: Floats
    points_of: Mapping[str, Index]
    groups: frozenset[int]
    key: SystemKey
    dofs: Ints
    make_pattern: Callable[[], StiffnessPattern]

    @cached_property
    def pattern(self) -> StiffnessPattern:
        """The stiffness pattern."""
        return self.make_pattern()


_order_of = OfMesh[Ints]()


class StageSystems:
    """The equations of all states of a sequence, each prepared when it is first needed.

    Equal patterns are analysed once, and only if something is solved on them.

    Args:
        on_mesh: the case on its mesh.
        solver: factorizes.

    Attributes:
        factor_costs: of the patterns whose cost was counted.
        rank: (n_nodes,) place of each node in the order of elimination.
    """

    def __init__(self, on_mesh: CaseOnMesh, solver: Solver) -> None:
        self.factor_costs: dict[SystemKey, FactorCost] = {}
        mesh, sequence, discretization = on_mesh.mesh, on_mesh.sequence, on_mesh.discretization
        geometries, structures = discretization.geometries, Structures(on_mesh)
        self.discretization, self.structures = discretization, structures
        self.on_mesh, self._mesh, self._sequence = on_mesh, mesh, sequence
        self._solver = solver
        self._fixed: list[Bools] = []
        self._numbers_of_fixed: dict[bytes, int] = {}
        order = _order_of(mesh, (), lambda: _elimination_order(mesh))
        self._node_of_rank = _moved_to_end(order, structures.late_nodes())
        self.rank = rank = np.empty_like(self._node_of_rank)
        rank[self._node_of_rank] = np.arange(len(rank))
        self._blocks: dict[int, GroupBlocks] = {
            g: group_blocks(mesh, geometries, sequence.elements(g), rank)
            for g in discretization.points_of
        } | structures.blocks(rank)
        self._systems: dict[int, StageSystem] = {}
        self._dofs: dict[SystemKey, Ints] = {}
        self._patterns: dict[SystemKey, StiffnessPattern] = {}
        self._point_blocks = PointBlocks(mesh, geometries, discretization.kinematics)
        self._pointwise = PointwiseStiffness(self._point_blocks)
        self._tangents: dict[SystemKey, TangentPattern] = {}
        self._member_points: dict[tuple[int, ...], MemberPoints | None] = {}
        self._symbolic_of_system: dict[tuple[SystemKey, int], SymbolicFactorization | None] = {}
        self._symbolic_of_pattern: dict[tuple[bytes, int], SymbolicFactorization] = {}

    def __getitem__(self, state: int) -> StageSystem:
        if state not in self._systems:
            self._systems[state] = self._prepare(state)
        return self._systems[state]

    def symbolic(self, system: StageSystem, spare: int = 0) -> SymbolicFactorization | None:
        """The symbolic factorization of K of a state; None if nothing is free to move.

        Args:
            system: the equations of the state.
            spare: number of a further one of the same pattern, where its factors are in use.
        """
        key = system.key, spare
        if key not in self._symbolic_of_system:
            self._symbolic_of_system[key] = self._analyse_pattern(system.pattern.lower, spare)
        return self._symbolic_of_system[key]

    def tangents(self, system: StageSystem) -> TangentPattern:
        """Where changes of moduli at strain points go in K of a state."""
        if system.key not in self._tangents:
            self._tangents[system.key] = TangentPattern(self._point_blocks, system.pattern)
        return self._tangents[system.key]

    def member_points(self, state: ConstructionState) -> MemberPoints | None:
        """Members that yield in a state, as strain points; None for none."""
        parts = self.structures.yielding(state)
        key = tuple(part.rows.start for part in parts)
        if key not in self._member_points:
            n_rows, n_strain = self.structures.n_rows, self.discretization.points.n_strain
            self._member_points[key] = MemberPoints(parts, n_rows, n_strain) if parts else None
        return self._member_points[key]

    def quasi_definite(
        self,
        constant: sp.csr_array,
        growing: sp.csr_array,
        *,
        places: Ints,
        signs: Floats,
        changing: sp.csr_array | None = None,
    ) -> QuasiDefinite:
        """Quasi-definite matrices A_0 + h A_1, whose unknowns stand at places in the elimination.

        Args:
            constant: A_0 (n, n).
            growing: A_1 (n, n).
            places: (n,) by which the unknowns are ordered.
            signs: (n,) of the diagonal, 1 or -1.
            changing: (n, n) where entries may change beside theirs; None for nowhere.
        """
        order = np.argsort(places, kind="stable")
        return self._solver.quasi_definite(
            constant, growing, signs=signs, order=order, changing=changing
        )

    def definite(self, matrix: sp.csr_array, nodes: Ints) -> QuasiDefinite:
        """A positive definite matrix (n, n) with one unknown at each of some nodes (n,)."""
        return self.definite_growing(matrix, sp.csr_array(matrix.shape), nodes)

    def definite_growing(
        self, constant: sp.csr_array, growing: sp.csr_array, nodes: Ints
    ) -> QuasiDefinite:
        """Positive definite matrices A_0 + h A_1 (n, n), one unknown at each of some nodes (n,)."""
        places, signs = self.rank[nodes], np.ones(len(nodes))
        return self.quasi_definite(constant, growing, places=places, signs=signs)

    @property
    def solver_counts(self) -> SolverCounts:
        """What the solver has done so far."""
        return self._solver.counts

    def stiffness_values(
        self,
        system: StageSystem,
        state: ConstructionState,
        moduli: Mapping[str, Moduli],
        parameters: Values,
        grown: Mapping[str, float] = MappingProxyType({}),
    ) -> Floats:
        """Values (nnz,) of K at a state.

        Structures take theirs from the parameter values. What moduli that vary from point to point
        add is summed over elements.

        Args:
            system: the equations of the state.
            state: what is there.
            moduli: material to its moduli at its points, Pa.
            parameters: their values by name, SI.
            grown: structure to what there is of its stiffness, where that is not all.
        """
        map_of = self.discretization.kinematics.stiffness_map
        maps = {
            n: map_of(one.matrix) for n, one in moduli.items() if isinstance(one, UniformModuli)
        }
        ground_maps = {
            g: maps[material] for g, material in state.materials.items() if material in maps
        }
        total = system.pattern.values(
            self._blocks, ground_maps | self.structures.maps(state, parameters, grown)
        )
        for name in moduli.keys() - maps.keys():
            points = numbers(system.points_of[name], len(system.volume))
            tangents = self.tangents(system)
            total += self._pointwise.values(tangents, name, points, moduli[name], system.volume)
        return total

    def work(self, points: Ints, stress: Floats) -> sp.csr_array:
        """Work of stresses (s, q) at points (q,), ascending, on displacements: (q, n_dofs)."""
        return self._point_blocks.work(points, stress)

    def describe_unknown(self, system: StageSystem, unknown: int | None) -> str:
        """Where an unknown stands, for a message."""
        if unknown is None:
            return ""
        node = system.dofs[unknown] // self._mesh.dim
        return f" near {format_point(self._mesh.points[node])}"

    def _places(self, dofs: Ints) -> UnknownPlaces:
        """Where unknowns stand, by their degrees of freedom (n,)."""
        return UnknownPlaces(dofs, self._mesh.points, self._edges)

    @cached_property
    def _edges(self) -> Ints:
        """(k, 3) nodes on edges, each with its two ends."""
        return nodes_on_edges(self._mesh)

    def _number_of_fixed(self, state: int) -> int:
        """The number of the degrees of freedom that are fixed in a state, among all such sets."""
        fixed = fixed_dofs(self.on_mesh, state)
        number = self._numbers_of_fixed.setdefault(fixed.tobytes(), len(self._fixed))
        if number == len(self._fixed):
            self._fixed.append(fixed)
        return number

    def _prepare(self, number: int) -> StageSystem:
        sequence, state = self._sequence, self._sequence.states[number]
        elements = sequence.present(number)
        points = self.discretization.points
        present = elements[points.element]
        points_of: dict[str, Index] = {}
        names = np.array([state.materials.get(g, "") for g in range(len(sequence.groups))])
        name_of_point = names[sequence.group_of[points.element]]
        for material in set(state.materials.values()):
            points_of[material] = as_index(name_of_point == material)
        groups = frozenset(state.materials) | self.structures.keys(state)
        key = groups, self._number_of_fixed(number)
        if key not in self._dofs:
            self._dofs[key] = free_dofs(
                [self._blocks[g] for g in groups],
                node_of_rank=self._node_of_rank,
                fixed=self._fixed[key[1]],
                dim=self._mesh.dim,
            )[1]
        volume = self.discretization.volume(elements)
        touched = _touched(self._mesh, elements)
        dofs, pattern = self._dofs[key], partial(self._pattern, key)
        return StageSystem(present, touched, volume, points_of, groups, key, dofs, pattern)

    def _pattern(self, key: SystemKey) -> StiffnessPattern:
        """The pattern of some groups and structures, with what is fixed."""
        if key not in self._patterns:
            self._patterns[key] = stiffness_pattern(
                {g: self._blocks[g] for g in key[0]},
                node_of_rank=self._node_of_rank,
                fixed=self._fixed[key[1]],
                dim=self._mesh.dim,
                places=None if len(self._mesh.beside) else self._places,
            )
        return self._patterns[key]

    def _analyse_pattern(self, lower: LowerPattern, spare: int) -> SymbolicFactorization | None:
        if lower.n == 0:
            return None
        parts = [lower.indptr, lower.indices]
        parts += [] if lower.places is None else [lower.places.dofs]
        key = hashlib.sha256(b"".join(part.tobytes() for part in parts)).digest(), spare
        if key not in self._symbolic_of_pattern:
            self._symbolic_of_pattern[key] = self._solver.analyse(lower)
        return self._symbolic_of_pattern[key]


def _elimination_order(mesh: Mesh) -> Ints:
    """Nested dissection (n_nodes,); what is no place follows the place near it."""
    order = nested_dissection(mesh.points, *node_graph(mesh))
    place = np.empty(len(order))
    place[order] = np.arange(len(order))
    place[mesh.n_places :] = place[mesh.beside] + 0.5
    return np.argsort(place, kind="stable")


def _moved_to_end(order: Ints, nodes: Ints) -> Ints:
    """An elimination order with some nodes last, otherwise as it was."""
    late = np.isin(order, nodes)
    return np.concatenate([order[~late], order[late]])


def _touched(mesh: Mesh, present: Bools) -> Bools:
    """(n_dofs,) degrees of freedom of the nodes of present elements, and of beams at these."""
    nodes = np.zeros(mesh.n_nodes, dtype=bool)
    nodes[and_inner(mesh, nodes_in(mesh.blocks, present))] = True
    first = mesh.n_places + len(mesh.rotations_of)
    nodes[mesh.n_places : first] = nodes[mesh.rotations_of]
    nodes[first:] = True  # a bar stands in ground that is there
    return np.repeat(nodes, mesh.dim)
