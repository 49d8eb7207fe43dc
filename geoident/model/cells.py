"""Kinds of cells: corners, edges and faces of each, and what other programs call it.

Everything that depends on the kind of an element stands here, but for its shape functions and
quadrature, which are in `geoident.fem.elements`. Nodes are in VTK's order: the corners, then a node
on each edge (of kinds of order 2) in the order of the edges. Wedges are right-handed as in gmsh,
Abaqus and VTK 9.7 (the first triangle runs counterclockwise when seen from the second one). Older
versions of VTK, and meshio when it reads VTK's files, number them in the opposite sense, which
`geoident.fem.orientation` mends as it does every turned element.

Names and numbers: VTK, vtkCellType.h and the parametric coordinates of its cells; gmsh reference
manual, "Node ordering" and "MSH file format"; meshio, _common.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

_Corners = tuple[int, ...]


@dataclass(frozen=True)
class CellShape:
    """A shape of cells on its reference domain.

    Args:
        name: such as ``tri``.
        corners: (n_corners, dim) reference coordinates, right-handed.
        edges: the pairs of corners that an edge joins.
        faces: corners of every face, outward by the right-hand rule (3-D) or with the cell on the
            left (2-D).
        simplices: corners of the lines, triangles or tetrahedra that fill the shape.
    """

    name: str
    corners: tuple[tuple[int, ...], ...]
    edges: tuple[_Corners, ...]
    faces: tuple[_Corners, ...]
    simplices: tuple[_Corners, ...]

    @property
    def dim(self) -> int:
        """Dimension of the reference domain."""
        return len(self.corners[0])


_POINT = CellShape("point", ((),), (), (), ())
_LINE = CellShape("line", ((-1,), (1,)), ((0, 1),), ((0,), (1,)), ((0, 1),))
_TRI = CellShape(
    "tri",
    ((0, 0), (1, 0), (0, 1)),
    ((0, 1), (1, 2), (2, 0)),
    ((0, 1), (1, 2), (2, 0)),
    ((0, 1, 2),),
)
_QUAD = CellShape(
    "quad",
    ((-1, -1), (1, -1), (1, 1), (-1, 1)),
    ((0, 1), (1, 2), (2, 3), (3, 0)),
    ((0, 1), (1, 2), (2, 3), (3, 0)),
    ((0, 1, 2), (0, 2, 3)),
)
_TET = CellShape(
    "tet",
    ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    ((0, 1, 2, 3),),
)
_HEX = CellShape(
    "hex",
    (
        *((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)),
        *((-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)),
    ),
    (
        *((0, 1), (1, 2), (2, 3), (3, 0)),
        *((4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
    ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)),
)
_WEDGE = CellShape(
    "wedge",
    ((0, 0, -1), (1, 0, -1), (0, 1, -1), (0, 0, 1), (1, 0, 1), (0, 1, 1)),
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3)),
)
_PYRAMID = CellShape(
    "pyramid",
    ((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (0, 0, 1)),
    ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    ((0, 1, 2, 4), (0, 2, 3, 4)),
)


@dataclass(frozen=True)
class CellKind:
    """A kind of cells.

    Args:
        kind: its name, which ends in the number of its nodes, such as ``tri6``.
        shape: what it looks like.
        order: 1, or 2 where the edges have nodes.
        vtk: VTK's number of the type.
        gmsh: gmsh's number of the type.
        meshio: meshio's name of the type.
        gmsh_order: entry i is the place in gmsh's row of nodes of VTK's node i; empty where the two
            orders are the same.
        other_orders: orders of further programs, likewise.
        pieces: nodes of the flat pieces of a line or a surface with nodes on its edges.
    """

    kind: str
    shape: CellShape
    order: int
    vtk: int
    gmsh: int
    meshio: str
    gmsh_order: tuple[int, ...] = ()
    other_orders: tuple[tuple[int, ...], ...] = ()
    pieces: tuple[tuple[int, ...], ...] = ()

    @property
    def dim(self) -> int:
        """Dimension of the cell."""
        return self.shape.dim

    @cached_property
    def n_nodes(self) -> int:
        """Number of nodes, which the name ends in; a ``point`` has one."""
        return int(self.kind.removeprefix(self.shape.name) or 1)

    @property
    def n_corners(self) -> int:
        """Number of corner nodes; they come first."""
        return len(self.shape.corners)

    @property
    def edges(self) -> tuple[_Corners, ...]:
        """The edges that have a node, in the order of these nodes after the corners."""
        return self.shape.edges if self.order == 2 else ()

    @property
    def flat_pieces(self) -> tuple[tuple[int, ...], ...]:
        """Nodes of the lines, triangles or tetrahedra that the cell is made of."""
        return self.pieces or self.shape.simplices

    @property
    def usable(self) -> bool:
        """Whether it can be computed with: all its nodes are corners or on edges."""
        return self.dim > 0 and self.n_nodes == self.n_corners + len(self.edges)

    @cached_property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Nodes of every face, in the order of the face's own kind."""
        middle = {frozenset(edge): self.n_corners + n for n, edge in enumerate(self.edges)}
        rows = []
        for corners in self.shape.faces:
            around = zip(corners, corners[1:] + corners[:1], strict=True)
            edges = dict.fromkeys(frozenset(pair) for pair in around)  # a line has one, not two
            rows.append((*corners, *(middle[edge] for edge in edges if edge in middle)))
        return tuple(rows)

    @cached_property
    def face_kinds(self) -> tuple[str, ...]:
        """Kind of every face."""
        shapes = {1: "point", 2: "line", 3: "tri", 4: "quad"}
        names = (shapes[len(corners)] for corners in self.shape.faces)
        counts = map(len, self.faces)
        return tuple(n if n == "point" else f"{n}{k}" for n, k in zip(names, counts, strict=True))


_ALL = (
    CellKind("point", _POINT, 1, 1, 15, "vertex"),
    CellKind("line2", _LINE, 1, 3, 1, "line"),
    CellKind("line3", _LINE, 2, 21, 8, "line3", (), ((0, 2, 1),), ((0, 2), (2, 1))),
    CellKind("tri3", _TRI, 1, 5, 2, "triangle"),
    CellKind(
        "tri6", _TRI, 2, 22, 9, "triangle6", (), ((0, 2, 4, 1, 3, 5),),
        ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    ),
    CellKind("quad4", _QUAD, 1, 9, 3, "quad"),
    CellKind(
        "quad8", _QUAD, 2, 23, 16, "quad8", (), ((0, 2, 4, 6, 1, 3, 5, 7),),
        ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 7), (5, 6, 7)),
    ),
    CellKind("quad9", _QUAD, 2, 28, 10, "quad9"),
    CellKind("tet4", _TET, 1, 10, 4, "tetra"),
    CellKind("tet10", _TET, 2, 24, 11, "tetra10", (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)),
    CellKind("hex8", _HEX, 1, 12, 5, "hexahedron"),
    CellKind(
        "hex20", _HEX, 2, 25, 17, "hexahedron20",
        (*range(9), 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
        ((*range(12), 16, 17, 18, 19, 12, 13, 14, 15),),
    ),
    CellKind("hex27", _HEX, 2, 29, 12, "hexahedron27"),
    CellKind("wedge6", _WEDGE, 1, 13, 6, "wedge"),
    CellKind(
        "wedge15", _WEDGE, 2, 26, 18, "wedge15",
        (*range(7), 9, 7, 12, 14, 13, 8, 10, 11),
        ((*range(9), 12, 13, 14, 9, 10, 11),),
    ),
    CellKind("wedge18", _WEDGE, 2, 32, 13, "wedge18"),
    CellKind("pyramid5", _PYRAMID, 1, 14, 7, "pyramid"),
    CellKind("pyramid13", _PYRAMID, 2, 27, 19, "pyramid13", (*range(6), 8, 10, 6, 7, 9, 11, 12)),
    CellKind("pyramid14", _PYRAMID, 2, 37, 14, "pyramid14"),
)  # fmt: skip

CELLS: Mapping[str, CellKind] = {cell.kind: cell for cell in _ALL}
"""Every kind that files may hold, by its name. Not all are `CellKind.usable`."""
