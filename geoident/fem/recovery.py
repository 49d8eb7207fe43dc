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
        patch = np.concatenate(
            [
                span.start
                + np.flatnonzero(np.isin(other.nodes, block.nodes[row]).any(axis=1) & group[span])
                for other, span in spans(mesh.blocks)
            ]
        )
    numbers, parts, first = list[Ints](), list[tuple[Ints, BlockGeometry]](), 0
    for other, rows in rows_in(mesh.blocks, patch):
        n_q = len(kinematics.quadrature(other.kind)[1])
        if len(rows):
            some = ElementBlock(other.kind, other.nodes[rows], other.numbers[rows])
            parts.append((some.nodes, block_geometry(mesh.points, some, kinematics)))
            numbers.append((first + rows[:, None] * n_q + np.arange(n_q)).ravel())
        first += len(other) * n_q
    positions = np.concatenate([g.positions.reshape(-1, mesh.dim) for _, g in parts])
    volumes = np.concatenate([g.volumes.ravel() for _, g in parts])
    weights = linear_fit(positions, volumes, place)
    gradients = sp.csr_array((kinematics.n_strain, mesh.points.size))
    ends = np.cumsum([len(own) for own in numbers])[:-1]
    for (nodes, geometry), own in zip(parts, np.split(weights, ends), strict=True):
        gradients = gradients + _strain(nodes, geometry, kinematics, own, mesh.points.size)
    return Recovery(np.concatenate(numbers), weights, sp.csr_array(gradients))


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


def _strain(
    nodes: Ints, geometry: BlockGeometry, kinematics: Kinematics, weights: Floats, n_dofs: int
) -> sp.csr_array:
    """Weighted sum (n_strain, n_dofs) of the strains at the points of elements of one kind.

    Args:
        nodes: (n_el, n_a) of the elements.
        geometry: of the elements.
        kinematics: of the analysis.
        weights: (n_el n_q,) of their strain points.
        n_dofs: degrees of freedom of the mesh.
    """
    n_el, n_q = geometry.volumes.shape
    summed = np.einsum("eq,eqan->ean", weights.reshape(n_el, n_q), geometry.gradients)
    rows, columns, data = [], [], []
    for component, terms in enumerate(kinematics.strains):
        for axis, entry in terms:
            columns.append((nodes * kinematics.dim + axis).ravel())
            data.append(summed[..., entry].ravel())
            rows.append(np.full(nodes.size, component))
    entries = np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(entries, shape=(kinematics.n_strain, n_dofs))
