"""Heat in a mesh: capacity, conduction and films on faces (theory 16.7).

With T the temperatures of the nodes, the heat balance of a body is

    M T' + H T = f ,   M = int rho c N N^T dV ,   H = int k grad N grad N^T dV + int h N N^T dA

and f = int h N theta dA on faces with a film of coefficient h (W/m2K) against a temperature theta.
All matrices here are those of the unit property: of one material, of one face group.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import mass_rule, reference_element
from geoident.fem.faces import FacetPatch
from geoident.fem.kinematics import Kinematics
from geoident.fem.loads import facet_geometry
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh, spans


def capacity_and_conduction(
    mesh: Mesh, kinematics: Kinematics, elements: Bools
) -> tuple[sp.csr_array, sp.csr_array]:
    """M and H (n_nodes, n_nodes) of some elements (n_elements,), for rho c = 1 and k = 1."""
    capacity, conduction = [], []
    for block, span in spans(mesh.blocks):
        nodes = block.nodes[elements[span.start : span.stop]]
        xi, weights = mass_rule(block.kind)
        reference = reference_element(block.kind)
        shapes, local = reference.shapes(xi), reference.gradients(xi)
        corners = mesh.points[nodes]
        jacobian = np.einsum("eai,qaj->eqij", corners, local, optimize=True)
        gradients = np.einsum("qaj,eqji->eqai", local, np.linalg.inv(jacobian), optimize=True)
        positions = np.einsum("qa,eai->eqi", shapes, corners, optimize=True)
        volumes = np.linalg.det(jacobian) * weights * kinematics.depth(positions)
        pairs = np.einsum("eq,qa,qb->eab", volumes, shapes, shapes, optimize=True)
        capacity.append((nodes, pairs))
        pairs = np.einsum("eq,eqai,eqbi->eab", volumes, gradients, gradients, optimize=True)
        conduction.append((nodes, pairs))
    return _summed(mesh, capacity), _summed(mesh, conduction)


def film(mesh: Mesh, kinematics: Kinematics, faces: Iterable[FacetPatch]) -> sp.csr_array:
    """The matrix int N N^T dA (n_nodes, n_nodes) of some faces: a film of coefficient one."""
    parts = []
    for patch in faces:
        geometry = facet_geometry(mesh.points, patch, kinematics)
        area = np.linalg.norm(geometry.normals, axis=2)
        pairs = np.einsum("fq,qa,qb->fab", area, geometry.shapes, geometry.shapes, optimize=True)
        parts.append((patch.nodes, pairs))
    return _summed(mesh, parts)


def _summed(mesh: Mesh, parts: Iterable[tuple[Ints, Floats]]) -> sp.csr_array:
    """A matrix of the nodes from those (n, a, a) of elements with nodes (n, a)."""
    total = sp.csr_array((mesh.n_nodes, mesh.n_nodes))
    for nodes, pairs in parts:
        rows = np.broadcast_to(nodes[:, :, None], pairs.shape).ravel()
        columns = np.broadcast_to(nodes[:, None, :], pairs.shape).ravel()
        total = total + sp.coo_array((pairs.ravel(), (rows, columns)), shape=total.shape).tocsr()
    return sp.csr_array(total)
