"""The error of a mesh from the jumps of its stress (Zienkiewicz & Zhu 1987), at no factorization.

A smooth stress sigma* is made of that of the strain points by means at the nodes, each material by
itself, and compared with it in the energy of the compliance:

    eta^2 = |sigma* - sigma|^2 / (|sigma|^2 + |sigma* - sigma|^2)

for the stress that construction has changed. The energy of that change is the work of what was
excavated and loaded, so eta^2 is about the relative error of the motions of the loaded faces.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import reference_element
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.model import StagedModel
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import spans


class EnergyError:
    """Relative error eta^2 of the energy of what all stages change, from states as they come.

    Where the last states differ in what is present, each change counts where the ground stays.

    Args:
        model: of the case.
        p: (n,) parameters, SI.
    """

    def __init__(self, model: StagedModel, p: Floats) -> None:
        self._model, self._point = model, ParameterPoint(model.values(p), ())
        self._stress: dict[int, Floats] = {}
        self._shapes = _shape_functions(model)
        self._wrong = self._whole = 0.0

    @property
    def relative(self) -> float:
        """Of the states so far."""
        both = self._whole + self._wrong
        return self._wrong / both if self._whole > 0.0 else 0.0

    def add(self, end: StageEnd) -> None:
        """The end of the next stage; the value of its stress counts."""
        model = self._model
        points = model.discretization.points
        stress = end.stress[..., 0].copy()
        state = model.sequence.states[end.number]
        self._stress[end.number] = stress
        if not end.number or state.base not in self._stress:
            return
        present = model.sequence.present(end.number)[points.element]
        change = np.where(present, stress - self._stress[state.base], 0.0)
        for material in sorted(set(state.materials.values())):
            groups = [g for g, name in state.materials.items() if name == material]
            where = np.flatnonzero(
                np.isin(model.sequence.group_of[points.element], groups) & present
            )
            elastic = elastic_matrix(
                model.case.materials[material].elastic,
                self._point,
                section=points.n_strain < _SOLID,
            )
            S = np.linalg.inv(elastic.value[: points.n_strain, : points.n_strain])
            part = change[:, where]
            gap = _smooth(model, self._shapes[where], where, part) - part
            V = points.volume[where]
            self._whole += float(np.einsum("im,ij,jm,m->", part, S, part, V, optimize=True))
            self._wrong += float(np.einsum("im,ij,jm,m->", gap, S, gap, V, optimize=True))


_SOLID = 6


def _shape_functions(model: StagedModel) -> sp.csr_array:
    """N (n_points, n_nodes), the shape functions at all strain points."""
    mesh = model.mesh
    columns, weights, counts = [], [], [np.zeros(1, dtype=np.int64)]
    for block, _ in spans(mesh.blocks):
        xi = model.discretization.kinematics.quadrature(block.kind)[0]
        shapes = reference_element(block.kind).shapes(xi)
        counts.append(np.full(len(block) * len(xi), shapes.shape[1]))
        columns.append(np.repeat(block.nodes, len(xi), axis=0).ravel())
        weights.append(np.tile(shapes, (len(block), 1)).ravel())
    indptr = np.cumsum(np.concatenate(counts))
    entries = np.concatenate(weights), np.concatenate(columns), indptr
    return sp.csr_array(entries, shape=(len(indptr) - 1, mesh.n_nodes))


def _smooth(model: StagedModel, N: sp.csr_array, where: Ints, values: Floats) -> Floats:
    """Values (s, q) at some strain points (q,) by means at nodes, interpolated back.

    Args:
        model: of the case.
        N: (q, n_nodes) shape functions there.
        where: (q,) the points.
        values: (s, q).
    """
    points = model.discretization.points
    near = sp.csr_array((np.abs(N.data), N.indices, N.indptr), shape=N.shape)
    V = points.volume[where]
    lumped = np.asarray(near.T @ V)
    sums = np.asarray(near.T @ (values * V).T)
    return np.asarray((N @ (sums / np.where(lumped > 0.0, lumped, 1.0)[:, None])).T)
