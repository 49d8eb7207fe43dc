"""Finer meshes of the same body: every edge halved, or a node on every edge.

Each kind of cell is cut into children of half its size, given by the reference coordinates of
their corners:

    line 2      tri 4      quad 4      tet 8      hex 8      wedge 8      pyramid 6 and 4 tets

or, to raise its order, into one child of second order as large as itself. A child of second order
has nodes on its edges too. Its nodes lie where the parent's own map puts them (theory 1.1): on
straight edges, or on the parabola of an edge with a node, so the body is the same to the last
digit. Where a wall is drawn by straight edges it stays a polygon.

A new node is known by the corners of its parent and their shares in it (the shape functions of
first order there), which neighbours see alike on the face that they share, so each node is made
once. Old nodes keep their numbers, groups and points stay what they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from geoident.fem.elements import reference_element
from geoident.fem.faces import face_table
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh, spans

Keys = NDArray[np.uint64]
"""By which nodes are known."""

_UNIT = 3 * 2**20
"""Shares of corners are counted in parts of it: halves, quarters, and thirds in pyramids."""


@dataclass(frozen=True)
class _Cut:
    """How a kind of cell is cut.

    Args:
        kind: of the children.
        rows: (n_children, n_a) their nodes among the places.
    """

    kind: str
    rows: Ints


@dataclass(frozen=True)
class _Template:
    """The nodes of all children of one cell, and how they are made.

    Args:
        shares: (n_places, n_corners) of the parent's corners.
        shapes: (n_places, n_a) of the parent's nodes in the position.
        cuts: the children, by kind.
    """

    shares: Floats
    shapes: Floats
    cuts: tuple[_Cut, ...]


def halved(mesh: Mesh) -> Mesh:
    """The mesh with every edge halved; groups as in `raised`."""
    return _finer(mesh, raises=False)


def raised(mesh: Mesh) -> Mesh:
    """A mesh of first order with a node on every edge; its elements are of second order.

    Element and facet groups hold the children of their members. Node groups hold in addition the
    new nodes between their members that lie on a border (of the mesh, or between groups), and all
    those of elements of which every corner is a member.
    """
    return _finer(mesh, raises=True)


def n_raised(mesh: Mesh) -> int:
    """Number of nodes of the `raised` mesh: one more for each edge."""
    keys = []
    for block in mesh.blocks:
        ends = np.sort(block.nodes[:, np.array(CELLS[block.kind].shape.edges)], axis=2)
        keys.append((ends[..., 0] * mesh.n_nodes + ends[..., 1]).ravel())
    return mesh.n_nodes + len(np.unique(np.concatenate(keys)))


def _finer(mesh: Mesh, *, raises: bool) -> Mesh:
    names = np.random.default_rng(1).integers(1, 2**63, mesh.n_nodes).astype(np.uint64)
    parts = [_children(mesh, block, names, raises=raises) for block in (*mesh.blocks, *mesh.facets)]
    old = [names * np.uint64(_UNIT), *(keys for keys, _ in _middles(mesh, names))]
    own = [np.arange(mesh.n_nodes), *(nodes for _, nodes in _middles(mesh, names))]
    keys = np.concatenate([*old, *(part.keys.ravel() for part in parts)])
    known = np.concatenate(own)
    _, first, place = np.unique(keys, return_index=True, return_inverse=True)
    fresh = first >= len(known)
    number = np.empty(len(first), dtype=np.int64)
    number[~fresh] = known[first[~fresh]]
    number[fresh] = mesh.n_nodes + np.arange(np.count_nonzero(fresh))
    points = np.empty((mesh.n_nodes + int(np.count_nonzero(fresh)), mesh.dim))
    points[: mesh.n_nodes] = mesh.points
    positions = np.concatenate([part.points.reshape(-1, mesh.dim) for part in parts])
    points[number[fresh]] = positions[first[fresh] - len(known)]
    node_of = number[place[len(known) :]]
    elements, facets = _Joined(raises=raises), _Joined(raises=raises)
    start = 0
    grown = {name: [np.asarray(group)] for name, group in mesh.node_groups.items()}
    borders = _borders(mesh)
    for count, ((block, span), part) in enumerate(zip(_all_spans(mesh), parts, strict=True)):
        nodes = node_of[start : start + part.keys.size].reshape(part.keys.shape)
        start += part.keys.size
        target = elements if count < len(mesh.blocks) else facets
        target.add(block, span, nodes)
        on_border = borders[count] if count < len(mesh.blocks) else None
        for name, members in _grown(mesh, block, nodes, on_border, raises=raises):
            grown[name].append(members)
    return replace(
        mesh,
        points=points,
        blocks=elements.blocks,
        facets=facets.blocks,
        groups={name: elements.of(group) for name, group in mesh.groups.items()},
        facet_groups={name: facets.of(group) for name, group in mesh.facet_groups.items()},
        node_groups={name: np.unique(np.concatenate(group)) for name, group in grown.items()},
    )


def _all_spans(mesh: Mesh) -> Iterable[tuple[ElementBlock, slice]]:
    yield from spans(mesh.blocks)
    yield from spans(mesh.facets)


@dataclass(frozen=True)
class _Children:
    """Places of the children of a block: keys (n_el, n_places), points (n_el, n_places, dim)."""

    keys: Keys
    points: Floats


def _children(mesh: Mesh, block: ElementBlock, names: Keys, *, raises: bool) -> _Children:
    template = _template(block.kind, raises=raises)
    corners = names[block.nodes[:, : CELLS[block.kind].n_corners]]
    shares = np.round(template.shares * _UNIT).astype(np.int64).astype(np.uint64)
    keys = np.zeros((len(block), len(shares)), dtype=np.uint64)
    for corner in range(corners.shape[1]):
        keys += corners[:, corner, None] * shares[:, corner]  # modulo 2^64, as hashes are
    points = np.einsum("pa,ead->epd", template.shapes, mesh.points[block.nodes], optimize=True)
    return _Children(keys.astype(np.uint64), points)


def _middles(mesh: Mesh, names: Keys) -> Iterable[tuple[Keys, Ints]]:
    """Keys (k,) and numbers of the nodes that stand on edges of cells of second order."""
    for block in (*mesh.blocks, *mesh.facets):
        cell = CELLS[block.kind]
        for k, (a, b) in enumerate(cell.edges):
            ends = names[block.nodes[:, a]] + names[block.nodes[:, b]]
            yield ends * np.uint64(_UNIT // 2), block.nodes[:, cell.n_corners + k]


class _Joined:
    """Collects children by kind, with the parent of each."""

    def __init__(self, *, raises: bool) -> None:
        self._raises = raises
        self._parts: dict[str, list[tuple[Ints, Ints, Ints]]] = {}

    def add(self, block: ElementBlock, span: slice, nodes: Ints) -> None:
        """Takes the children of a block whose places have these nodes (n_el, n_places)."""
        parents = np.arange(span.start, span.stop)
        for cut in _template(block.kind, raises=self._raises).cuts:
            rows = nodes[:, cut.rows].reshape(-1, cut.rows.shape[1])
            each = len(cut.rows)
            self._parts.setdefault(cut.kind, []).append(
                (rows, np.repeat(block.numbers, each), np.repeat(parents, each))
            )

    @property
    def blocks(self) -> tuple[ElementBlock, ...]:
        """The children; each has the number of its parent."""
        return tuple(
            ElementBlock(kind, *(np.concatenate([p[k] for p in parts]) for k in (0, 1)))
            for kind, parts in self._parts.items()
        )

    def of(self, group: Ints) -> Ints:
        """The children (k,) of some parents."""
        parents = [p[2] for parts in self._parts.values() for p in parts]
        return np.flatnonzero(np.isin(np.concatenate(parents), group)) if parents else group


def _borders(mesh: Mesh) -> list[Bools]:
    """(n_el, n_faces) of each block: a face with nothing, or with other groups, behind it."""
    table = face_table(mesh)
    member = np.zeros(mesh.n_elements, dtype=np.int64)
    for k, group in enumerate(mesh.groups.values()):
        member[group] += 2**k if k < 62 else k  # enough to tell groups apart
    low = np.full(table.n_faces, np.iinfo(np.int64).max)
    high = np.full(table.n_faces, -1)
    np.minimum.at(low, table.face, member[table.element])
    np.maximum.at(high, table.face, member[table.element])
    single = np.bincount(table.face, minlength=table.n_faces) == 1
    border = (single | (low != high))[table.face]
    borders = []
    for number, (block, span) in enumerate(spans(mesh.blocks)):
        on_border = np.zeros((len(block), len(CELLS[block.kind].shape.faces)), dtype=np.bool_)
        rows = np.flatnonzero(table.block == number)
        on_border[table.element[rows] - span.start, table.local[rows]] = border[rows]
        borders.append(on_border)
    return borders


def _grown(
    mesh: Mesh, block: ElementBlock, nodes: Ints, border: Bools | None, *, raises: bool
) -> Iterable[tuple[str, Ints]]:
    """New members of node groups among the places (n_el, n_places) of a block."""
    cell, template = CELLS[block.kind], _template(block.kind, raises=raises)
    corners = block.nodes[:, : cell.n_corners]
    behind: Bools = np.array(template.shares > 0.0, dtype=np.bool_, ndmin=2)
    for name, group in mesh.node_groups.items():
        inside = np.isin(corners, group)
        if not inside.any():
            continue
        member = np.stack([inside[:, which].all(axis=1) for which in behind], axis=1)
        if border is None:
            yield name, nodes[member]  # of a facet
            continue
        whole = np.flatnonzero(np.count_nonzero(inside, axis=1) == cell.n_corners)
        allowed = np.zeros(nodes.shape, dtype=np.bool_)
        allowed[whole] = True
        for face, on in enumerate(cell.shape.faces):
            outside = np.setdiff1d(np.arange(cell.n_corners), on)
            allowed |= border[:, face, None] & ~behind[:, outside].any(axis=1)
        yield name, nodes[member & allowed]


@cache
def _template(kind: str, *, raises: bool) -> _Template:
    """How cells of a kind are cut, or raised to second order."""
    cell = CELLS[kind]
    order, name = (2 if raises else cell.order), cell.shape.name
    parent = reference_element(kind)
    first = reference_element(f"{name}{cell.n_corners}")
    cuts: list[tuple[str, list[Floats]]] = []
    for shape, children in ((name, [_of(name)]),) if raises else _CUTS[name]:
        child = next(
            c for c in CELLS.values() if c.shape.name == shape and c.order == order and c.usable
        )
        edges = child.edges
        rows = []
        for corners in children:
            at = np.array(corners, dtype=np.float64)
            rows.append(np.vstack([at, *((at[a] + at[b]) / 2 for a, b in edges)]))
        cuts.append((child.kind, rows))
    everything = np.vstack([row for _, rows in cuts for row in rows])
    places, index = np.unique(np.round(everything, 9), axis=0, return_inverse=True)
    index = index.ravel()
    cut, start = [], 0
    for kind_of_child, rows in cuts:
        size = len(rows) * len(rows[0])
        cut.append(_Cut(kind_of_child, index[start : start + size].reshape(len(rows), -1)))
        start += size
    shares = first.shapes(places)
    return _Template(
        np.where(np.abs(shares) < _NO_SHARE, 0.0, shares), parent.shapes(places), tuple(cut)
    )


_NO_SHARE = 1e-9  # a shape function that is 0 at the place, but for rounding
_Corners = tuple[tuple[float, ...], ...]


def _grid(corners: _Corners) -> list[_Corners]:
    """The halves of a line, quarters of a square, eighths of a cube from -1 to 1."""
    at = np.array(corners, dtype=np.float64)
    return [tuple(map(tuple, (corner + at) / 2)) for corner in at]


def _between(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple((x + y) / 2 for x, y in zip(a, b, strict=True))


def _triangles(a: _Corners) -> list[_Corners]:
    """Three at the corners and one between them."""
    m = [_between(a[i], a[(i + 1) % 3]) for i in range(3)]
    return [(a[0], m[0], m[2]), (m[0], a[1], m[1]), (m[2], m[1], a[2]), (m[0], m[1], m[2])]


def _tetrahedra(a: _Corners) -> list[_Corners]:
    """Four at the corners, and the octahedron between them cut along one diagonal.

    Bey (1995), Tetrahedral grid refinement, Computing 55: repeated, it makes three shapes only.
    """
    m = {(i, j): _between(a[i], a[j]) for i in range(4) for j in range(i + 1, 4)}
    return [
        (a[0], m[0, 1], m[0, 2], m[0, 3]),
        (m[0, 1], a[1], m[1, 2], m[1, 3]),
        (m[0, 2], m[1, 2], a[2], m[2, 3]),
        (m[0, 3], m[1, 3], m[2, 3], a[3]),
        (m[0, 1], m[0, 2], m[0, 3], m[1, 3]),
        (m[0, 1], m[0, 2], m[1, 3], m[1, 2]),
        (m[0, 2], m[0, 3], m[1, 3], m[2, 3]),
        (m[0, 2], m[1, 2], m[2, 3], m[1, 3]),
    ]  # fmt: skip


def _wedges(a: _Corners) -> list[_Corners]:
    """Four triangles in each of two layers."""
    levels = [a[0][2], (a[0][2] + a[3][2]) / 2, a[3][2]]
    flat: _Corners = tuple(corner[:2] for corner in a[:3])
    return [
        tuple((*xy, z) for z in pair for xy in triangle)
        for pair in pairwise(levels)
        for triangle in _triangles(flat)
    ]


def _pyramids(a: _Corners) -> tuple[list[_Corners], list[_Corners]]:
    """Four on the base, one at the apex, one upside down between; tetrahedra in the four gaps."""
    apex = a[4]
    base = [_between(a[i], a[(i + 1) % 4]) for i in range(4)]  # middles of the base's edges
    top = [_between(a[i], apex) for i in range(4)]  # middles of the edges to the apex
    centre = _between(a[0], a[2])
    below = [(a[i], base[i], centre, base[i - 1], top[i]) for i in range(4)]
    upper = [(*top, apex), (top[3], top[2], top[1], top[0], centre)]
    gaps = [(base[i], top[i], top[(i + 1) % 4], centre) for i in range(4)]
    return [*below, *upper], [_right_handed(gap) for gap in gaps]


def _right_handed(a: _Corners) -> _Corners:
    edges = np.array(a[1:]) - np.array(a[0])
    return a if np.linalg.det(edges) > 0.0 else (a[0], a[2], a[1], a[3])


def _of(name: str) -> _Corners:
    shape = next(cell.shape for cell in CELLS.values() if cell.shape.name == name)
    return tuple(tuple(map(float, corner)) for corner in shape.corners)


_BY_PYRAMIDS = _pyramids(_of("pyramid"))
_CUTS: dict[str, tuple[tuple[str, list[_Corners]], ...]] = {
    "line": (("line", _grid(_of("line"))),),
    "tri": (("tri", _triangles(_of("tri"))),),
    "quad": (("quad", _grid(_of("quad"))),),
    "tet": (("tet", [_right_handed(tet) for tet in _tetrahedra(_of("tet"))]),),
    "hex": (("hex", _grid(_of("hex"))),),
    "wedge": (("wedge", _wedges(_of("wedge"))),),
    "pyramid": (("pyramid", _BY_PYRAMIDS[0]), ("tet", _BY_PYRAMIDS[1])),
}
