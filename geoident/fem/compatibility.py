"""The compatibility operator C and the integration weights V (theory 1).

    eps = C u            strains of all strain points from displacements
    f   = C^T diag(V) sigma   nodal forces of a stress field

Strain points are numbered element by element in the mesh's order. Vectors of strain or stress are
stored *component by component*, (n_strain, n_points), so that the elastic law of one material is
one small matrix times one long one; row c m + i of C is component c at point i.

Components: plane strain (xx, yy, zz, xy) with eps_zz = 0, so that the out-of-plane stress needs no
special case; 3-D (xx, yy, zz, xy, yz, xz). Shear strains are gamma = 2 eps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import reference_element
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import ElementBlock, Mesh

N_STRAIN = {2: 4, 3: 6}
# Rows of C: component c is the sum over (derivative by axis j of displacement i).
COMPONENTS = {
    2: (((0, 0),), ((1, 1),), (), ((0, 1), (1, 0))),
    3: (((0, 0),), ((1, 1),), ((2, 2),), ((0, 1), (1, 0)), ((1, 2), (2, 1)), ((0, 2), (2, 0))),
}


@dataclass(frozen=True)
class BlockGeometry:
    """Derivatives of the shape functions at the strain points of one block.

    Args:
        gradients: (n_el, n_q, n_a, dim) dN_a/dx_j in 1/m.
        volumes: (n_el, n_q) integration weights, m3 (m2 times unit thickness in plane strain).
        shapes: (n_q, n_a) shape functions.
    """

    gradients: Floats
    volumes: Floats
    shapes: Floats


def block_geometry(points: Floats, block: ElementBlock) -> BlockGeometry:
    """Geometry of a block of elements whose orientation is right."""
    reference = reference_element(block.kind)
    local = reference.gradients(reference.points)
    corners = points[block.nodes]
    jacobian = np.einsum("eai,qaj->eqij", corners, local, optimize=True)
    determinant = np.linalg.det(jacobian)
    inverse = np.linalg.inv(jacobian)
    gradients = np.einsum("qaj,eqji->eqai", local, inverse, optimize=True)
    shapes = reference.shapes(reference.points)
    return BlockGeometry(gradients, determinant * reference.weights, shapes)


@dataclass(frozen=True)
class StrainPoints:
    """The strain points of a mesh.

    Args:
        compatibility: C, (n_strain n_points, n_dofs) sparse by rows.
        transpose: C^T, kept because transposing at every use costs as much as using it.
        volume: V, (n_points,).
        element: (n_points,) element index of each point.
        position: (n_points, dim) coordinates, m.
    """

    compatibility: sp.csr_array
    transpose: sp.csr_array
    volume: Floats
    element: Ints
    position: Floats

    @property
    def n_points(self) -> int:
        """Number m of strain points."""
        return int(self.volume.shape[0])

    @property
    def n_strain(self) -> int:
        """Number s of strain components."""
        return int(self.compatibility.shape[0]) // self.n_points

    def strain(self, u: Floats) -> Floats:
        """Strains (n_strain, n_points, ...) of displacements (n_dofs, ...)."""
        return np.asarray(self.compatibility @ u).reshape(
            (self.n_strain, self.n_points, *u.shape[1:])
        )

    def forces(self, stress: Floats, volume: Floats) -> Floats:
        """Nodal forces (n_dofs, ...) of stresses (n_strain, n_points, ...), with weights (m,).

        The weights are ``volume`` with zeros at the points that are absent.
        """
        weighted = stress * volume.reshape((1, -1) + (1,) * (stress.ndim - 2))
        flat = weighted.reshape((-1, *stress.shape[2:]))
        return np.asarray(self.transpose @ flat)


def strain_points(mesh: Mesh, geometries: tuple[BlockGeometry, ...]) -> StrainPoints:
    """C, V and where the points are, for all elements of a mesh."""
    volume = np.concatenate([g.volumes.ravel() for g in geometries])
    compatibility = _compatibility(mesh, geometries)
    element, first = [], 0
    for block, geometry in zip(mesh.blocks, geometries, strict=True):
        element.append(np.repeat(np.arange(first, first + len(block)), geometry.volumes.shape[1]))
        first += len(block)
    position = [
        np.einsum("qa,eai->eqi", g.shapes, mesh.points[b.nodes]).reshape(-1, mesh.dim)
        for b, g in zip(mesh.blocks, geometries, strict=True)
    ]
    return StrainPoints(
        compatibility, compatibility.T.tocsr(), volume, np.concatenate(element), np.vstack(position)
    )


def _compatibility(mesh: Mesh, geometries: tuple[BlockGeometry, ...]) -> sp.csr_array:
    """Built row by row in its final place: no sorting, no triplets."""
    n_columns = mesh.n_nodes * mesh.dim
    data, indices, counts = [], [], []
    for terms in COMPONENTS[mesh.dim]:
        for block, geometry in zip(mesh.blocks, geometries, strict=True):
            n_el, n_q, n_a, _ = geometry.gradients.shape
            counts.append(np.full(n_el * n_q, n_a * len(terms)))
            if terms:
                values = [geometry.gradients[..., axis] for _, axis in terms]
                columns = [block.nodes * mesh.dim + i for i, _ in terms]
                data.append(np.stack(values, axis=-1).ravel())
                nodes = np.stack(columns, axis=-1)[:, None]
                indices.append(np.broadcast_to(nodes, (n_el, n_q, n_a, len(terms))).ravel())
    indptr = np.concatenate([[0], np.cumsum(np.concatenate(counts))])
    return sp.csr_array(
        (np.concatenate(data), np.concatenate(indices), indptr), shape=(len(indptr) - 1, n_columns)
    )
