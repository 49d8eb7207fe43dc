"""Ground that is meshed twice: elements that lie in each other without sharing a face.

How many elements hold a point changes only across faces that are not shared by two elements. So
wherever two lie on each other, a place just inside such a face is held by a second element, and
these faces are few: the surface of the mesh, and of every part of it that may be absent. Places
are taken near the corners, the middle and (in the plane) the quarters of each of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.elements import ReferenceElement, reference_element
from geoident.fem.faces import FaceTable
from geoident.fem.location import reference_coordinates
from geoident.fem.near import points_in_boxes
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, spans

JUST_INSIDE = 0.06
"""Depth of the places in their own element, in parts of its height over a face."""

DEEP = 0.05
"""The same in another element, from which on the two lie in each other.

Less is no fault: walls that are meshed by chords of different length from both sides lie in each
other by delta^2 / 8 of a chord, 4 % where it turns by 32 degrees.
"""

_ALONG = (0.01, 0.26, 0.49, 0.74, 0.97)
"""Where on an edge the places are: near its ends, middle and quarters, and not symmetric."""

_BESIDE = (0.05, 0.03)
"""Weights of the neighbours of a corner for the place beside it: on no line of symmetry."""

_LINEAR = 0.5
"""Parts of its height by which an element may differ from its linear map about the centre."""

_STRAIGHT = 1e-4
"""Distance of nodes from their places in the linear map, in parts of the size, that is none."""

_AT_A_TIME = 200_000
"""Pairs of places and elements whose arrays are held together."""


@dataclass(frozen=True)
class Overlaps:
    """Places of the mesh that a second element holds.

    Args:
        element: (k,) the element at whose face the place is.
        other: (k,) the element that holds it too.
        place: (k, dim) m.
    """

    element: Ints
    other: Ints
    place: Floats

    def of(self, which: Bools) -> Overlaps:
        """Some of them (k,)."""
        return Overlaps(self.element[which], self.other[which], self.place[which])


def overlaps(mesh: Mesh, table: FaceTable, part: Ints) -> Overlaps:
    """Where elements lie in each other by more than `DEEP`.

    Args:
        mesh: of right-handed elements.
        table: its faces.
        part: (n_elements,) number of the part of the mesh to which each element belongs; elements
            of one part are present together.
    """
    element, place = _places(mesh, table, _single(table, part))
    pairs: list[tuple[Ints, Ints]] = []
    for block, span in spans(mesh.blocks):
        at, row = _in_their_boxes(place, mesh.points, block.nodes)
        foreign = element[at] != row + span.start
        at, row = at[foreign], row[foreign]
        for first in range(0, len(at), _AT_A_TIME):
            a, r = at[first : first + _AT_A_TIME], row[first : first + _AT_A_TIME]
            deep = _lies_deep(block.kind, mesh.points, block.nodes, r, place[a])
            pairs.append((a[deep], r[deep] + span.start))
    at, other = (
        np.concatenate([np.empty(0, np.int64), *(pair[k] for pair in pairs)]) for k in (0, 1)
    )
    order = np.lexsort((other, at))
    return Overlaps(element[at[order]], other[order], place[at[order]])


def _single(table: FaceTable, part: Ints) -> Ints:
    """Rows (r,) of faces behind which there is nothing, or another part, or more than one."""
    part_of_element = part[table.element]
    low, high = np.full(table.n_faces, np.iinfo(np.int64).max), np.full(table.n_faces, -1)
    np.minimum.at(low, table.face, part_of_element)
    np.maximum.at(high, table.face, part_of_element)
    shared = np.bincount(table.face, minlength=table.n_faces) == 2
    return np.flatnonzero(~(shared & (low == high))[table.face])


def _places(mesh: Mesh, table: FaceTable, rows: Ints) -> tuple[Ints, Floats]:
    """Elements (m,), and places (m, dim) in them just inside the faces in some rows."""
    elements, places = [], []
    for number, (block, span) in enumerate(spans(mesh.blocks)):
        reference = reference_element(block.kind)
        corners = reference.nodes[: reference.cell.n_corners]
        for local, face in enumerate(CELLS[block.kind].shape.faces):
            chosen = (table.block[rows] == number) & (table.local[rows] == local)
            element = table.element[rows[chosen]]
            at = _moved_inwards(reference, _on_face(corners[list(face)]))
            x = reference.shapes(at) @ mesh.points[block.nodes[element - span.start]]
            elements.append(np.repeat(element, len(at)))
            places.append(x.reshape(-1, mesh.dim))
    return np.concatenate(elements), np.concatenate(places)


def _on_face(corners: Floats) -> Floats:
    """Reference coordinates of places on a face with some corners (n, dim).

    None is on a line of symmetry, where the edges of another part may run.
    """
    if len(corners) == 2:
        return np.asarray(corners[0] + np.array(_ALONG)[:, None] * (corners[1] - corners[0]))
    n = len(corners)
    weights = [np.roll([1.0 - sum(_BESIDE), *_BESIDE, 0.0][:n], k) for k in range(n)]
    return np.vstack([weights @ corners, corners.mean(axis=0)])


def _moved_inwards(reference: ReferenceElement, on: Floats) -> Floats:
    """Places on faces (n, dim), moved towards the centre by `JUST_INSIDE`."""
    centre = reference.nodes[: reference.cell.n_corners].mean(axis=0)
    t = JUST_INSIDE / -reference.outside(centre)
    return np.asarray((1.0 - t) * on + t * centre)


def _in_their_boxes(place: Floats, points: Floats, nodes: Ints) -> tuple[Ints, Ints]:
    """Pairs of a place (m, dim) and an element with nodes (n, n_a) in whose box it is."""
    low = points[nodes[:, 0]]
    high = low.copy()
    for column in nodes.T[1:]:
        x = points[column]
        np.minimum(low, x, out=low)
        np.maximum(high, x, out=high)
    return points_in_boxes(place, low, high)


def _lies_deep(kind: str, points: Floats, nodes: Ints, row: Ints, place: Floats) -> Bools:
    """Which places (n, dim) lie `DEEP` in the element in a row (n,) of nodes (n_el, n_a).

    The map of the element is linear about its centre first, which leaves few to be mapped exactly.
    """
    reference = reference_element(kind)
    centre = reference.nodes[: reference.cell.n_corners].mean(axis=0)[None]
    own, which = np.unique(row, return_inverse=True)
    x = points[nodes[own]]
    middle = reference.shapes(centre)[0] @ x
    slopes = np.einsum("nai,aj->nij", x, reference.gradients(centre)[0])
    xi = centre + np.einsum("nij,nj->ni", np.linalg.inv(slopes)[which], place - middle[which])
    depth = _depth(reference, xi)
    straight = middle[:, None] + np.einsum("nij,aj->nai", slopes, reference.nodes - centre)
    bent = np.abs(x - straight).max(axis=(1, 2)) > _STRAIGHT * np.ptp(x, axis=1).max(axis=1)
    deep = np.asarray(~bent[which] & (depth >= DEEP))
    near = np.flatnonzero(bent[which] & (depth >= -_LINEAR))
    deep[near] = (
        _depth(reference, reference_coordinates(reference, x[which[near]], place[near])) >= DEEP
    )
    return deep


def _depth(reference: ReferenceElement, xi: Floats) -> Floats:
    """(n,) depth of reference points (n, dim), in parts of heights; minus infinity for NaN."""
    above = np.full(len(xi), -np.inf)
    for wall in reference.walls:
        np.fmax(above, xi @ wall[:-1] + wall[-1], out=above)
    return np.asarray(np.where(np.isnan(xi[:, 0]), -np.inf, -above))
