"""Interfaces: a mesh split along faces, and elements of no thickness between the two sides.

*Splitting.* Every node on the faces gets as many copies as there are bodies of elements around it
that hang together through other faces. So a face that ends inside the ground leaves its end joined,
and where faces meet or cross each part has nodes of its own: nothing is said of sides. A beam on
such faces has nodes of its own wherever the sides part, and faces on both sides of it.

*Elements.* With n the normal out of the first side, s along the face, the jumps of the displacement

    d = (n . (u_2 - u_1), s . (u_2 - u_1))        opening, slip (two slips in space)

are the strains of points on the face, tractions (k_n d_n, k_s d_s) their stresses: an interface is
one more group of strain points, as members of structures are. Its points stand at the nodes of
faces of first order, where each has the part of the area that the shape functions give it, and at
those of Simpson's rule on faces of second order (on triangles: corners, middles of edges and the
centre, degree 3). Gauss points let tractions oscillate where an interface is stiff (Schellekens and
de Borst 1993, Int. J. Numer. Meth. Eng. 36, 43-66).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from geoident.fem.consolidation import pressure_shapes
from geoident.fem.elements import raised_rule, reference_element
from geoident.fem.faces import FaceTable, face_table
from geoident.fem.kinematics import Kinematics
from geoident.fem.structures import Members
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, nodes_in, spans


@dataclass(frozen=True)
class JointFaces:
    """Faces of one kind with the nodes of both sides.

    Args:
        kind: of the faces.
        first: (n, n_a) nodes of the first elements, the normal points out of these.
        second: (n, n_a) nodes of the second elements at the same places.
        elements: (n, 2) elements on the first and on the second side.
        beams: groups of the beams that are between the sides.
        inner: (n, n_a) nodes of the beams; None without.
        side: of beams, which of the elements the faces join with them, 0 or 1.
    """

    kind: str
    first: Ints
    second: Ints
    elements: Ints
    beams: tuple[str, ...] = ()
    inner: Ints | None = None
    side: int = 0

    @property
    def ends(self) -> tuple[Ints, Ints]:
        """Nodes (n, n_a) of what they join, the normal points out of the former."""
        if self.inner is None:
            return self.first, self.second
        return (self.inner, self.second) if self.side else (self.first, self.inner)

    @property
    def touches(self) -> tuple[bool, bool]:
        """Which of the elements they join: both, or one with beams."""
        return self.inner is None or self.side == 0, self.inner is None or self.side == 1

    def of(self, mask: Bools) -> JointFaces:
        """Some of them, by a mask (n,)."""
        return replace(
            self,
            first=self.first[mask],
            second=self.second[mask],
            elements=self.elements[mask],
            inner=None if self.inner is None else self.inner[mask],
        )


@dataclass(frozen=True, eq=False)
class SplitMesh:
    """A mesh that is split along groups of faces.

    Args:
        mesh: with further nodes behind those of before; elements keep their numbers.
        joints: group to its faces that have elements on both sides.
        original: (n_nodes,) which node of before each node is.
    """

    mesh: Mesh
    joints: Mapping[str, tuple[JointFaces, ...]]
    original: Ints


def split(mesh: Mesh, groups: Sequence[str], beams: Sequence[str] = ()) -> SplitMesh:
    """Split a mesh along groups of faces; what is no group, or has one side only, stays as it is.

    Faces that other groups have there go with the first side; beams get nodes of their own.

    Args:
        mesh: the mesh.
        groups: along which it is split.
        beams: groups of lines on which beams are.
    """
    known = [name for name in groups if name in mesh.facet_groups]
    if not known:
        return SplitMesh(mesh, {}, np.arange(mesh.n_nodes))
    table = face_table(mesh)
    face_of_facet = np.concatenate([table.find(block) for block in mesh.facets])
    sharing = np.bincount(table.face, minlength=table.n_faces)
    faces_of = {}
    for name in known:
        faces = np.unique(face_of_facet[mesh.facet_groups[name]])
        faces_of[name] = faces[(faces >= 0) & (sharing[faces] == 2)]
    cut = np.zeros(table.n_faces, dtype=bool)
    cut[np.concatenate(list(faces_of.values()))] = True
    copies = _Copies(mesh, table, cut)
    beams = [name for name in beams if name in mesh.facet_groups]
    between = _Between(mesh, table, copies, face_of_facet, beams, cut)
    blocks = tuple(
        replace(block, nodes=copies.of(np.arange(span.start, span.stop), block.nodes))
        for block, span in spans(mesh.blocks)
    )
    behind = np.full(table.n_faces, -1)
    behind[table.face[::-1]] = table.element[::-1]  # of several the first in the table
    facets = []
    for block, span in spans(mesh.facets):
        nodes = copies.of(behind[face_of_facet[span]], block.nodes)
        inner = between.of(block.nodes, nodes)
        facets.append(replace(block, nodes=np.where(between.facets[span, None], inner, nodes)))
    original = np.concatenate([np.arange(mesh.n_nodes), copies.original, between.original])
    named = {name: copies.with_copies(nodes) for name, nodes in mesh.node_groups.items()}
    whole = replace(
        mesh,
        points=mesh.points[original],
        blocks=blocks,
        facets=tuple(facets),
        node_groups=named,
        inner=between.pairs(original),
    )
    joints = {}
    for name, faces in faces_of.items():
        parts = []
        for own in np.unique(between.beams[faces], axis=0):
            some = faces[(between.beams[faces] == own).all(axis=1)]
            on = tuple(beam for beam, there in zip(beams, own, strict=True) if there)
            for part in _joints(mesh, table, copies, some):
                parts += between.two_sides(part, original, on) if on else [part]
        joints[name] = tuple(parts)
    return SplitMesh(whole, joints, original)


class _Copies:
    """Which copy of a node each element has.

    Args:
        mesh: before the split.
        table: its faces.
        cut: (n_faces,) along which it is split.

    Attributes:
        original: (k,) of which node each new one, behind those of the mesh, is a copy.
    """

    def __init__(self, mesh: Mesh, table: FaceTable, cut: Bools) -> None:
        self._count = mesh.n_elements
        on_cut = np.zeros(mesh.n_nodes, dtype=bool)
        for *_, nodes in table.by_place(mesh, np.flatnonzero(cut[table.face])):
            on_cut[nodes] = True
        pairs = [np.empty(0, dtype=np.int64)]
        for block, span in spans(mesh.blocks):
            row, column = np.nonzero(on_cut[block.nodes])
            pairs.append(block.nodes[row, column] * self._count + span.start + row)
        self._pairs = np.unique(np.concatenate(pairs))  # of node and element, in this order
        node, body = self._pairs // self._count, self._bodies(mesh, table, cut, on_cut)
        # the body with the element of lowest number keeps the node
        head = np.unique(body, return_index=True)[1][body]
        keeper = np.unique(node, return_index=True)[1][np.unique(node, return_inverse=True)[1]]
        copied = np.unique(head[head != keeper])
        self.original: Ints = node[copied]
        self._number = node.copy()
        new = head != keeper
        self._number[new] = mesh.n_nodes + np.searchsorted(copied, head[new])

    def _bodies(self, mesh: Mesh, table: FaceTable, cut: Bools, on_cut: Bools) -> Ints:
        """Of each pair the body of elements around its node that hang together there."""
        faces: list[Ints] = []
        pairs: list[Ints] = []
        for *_, rows, nodes in table.by_place(mesh, np.flatnonzero(~cut[table.face])):
            row, column = np.nonzero(on_cut[nodes])
            at = nodes[row, column]
            faces.append(at * table.n_faces + table.face[rows[row]])
            pairs.append(at * self._count + table.element[rows[row]])
        _, face = np.unique(np.concatenate(faces), return_inverse=True)
        place = np.searchsorted(self._pairs, np.concatenate(pairs))
        shape = (len(self._pairs), int(face.max(initial=-1)) + 1)
        graph = sp.csr_array((np.ones(len(place)), (place, face)), shape=shape)
        return np.asarray(connected_components(graph @ graph.T, directed=False)[1], dtype=np.int64)

    def of(self, elements: Ints, nodes: Ints) -> Ints:
        """Nodes (n, n_a) as the elements (n,) have them; where there is none (-1) as they were."""
        keys = nodes * self._count + elements[:, None]
        place = np.minimum(np.searchsorted(self._pairs, keys), len(self._pairs) - 1)
        known = (self._pairs[place] == keys) & (elements[:, None] >= 0)
        return np.asarray(np.where(known, self._number[place], nodes))

    def with_copies(self, nodes: Ints) -> Ints:
        """Some nodes (k,) and all their copies, ascending."""
        first = int(self._number.max(initial=-1)) + 1 - len(self.original)
        more = first + np.flatnonzero(np.isin(self.original, nodes))
        return np.concatenate([nodes, more])


class _Between:
    """The nodes of beams between the two sides of a split mesh.

    Args:
        mesh: before the split.
        table: its faces.
        copies: which copy of a node each element has.
        face_of_facet: (n_facets,) identity of the face of each facet, or -1.
        beams: groups of the facets on which beams are.
        cut: (n_faces,) along which the mesh is split.

    Attributes:
        facets: (n_facets,) which are of beams.
        beams: (n_faces, n_beams) which beams are on each face.
        original: (k,) of which node each of theirs, behind all others, is a copy.
    """

    def __init__(
        self,
        mesh: Mesh,
        table: FaceTable,
        copies: _Copies,
        face_of_facet: Ints,
        beams: Sequence[str],
        cut: Bools,
    ) -> None:
        self.facets: Bools = np.zeros(len(face_of_facet), dtype=bool)
        self.beams: Bools = np.zeros((table.n_faces, len(beams)), dtype=bool)
        inner = [np.empty(0, dtype=np.int64)]
        for number, name in enumerate(beams):
            own = mesh.facet_groups[name]
            faces = face_of_facet[own]
            self.facets[own] = True
            self.beams[faces[faces >= 0], number] = True
            inner.append(nodes_in(mesh.facets, own[(faces >= 0) & cut[faces]]))
        # where the sides do not part, as at a tip in the ground, the beam is joined to both
        self.original: Ints = np.intersect1d(np.concatenate(inner), copies.original)
        self._number = np.full(mesh.n_nodes, -1)
        first = mesh.n_nodes + len(copies.original)
        self._number[self.original] = first + np.arange(len(self.original))

    def of(self, nodes: Ints, others: Ints) -> Ints:
        """Nodes of before the split as beams have them, and others where beams have none."""
        return np.asarray(np.where(self._number[nodes] >= 0, self._number[nodes], others))

    def pairs(self, original: Ints) -> Ints:
        """(k, 2) nodes of the ground, each with that of beams there; see `Mesh.inner`."""
        ground = np.arange(len(original) - len(self.original))
        inner = self._number[original[ground]]
        return np.stack([ground, inner], axis=1)[inner >= 0]

    def two_sides(self, part: JointFaces, original: Ints, on: tuple[str, ...]) -> list[JointFaces]:
        """The faces between the first side and beams, and between these and the second side."""
        inner = self.of(original[part.first], part.first)
        return [replace(part, beams=on, inner=inner, side=side) for side in (0, 1)]


def _joints(mesh: Mesh, table: FaceTable, copies: _Copies, faces: Ints) -> tuple[JointFaces, ...]:
    """Faces (k,) with the nodes of both sides; the first side is that of the element before."""
    both = np.flatnonzero(np.isin(table.face, faces))
    rows = both[np.argsort(table.face[both], kind="stable")].reshape(-1, 2)
    second = np.full(table.n_faces, -1)
    second[table.face[rows[:, 1]]] = table.element[rows[:, 1]]
    parts = []
    for block, local, at, nodes in table.by_place(mesh, rows[:, 0]):
        if len(at):
            elements = np.stack([table.element[at], second[table.face[at]]], axis=1)
            one, other = (copies.of(side, nodes) for side in elements.T)
            kind = CELLS[block.kind].face_kinds[local]
            parts.append(JointFaces(kind, one, other, elements))
    return tuple(parts)


@dataclass(frozen=True, eq=False)
class JointPoints:
    """The points of an interface.

    Args:
        members: the interface as rows of openings, then of slips, of all points.
        position: (m, dim) of the points, m.
        normal: (m, dim) out of the first side.
        slips: (dim - 1, m, dim) directions of the slips.
        face: (m,) number of the face of each point, from 0; corners come first in a face.
        places: (k, dim) m, where the traction is asked for that a stress of the ground has there.
        beside: (k,) the elements on the first side of these places.
        mean: (m, k) that of a point from those at the places, so that the forces on the nodes are
            those of the traction on the face.
        elements: (m, 2) on the first and on the second side.
        touches: (m, 2) which of these it joins: both, or one with a beam.
        sides: (m, n_nodes) how pressures at corners of these elements give those at the points.
        size: of a face on average, m.
    """

    members: Members
    position: Floats
    normal: Floats
    slips: Floats
    face: Ints
    places: Floats
    beside: Ints
    mean: sp.csr_array
    elements: Ints
    touches: Bools
    sides: tuple[sp.csr_array, sp.csr_array]
    size: float

    @property
    def parted(self) -> Bools:
        """(m,) where the sides can part: not at ends inside the ground, which are joined."""
        return np.diff(self.members.operator.indptr)[: len(self.face)] > 0

    def tractions(self, stress: Floats) -> Floats:
        """Tractions (n_rows, c), Pa, of stresses (n_strain, k, c) of the ground at the places."""
        dim = self.normal.shape[1]
        at = {(0, 0): 0, (1, 1): 1, (2, 2): 2, (0, 1): 3, (1, 2): 4, (0, 2): 5}
        mean = np.stack([self.mean @ component for component in stress])
        pull = np.zeros((dim, *mean.shape[1:]))
        for i, j in product(range(dim), repeat=2):
            pull[i] += self.normal[:, j, None] * mean[at[min(i, j), max(i, j)]]
        rows = [np.einsum("mi,imc->mc", way, pull) for way in (self.normal, *self.slips)]
        return np.concatenate(rows)


def joint_points(mesh: Mesh, parts: Sequence[JointFaces], kinematics: Kinematics) -> JointPoints:
    """The points of an interface along some faces of a mesh that is split along them."""
    of_parts = []
    for part in parts:
        axial = np.asarray(kinematics.on_axis(mesh.points)[part.first].any(axis=1))
        for own, gauss in ((part.of(~axial), False), (part.of(axial), True)):
            if len(own.elements):
                of_parts.append(_points_of(mesh, own, kinematics, gauss=gauss))
    position, normal, weight, places, beside = (
        np.concatenate([getattr(one, name) for one in of_parts])
        for name in ("position", "normal", "weight", "places", "beside")
    )
    slips = np.concatenate([one.slips for one in of_parts], axis=1)
    sizes = np.concatenate([np.full(one.count, len(one.weight) // one.count) for one in of_parts])
    mean = sp.csr_array(sp.block_diag([one.mean for one in of_parts]))
    jumps = [sp.vstack([one.jumps[k] for one in of_parts]) for k in range(mesh.dim)]
    one_side, other = (sp.csr_array(sp.vstack([p.sides[k] for p in of_parts])) for k in range(2))
    members = Members(
        sp.csr_array(sp.vstack(jumps)),
        np.tile(weight, mesh.dim),
        np.repeat([0, *[1] * (mesh.dim - 1)], len(weight)),
        np.repeat(position[:, None], 2, axis=1),
    )
    return JointPoints(
        members,
        position,
        normal,
        slips,
        np.repeat(np.arange(len(sizes)), sizes),
        places,
        beside,
        mean,
        np.concatenate([one.elements for one in of_parts]),
        np.concatenate([one.touches for one in of_parts]),
        (one_side, other),
        float(np.mean([_size_of(mesh, part) for part in parts])),
    )


@dataclass(frozen=True, eq=False)
class _PartPoints:
    """Points of so many faces of one kind; see `JointPoints`."""

    count: int
    position: Floats
    normal: Floats
    weight: Floats
    places: Floats
    beside: Ints
    slips: Floats
    mean: sp.csr_array
    jumps: list[sp.csr_array]
    elements: Ints
    touches: Bools
    sides: list[sp.csr_array]


def _points_of(mesh: Mesh, part: JointFaces, kinematics: Kinematics, *, gauss: bool) -> _PartPoints:
    """The points of faces; with Gauss points where a face of second order has its end on an axis.

    Simpson's rule has nothing there, and the ends of both sides would not hold together.
    """
    reference, dim = reference_element(part.kind), mesh.dim
    corners = mesh.points[part.first]

    def on_faces(xi: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Shape functions, positions, normals of the length of the area, directions of xi_1."""
        shapes = reference.shapes(xi)
        along = np.einsum("nai,qaj->jnqi", corners, reference.gradients(xi), optimize=True)
        across = np.cross(*along) if dim == 3 else along[0] @ _QUARTER_TURN
        return shapes, np.einsum("qa,nai->nqi", shapes, corners), across, along[0]

    of_first_order = reference.cell.order == 1
    if of_first_order:
        xi, rule = reference.nodes, None
    else:
        xi, rule = raised_rule(part.kind) if gauss else _simpson(part.kind)
        if gauss:
            xi, rule = xi[_ENDS_FIRST], rule[_ENDS_FIRST]
    shapes, position, across, along = on_faces(xi)
    size = np.linalg.norm(across, axis=2)
    normal = across / size[..., None]
    n, q = size.shape
    if rule is None:
        inner, weights = raised_rule(part.kind)
        N, places, wide, _ = on_faces(inner)
        area = np.linalg.norm(wide, axis=2) * weights * kinematics.depth(places)
        shares = np.einsum("ng,ga->nag", area, N)
        weight = shares.sum(axis=2)
        mean = sp.csr_array(sp.block_diag(list(shares / weight[..., None])))
    else:
        weight, places = size * rule * kinematics.depth(position), position
        mean = sp.csr_array(sp.eye_array(n * q))
    if dim == 2:
        slips = (along / size[..., None])[None]
    else:
        strike = np.cross([0.0, 0.0, 1.0], normal)
        flat = np.linalg.norm(strike, axis=2, keepdims=True) < _FLAT
        strike = np.where(flat, np.cross(np.cross(normal, [1.0, 0.0, 0.0]), normal), strike)
        strike /= np.linalg.norm(strike, axis=2, keepdims=True)
        slips = np.stack([strike, np.cross(normal, strike)])
    rows = np.repeat(np.arange(n * q), shapes.shape[1] * dim)
    sides = np.stack(part.ends[::-1])[:, :, None, :, None] * dim + np.arange(dim)
    dofs = np.broadcast_to(sides, (2, n, q, *sides.shape[3:])).ravel()
    jumps = []
    for way in (normal, *slips):
        moves = np.einsum("qa,nqi->nqai", shapes, way).ravel()
        data = np.concatenate([moves, -moves])
        entries = (data, (np.tile(rows, 2), dofs))
        jump = sp.csr_array(entries, shape=(n * q, mesh.points.size))
        jump.eliminate_zeros()
        jumps.append(jump)
    linear = pressure_shapes(CELLS[part.kind].shape, xi)
    rows = np.repeat(np.arange(n * q), linear.shape[1])
    sides_of = []
    for ends in (part.first[:, : linear.shape[1]], part.second[:, : linear.shape[1]]):
        entries = (np.tile(linear.ravel(), n), (rows, np.repeat(ends, q, axis=0).ravel()))
        sides_of.append(sp.csr_array(entries, shape=(n * q, mesh.n_nodes)))
    return _PartPoints(
        n,
        position.reshape(-1, dim),
        normal.reshape(-1, dim),
        weight.ravel(),
        places.reshape(-1, dim),
        np.repeat(part.elements[:, 0], places.shape[1]),
        slips.reshape(dim - 1, -1, dim),
        mean,
        jumps,
        np.repeat(part.elements, q, axis=0),
        np.tile(part.touches, (n * q, 1)),
        sides_of,
    )


def _size_of(mesh: Mesh, part: JointFaces) -> float:
    """Size of the faces on average, m."""
    return float(np.ptp(mesh.points[part.first], axis=1).max(axis=1).mean())


_ENDS_FIRST = [0, 2, 1]
"""Order of the three Gauss points of a line, as that of other points."""

_QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Vectors times it are turned to the right: the element is on the left of its sides."""

_FLAT = 1e-6
"""Sine of the dip of a face below which it has no strike: its slips are along x and y then."""


def _simpson(kind: str) -> tuple[Floats, Floats]:
    """Closed rule (points (q, dim), weights (q,)) of degree 3 with positive weights.

    Corners come first, then the middles of edges and the centre.
    """
    cell, nodes = CELLS[kind], reference_element(kind).nodes
    if cell.dim == 1:
        return nodes, np.array([1 / 3, 1 / 3, 4 / 3])
    corner, edge, middle = _OF_TRIANGLES if cell.shape.name == "tri" else _OF_QUADRILATERALS
    n = cell.n_corners
    points = np.vstack([nodes, nodes[:n].mean(axis=0)])
    return points, np.array([*[corner] * n, *[edge] * n, middle])


_OF_TRIANGLES, _OF_QUADRILATERALS = (1 / 40, 1 / 15, 9 / 40), (1 / 9, 4 / 9, 16 / 9)
"""Weights at corners, middles of edges and the centre."""
