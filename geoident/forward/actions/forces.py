"""External actions f_j of every state and their derivatives: weight, loads, held edges, water.

Loads are made ready first: what does not depend on parameters is computed once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from geoident.fem.faces import FacetPatch, load_patches, patches
from geoident.fem.loads import (
    facet_geometry,
    pressure_forces,
    pressure_operator,
    stress_forces,
    traction_weights,
    weight_shares,
)
from geoident.forward.actions.supports import group_nodes
from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.in_situ.overburden import Overburden
from geoident.forward.in_situ.stress import (
    CoverAndSurcharge,
    InSituStress,
    StressPlaces,
    edges_held,
)
from geoident.forward.in_situ.water import FacePressure, PorePressure, is_wet
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.model.actions import FaceLoad, PointForce, Pressure, Seismic, Traction, Water
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.in_situ import GeostaticStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar

ReadyLoad: TypeAlias = Callable[[ParameterPoint], Floats]
"""A load that can be asked for its nodal forces (n_dofs, 1 + n) and their derivatives, N."""


def _scaled_forces(terms: Sequence[tuple[Floats, Scalar]], point: ParameterPoint) -> Floats:
    """Nodal forces (n_dofs,) that are given, each times a number of the case: (n_dofs, 1 + n)."""
    return np.asarray(sum(np.outer(unit, point.number(k).columns) for unit, k in terms))


def _water_forces(
    terms: Sequence[tuple[FacePressure, sp.csr_array]], point: ParameterPoint
) -> Floats:
    """Forces (n_dofs, 1 + n) of water on faces.

    Args:
        terms: the pressure at the quadrature points of a patch with the operator (n_dofs, m)
            that makes forces of it.
        point: the parameters.
    """
    return np.asarray(sum(matrix @ p.at(point).columns for p, matrix in terms))


def face_load(on_mesh: CaseOnMesh, load: FaceLoad, faces: Sequence[FacetPatch]) -> ReadyLoad:
    """A load on the free faces of the ground.

    Args:
        on_mesh: the case on its mesh.
        load: the load.
        faces: the free faces on which it acts.
    """
    mesh, kinematics = on_mesh.mesh, on_mesh.kinematics
    if isinstance(load, Pressure):
        push = sum((pressure_forces(mesh, p, kinematics) for p in faces), np.zeros(1))
        return partial(_scaled_forces, [(push, load.value)])
    if isinstance(load, Traction):
        area = sum((traction_weights(mesh, p, kinematics) for p in faces), np.zeros(1))
        return _along_axes(mesh, area, load.value)
    ready = [pressure_operator(mesh, p, kinematics) for p in faces]
    return partial(_water_forces, [(FacePressure(load, where), matrix) for where, matrix in ready])


def point_force(on_mesh: CaseOnMesh, load: PointForce, present: Bools) -> ReadyLoad:
    """A force at a point, shared by the nodes around it; or on the nodes of a group.

    Args:
        on_mesh: the case on its mesh.
        load: the force.
        present: (n_elements,) which elements are there.
    """
    mesh = on_mesh.mesh
    shares = np.zeros(mesh.n_nodes)
    if isinstance(load.place, str):
        nodes = group_nodes(mesh, load.place)
        shares[nodes] = 1 / len(nodes)
    elif (site := on_mesh.locator.best(load.place, present)) is not None:
        shares[site.nodes] = site.shapes
    return _along_axes(mesh, shares, load.value)


def _along_axes(mesh: Mesh, shares: Floats, value: Sequence[Scalar]) -> ReadyLoad:
    """Forces shared by the nodes (n_nodes,), with one number per axis."""
    axes = np.eye(mesh.dim)
    terms = [(np.outer(shares, a).ravel(), number) for a, number in zip(axes, value, strict=True)]
    return partial(_scaled_forces, terms)


ForcePart: TypeAlias = tuple[str, Callable[[ParameterPoint], Floats]]
"""What acts, for a sentence, and its nodal forces (n_dofs, 1 + n) at a point."""

HELD_EDGES = "what holds the edges of the model"

_ROUNDING = 1e-9
"""Part of the largest force below which a force is none."""


class Actions:
    """Nodal forces of everything that acts from outside; what is given is computed once.

    Args:
        on_mesh: the case on its mesh.
        beside: what acts in a state beside loads and on what is no ground: weight of structures.
    """

    def __init__(
        self, on_mesh: CaseOnMesh, beside: Callable[[ConstructionState], Iterable[ForcePart]]
    ) -> None:
        self._on_mesh, self._beside = on_mesh, beside
        self._case, self._mesh, self._sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
        self._discretization = on_mesh.discretization
        self._shares = self._volume_shares()
        self._edges = self._held_edges()
        self._loads = self._ready_loads()
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
        edges = (edge for edges in self._edges.values() for edge in edges)
        for forces in (e.forces(point)[:, 0] for e in edges if isinstance(e, _HeldEdge)):
            largest = float(np.abs(forces).max(initial=0.0))
            if np.abs(forces[unknowns]).max(initial=0.0) > _ROUNDING * largest:
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
            if not isinstance(load, Seismic):
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
            yield "the weight", partial(self._weight, some, self._case.gravity)
        for group in groups:
            for edge in self._edges.get(group, ()):
                yield edge.name, edge.forces
        for name, load in current.loads.items():
            if isinstance(load, Seismic):
                yield f"the seismic force '{name}'", partial(self._shaking, some, load)
        if current.water is not None:
            yield (
                "the pressure of the water in the pores",
                partial(self._pore_forces, state, groups, current.water),
            )

    def _weight(
        self, state: ConstructionState, gravity: Sequence[float], point: ParameterPoint
    ) -> Floats:
        mass = self._mass(state, point).columns
        return np.asarray(np.einsum("nc,i->nic", mass, gravity).reshape(-1, point.n_columns))

    def _shaking(self, state: ConstructionState, load: Seismic, point: ParameterPoint) -> Floats:
        """Parts of the weight of all ground that is there, along the axes."""
        mass = self._mass(state, point)
        size = 0.0 if self._case.gravity is None else float(np.linalg.norm(self._case.gravity))
        along = [(mass * point.number(factor)).times(size).columns for factor in load.factors]
        return np.stack(along, axis=1).reshape(-1, point.n_columns)

    def _mass(self, state: ConstructionState, point: ParameterPoint) -> Dual:
        """Mass (n_nodes,) that belongs to each node, kg."""
        mass = np.zeros((self._mesh.n_nodes, point.n_columns))
        for group, material in state.materials.items():
            density = point.number(self._case.materials[material].density)
            mass += np.outer(self._shares[group], density.columns)
        return Dual(mass)

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

    def _volume_shares(self) -> list[Floats]:
        """Per group the volume (n_nodes,) that belongs to each node, m3; no gravity, nothing."""
        mesh, sequence, groups = self._mesh, self._sequence, range(len(self._sequence.groups))
        if self._case.gravity is None:
            return [np.zeros(mesh.n_nodes)] * len(groups)
        geometries = self._discretization.geometries
        return [weight_shares(mesh, geometries, sequence.elements(g)) for g in groups]

    def _held_edges(self) -> dict[int, list[_Edge]]:
        """Per group its outer faces in the virgin state, if something stays on them.

        That is the in-situ stress where it is held, else what lies on the ground beside it.
        """
        case, sequence, table = self._case, self._sequence, self._on_mesh.table
        rows = table.free(sequence.present(0))
        group_of_row = sequence.group_of[table.element[rows]]
        edges: dict[int, list[_Edge]] = {}
        for g in map(int, np.unique(group_of_row)):
            model = case.in_situ_of.get(sequence.groups[g], case.in_situ)
            patches_of_group = partial(patches, self._mesh, table, rows[group_of_row == g])
            if edges_held(model):
                edges[g] = [_HeldEdge(self._on_mesh, patch) for patch in patches_of_group()]
            elif isinstance(model, GeostaticStress) and (model.surcharge or model.cover):
                edges[g] = [
                    _CoveredEdge(self._on_mesh, patch, model) for patch in patches_of_group()
                ]
        return edges

    def _ready_loads(self) -> dict[tuple[int, str], ReadyLoad]:
        """The loads of every state; what acts on the same ground is prepared once."""
        made: dict[tuple[FaceLoad | PointForce, bytes], ReadyLoad] = {}
        result = {}
        for n, state in enumerate(self._sequence.states):
            present = self._sequence.present(n)
            for name, load in state.loads.items():
                if isinstance(load, Seismic):
                    continue
                key = (load, present.tobytes())
                if key not in made:
                    made[key] = self._ready(load, present)
                result[n, name] = made[key]
        return result

    def _ready(self, load: FaceLoad | PointForce, present: Bools) -> ReadyLoad:
        if isinstance(load, PointForce):
            return point_force(self._on_mesh, load, present)
        faces = load_patches(self._mesh, self._on_mesh.table, load.group, present)
        if faces is None:
            msg = f"load on '{load.group}' has no free face (see load_place_faults)"
            raise ValueError(msg)
        return face_load(self._on_mesh, load, faces)


class _Edge(Protocol):
    """Something that stays on a part of the model's edge."""

    name: str

    def forces(self, point: ParameterPoint) -> Floats:
        """Forces (n_dofs, 1 + n), N."""


class _HeldEdge:
    """Tractions sigma_0 n of the ground beyond a patch of the model's edge, water included."""

    name = HELD_EDGES

    def __init__(self, on_mesh: CaseOnMesh, patch: FacetPatch) -> None:
        mesh, sequence, water = on_mesh.mesh, on_mesh.sequence, on_mesh.case.water
        self._mesh, self._patch = mesh, patch
        self._geometry = geometry = facet_geometry(mesh.points, patch, on_mesh.kinematics)
        self._known: tuple[ParameterPoint, Ints, Floats] | None = None
        positions = geometry.positions.reshape(-1, mesh.dim)
        elements = patch.element.repeat(geometry.positions.shape[1])
        groups = sequence.group_of[elements]
        self._skeleton = InSituStress(on_mesh, StressPlaces(positions, groups, elements))
        self._pores = None if water is None else PorePressure(water, mesh, positions)
        self._wet = is_wet(water, groups, sequence.groups)

    def forces(self, point: ParameterPoint) -> Floats:
        """Forces (n_dofs, 1 + n), N; those of the last parameters are known, for all stages."""
        if self._known is None or self._known[0] is not point:
            nodal_forces = self._made(point)
            some = np.flatnonzero(nodal_forces.any(axis=1))
            self._known = point, some, nodal_forces[some]
            return nodal_forces
        _, some, values = self._known
        nodal_forces = np.zeros((self._mesh.n_nodes * self._mesh.dim, point.n_columns))
        nodal_forces[some] = values
        return nodal_forces

    def _made(self, point: ParameterPoint) -> Floats:
        stress = self._skeleton.columns(point)
        if self._pores is not None:
            pressure = self._pores.at(point).columns
            stress[:NORMAL_COMPONENTS] -= np.where(self._wet[:, None], pressure, 0.0)
        return stress_forces(self._mesh, self._patch, self._geometry, stress)


class _CoveredEdge:
    """Cover and surcharge of a geostatic stress on a patch of the model's edge."""

    name = "what lies on the ground"

    def __init__(self, on_mesh: CaseOnMesh, patch: FacetPatch, model: GeostaticStress) -> None:
        mesh = on_mesh.mesh
        self._mesh, self._patch, self._kinematics = mesh, patch, on_mesh.kinematics
        self._geometry = geometry = facet_geometry(mesh.points, patch, self._kinematics)
        positions = geometry.positions.reshape(-1, mesh.dim)
        elements = patch.element.repeat(geometry.positions.shape[1])
        above = Overburden(on_mesh).above(positions, elements)
        self._open = above.uncovered
        self._on_top = CoverAndSurcharge(model, mesh, positions, above)

    def forces(self, point: ParameterPoint) -> Floats:
        """Forces (n_dofs, 1 + n), N: per area in plan, so as sigma n of a vertical stress."""
        pressure = np.where(self._open[:, None], self._on_top.pressure(point).columns, 0.0)
        stress = np.zeros((self._kinematics.n_strain, *pressure.shape))
        stress[self._mesh.dim - 1] = -pressure
        return stress_forces(self._mesh, self._patch, self._geometry, stress)
