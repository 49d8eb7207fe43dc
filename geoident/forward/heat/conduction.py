"""Heat of a case on its mesh: its matrices, given temperatures, films and sources (theory 18.7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geoident.fem.faces import free_patches
from geoident.fem.heat import capacity_and_conduction, film
from geoident.forward.actions.supports import group_nodes
from geoident.forward.stages import CaseOnMesh, ConstructionState, Discretization
from geoident.forward.summed import Summed, summed
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.heat import HeatFace, bends
from geoident.model.mesh import Mesh, nodes_in


@dataclass(frozen=True)
class GivenNodes:
    """Nodes (k,) whose temperature is given, and what says it since a time, s."""

    nodes: Ints
    face: HeatFace
    begun: float


@dataclass(frozen=True)
class Film:
    """Faces with a film.

    Args:
        matrix: int N N^T dA, (n_nodes, n_nodes).
        face: what says it.
        begun: since when, s.
    """

    matrix: sp.csr_array
    face: HeatFace
    begun: float


@dataclass(frozen=True)
class HeatSystem:
    """What heat flows through in one stage; times count from its beginning.

    Args:
        nodes: (n,) of the ground that is there, ascending.
        held: (n_nodes,) where temperatures are given.
        given: what says them; the later counts where two say it.
        films: faces with one.
        placed: group to when it was placed or made of its material, s, at most 0; minus infinity
            for virgin ground.
    """

    nodes: Ints
    held: Bools
    given: tuple[GivenNodes, ...]
    films: tuple[Film, ...]
    placed: dict[int, float]


@dataclass(frozen=True)
class HeatOperators:
    """M and H of a stage at some parameters, films among H."""

    capacity: Summed
    flow: Summed


class Conduction:
    """Heat of a case; what depends on no parameter is made once, when it is needed.

    Args:
        on_mesh: the case on its mesh.

    Attributes:
        joined: (n_nodes,) the node that has the temperature of each: both sides of an interface
            have one, as heat flows through it.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._on_mesh, self._case = on_mesh, on_mesh.case
        self._sequence, mesh = on_mesh.sequence, on_mesh.mesh
        self.joined: Ints = np.arange(mesh.n_nodes)
        if on_mesh.original is not None:
            self.joined[: len(on_mesh.original)] = on_mesh.original
        self._mesh = replace(
            mesh, blocks=tuple(replace(one, nodes=self.joined[one.nodes]) for one in mesh.blocks)
        )
        self._systems: dict[int, HeatSystem] = {}
        self._matrices: dict[int, tuple[sp.csr_array, sp.csr_array]] = {}

    def __getitem__(self, state: int) -> HeatSystem:
        if state not in self._systems:
            self._systems[state] = self._prepare(state)
        return self._systems[state]

    @cached_property
    def at_points(self) -> sp.csr_array:
        """(n_points, n_nodes) how values at nodes give those at strain points."""
        return shapes_at_points(self._mesh, self._on_mesh.discretization)

    def operators(self, state: int, point: ParameterPoint) -> HeatOperators:
        """The matrices of a state, (n_nodes, n_nodes)."""
        current, shape = self._sequence.states[state], (self._mesh.n_nodes,) * 2
        capacity, flow = [], []
        for group in sorted(current.materials):
            M, H = self._of_group(group)
            material = self._case.materials[current.materials[group]]
            assert material.conductivity is not None  # as the case was checked
            capacity.append((heat_capacity(material, point), M))
            flow.append((point.number(material.conductivity), H))
        for one in self[state].films:
            assert one.face.film is not None
            flow.append((point.number(one.face.film), one.matrix))
        return HeatOperators(summed(capacity, shape), summed(flow, shape))

    def begin(self, state: int, before: Floats, point: ParameterPoint) -> tuple[Floats, Floats]:
        """Temperatures with which a stage begins.

        Where what is placed touches what is there, a node takes the mean by their heat capacities.

        Args:
            state: number of the state.
            before: (n_nodes, 1 + n) of the state on which it builds.
            point: the parameters.

        Returns:
            (n_nodes, 1 + n) those of the nodes, and (n_points, 1 + n) those from which the strain
            of the stage counts: in what is placed that of its placing.
        """
        current, discretization = self._sequence.states[state], self._on_mesh.discretization
        at_points = np.asarray(self.at_points @ before)
        if not current.placed:
            return before, at_points
        total, weight = np.zeros_like(before), np.zeros_like(before)
        for group, name in current.materials.items():
            capacity = heat_capacity(self._case.materials[name], point)
            share = capacity.columns * self._of_group(group)[0].diagonal()[:, None]
            own = Dual(before)
            if group in current.placed:
                own = self._placed_at(current, group, point, before.shape)
                at_points[discretization.points_of[group]] = own.columns[0]
            total += (Dual(share) * own).columns
            weight += share
        touched = weight[:, 0] > 0.0
        begun = before.copy()
        begun[touched] = (Dual(total[touched]) / Dual(weight[touched])).columns
        return begun, at_points

    def _placed_at(
        self, current: ConstructionState, group: int, point: ParameterPoint, shape: tuple[int, ...]
    ) -> Dual:
        """The temperature of a group that is placed, at all nodes."""
        scalar = current.placed_at.get(group, self._case.initial_temperature)
        assert scalar is not None  # of a case that conducts
        return Dual(np.broadcast_to(point.number(scalar).columns, shape))

    def given(self, state: int, time: float, point: ParameterPoint) -> Floats:
        """Temperatures (n_nodes, 1 + n) where they are given at a time of a stage, s."""
        values = np.zeros((self._mesh.n_nodes, point.n_columns))
        for one in self[state].given:
            values[one.nodes] = one.face.temperature.at(time - one.begun, point).columns
        return values

    def let_in(self, state: int, span: tuple[float, float], point: ParameterPoint) -> Floats:
        """Heat (n_nodes, 1 + n) that films let in during a part of a stage, s, for T = 0."""
        total = np.zeros((self._mesh.n_nodes, point.n_columns))
        for one in self[state].films:
            assert one.face.film is not None
            start, end = (time - one.begun for time in span)
            inflow = point.number(one.face.film) * one.face.temperature.over(start, end, point)
            total += one.matrix.sum(axis=1)[:, None] * inflow.columns
        return total

    def set_free(
        self, state: int, span: tuple[float, float], point: ParameterPoint
    ) -> Floats | None:
        """Heat (n_nodes, 1 + n) of hydration in a part of a stage, s; None where there is none."""
        total, current = None, self._sequence.states[state]
        for group, placed in self[state].placed.items():
            material = self._case.materials[current.materials[group]]
            if material.hydration is None or not np.isfinite(placed):
                continue
            start, end = (material.hydration.until(time - placed, point) for time in span)
            heat = heat_capacity(material, point) * (end - start)
            own = self._of_group(group)[0].sum(axis=1)[:, None] * heat.columns
            total = own if total is None else total + own
        return total

    def bends(self, state: int) -> tuple[float, ...]:
        """Times in a stage, s, at which something given changes its slope, ascending."""
        system, current = self[state], self._sequence.states[state]
        said = [(one.face.temperature, one.begun) for one in system.given]
        said += [(one.face.temperature, one.begun) for one in system.films]
        times = {time for course, begun in said for time in bends(course, begun)}
        for group, placed in system.placed.items():
            hydration = self._case.materials[current.materials[group]].hydration
            if hydration is not None and np.isfinite(placed):
                times |= {*bends(hydration.curve, placed)}
        return tuple(sorted(times))

    def _of_group(self, group: int) -> tuple[sp.csr_array, sp.csr_array]:
        """M and H of a group, for unit properties."""
        if group not in self._matrices:
            mesh, kinematics = self._mesh, self._on_mesh.kinematics
            elements = self._sequence.group_of == group
            self._matrices[group] = capacity_and_conduction(mesh, kinematics, elements)
        return self._matrices[group]

    def _prepare(self, state: int) -> HeatSystem:
        on_mesh, mesh = self._on_mesh, self._mesh
        current, present = self._sequence.states[state], self._sequence.present(state)
        nodes = nodes_in(mesh.blocks, present)
        now, given, films = self._begins(state), [], []
        for name, face in current.heat.items():
            since = current.heat_since[name]
            begun = self._begins(since) - now
            if face.film is None:
                at = self.joined[given_nodes(on_mesh, name, since, state)]
                named = np.intersect1d(at, nodes)
                given.append(GivenNodes(named, face, begun))
            else:
                patches = free_patches(mesh, on_mesh.table, name, present)
                films.append(Film(film(mesh, on_mesh.kinematics, patches), face, begun))
        held = np.zeros(mesh.n_nodes, dtype=np.bool_)
        for one in given:
            held[one.nodes] = True
        placed = {group: self._made(state, group) - now for group in current.materials}
        return HeatSystem(nodes, held, tuple(given), tuple(films), placed)

    def _begins(self, state: int) -> float:
        """When the stage of a state begins, s since the virgin state; stages in a row."""
        states = self._sequence.states
        while states[state].goes_on:
            state = states[state].base
        if not state:
            return 0.0
        base = states[state].base
        lasted = states[base].lasts if states[base].at is None else states[base].at
        return self._begins(base) + (lasted or 0.0)

    def _made(self, state: int, group: int) -> float:
        """When a group was placed or made of its material, s; minus infinity before all stages."""
        states = self._sequence.states
        while state:
            current, before = states[state], states[states[state].base]
            own = before.materials.get(group)
            if group in current.placed or own != current.materials[group]:
                return self._begins(state)
            state = current.base
        return -np.inf


def shapes_at_points(mesh: Mesh, discretization: Discretization) -> sp.csr_array:
    """(n_points, n_nodes) how values at the nodes give those at the strain points."""
    rows, columns, shares, first = [], [], [], 0
    for block, geometry in zip(mesh.blocks, discretization.geometries, strict=True):
        n, (q, a) = len(block.nodes), geometry.shapes.shape
        points = first + np.arange(n * q)
        rows.append(np.repeat(points, a))
        columns.append(np.repeat(block.nodes, q, axis=0).ravel())
        shares.append(np.tile(geometry.shapes.ravel(), n))
        first += n * q
    at = np.concatenate(rows), np.concatenate(columns)
    return sp.csr_array(sp.coo_array((np.concatenate(shares), at), shape=(first, mesh.n_nodes)))


def given_nodes(on_mesh: CaseOnMesh, name: str, since: int, state: int) -> Ints:
    """Nodes (k,) of a group that has a given temperature.

    Of faces those that are free, if some were in the stage that said it: what later covers them
    ends it. Faces inside the ground, such as freeze pipes that are lines of the mesh, keep it.

    Args:
        on_mesh: the case on its mesh.
        name: of the group.
        since: number of the state that said it.
        state: number of the state.
    """
    mesh = on_mesh.mesh
    if name in mesh.facet_groups:
        at = [on_mesh.sequence.present(number) for number in (since, state)]
        then, now = (free_patches(mesh, on_mesh.table, name, present) for present in at)
        if then:
            nodes = [patch.nodes.ravel() for patch in now]
            return np.unique(np.concatenate([np.empty(0, np.int64), *nodes]))
    return group_nodes(mesh, name)


def heat_capacity(material: Material, point: ParameterPoint) -> Dual:
    """Heat per volume and degree of a material that conducts, J/m3K."""
    if material.heat_capacity is not None:
        return point.number(material.heat_capacity)
    assert material.specific_heat is not None
    return point.number(material.specific_heat) * point.number(material.density)
