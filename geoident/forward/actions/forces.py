"""External actions f_j of every state and their derivatives: weight, loads, held edges, water.

What does not depend on parameters is computed once, when a model is made.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from geoident.fem.faces import load_patches
from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.fem.loads import (
    pressure_forces,
    pressure_operator,
    traction_weights,
    weight_shares,
)
from geoident.forward.actions.edges import HELD_EDGES, loaded_edges
from geoident.forward.actions.on_beams import onto_beams, site_on_beam
from geoident.forward.actions.supports import group_nodes
from geoident.forward.in_situ.water import FacePressure, PorePressure, is_wet
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.model.actions import (
    FaceLoad,
    HeadForce,
    PointForce,
    Pressure,
    Seismic,
    Traction,
    Water,
)
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar

NodalForces: TypeAlias = Callable[[ParameterPoint], Floats]
"""Nodal forces (n_dofs, 1 + n), N, with derivatives in the columns from 1 on."""

ForcePart: TypeAlias = tuple[str, NodalForces]
"""What acts, for a sentence, and its nodal forces."""

_NO_FORCE = 1e-9
"""Part of the largest force below which a force is rounding."""


def load_forces(
    on_mesh: CaseOnMesh,
    load: FaceLoad | PointForce,
    present: Bools,
    standing: frozenset[str] = frozenset(),
) -> NodalForces:
    """Nodal forces of a load on the ground that is there, or on beams between it and interfaces.

    A point force is shared by the nodes of the element around it, or evenly by those of a group.

    Args:
        on_mesh: the case on its mesh.
        load: the load.
        present: (n_elements,) which elements are there.
        standing: names of the structures that stand.

    Raises:
        ValueError: a face of the load is not free (`load_place_faults`).
    """
    mesh, kinematics = on_mesh.mesh, on_mesh.kinematics
    shares = np.zeros(mesh.n_nodes)
    if isinstance(load, PointForce):
        if isinstance(load.place, str):
            nodes = group_nodes(mesh, load.place)
            shares[nodes] = 1 / len(nodes)
        else:
            site = site_on_beam(on_mesh, load.place, standing)
            site = site or on_mesh.locator.best(load.place, present)
            if site is not None:
                shares[site.nodes] = site.shapes
        return partial(_along_axes, shares, load.value)
    faces = load_patches(mesh, on_mesh.table, load.group, present)
    if faces is None:
        raise ValueError(f"load on '{load.group}' has no free face (see load_place_faults)")
    if len(mesh.inner):
        faces = tuple(replace(p, nodes=onto_beams(on_mesh, p.nodes, standing)) for p in faces)
    if isinstance(load, Traction):
        for patch in faces:
            shares += traction_weights(mesh, patch, kinematics)
        return partial(_along_axes, shares, load.value)
    if isinstance(load, Pressure):
        push = np.sum([pressure_forces(mesh, p, kinematics) for p in faces], axis=0)
        pressure = load.value
        return lambda point: np.outer(push, point.number(pressure).columns)
    pushes = (pressure_operator(mesh, p, kinematics, load.parts) for p in faces)
    places, operators = zip(*pushes, strict=True)
    water, operator = FacePressure(load, np.concatenate(places)), sp.hstack(operators, "csr")
    return lambda point: np.asarray(operator @ water.at(point).columns)


def _along_axes(shares: Floats, value: Sequence[Scalar], point: ParameterPoint) -> Floats:
    """Forces (n_dofs, 1 + n) of which each node has its share (n_nodes,), one number an axis."""
    numbers = np.array([point.number(scalar).columns for scalar in value])
    return np.asarray((shares[:, None, None] * numbers).reshape(-1, point.n_columns))


class Actions:
    """Nodal forces of everything that acts from outside.

    Args:
        on_mesh: the case on its mesh.
        beside: what acts in a state on what is no ground: weight of structures, loads on them.
    """

    def __init__(
        self, on_mesh: CaseOnMesh, beside: Callable[[ConstructionState], Iterable[ForcePart]]
    ) -> None:
        self._on_mesh, self._beside = on_mesh, beside
        self._case, self._mesh, self._sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
        self._discretization = on_mesh.discretization
        if self._case.gravity is not None:
            geometries = self._discretization.geometries
            self._volume_shares = [  # of every group, (n_nodes,) m3
                weight_shares(self._mesh, geometries, self._sequence.elements(g))
                for g in range(len(self._sequence.groups))
            ]
        self._edges = loaded_edges(on_mesh)
        self._loads = self._all_load_forces()
        self._pores: dict[Water, PorePressure] = {}

    @property
    def n_outside(self) -> int:
        """Strain points that lie beside the water tables given by faces, so far."""
        return sum(pores.n_outside for pores in self._pores.values())

    def forces(self, state: int, point: ParameterPoint) -> Floats:
        """Forces (n_dofs, 1 + n) of a state in column 0, their derivatives in the others."""
        return self._sum(self.parts(state), point)

    def hold_edges(self, point: ParameterPoint, unknowns: Ints) -> bool:
        """Whether tractions on the edges act on anything that can move in the virgin state.

        Args:
            point: the parameters.
            unknowns: (m,) numbers of the dofs that no support fixes.
        """
        for edge in (edge for edges in self._edges.values() for edge in edges):
            if edge.name == HELD_EDGES:
                forces = np.abs(edge.forces(point)[:, 0])
                if forces[unknowns].max(initial=0.0) > _NO_FORCE * forces.max(initial=0.0):
                    return True
        return False

    def carried(self, state: int, groups: Collection[int], point: ParameterPoint) -> Floats:
        """The part (n_dofs, 1 + n) that belongs to some present groups: weight, edges, water.

        Args:
            state: number of the state.
            groups: indices of the groups.
            point: the parameters.
        """
        return self._sum(self._parts_of_groups(state, groups), point)

    def parts(self, state: int) -> Iterator[ForcePart]:
        """Everything that acts in a state, one by one."""
        current = self._sequence.states[state]
        yield from self._parts_of_groups(state, current.materials.keys())
        yield from self._beside(current)
        for name, load in current.loads.items():
            if not isinstance(load, Seismic | HeadForce):
                yield f"the load '{name}'", self._loads[state, name]

    def _sum(self, parts: Iterable[ForcePart], point: ParameterPoint) -> Floats:
        """Forces (n_dofs, 1 + n) of several parts."""
        total = np.zeros((self._mesh.n_nodes * self._mesh.dim, point.n_columns))
        for _, forces in parts:
            total += forces(point)
        return total

    def _parts_of_groups(self, state: int, groups: Collection[int]) -> Iterator[ForcePart]:
        """What acts in a state on some present groups themselves."""
        current = self._sequence.states[state]
        some = replace(current, materials={g: current.materials[g] for g in groups})
        if self._case.gravity is not None:
            yield "the weight", partial(self._inertia, some, None)
        for group in groups:
            for edge in self._edges.get(group, ()):
                yield edge.name, edge.forces
        for name, load in current.loads.items():
            if isinstance(load, Seismic) and self._case.gravity is not None:
                yield f"the seismic force '{name}'", partial(self._inertia, some, load)
        if current.water is not None:
            yield (
                "the pressure of the water in the pores",
                partial(self._pore_forces, state, groups, current.water),
            )

    def _inertia(
        self, state: ConstructionState, shaking: Seismic | None, point: ParameterPoint
    ) -> Floats:
        """The weight of the ground, or the parts of it with which an earthquake pushes."""
        gravity = np.array(self._case.gravity)
        mass = np.zeros((self._mesh.n_nodes, point.n_columns))
        for group, material in state.materials.items():
            density = point.number(self._case.materials[material].density)
            mass += np.outer(self._volume_shares[group], density.columns)
        if shaking is None:
            along = [mass * component for component in gravity]
        else:
            size = float(np.linalg.norm(gravity))
            factors = [point.number(factor).times(size) for factor in shaking.factors]
            along = [(Dual(mass) * factor).columns for factor in factors]
        return np.stack(along, axis=1).reshape(-1, point.n_columns)

    def _pore_forces(
        self, state: int, groups: Collection[int], water: Water, point: ParameterPoint
    ) -> Floats:
        """C^T V p over the points of some groups with water in their pores."""
        points = self._discretization.points
        if water not in self._pores:
            self._pores[water] = PorePressure(water, self._mesh, points.position)
        pressure = self._pores[water].at(point).columns
        stress = np.zeros((points.n_strain, *pressure.shape))
        stress[:NORMAL_COMPONENTS] = pressure
        volume = self._discretization.volume(self._sequence.present(state))
        group_of_point = self._sequence.group_of[points.element]
        wet = is_wet(water, group_of_point, self._sequence.groups)
        wet &= np.isin(group_of_point, list(groups))
        return points.forces(stress, np.where(wet, volume, 0.0))

    def _all_load_forces(self) -> dict[tuple[int, str], NodalForces]:
        """The loads of every state; what acts on the same ground is prepared once."""
        prepared: dict[tuple[FaceLoad | PointForce, bytes, frozenset[str]], NodalForces] = {}
        result = {}
        for n, state in enumerate(self._sequence.states):
            present = self._sequence.present(n)
            for name, load in state.loads.items():
                if isinstance(load, Seismic | HeadForce):
                    continue
                on = state.structures if len(self._mesh.inner) else frozenset[str]()
                key = (load, present.tobytes(), on)
                if key not in prepared:
                    prepared[key] = load_forces(self._on_mesh, load, present, on)
                result[n, name] = prepared[key]
        return result
