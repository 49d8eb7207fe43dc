"""Reference elements: shape functions, quadrature and faces of every element kind.

Nodes are in VTK's order. Shape functions are not typed in one by one: an element is its node
coordinates and its monomials, and N(xi) = m(xi) M^-1 with M the monomials at the nodes. So the
numbering is stated once, in the coordinates, and N_a(xi_b) = delta_ab holds by construction.

Quadrature integrates the stiffness exactly on straight-sided (affine) elements. Strain points are
these quadrature points: one for tri3 and tet4, for which the model is the founding paper's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from geoident.model.arrays import Floats, Ints

_SIMPLEX_CORNERS = {
    2: ((0, 0), (1, 0), (0, 1)),
    3: ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
}
_CUBE_CORNERS = {
    1: ((-1,), (1,)),
    2: ((-1, -1), (1, -1), (1, 1), (-1, 1)),
    3: (
        (-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1),
        (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1),
    ),
}  # fmt: skip
_HEX_EDGES = (
    (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
)  # fmt: skip
_EDGES = {
    "line3": ((0, 1),),
    "tri6": ((0, 1), (1, 2), (2, 0)),
    "quad8": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tet10": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hex20": _HEX_EDGES,
}
# Faces by corner nodes, outward by the right-hand rule (3-D) or with the element on the left (2-D).
_CORNER_FACES = {
    "tri": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tet": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hex": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "line": ((0,), (1,)),
}
_FAMILY = {
    "line2": ("line", 1, 1), "line3": ("line", 1, 2),
    "tri3": ("tri", 2, 1), "tri6": ("tri", 2, 2), "quad4": ("quad", 2, 1), "quad8": ("quad", 2, 2),
    "tet4": ("tet", 3, 1), "tet10": ("tet", 3, 2), "hex8": ("hex", 3, 1), "hex20": ("hex", 3, 2),
}  # fmt: skip


@dataclass(frozen=True)
class ReferenceElement:
    """One kind of element on its reference domain.

    Args:
        kind: such as ``tri6``.
        family: ``line``, ``tri``, ``quad``, ``tet`` or ``hex``.
        dim: dimension of the reference domain.
        order: 1 or 2.
        nodes: (n_a, dim) reference coordinates.
        exponents: (n_a, dim) exponents of the monomials.
        coefficients: (n_a, n_a) inverse of the monomials at the nodes.
        points: (n_q, dim) quadrature points.
        weights: (n_q,) quadrature weights.
        edges: corner pairs with their mid-node, empty for order 1: (first, second, middle).
        faces: node indices of every face, its nodes in the order of the face's own kind.
    """

    kind: str
    family: str
    dim: int
    order: int
    nodes: Floats
    exponents: Ints
    coefficients: Floats
    points: Floats
    weights: Floats
    edges: tuple[tuple[int, int, int], ...]
    faces: tuple[tuple[int, ...], ...]

    @property
    def n_nodes(self) -> int:
        """Nodes of the element."""
        return int(self.nodes.shape[0])

    @property
    def n_corners(self) -> int:
        """Corner nodes of the element; they come first."""
        return self.n_nodes - len(self.edges)

    @property
    def face_kinds(self) -> tuple[str, ...]:
        """Kind of every face."""
        names = {2: "line2", 3: "tri3" if self.dim == 3 else "line3", 4: "quad4", 6: "tri6"}
        names |= {8: "quad8", 1: "point"}
        return tuple(names[len(face)] for face in self.faces)

    def shapes(self, xi: Floats) -> Floats:
        """Shape functions (n, n_a) at reference points (n, dim)."""
        powers = xi[:, None, :] ** self.exponents[None]
        return np.asarray(np.prod(powers, axis=2) @ self.coefficients)

    def gradients(self, xi: Floats) -> Floats:
        """Derivatives (n, n_a, dim) of the shape functions by the reference coordinates."""
        result = np.empty((xi.shape[0], self.n_nodes, self.dim))
        powers = xi[:, None, :] ** self.exponents[None]
        for axis in range(self.dim):
            lowered = np.maximum(self.exponents[:, axis] - 1, 0)
            factors = powers.copy()
            factors[:, :, axis] = self.exponents[:, axis] * xi[:, None, axis] ** lowered
            result[:, :, axis] = np.prod(factors, axis=2) @ self.coefficients
        return result


@cache
def reference_element(kind: str) -> ReferenceElement:
    """The reference element of a kind: line2, line3, tri3, ..., hex20."""
    family, dim, order = _FAMILY[kind]
    corners = np.array(_CUBE_CORNERS[dim] if _is_cube(family) else _SIMPLEX_CORNERS[dim], float)
    pairs = _EDGES[kind] if order == 2 else ()
    middles = [(corners[a] + corners[b]) / 2 for a, b in pairs]
    nodes = np.vstack([corners, *middles])
    exponents = np.array(_monomials(family, dim, order), dtype=np.int64)
    at_nodes = np.prod(nodes[:, None, :] ** exponents[None], axis=2)
    points, weights = _stiffness_rule(family, dim, order)
    edges = tuple((a, b, len(corners) + n) for n, (a, b) in enumerate(pairs))
    return ReferenceElement(
        kind, family, dim, order, nodes, exponents, np.linalg.inv(at_nodes), points, weights,
        edges, tuple(_face_nodes(face, edges) for face in _CORNER_FACES[family]),
    )  # fmt: skip


def raised_rule(kind: str) -> tuple[Floats, Floats]:
    """Quadrature (points (n_q, dim), weights (n_q,)) with room for a further linear factor.

    For loads on facets: exact for shape functions times a linear pressure, also when turned about
    an axis. For the stiffness of bodies of revolution: see `kinematics`. Lines to quadrilaterals,
    straight-sided.
    """
    family, dim, order = _FAMILY[kind]
    if _is_cube(family):
        return _cube_rule(dim, order + 1)
    return _TRIANGLE_DEGREE_4 if order == 2 else _stiffness_rule("tri", 2, 2)


def _is_cube(family: str) -> bool:
    return family in ("line", "quad", "hex")


def _monomials(family: str, dim: int, order: int) -> list[tuple[int, ...]]:
    """Complete polynomials on simplices, Arnold and Awanou's serendipity space on cubes."""
    exponents = product(range(order + 1), repeat=dim)
    if _is_cube(family):
        return [e for e in exponents if e.count(2) <= 1]
    return [e for e in exponents if sum(e) <= order]


def _face_nodes(
    corners: tuple[int, ...], edges: tuple[tuple[int, int, int], ...]
) -> tuple[int, ...]:
    """Corner nodes of a face followed by its mid-nodes, in the order of the face's kind."""
    middle = {frozenset((a, b)): m for a, b, m in edges}
    if not middle or len(corners) == 1:
        return corners
    if len(corners) == 2:
        return (*corners, middle[frozenset(corners)])
    around = zip(corners, corners[1:] + corners[:1], strict=True)
    return (*corners, *(middle[frozenset(pair)] for pair in around))


def _cube_rule(dim: int, n: int) -> tuple[Floats, Floats]:
    x, w = np.polynomial.legendre.leggauss(n)
    points = np.array(list(product(x, repeat=dim)))
    weights = np.array([np.prod(ws) for ws in product(w, repeat=dim)])
    return points, weights


def _stiffness_rule(family: str, dim: int, order: int) -> tuple[Floats, Floats]:
    """Exact for the products of gradients on affine elements."""
    if _is_cube(family):
        return _cube_rule(dim, order + 1)
    n = dim + 1
    volume = 1 / 2 if dim == 2 else 1 / 6
    if order == 1:
        return np.full((1, dim), 1 / n), np.array([volume])
    # Degree 2: points on the medians (Zienkiewicz & Taylor, The Finite Element Method, vol. 1).
    a = 2 / 3 if dim == 2 else (5 + 3 * np.sqrt(5)) / 20
    b = 1 / 6 if dim == 2 else (5 - np.sqrt(5)) / 20
    barycentric = np.full((n, n), b) + (a - b) * np.eye(n)
    return barycentric[:, 1:].copy(), np.full(n, volume / n)


def _dunavant_degree_4() -> tuple[Floats, Floats]:
    """Six points, degree 4 (Dunavant, Int. J. Numer. Meth. Eng. 21, 1985)."""
    points, weights = [], []
    for a, w in ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322)):
        b = 1 - 2 * a
        points += [(a, a), (b, a), (a, b)]
        weights += [w / 2] * 3
    return np.array(points), np.array(weights)


_TRIANGLE_DEGREE_4 = _dunavant_degree_4()
