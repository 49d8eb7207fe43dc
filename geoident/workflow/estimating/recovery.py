"""The error of a mesh from the jumps of its stress, at no further factorization.

A smooth stress sigma* is made of that of the strain points by means at the nodes, each material by
itself (Zienkiewicz & Zhu 1987). What it differs from sigma is about the error of the stress.

Where ground is elastic, the error of a reading is the work of this error on that of the reading's
own adjoint strain (Becker & Rannacher 2001), summed over the stages l,

    v - v_h  ~  sum_l  integral  (sigma*_l - sigma_l) : (eps*(lambda_l) - eps(lambda_l))

with sigma_l all that construction has changed until then. Where parts of it have both signs their
sum may vanish by chance: the size is taken in the middle between that of the sum and the sum of the
sizes.

Where ground yields there is no adjoint, and the part eta^2 of the energy is all that is known,

    eta^2 = |sigma* - sigma|^2 / (|sigma|^2 + |sigma* - sigma|^2)

in the norm of the compliance. The energy of the change is the work of what was excavated and
loaded, so eta^2 is about the relative error of the motions of the loaded faces.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import reference_element
from geoident.fem.solvers import BEYOND
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.model import StagedModel
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import spans
from geoident.workflow.running.cost import estimate_cost

_MOST_SOLVES = 250
"""Right-hand sides of adjoints for each stage, as costly as about three factorizations in space."""


def reading_errors(model: StagedModel, p: Floats) -> Floats | None:
    """Estimated error (n_channels, n_stages) of all readings, exact less computed, SI.

    Args:
        model: of the case.
        p: (n,) parameters, SI.

    Returns:
        NaN where nothing can be read; None where there are no adjoints: ground yields, or a gauge
        reads a principal stress; or where they cost too much: for many readings, or by iterations.
    """
    last = len(model.bases) - 1
    places = model.readable_until(last)
    way = model.way_back(places, last)
    if way.obstacle is not None or way.solves > _MOST_SOLVES * len(model.bases):
        return None
    if estimate_cost(model, solver=model.solver_name, rough=True).solver == BEYOND:
        return None
    run = model.at(p, RunOptions(derivatives=False, traced=True))
    shapes, points = _shape_functions(model), model.discretization.points
    virgin, weights = np.empty(0), {}
    for end in run.states():
        if end.number == 0:
            virgin = end.stress[..., 0].copy()
            continue
        by_material = _points_by_material(model, end.number)
        change, gap = end.stress[..., 0] - virgin, np.zeros_like(virgin)
        for where in by_material.values():
            part = change[:, where]
            gap[:, where] = _smooth(model, shapes[where], where, part) - part
        weights[end.number] = partial(
            _work, model, shapes, list(by_material.values()), gap * points.volume
        )
    signed, size = way.weigh(run, end, weights)
    error = np.full((len(model.case.channels), last), np.nan)
    error[places.rows, places.states - 1] = np.copysign((np.abs(signed) + size) / 2.0, signed)
    return error


def _work(
    model: StagedModel, shapes: sp.csr_array, materials: list[Ints], gap: Floats, adjoint: Floats
) -> tuple[float, float]:
    """Work of a stress on the jumps of the strain of adjoint displacements, and its size.

    Args:
        model: of the case.
        shapes: (n_points, n_nodes).
        materials: strain points of each.
        gap: (n_strain, n_points) sigma* - sigma, times volume.
        adjoint: (n_dofs,) displacements.
    """
    strain, signed, size = model.discretization.points.strain(adjoint), 0.0, 0.0
    for where in materials:
        part = strain[:, where]
        work = np.sum(gap[:, where] * (_smooth(model, shapes[where], where, part) - part), axis=0)
        signed += float(work.sum())
        size += float(np.abs(work).sum())
    return signed, size


def _points_by_material(model: StagedModel, number: int) -> dict[str, Ints]:
    """The strain points that are there at a state, by the name of their material."""
    state, element = model.sequence.states[number], model.discretization.points.element
    present, group = model.sequence.present(number)[element], model.sequence.group_of[element]
    by_material = {}
    for material in sorted(set(state.materials.values())):
        groups = [g for g, name in state.materials.items() if name == material]
        by_material[material] = np.flatnonzero(np.isin(group, groups) & present)
    return by_material


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
        change = stress - self._stress[state.base]
        for material, where in _points_by_material(model, end.number).items():
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
