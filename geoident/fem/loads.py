"""Nodal forces of what acts on faces and of weight (theory 1, F)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.fem.elasticity import VOIGT
from geoident.fem.elements import divided_rule, raised_rule, reference_element
from geoident.fem.faces import FacetPatch
from geoident.fem.kinematics import BlockGeometry, Kinematics
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import Mesh, rows_in


@dataclass(frozen=True)
class FacetGeometry:
    """Quadrature on the faces of a patch.

    Args:
        shapes: (n_q, n_a) shape functions.
        normals: (n, n_q, dim) outward normals times integration weights, m2 (of a unit thickness
            in plane strain, of the whole turn in a body of revolution).
        positions: (n, n_q, dim) quadrature points, m.
    """

    shapes: Floats
    normals: Floats
    positions: Floats


def facet_geometry(
    points: Floats, patch: FacetPatch, kinematics: Kinematics, parts: int = 1
) -> FacetGeometry:
    """Quadrature points, weights and outward normals of a patch.

    Args:
        points: (n_nodes, dim) nodes of the mesh, m.
        patch: faces of one kind.
        kinematics: of the analysis.
        parts: into which each edge of a face is divided for the quadrature.
    """
    reference = reference_element(patch.kind)
    xi, weights = raised_rule(patch.kind) if parts == 1 else divided_rule(patch.kind, parts)
    shapes, local = reference.shapes(xi), reference.gradients(xi)
    corners = points[patch.nodes]
    tangents = np.einsum("fai,qaj->fqij", corners, local)
    if points.shape[1] == 2:
        t = tangents[..., 0]
        normals = np.stack([t[..., 1], -t[..., 0]], axis=-1)
    else:
        normals = np.cross(tangents[..., 0], tangents[..., 1])
    positions = np.einsum("qa,fai->fqi", shapes, corners)
    areas = np.expand_dims(weights * kinematics.depth(positions), -1)
    return FacetGeometry(shapes, normals * areas, positions)


def pressure_forces(mesh: Mesh, patch: FacetPatch, kinematics: Kinematics) -> Floats:
    """Nodal forces (n_dofs,) of a unit pressure that pushes onto the body.

    Args:
        mesh: the mesh.
        patch: faces of one kind.
        kinematics: of the analysis.
    """
    geometry = facet_geometry(mesh.points, patch, kinematics)
    return _scatter(mesh, patch, np.einsum("qa,fqi->fai", geometry.shapes, -geometry.normals))


def pressure_operator(
    mesh: Mesh, patch: FacetPatch, kinematics: Kinematics, parts: int = 1
) -> tuple[Floats, sp.csr_array]:
    """Where pressures on a patch are asked for, and the forces that they make.

    Args:
        mesh: the mesh.
        patch: faces of one kind.
        kinematics: of the analysis.
        parts: into which each edge of a face is divided for the quadrature.

    Returns:
        (m, dim) quadrature points, m, and the matrix (n_dofs, m) from pressures there, Pa, to
        nodal forces, N.
    """
    geometry = facet_geometry(mesh.points, patch, kinematics, parts)
    n_faces, n_q, dim = geometry.normals.shape
    shares = np.einsum("qa,fqi->fqai", geometry.shapes, -geometry.normals)
    rows = patch.nodes[:, None, :, None] * dim + np.arange(dim)
    columns = np.arange(n_faces * n_q).reshape(n_faces, n_q, 1, 1)
    places = np.broadcast_to(rows, shares.shape), np.broadcast_to(columns, shares.shape)
    operator = sp.coo_array(
        (shares.ravel(), tuple(place.ravel() for place in places)),
        shape=(mesh.n_nodes * dim, n_faces * n_q),
    )
    return geometry.positions.reshape(-1, dim), operator.tocsr()


def traction_weights(mesh: Mesh, patch: FacetPatch, kinematics: Kinematics) -> Floats:
    """Area (n_nodes,) that belongs to each node: integral of its shape function, m2.

    Args:
        mesh: the mesh.
        patch: faces of one kind.
        kinematics: of the analysis.
    """
    geometry = facet_geometry(mesh.points, patch, kinematics)
    area = np.linalg.norm(geometry.normals, axis=2)
    weights = np.zeros(mesh.n_nodes)
    np.add.at(weights, patch.nodes, np.einsum("qa,fq->fa", geometry.shapes, area))
    return weights


def stress_forces(mesh: Mesh, patch: FacetPatch, geometry: FacetGeometry, sigma: Floats) -> Floats:
    """Nodal forces (n_dofs, ...) of the tractions sigma n of a stress field.

    Args:
        mesh: the mesh.
        patch: the faces on which the tractions act.
        geometry: of the patch.
        sigma: (n_strain, m, ...) stresses at its quadrature points, Pa.
    """
    tensor = sigma[VOIGT[mesh.dim]].reshape(
        (mesh.dim, mesh.dim, *geometry.normals.shape[:2], *sigma.shape[2:])
    )
    forces = np.einsum("qa,ijfq...,fqj->fai...", geometry.shapes, tensor, geometry.normals)
    return _scatter(mesh, patch, forces)


def weight_shares(mesh: Mesh, geometries: tuple[BlockGeometry, ...], elements: Ints) -> Floats:
    """Volume (n_nodes,) that belongs to each node, of some elements: integral of N_a, m3.

    Args:
        mesh: the mesh.
        geometries: of its blocks, in their order.
        elements: (k,) indices of the elements.
    """
    shares = np.zeros(mesh.n_nodes)
    for (block, rows), geometry in zip(rows_in(mesh.blocks, elements), geometries, strict=True):
        volumes = geometry.volumes[rows] @ geometry.shapes
        shares += np.bincount(
            block.nodes[rows].ravel(), weights=volumes.ravel(), minlength=mesh.n_nodes
        )
    return shares


def _scatter(mesh: Mesh, patch: FacetPatch, forces: Floats) -> Floats:
    """Sum forces (n_f, n_a, dim, ...) of faces into (n_dofs, ...)."""
    total = np.zeros((mesh.n_nodes, *forces.shape[2:]))
    np.add.at(total, patch.nodes, forces)
    return total.reshape((mesh.n_nodes * mesh.dim, *forces.shape[3:]))
