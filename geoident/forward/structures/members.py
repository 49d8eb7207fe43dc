"""Linings and bolts in the sequence of stages: which stand when, what they bear, derivatives.

A structure works like a group of elements. It is built free of stress, its forces q (see
`fem.structures`) grow with the motion since then, and they end when it is dismantled. In the march

    q <- q + D(p) B du ,      r = f - C^T V sigma - B^T w q

so one more generalized stress is carried from stage to stage, with its derivatives. D holds EA(p)
and EI(p), N/m and N m; bars are smeared over their spacing out of plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.fem.stiffness import GroupBlocks
from geoident.fem.structures import Members, bars, beams, member_blocks, stiffness_map
from geoident.forward.actions.supports import group_nodes
from geoident.forward.stages import CaseOnMesh, ConstructionSequence, ConstructionState
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.cells import CELLS
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.mesh import Mesh, rows_in
from geoident.model.parameter import Values
from geoident.model.structures import Beam, Structure


@dataclass(frozen=True)
class _Part:
    """One structure on the mesh.

    Args:
        name: of the structure.
        structure: what the case says of it.
        members: its members.
        rows: where its rows lie among those of all structures.
    """

    name: str
    structure: Structure
    members: Members
    rows: slice


class Structures:
    """All structures of a case that ever stand.

    `structure_checks` has made sure that each finds its nodes and elements.

    Args:
        on_mesh: the case on its mesh.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._sequence, self._dim = on_mesh.sequence, on_mesh.mesh.dim
        self.parts = tuple(_parts(on_mesh))
        members = [part.members for part in self.parts]
        operators = [m.operator for m in members] or [sp.csr_array((0, on_mesh.mesh.points.size))]
        self._operator = sp.csr_array(sp.vstack(operators))
        self._transpose = self._operator.T.tocsr()
        self._weight = np.concatenate([m.weight for m in members] or [np.empty(0)])

    @property
    def n_rows(self) -> int:
        """Number of member forces q; 0 if there are no structures."""
        return len(self._weight)

    def key(self, number: int) -> int:
        """Key of a structure in the stiffness pattern, where groups have their indices."""
        return len(self._sequence.groups) + number

    def keys(self, state: ConstructionState) -> frozenset[int]:
        """Keys of the structures that stand at a state."""
        return frozenset(self.key(n) for n, _ in self._in_place(state))

    def late_nodes(self) -> Ints:
        """Nodes (k,) of beams, which all couple: eliminated last, so that they do not fill in."""
        along = [p.members.operator.indices for p in self.parts if isinstance(p.structure, Beam)]
        dofs = np.concatenate([np.empty(0, dtype=np.int64), *along])
        return np.unique(dofs // self._dim)

    def blocks(self, rank: Ints) -> dict[int, GroupBlocks]:
        """Node-pair blocks by key; rank is the place (n_nodes,) of a node in the elimination."""
        return {
            self.key(n): member_blocks(part.members, rank, self._dim)
            for n, part in enumerate(self.parts)
        }

    def maps(self, state: ConstructionState, values: Values) -> dict[int, Floats]:
        """Stiffness maps (2 dim^2, dim^2) of the structures that stand, by key."""
        maps, point = {}, ParameterPoint(values, ())
        for n, part in self._in_place(state):
            axial, bending = rigidities(part.structure, point)
            maps[self.key(n)] = stiffness_map(
                float(axial.value), float(bending.value), dim=self._dim
            )
        return maps

    def moduli(self, state: ConstructionState, point: ParameterPoint) -> Floats:
        """D and its derivatives (n_rows, 1 + n), zero in what does not stand."""
        result = np.zeros((self.n_rows, point.n_columns))
        for _, part in self._in_place(state):
            axial, bending = rigidities(part.structure, point)
            chosen = part.members.bending[:, None]
            result[part.rows] = np.where(chosen, bending.columns, axial.columns)
        return result

    def strain(self, u: Floats) -> Floats:
        """Member strains (n_rows, ...) of displacements (n_dofs, ...)."""
        return np.asarray(self._operator @ u)

    def nodal_forces(self, forces: Floats) -> Floats:
        """B^T w q, (n_dofs, k), of member forces (n_rows, k)."""
        return np.asarray(self._transpose @ (self._weight[:, None] * forces))

    def clear(self, state: ConstructionState, forces: Floats) -> None:
        """What does not stand, or is built only now, carries no forces (n_rows, k)."""
        for part in self.parts:
            if part.name not in state.structures or part.name in state.built:
                forces[part.rows] = 0.0

    def _in_place(self, state: ConstructionState) -> Iterator[tuple[int, _Part]]:
        return ((n, p) for n, p in enumerate(self.parts) if p.name in state.structures)


def rigidities(structure: Structure, point: ParameterPoint) -> tuple[Dual, Dual]:
    """EA and EI per metre out of plane (in a solid: EA of a bar), with derivatives."""
    if isinstance(structure, Beam):
        return _of_wall(structure, point)
    none = point.constant(0.0)
    if structure.EA is not None:
        axial = point.number(structure.EA)
    elif structure.E is not None and structure.diameter is not None:
        diameter = point.number(structure.diameter)
        axial = (point.number(structure.E) * diameter * diameter).times(np.pi / 4)
    else:
        axial = none
    if structure.spacing is None:
        return axial, none
    return axial * _inverse(point.number(structure.spacing)), none


def _of_wall(beam: Beam, point: ParameterPoint) -> tuple[Dual, Dual]:
    if beam.EA is not None and beam.EI is not None:
        return point.number(beam.EA), point.number(beam.EI)
    if beam.E is None or beam.thickness is None:
        return point.constant(0.0), point.constant(0.0)
    modulus, t = point.number(beam.E), point.number(beam.thickness)
    if beam.nu is not None:
        nu = point.number(beam.nu)
        modulus = modulus * _inverse((-(nu * nu)).plus(1.0))
    return modulus * t, (modulus * t * t * t).times(1 / 12)


def _inverse(dual: Dual) -> Dual:
    return dual.through(lambda x: 1 / x, lambda x: -1 / x**2)


def inadmissible(case: Case, values: Values) -> str | None:
    """Which number of a structure is impossible at parameter values, or None."""
    for name, structure in case.structures.items():
        found = structure.breach(values)
        if found:
            return f"of the structure '{name}' {found}"
    return None


def _parts(on_mesh: CaseOnMesh) -> Iterator[_Part]:
    mesh, locator = on_mesh.mesh, on_mesh.locator
    first = 0
    for name, structure in on_mesh.case.structures.items():
        present = present_throughout(on_mesh.sequence, name)
        if present is None:
            continue
        if isinstance(structure, Beam):
            edges = _facing_ground(mesh, straight_pieces(mesh, structure.group), present)
            members = beams(mesh, edges, clamped_nodes(mesh, structure))
        else:
            sites = [tuple(locator.best(x, present) for x in pair) for pair in structure.ends]
            found = [(a, b) for a, b in sites if a is not None and b is not None]
            members = bars(mesh, np.array(structure.ends, dtype=np.float64), found)
        rows = slice(first, first + len(members.weight))
        first = rows.stop
        yield _Part(name, structure, members, rows)


def present_throughout(sequence: ConstructionSequence, name: str) -> Bools | None:
    """(n_elements,) what is there as long as a structure stands; None if it never does."""
    there = [n for n, state in enumerate(sequence.states) if name in state.structures]
    return np.logical_and.reduce([sequence.present(n) for n in there]) if there else None


def straight_pieces(mesh: Mesh, group: str) -> Ints:
    """(n, 2) nodes of the straight pieces of a group of lines, each once; line3 are two pieces."""
    edges = []
    for block, rows in rows_in(mesh.facets, mesh.facet_groups[group]):
        edges += [block.nodes[rows][:, piece] for piece in CELLS[block.kind].flat_pieces]
    joined = np.concatenate(edges)
    _, once = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    return joined[np.sort(once)]


def _facing_ground(mesh: Mesh, edges: Ints, present: Bools) -> Ints:
    """Edges turned so that present ground is on their left, where it is on one side only.

    Bending moments then are positive with tension on the open side.
    """
    balance = np.zeros(len(edges))
    along = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    for block, here in rows_in(mesh.blocks, present):
        centre = mesh.points[block.nodes[here]].mean(axis=1)
        holds = _incidence(mesh, block.nodes[here])
        both = (holds[edges[:, 0]] * holds[edges[:, 1]]).tocoo()
        to_centre = centre[both.col] - mesh.points[edges[both.row, 0]]
        a = along[both.row]
        np.add.at(balance, both.row, np.sign(a[:, 0] * to_centre[:, 1] - a[:, 1] * to_centre[:, 0]))
    return np.where((balance < 0)[:, None], edges[:, ::-1], edges)


def _incidence(mesh: Mesh, nodes: Ints) -> sp.csr_array:
    """(n_nodes, n_elements) which element has which node."""
    columns = np.repeat(np.arange(len(nodes)), nodes.shape[1])
    shape = (mesh.n_nodes, len(nodes))
    return sp.csr_array((np.ones(nodes.size), (nodes.ravel(), columns)), shape=shape)


def clamped_nodes(mesh: Mesh, beam: Beam) -> Bools:
    """(n_nodes,) nodes at which a beam does not turn."""
    clamped = np.zeros(mesh.n_nodes, dtype=bool)
    for group in beam.clamped_on:
        clamped[group_nodes(mesh, group)] = True
    return clamped
