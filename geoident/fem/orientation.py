"""Orientation of elements: turned ones are mended, folded ones are refused by their number.

Right-handed neighbours lie on both sides of the face that they share, and so see its nodes in
opposite order. Where they see them in the same order both lie on one side and overlap: the mesh is
tangled, as by a node that stands in the wrong place.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.errors import Fault, InputError, Location
from geoident.fem.elements import ReferenceElement, reference_element
from geoident.fem.faces import FaceTable
from geoident.fem.kinematics import Kinematics
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh

_FLAT = 1e-12  # of the volume of a regular element: below this an element has no volume
_SHOWN = 10  # numbers in a message: enough to find the place


def oriented(mesh: Mesh, kinematics: Kinematics) -> Mesh:
    """The mesh with every element right-handed.

    Raises:
        InputError: elements that are folded, or flat, with their numbers.
    """
    faults: list[Fault] = []
    blocks = tuple(_oriented_block(mesh, block, kinematics, faults) for block in mesh.blocks)
    if faults:
        raise InputError(faults)
    return replace(mesh, blocks=blocks)


def turned_elements(before: Mesh, after: Mesh) -> Ints:
    """Numbers (k,) of the elements that `oriented` has turned."""
    pairs = zip(before.blocks, after.blocks, strict=True)
    changed = [a.numbers[np.any(a.nodes != b.nodes, axis=1)] for a, b in pairs]
    return np.concatenate([np.empty(0, np.int64), *changed])


def overlapping(mesh: Mesh, table: FaceTable) -> Ints:
    """Pairs (k, 2) of elements that lie on the same side of the face that they share.

    Args:
        mesh: of right-handed elements.
        table: its faces.
    """
    seen = np.empty(len(table.element), dtype=np.bool_)
    for block, local, rows, nodes in table.by_place(mesh, np.arange(len(table.element))):
        seen[rows] = _forwards(nodes[:, : len(CELLS[block.kind].shape.faces[local])])
    order = np.lexsort((seen, table.face))  # those of one face together, seen alike side by side
    same = (np.diff(table.face[order]) == 0) & (seen[order][1:] == seen[order][:-1])
    at = np.flatnonzero(same)
    return np.asarray(table.element[np.stack([order[at], order[at + 1]], axis=1)])


def _forwards(nodes: Ints) -> Bools:
    """Which faces (n, k) go on from their smallest node towards the smaller of its neighbours."""
    n, k = nodes.shape
    rows, first = np.arange(n), nodes.argmin(axis=1)
    after, before = nodes[rows, (first + 1) % k], nodes[rows, first - 1]
    return np.asarray(first == 0 if k <= 2 else after < before)


def _oriented_block(
    mesh: Mesh, block: ElementBlock, kinematics: Kinematics, faults: list[Fault]
) -> ElementBlock:
    reference = reference_element(block.kind)
    determinant = _determinants(mesh.points, block, kinematics.quadrature(block.kind)[0])
    size = np.ptp(mesh.points[block.nodes], axis=1).max(axis=1) ** mesh.dim
    sign = np.where(np.abs(determinant) > _FLAT * size[:, None], np.sign(determinant), 0.0)
    turned = np.all(sign < 0, axis=1)
    folded = ~turned & ~np.all(sign > 0, axis=1)
    if np.any(folded):
        faults.append(_fault(mesh, block, np.flatnonzero(folded)))
    if not np.any(turned):
        return block
    nodes = block.nodes.copy()
    nodes[turned] = nodes[turned][:, _mirror(reference)]
    return replace(block, nodes=nodes)


def _determinants(points: Floats, block: ElementBlock, xi: Floats) -> Floats:
    """Jacobian determinants (n_el, n) at the strain points (n_q, dim) and the corners."""
    reference = reference_element(block.kind)
    corners = reference.nodes[: reference.cell.n_corners]
    local = reference.gradients(np.vstack([xi, corners]))
    return np.asarray(
        np.linalg.det(np.einsum("eai,qaj->eqij", points[block.nodes], local, optimize=True))
    )


def _mirror(reference: ReferenceElement) -> Ints:
    """Permutation of the nodes when the first two reference axes are exchanged."""
    mirrored = reference.nodes.copy()
    mirrored[:, [0, 1]] = mirrored[:, [1, 0]]
    distance = np.abs(mirrored[:, None] - reference.nodes[None]).sum(axis=2)
    return np.asarray(distance.argmin(axis=1))


def _fault(mesh: Mesh, block: ElementBlock, elements: Ints) -> Fault:
    numbers = ", ".join(str(n) for n in block.numbers[elements[:_SHOWN]])
    more = f" and {len(elements) - _SHOWN} more" if len(elements) > _SHOWN else ""
    centre = mesh.points[block.nodes[elements[0]]].mean(axis=0)
    place = ", ".join(f"{x:.6g}" for x in centre)
    return Fault(
        "folded-element",
        f"{block.kind} elements {numbers}{more} are folded or flat (the first near ({place}) m)",
        "check the mesh there: nodes numbered across, mid-nodes too far off, or zero thickness",
        Location(mesh.file),
    )
