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
class _Template:
    """The nodes of all children of one cell, and how they are made.

    Args:
        shares: (n_places, n_corners) of the parent's corners.
        shapes: (n_places, n_a) of the parent's nodes in the position.
        children: kind and nodes (n_children, n_a) among the places, of children of each kind.
    """

    shares: Floats
    shapes: Floats
    children: tuple[tuple[str, Ints], ...]


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
    blocks = [*spans(mesh.blocks), *spans(mesh.facets)]
    templates = [_template(block.kind, raises=raises) for block, _ in blocks]
    old_keys, old_nodes = _old_nodes(mesh, names)
    keys, positions = [old_keys], [np.empty((0, mesh.dim))]
    for (block, _), template in zip(blocks, templates, strict=True):
        corners = names[block.nodes[:, : CELLS[block.kind].n_corners]]
        shares = np.round(template.shares * _UNIT).astype(np.int64).astype(np.uint64)
        keys.append((corners @ shares.T).ravel())  # modulo 2^64, as hashes are
        x = np.einsum("pa,ead->epd", template.shapes, mesh.points[block.nodes], optimize=True)
        positions.append(x.reshape(-1, mesh.dim))
    _, first, place = np.unique(np.concatenate(keys), return_index=True, return_inverse=True)
    is_old = first < len(old_nodes)
    number = np.empty(len(first), dtype=np.int64)
    number[is_old] = old_nodes[first[is_old]]
    number[~is_old] = mesh.n_nodes + np.arange(np.count_nonzero(~is_old))
    new_points = np.concatenate(positions)[first[~is_old] - len(old_nodes)]
    places = np.split(number[place], np.cumsum([len(part) for part in keys[:-1]]))[1:]
    elements, facets = _Children(), _Children()
    grown = {name: [np.asarray(group)] for name, group in mesh.node_groups.items()}
    borders = _borders(mesh)
    for count, ((block, span), template) in enumerate(zip(blocks, templates, strict=True)):
        nodes = places[count].reshape(len(block), -1)
        is_element = count < len(mesh.blocks)
        (elements if is_element else facets).add(block, span, nodes, template)
        on_border = borders[count] if is_element else None
        for name, members in _grown(mesh, block, nodes, on_border, template):
            grown[name].append(members)
    return replace(
        mesh,
        points=np.concatenate([mesh.points, new_points]),
        blocks=elements.blocks,
        facets=facets.blocks,
        groups={name: elements.of(group) for name, group in mesh.groups.items()},
        facet_groups={name: facets.of(group) for name, group in mesh.facet_groups.items()},
        node_groups={name: np.unique(np.concatenate(group)) for name, group in grown.items()},
    )


def _old_nodes(mesh: Mesh, names: Keys) -> tuple[Keys, Ints]:
    """Keys (k,) and numbers of the nodes of the mesh, those on edges by the ends of their edge."""
    keys, nodes = [names * np.uint64(_UNIT)], [np.arange(mesh.n_nodes)]
    for block in (*mesh.blocks, *mesh.facets):
        cell = CELLS[block.kind]
        for k, (a, b) in enumerate(cell.edges):
            ends = names[block.nodes[:, a]] + names[block.nodes[:, b]]
            keys.append(ends * np.uint64(_UNIT // 2))
            nodes.append(block.nodes[:, cell.n_corners + k])
    return np.concatenate(keys), np.concatenate(nodes)


class _Children:
    """Children by kind, with the number and the row of the parent of each."""

    def __init__(self) -> None:
        self._parts: dict[str, list[tuple[Ints, Ints, Ints]]] = {}

    def add(self, block: ElementBlock, span: slice, nodes: Ints, template: _Template) -> None:
        """Takes the children of a block whose places have these nodes (n_el, n_places)."""
        parents = np.arange(span.start, span.stop)
        for kind, places in template.children:
            rows, each = nodes[:, places].reshape(-1, places.shape[1]), len(places)
            part = rows, np.repeat(block.numbers, each), np.repeat(parents, each)
            self._parts.setdefault(kind, []).append(part)

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
    mesh: Mesh, block: ElementBlock, nodes: Ints, border: Bools | None, template: _Template
) -> Iterable[tuple[str, Ints]]:
    """New members of node groups among the places (n_el, n_places) of a block."""
    cell = CELLS[block.kind]
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
    kinds, rows = list[str](), list[Floats]()  # of every child, and its nodes
    for shape, children in ((name, [_corners_of(name)]),) if raises else _CUTS[name]:
        child = next(
            c for c in CELLS.values() if c.shape.name == shape and c.order == order and c.usable
        )
        for corners in children:
            at = np.array(corners, dtype=np.float64)
            kinds.append(child.kind)
            rows.append(np.vstack([at, *((at[a] + at[b]) / 2 for a, b in child.edges)]))
    places, index = np.unique(np.vstack(rows).round(9), axis=0, return_inverse=True)
    index_of = np.split(index.ravel(), np.cumsum([len(row) for row in rows])[:-1])
    shares = first.shapes(places)
    return _Template(
        np.where(np.abs(shares) < _NO_SHARE, 0.0, shares),
        parent.shapes(places),
        tuple(
            (kind, np.array([own for own, k in zip(index_of, kinds, strict=True) if k == kind]))
            for kind in dict.fromkeys(kinds)
        ),
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


def _corners_of(name: str) -> _Corners:
    shape = next(cell.shape for cell in CELLS.values() if cell.shape.name == name)
    return tuple(tuple(map(float, corner)) for corner in shape.corners)


_BY_PYRAMIDS = _pyramids(_corners_of("pyramid"))
_CUTS: dict[str, tuple[tuple[str, list[_Corners]], ...]] = {
    "line": (("line", _grid(_corners_of("line"))),),
    "tri": (("tri", _triangles(_corners_of("tri"))),),
    "quad": (("quad", _grid(_corners_of("quad"))),),
    "tet": (("tet", [_right_handed(tet) for tet in _tetrahedra(_corners_of("tet"))]),),
    "hex": (("hex", _grid(_corners_of("hex"))),),
    "wedge": (("wedge", _wedges(_corners_of("wedge"))),),
    "pyramid": (("pyramid", _BY_PYRAMIDS[0]), ("tet", _BY_PYRAMIDS[1])),
}
