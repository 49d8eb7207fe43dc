"""A part of a mesh by itself: unknowns that move while all others stay where they are.

Where stresses concentrate, a few elements decide how many steps Newton's method takes. Their
equations are small, and solved by themselves they cost next to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from geoident.fem.kinematics import StrainPoints
from geoident.fem.solvers.direct import Factor, LowerPattern, SolverCounts
from geoident.fem.solvers.splu import SpluFactorization
from geoident.model.arrays import Bools, Floats, Ints

LAYERS = 2
"""Layers of elements around the unknowns that are asked for."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Unknowns of some nodes with all strain points that they strain.

    Fulfils what the equations of a stage ask of strain points, for displacements of its own.

    Args:
        points: (q,) strain points, ascending.
        dofs: (k,) degrees of freedom that strain these points, ascending.
        unknowns: (f,) numbers of the unknowns that move, ascending.
        places: (f,) where they stand among `dofs`.
        compatibility: C of the points, (s q, k) sparse, component by component.
    """

    points: Ints
    dofs: Ints
    unknowns: Ints
    places: Ints
    compatibility: sp.csr_array

    @property
    def n_points(self) -> int:
        """Number q of strain points."""
        return int(self.points.size)

    def strain(self, u: Floats) -> Floats:
        """Strains (s, q) of displacements (k,)."""
        return np.asarray(self.compatibility @ u).reshape(-1, self.n_points)

    def forces(self, stress: Floats, volume: Floats) -> Floats:
        """Nodal forces (k,) of stresses (s, q) with weights (q,)."""
        return np.asarray(self.compatibility.T @ (stress * volume).ravel())

    @cached_property
    def _moving(self) -> sp.csc_array:
        """C of the unknowns that move, (s q, f)."""
        return sp.csc_array(self.compatibility)[:, self.places]

    def stiffness(self, points: Ints, change: Floats) -> sp.csc_array:
        """(f, f) what changes of moduli add to K.

        Args:
            points: (p,) by their places among the points of the patch.
            change: (p, s, s) of the moduli times V.
        """
        s = change.shape[1]
        row, column = np.meshgrid(np.arange(s), np.arange(s), indexing="ij")
        at = points[:, None, None]
        entries = (
            change.ravel(),
            ((row * self.n_points + at).ravel(), (column * self.n_points + at).ravel()),
        )
        blocks = sp.csr_array(entries, shape=(s * self.n_points,) * 2)
        return sp.csc_array(self._moving.T @ (blocks @ self._moving))


def patch_around(
    strain_points: StrainPoints, present: Bools, dofs: Ints, unknowns: Ints, most: int
) -> Patch | None:
    """The patch around some unknowns; None where it has more than a number of them.

    Args:
        strain_points: of the mesh.
        present: (n_points,) those that are there.
        dofs: (n,) degree of freedom of each unknown.
        unknowns: (w,) numbers of the unknowns around which it is.
        most: unknowns that may move.
    """
    dim, touches = strain_points.kinematics.dim, strain_points.gradients[0]
    nodes = np.unique(dofs[unknowns] // dim)
    for _ in range(LAYERS):
        nodes = np.unique(_nodes(touches, _points(strain_points, present, nodes)))
        if nodes.size > most:
            return None
    points = _points(strain_points, present, nodes)
    inside = np.zeros(strain_points.n_dofs // dim, dtype=bool)
    inside[nodes] = True
    moving = np.flatnonzero(inside[dofs // dim])
    if moving.size > most:
        return None
    every = np.unique(_nodes(touches, points))
    own = (every[:, None] * dim + np.arange(dim)).ravel()
    compatibility = sp.csc_array(strain_points.compatibility(points))[:, own]
    places = np.searchsorted(own, dofs[moving])
    return Patch(points, own, moving, places, sp.csr_array(compatibility))


def _points(strain_points: StrainPoints, present: Bools, nodes: Ints) -> Ints:
    """Points that are there and that some nodes strain, ascending."""
    strained = strain_points.points_of_nodes
    points = np.unique(_rows(strained.indptr, strained.indices, nodes))
    return points[present[points]]


def _nodes(touches: sp.csr_array, points: Ints) -> Ints:
    """Nodes that strain some points, with repetitions."""
    return _rows(touches.indptr, touches.indices, points)


def _rows(indptr: npt.NDArray[Any], indices: npt.NDArray[Any], rows: Ints) -> Ints:
    """The entries of some rows of a compressed pattern, one row after the other."""
    counts = indptr[rows + 1] - indptr[rows]
    ends = np.cumsum(counts)
    within = np.arange(ends[-1] if ends.size else 0) - np.repeat(ends - counts, counts)
    return np.asarray(indices[np.repeat(indptr[rows], counts) + within])


class PatchTangents:
    """Factorizes the stiffness of a patch.

    Args:
        patch: the patch.
        elastic: (f, f) lower triangle of its elastic K, by columns, entries of all node pairs.
    """

    def __init__(self, patch: Patch, elastic: sp.csc_array) -> None:
        elastic.sort_indices()
        self._patch, self._values = patch, elastic.data
        pattern = LowerPattern(elastic.indptr.astype(np.int64), elastic.indices.astype(np.int64))
        columns = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
        self._keys = columns * pattern.n + pattern.indices
        self._analysis = SpluFactorization(pattern, SolverCounts())

    def factorize(self, points: Ints, change: Floats, *, symmetric: bool) -> Factor:
        """Factor of K plus symmetric changes (p, s, s) of V E at some points (p,) of the patch.

        Raises:
            NotPositiveDefinite: it has none.
        """
        assert symmetric
        values = self._values
        if len(points):
            added = sp.coo_array(sp.tril(self._patch.stiffness(points, change)))
            row, column = added.coords
            keys = column.astype(np.int64) * added.shape[0] + row
            values = values + np.bincount(
                np.searchsorted(self._keys, keys), weights=added.data, minlength=len(values)
            )
        return self._analysis.factorize(values)
