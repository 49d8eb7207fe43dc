"""The compatibility operator C and the integration weights V (theory 1).

    eps = C u            strains of all strain points from displacements
    f   = C^T diag(V) sigma   nodal forces of a stress field

Strain points are numbered element by element in the mesh's order. Vectors of strain or stress are
stored *component by component*, (n_strain, n_points), so that the elastic law of one material is
one small matrix times one long one; row c m + i of C is component c at point i.
The components of each kind of analysis are in `kinematics`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import reference_element
from geoident.fem.kinematics import Kinematics, Terms
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import ElementBlock, Mesh


@dataclass(frozen=True)
class BlockGeometry:
    """Shape functions and what derives from them at the strain points of one block.

    Args:
        gradients: (n_el, n_q, n_a, n_entries) gradient vectors of the nodes, 1/m.
        volumes: (n_el, n_q) integration weights, m3 (of a unit thickness in plane strain, of the
            whole turn in a body of revolution).
        shapes: (n_q, n_a) shape functions.
        positions: (n_el, n_q, dim) strain points, m.
    """

    gradients: Floats
    volumes: Floats
    shapes: Floats
    positions: Floats


def block_geometry(points: Floats, block: ElementBlock, kinematics: Kinematics) -> BlockGeometry:
    """Geometry of a block of elements whose orientation is right.

    Args:
        points: (n_nodes, dim) nodes of the mesh, m.
        block: elements of one kind.
        kinematics: of the analysis.
    """
    reference = reference_element(block.kind)
    xi, weights = kinematics.quadrature(block.kind)
    shapes, local = reference.shapes(xi), reference.gradients(xi)
    corners = points[block.nodes]
    jacobian = np.einsum("eai,qaj->eqij", corners, local, optimize=True)
    determinant = np.linalg.det(jacobian)
    inverse = np.linalg.inv(jacobian)
    gradients = np.einsum("qaj,eqji->eqai", local, inverse, optimize=True)
    positions = np.einsum("qa,eai->eqi", shapes, corners, optimize=True)
    volumes = determinant * weights * kinematics.depth(positions)
    vectors = kinematics.gradient_vectors(gradients, shapes, positions)
    return BlockGeometry(vectors, volumes, shapes, positions)


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


def strain_points(
    mesh: Mesh, geometries: tuple[BlockGeometry, ...], kinematics: Kinematics
) -> StrainPoints:
    """C, V and where the points are, for all elements of a mesh.

    Args:
        mesh: the mesh.
        geometries: of its blocks, in their order.
        kinematics: of the analysis.
    """
    volume = np.concatenate([g.volumes.ravel() for g in geometries])
    compatibility = _compatibility(mesh, geometries, kinematics.strains)
    per_element = [np.full(len(g.volumes), g.volumes.shape[1]) for g in geometries]
    element = np.repeat(np.arange(mesh.n_elements), np.concatenate(per_element))
    position = [g.positions.reshape(-1, mesh.dim) for g in geometries]
    return StrainPoints(
        compatibility, compatibility.T.tocsr(), volume, element, np.vstack(position)
    )


def _compatibility(
    mesh: Mesh, geometries: tuple[BlockGeometry, ...], strains: tuple[Terms, ...]
) -> sp.csr_array:
    """Built row by row in its final place: no sorting, no triplets."""
    n_columns = mesh.n_nodes * mesh.dim
    data, indices, counts = [], [], []
    for terms in strains:
        for block, geometry in zip(mesh.blocks, geometries, strict=True):
            n_el, n_q, n_a, _ = geometry.gradients.shape
            counts.append(np.full(n_el * n_q, n_a * len(terms)))
            if terms:
                values = [geometry.gradients[..., entry] for _, entry in terms]
                columns = [block.nodes * mesh.dim + i for i, _ in terms]
                data.append(np.stack(values, axis=-1).ravel())
                nodes = np.stack(columns, axis=-1)[:, None]
                indices.append(np.broadcast_to(nodes, (n_el, n_q, n_a, len(terms))).ravel())
    indptr = np.concatenate([[0], np.cumsum(np.concatenate(counts))])
    return sp.csr_array(
        (np.concatenate(data), np.concatenate(indices), indptr), shape=(len(indptr) - 1, n_columns)
    )
