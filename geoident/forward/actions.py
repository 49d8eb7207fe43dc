"""External actions f_j of every state and their derivatives: weight, loads, held edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.fem.faces import FaceTable, FacetPatch, patches
from geoident.fem.kinematics import Kinematics
from geoident.fem.loads import pressure_forces, stress_forces, traction_weights, weight_shares
from geoident.forward.in_situ import edges_held, in_situ_stress
from geoident.forward.materials import Values
from geoident.forward.stage_systems import StageSystems
from geoident.forward.supports import load_patches
from geoident.forward.timeline import Timeline
from geoident.model.actions import Load, Pressure
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar


class Actions:
    """Nodal forces of everything that acts from outside; unit forces are made once."""

    def __init__(
        self, case: Case, mesh: Mesh, table: FaceTable, timeline: Timeline, systems: StageSystems
    ) -> None:
        self._case = case
        self._mesh = mesh
        self._timeline = timeline
        self._weights = (
            {} if case.gravity is None else _group_weights(case, mesh, timeline, systems)
        )
        self._kinematics = systems.kinematics
        self._edges = _held_edges(case, mesh, table, timeline)
        self._load_forces = _load_forces(mesh, table, timeline, systems.kinematics)

    def forces(self, state: int, values: Values, names: Sequence[str]) -> Floats:
        """Forces (n_dofs, 1 + n) of a state in column 0, their derivatives in the others."""
        current = self._timeline.states[state]
        total = np.zeros((self._mesh.n_nodes * self._mesh.dim, 1 + len(names)))
        for group, material in current.materials.items():
            if group in self._weights:
                density = self._case.materials[material].density
                _add(total, self._weights[group], density, values, names)
            if group in self._edges:
                total += self._edge_forces(group, values, names)
        for name in current.loads:
            for unit, scalar in self._load_forces[state, name]:
                _add(total, unit, scalar, values, names)
        return total

    def _edge_forces(self, group: int, values: Values, names: Sequence[str]) -> Floats:
        """Tractions sigma_0 n on the outer faces of a group."""

        def stress(positions: Floats) -> Floats:
            return in_situ_stress(self._case.in_situ, values, names, positions)

        return np.asarray(
            sum(
                stress_forces(self._mesh, patch, self._kinematics, stress)
                for patch in self._edges[group]
            )
        )


def _add(total: Floats, unit: Floats, scalar: Scalar, values: Values, names: Sequence[str]) -> None:
    """Add a unit force (n_dofs,) times a number and its derivatives."""
    total[:, 0] += scalar.value(values) * unit
    if scalar.parameter in names:
        total[:, 1 + names.index(scalar.parameter)] += scalar.factor * unit


def _group_weights(
    case: Case, mesh: Mesh, timeline: Timeline, systems: StageSystems
) -> dict[int, Floats]:
    """Per group the nodal forces (n_dofs,) of its weight at unit density."""
    gravity = np.array(case.gravity)
    return {
        g: np.outer(weight_shares(mesh, systems.geometries, timeline.elements(g)), gravity).ravel()
        for g in range(len(timeline.groups))
    }


def _held_edges(
    case: Case, mesh: Mesh, table: FaceTable, timeline: Timeline
) -> dict[int, tuple[FacetPatch, ...]]:
    """Per group its outer faces in the virgin state, if the in-situ stress is held there."""
    if not edges_held(case.in_situ):
        return {}
    rows = table.free(timeline.present(0))
    group_of_row = timeline.group_of[table.element[rows]]
    return {int(g): patches(mesh, table, rows[group_of_row == g]) for g in np.unique(group_of_row)}


def _load_forces(
    mesh: Mesh, table: FaceTable, timeline: Timeline, kinematics: Kinematics
) -> dict[tuple[int, str], list[tuple[Floats, Scalar]]]:
    """Per state and load its unit forces with the numbers that scale them."""
    made: dict[tuple[int, bytes], list[tuple[Floats, Scalar]]] = {}
    result = {}
    for n, state in enumerate(timeline.states):
        present = timeline.present(n)
        for name, load in state.loads.items():
            key = (id(load), present.tobytes())
            if key not in made:
                faces = load_patches(mesh, table, load.group, present)
                made[key] = _unit_forces(mesh, load, faces, kinematics)
            result[n, name] = made[key]
    return result


def _unit_forces(
    mesh: Mesh, load: Load, faces: tuple[FacetPatch, ...] | None, kinematics: Kinematics
) -> list[tuple[Floats, Scalar]]:
    if faces is None:
        msg = f"load on '{load.group}' has no free face (see burden_faults)"
        raise ValueError(msg)
    if isinstance(load, Pressure):
        return [
            (sum((pressure_forces(mesh, p, kinematics) for p in faces), np.zeros(1)), load.value)
        ]
    area = sum((traction_weights(mesh, p, kinematics) for p in faces), np.zeros(1))
    return [
        (np.outer(area, np.eye(mesh.dim)[axis]).ravel(), scalar)
        for axis, scalar in enumerate(load.value)
    ]
