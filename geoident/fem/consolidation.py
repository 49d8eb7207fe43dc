"""Ground with water in its pores: coupling, storage and flow (Biot; theory 17).

With u the displacements, and p the pressure of the water in excess of that at rest, compression
positive, at the corners of elements of second order (Taylor and Hood),

    K u - Q p = f ,     Q^T u' + S p' + H p = 0

    Q = int B^T m alpha N dV ,   S = int c N^T N dV ,   H = sum_j int (k_j / gamma_w) N_,j^T N_,j dV

with m the strains that make up a change of volume, alpha Biot's coefficient, c the storage (1/Pa),
k_j the permeability along axis j and gamma_w the unit weight of the water. The matrices here are
those for alpha = 1, c = 1 and k_j / gamma_w = 1. A pressure of the first order beside motions of
the second one has no spurious modes, also where nothing can flow and nothing is stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import reference_element
from geoident.fem.kinematics import NORMAL_COMPONENTS, BlockGeometry, Kinematics
from geoident.fem.location import reference_coordinates
from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS, CellShape
from geoident.model.mesh import Mesh, rows_in, spans

_FIRST_ORDER = {cell.shape: kind for kind, cell in CELLS.items() if cell.order == 1}
"""Shape of a cell to its kind of first order."""


@dataclass(frozen=True)
class PoreMatrices:
    """Matrices of some elements, for unit properties.

    Args:
        nodes: (n_p,) corners of the elements, ascending: where their pressures are.
        coupling: Q, (n_dofs, n_nodes).
        storage: S, (n_nodes, n_nodes).
        flow: H of each axis, (n_nodes, n_nodes).
    """

    nodes: Ints
    coupling: sp.csr_array
    storage: sp.csr_array
    flow: tuple[sp.csr_array, ...]


def pore_matrices(
    mesh: Mesh, geometries: Sequence[BlockGeometry], kinematics: Kinematics, elements: Ints
) -> PoreMatrices:
    """The matrices of some elements (k,) of second order.

    Args:
        mesh: the mesh.
        geometries: of its blocks, at their strain points.
        kinematics: of the analysis.
        elements: (k,) their indices.
    """
    dim, n, n_dofs = mesh.dim, mesh.n_nodes, mesh.n_nodes * mesh.dim
    coupling, storage = sp.csr_array((n_dofs, n)), sp.csr_array((n, n))
    flow = [sp.csr_array((n, n)) for _ in range(dim)]
    corners = [np.empty(0, np.int64)]
    for (block, rows), geometry in zip(rows_in(mesh.blocks, elements), geometries, strict=True):
        if not len(rows):
            continue
        shape, nodes = CELLS[block.kind].shape, block.nodes[rows]
        ends = nodes[:, : len(shape.corners)]
        corners.append(ends.ravel())
        volumes = geometry.volumes[rows]
        xi = kinematics.quadrature(block.kind)[0]
        shapes = pressure_shapes(shape, xi)
        dilatation = _dilatation(kinematics, geometry.gradients[rows])
        pairs = np.einsum("eq,eqai,qb->eaib", volumes, dilatation, shapes, optimize=True)
        dofs = (nodes[:, :, None] * dim + np.arange(dim)).reshape(len(rows), -1)
        coupling = coupling + _summed(dofs, ends, pairs.reshape(*dofs.shape, -1), (n_dofs, n))
        pairs = np.einsum("eq,qa,qb->eab", volumes, shapes, shapes, optimize=True)
        storage = storage + _summed(ends, ends, pairs, (n, n))
        local = reference_element(block.kind).gradients(xi)
        jacobian = np.einsum("eai,qaj->eqij", mesh.points[nodes], local, optimize=True)
        linear = reference_element(_FIRST_ORDER[shape]).gradients(xi)
        slopes = np.einsum("qaj,eqji->eqai", linear, np.linalg.inv(jacobian), optimize=True)
        for j in range(dim):
            slope = slopes[..., j]
            pairs = np.einsum("eq,eqa,eqb->eab", volumes, slope, slope, optimize=True)
            flow[j] = flow[j] + _summed(ends, ends, pairs, (n, n))
    return PoreMatrices(np.unique(np.concatenate(corners)), coupling, storage, tuple(flow))


def pressure_shapes(shape: CellShape, xi: Floats) -> Floats:
    """Shape functions (..., n_corners) of the pressure at reference points (..., dim)."""
    return reference_element(_FIRST_ORDER[shape]).shapes(xi)


def pressure_at(mesh: Mesh, element: int, position: Floats) -> tuple[Ints, Floats]:
    """Corners (n_corners,) of an element, and their shares in the pressure at a position (dim,)."""
    for block, span in spans(mesh.blocks):
        if span.start <= element < span.stop:
            nodes, reference = block.nodes[element - span.start], reference_element(block.kind)
            xi = reference_coordinates(reference, mesh.points[nodes][None], position[None])[0]
            shape = CELLS[block.kind].shape
            return nodes[: len(shape.corners)], pressure_shapes(shape, xi)
    raise IndexError("no such element")


def _dilatation(kinematics: Kinematics, gradients: Floats) -> Floats:
    """Change of volume (n_el, n_q, n_a, dim) by each displacement of each node."""
    adds = kinematics.incidence[:NORMAL_COMPONENTS].sum(axis=0)
    return np.asarray(gradients @ adds.T)


def _summed(rows: Ints, columns: Ints, pairs: Floats, shape: tuple[int, int]) -> sp.csr_array:
    """A matrix from those (n, a, b) of elements, with their rows (n, a) and columns (n, b)."""
    at = np.broadcast_to(rows[:, :, None], pairs.shape).ravel()
    across = np.broadcast_to(columns[:, None, :], pairs.shape).ravel()
    return sp.csr_array(sp.coo_array((pairs.ravel(), (at, across)), shape=shape))
