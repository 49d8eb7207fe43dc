"""Stresses and strains at points of the ground, from those at the strain points around them.

What the elements know best they know at their strain points. At any other point a linear field is
fitted to them in least squares, each weighted with its volume, and taken there:

* in elements of order 2, to the strain points of the element that holds the point;
* in elements of order 1, whose stress hardly varies within one of them, to those of the element
  and of its neighbours in the same group (the patch recovery of Zienkiewicz & Zhu, Int. J. Numer.
  Meth. Eng. 33, 1992), so that no stress of another material, or of ground placed at another time,
  mixes in.

A field that is linear in space is met exactly, on any mesh of either order; any other with an error
that falls with h^2, as long as the stress at the strain points does (h where elements of order 1
are irregular). Where the strain points lie on a line or in a plane (a group one element thick) the
field is taken as constant across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import reference_element
from geoident.fem.kinematics import BlockGeometry, Kinematics, block_geometry
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import ElementBlock, Mesh, rows_in, spans

_DEPENDENT = 1e-8
"""Singular value, relative to the largest, below which strain points lie in a line or a plane."""


@dataclass(frozen=True)
class Recovery:
    """How a stress or strain at one point follows from those at some strain points.

    Args:
        points: (k,) their numbers.
        weights: (k,) of each; they add up to one.
        gradients: (n_strain, n_dofs) sparse: the strain at the point from displacements.
    """

    points: Ints
    weights: Floats
    gradients: sp.csr_array

    def at(self, field: Floats) -> Floats:
        """What a field (n_strain, n_points, ...) is at the point, (n_strain, ...)."""
        return np.asarray(np.tensordot(self.weights, field[:, self.points], axes=([0], [1])))


def recovery(
    mesh: Mesh, kinematics: Kinematics, element: int, group: Bools, place: Floats
) -> Recovery:
    """The recovery at a point that an element holds.

    Args:
        mesh: the mesh.
        kinematics: of the analysis.
        element: index of the element.
        group: (n_elements,) the elements that belong together with it.
        place: (dim,) the point, m.
    """
    block, row = next(
        (block, element - span.start)
        for block, span in spans(mesh.blocks)
        if span.start <= element < span.stop
    )
    patch = np.array([element])
    if reference_element(block.kind).cell.order == 1:
        patch = _touching(mesh, block.nodes[row], group)
    parts = [
        _Part(mesh, kinematics, other, rows, first)
        for (other, rows), first in zip(
            rows_in(mesh.blocks, patch), _first_points(mesh, kinematics), strict=True
        )
        if len(rows)
    ]
    numbers = np.concatenate([part.numbers for part in parts])
    positions = np.concatenate([part.geometry.positions.reshape(-1, mesh.dim) for part in parts])
    volumes = np.concatenate([part.geometry.volumes.ravel() for part in parts])
    weights = linear_fit(positions, volumes, place)
    rows = np.split(weights, np.cumsum([len(part.numbers) for part in parts])[:-1])
    strain = sum(
        (part.strain(own) for part, own in zip(parts, rows, strict=True)),
        sp.csr_array((kinematics.n_strain, mesh.points.size)),
    )
    return Recovery(numbers, weights, sp.csr_array(strain))


def linear_fit(positions: Floats, volumes: Floats, place: Floats) -> Floats:
    """Weights (k,) that make of values at positions their linear fit at a place.

    Args:
        positions: (k, dim) m.
        volumes: (k,) weight of each in the squares.
        place: (dim,) m.
    """
    centre = volumes @ positions / volumes.sum()
    size = np.abs(positions - centre).max(initial=0.0) or 1.0
    root = np.sqrt(volumes)
    terms = np.column_stack([np.ones(len(positions)), (positions - centre) / size])
    inverse = np.linalg.pinv(root[:, None] * terms, rcond=_DEPENDENT)
    return np.asarray(np.concatenate([[1.0], (place - centre) / size]) @ inverse * root)


class _Part:
    """The elements of one block that belong to a patch.

    Args:
        mesh: the mesh.
        kinematics: of the analysis.
        block: the block.
        rows: (n_el,) its elements in the patch.
        first: number of the first strain point of the block.
    """

    def __init__(
        self, mesh: Mesh, kinematics: Kinematics, block: ElementBlock, rows: Ints, first: int
    ) -> None:
        self._kinematics, self._n_dofs = kinematics, mesh.points.size
        self._nodes = block.nodes[rows]
        some = ElementBlock(block.kind, self._nodes, block.numbers[rows])
        self.geometry: BlockGeometry = block_geometry(mesh.points, some, kinematics)
        n_q = self.geometry.volumes.shape[1]
        self.numbers = (first + rows[:, None] * n_q + np.arange(n_q)).ravel()

    def strain(self, weights: Floats) -> sp.csr_array:
        """Weighted sum (n_strain, n_dofs) of the strains of its points, weights (k,)."""
        n_el, n_q, _, _ = self.geometry.gradients.shape
        summed = np.einsum("eq,eqan->ean", weights.reshape(n_el, n_q), self.geometry.gradients)
        rows, columns, data = [], [], []
        for component, terms in enumerate(self._kinematics.strains):
            for axis, entry in terms:
                columns.append((self._nodes * self._kinematics.dim + axis).ravel())
                data.append(summed[..., entry].ravel())
                rows.append(np.full(len(columns[-1]), component))
        entries = (np.concatenate(rows), np.concatenate(columns))
        shape = (self._kinematics.n_strain, self._n_dofs)
        return sp.csr_array((np.concatenate(data), entries), shape=shape)


def _touching(mesh: Mesh, nodes: Ints, group: Bools) -> Ints:
    """Elements (k,) of a group that have one of some nodes."""
    touching = []
    for block, span in spans(mesh.blocks):
        near = np.isin(block.nodes, nodes).any(axis=1)
        touching.append(span.start + np.flatnonzero(near & group[span]))
    return np.concatenate(touching)


def _first_points(mesh: Mesh, kinematics: Kinematics) -> list[int]:
    """Number of the first strain point of every block."""
    counts = [len(block) * len(kinematics.quadrature(block.kind)[1]) for block in mesh.blocks]
    return [0, *np.cumsum(counts)[:-1].tolist()]
