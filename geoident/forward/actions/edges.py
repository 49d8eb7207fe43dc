"""What stays on the edges of the model: the ground beyond them, and what lies on it.

Where the in-situ stress is held (`stress.edges_held`) the tractions sigma n of the ground beyond
stay on the outer faces of a group, elsewhere the cover and the surcharge of a geostatic stress.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np

from geoident.fem.faces import FacetPatch, patches
from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.fem.loads import facet_geometry, stress_forces
from geoident.forward.in_situ.overburden import Overburden
from geoident.forward.in_situ.stress import (
    CoverAndSurcharge,
    InSituStress,
    StressPlaces,
    edges_held,
)
from geoident.forward.in_situ.water import PorePressure, is_wet
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import ParameterPoint
from geoident.model.in_situ import GeostaticStress

HELD_EDGES = "what holds the edges of the model"

_Stress: TypeAlias = Callable[[ParameterPoint], Floats]
"""(n_strain, m, 1 + n) Pa at m places."""


def loaded_edges(on_mesh: CaseOnMesh) -> dict[int, list[EdgeTractions]]:
    """Per group its outer faces in the virgin state, if something stays on them."""
    case, sequence, table = on_mesh.case, on_mesh.sequence, on_mesh.table
    rows = table.free(sequence.present(0))
    group_of_row = sequence.group_of[table.element[rows]]
    edges: dict[int, list[EdgeTractions]] = {}
    for g in map(int, np.unique(group_of_row)):
        model = case.in_situ_of.get(sequence.groups[g], case.in_situ)
        stress: Callable[[CaseOnMesh, Floats, Ints], _Stress]
        if edges_held(model):
            name, stress = HELD_EDGES, _total_stress
        elif isinstance(model, GeostaticStress) and (model.surcharge or model.cover):
            name, stress = "what lies on the ground", partial(_stress_of_cover, model)
        else:
            continue
        own = patches(on_mesh.mesh, table, rows[group_of_row == g])
        edges[g] = [EdgeTractions(name, on_mesh, patch, stress) for patch in own]
    return edges


class EdgeTractions:
    """Tractions sigma n of a stress that stays on a patch of the model's edge.

    Args:
        name: for a sentence.
        on_mesh: the case on its mesh.
        patch: the faces.
        stress: prepares the stress at places (n, dim) in elements (n,) on the patch.
    """

    def __init__(
        self,
        name: str,
        on_mesh: CaseOnMesh,
        patch: FacetPatch,
        stress: Callable[[CaseOnMesh, Floats, Ints], _Stress],
    ) -> None:
        mesh = on_mesh.mesh
        self.name, self._mesh, self._patch = name, mesh, patch
        self._geometry = geometry = facet_geometry(mesh.points, patch, on_mesh.kinematics)
        positions = geometry.positions.reshape(-1, mesh.dim)
        self._stress = stress(on_mesh, positions, patch.element.repeat(geometry.shapes.shape[0]))
        self._last: tuple[ParameterPoint, Ints, Floats] | None = None

    def forces(self, point: ParameterPoint) -> Floats:
        """Forces (n_dofs, 1 + n), N; those of the last parameters are known, for all stages."""
        if self._last is None or self._last[0] is not point:
            forces = stress_forces(self._mesh, self._patch, self._geometry, self._stress(point))
            some = np.flatnonzero(forces.any(axis=1))
            self._last = point, some, forces[some]
            return forces
        _, some, values = self._last
        forces = np.zeros((self._mesh.n_nodes * self._mesh.dim, point.n_columns))
        forces[some] = values
        return forces


def _total_stress(on_mesh: CaseOnMesh, positions: Floats, elements: Ints) -> _Stress:
    """The in-situ stress of the ground beyond the edge, water included."""
    sequence, water = on_mesh.sequence, on_mesh.case.water
    groups = sequence.group_of[elements]
    skeleton = InSituStress(on_mesh, StressPlaces(positions, groups, elements))
    if water is None:
        return skeleton.columns
    pores = PorePressure(water, on_mesh.mesh, positions)
    wet = is_wet(water, groups, sequence.groups)

    def total(point: ParameterPoint) -> Floats:
        stress = skeleton.columns(point)
        stress[:NORMAL_COMPONENTS] -= np.where(wet[:, None], pores.at(point).columns, 0.0)
        return stress

    return total


def _stress_of_cover(
    model: GeostaticStress, on_mesh: CaseOnMesh, positions: Floats, elements: Ints
) -> _Stress:
    """The vertical stress of what lies on the ground, per area in plan, where nothing is above."""
    above = Overburden(on_mesh).above(positions, elements)
    cover = CoverAndSurcharge(model, on_mesh.mesh, positions, above)

    def vertical(point: ParameterPoint) -> Floats:
        pressure = np.where(above.uncovered[:, None], cover.pressure(point).columns, 0.0)
        stress = np.zeros((on_mesh.kinematics.n_strain, *pressure.shape))
        stress[on_mesh.mesh.dim - 1] = -pressure
        return stress

    return vertical
