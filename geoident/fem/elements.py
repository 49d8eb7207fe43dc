"""Reference elements: shape functions and quadrature of every kind of cell.

Shape functions are not typed in one by one: an element is its node coordinates and the functions
that span its space, and N(xi) = m(xi) M^-1 with M these functions at the nodes. So the numbering is
stated once, in the coordinates (`geoident.model.cells`), and N_a(xi_b) = delta_ab holds by
construction.

Spaces, with p the order (1 or 2):

    tri, tet            all polynomials of degree p
    line, quad, hex     serendipity [Arnold & Awanou, Found. Comput. Math. 11, 2011]: of degree p in
                        each coordinate, squares of at most one of them in a term
    wedge               the same with the triangle in the place of one coordinate: P_p(x, y) times
                        P_p(z) without P_2 z^2 (15 nodes; Zienkiewicz & Taylor, The Finite Element
                        Method, vol. 1, triangular prisms)
    pyramid             all polynomials of degree p and, with w = 1 - z that falls from 1 at the
                        base to 0 at the apex, the rational functions xy/w (5 nodes), or xyz/w,
                        x^2 y/w and x y^2/w (13 nodes) [Bedrosian, Int. J. Numer. Meth. Eng. 35,
                        1992]. On its faces these are the functions of triangles and of the
                        quadrilateral, so pyramids join tetrahedra to hexahedra without gaps

Every space holds all polynomials of degree p, which gives the order of convergence p + 1.

Quadrature integrates the stiffness exactly on straight-sided (affine) elements. Strain points are
these quadrature points: one for tri3 and tet4, for which the model is the founding paper's. With
x = w s, y = w t the functions of a pyramid are polynomials in s, t, w, and the volume is
w^2 ds dt dw: Gauss points in s and t times Gauss-Jacobi points in z with the weight w^2 (a conical
product rule: Stroud, Approximate calculation of multiple integrals, 1971, section 2.5). It is exact
for the forces of a constant stress on any straight-sided pyramid too, which is the patch test.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import product

import numpy as np
from scipy.special import roots_jacobi

from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS, CellKind, CellShape


@dataclass(frozen=True)
class ReferenceElement:
    """One kind of element on its reference domain.

    >>> quad = reference_element("quad4")
    >>> quad.shapes(np.array([0.5, 1.0]))  # on the upper side, nearer to its right end
    array([0.  , 0.  , 0.75, 0.25])

    Args:
        cell: its corners, edges and faces.
        nodes: (n_a, dim) reference coordinates.
        exponents: (n_a, dim) exponents of the coordinates in the functions of its space.
        apex: (n_a,) how often each function is divided by 1 - z; zeros but in pyramids.
        coefficients: (n_a, n_a) inverse of these functions at the nodes.
        points: (n_q, dim) quadrature points.
        weights: (n_q,) quadrature weights.
        walls: (n_faces, dim + 1) the planes of the faces, see `outside`.
    """

    cell: CellKind
    nodes: Floats
    exponents: Ints
    apex: Ints
    coefficients: Floats
    points: Floats
    weights: Floats
    walls: Floats

    @property
    def dim(self) -> int:
        """Dimension of the reference domain."""
        return self.cell.dim

    @property
    def n_nodes(self) -> int:
        """Nodes of the element."""
        return self.cell.n_nodes

    def shapes(self, xi: Floats) -> Floats:
        """Shape functions (..., n_a) at reference points (..., dim)."""
        powers = xi[..., None, :] ** self.exponents
        return np.asarray(np.prod(powers, axis=-1) * self._over_w(xi) @ self.coefficients)

    def gradients(self, xi: Floats) -> Floats:
        """Derivatives (..., n_a, dim) of the shape functions by the coordinates xi (..., dim).

        At the apex of a pyramid, where they have no limit, those along its axis.
        """
        result = np.empty((*xi.shape[:-1], self.n_nodes, self.dim))
        powers = xi[..., None, :] ** self.exponents
        over = self._over_w(xi)
        for axis in range(self.dim):
            lowered = np.maximum(self.exponents[:, axis] - 1, 0)
            factors = powers.copy()
            factors[..., axis] = self.exponents[:, axis] * xi[..., None, axis] ** lowered
            slopes = np.prod(factors, axis=-1) * over
            if axis == 2 and self.apex.any():
                slopes += np.prod(powers, axis=-1) * self.apex * self._over_w(xi, more=1)
            result[..., axis] = slopes @ self.coefficients
        return result

    def outside(self, xi: Floats) -> float:
        """How far a reference point (dim,) lies outside, in parts of the height over a face.

        Zero on the border, negative inside.
        """
        return float((self.walls[:, :-1] @ xi + self.walls[:, -1]).max())

    def _over_w(self, xi: Floats, *, more: int = 0) -> Floats | float:
        """(..., n_a) w^-(apex + more) with w = 1 - z, 0 for w = 0; 1 if nothing is divided."""
        if not self.apex.any():
            return 1.0
        w = 1.0 - xi[..., 2:]
        powers = self.apex + more
        return np.asarray(np.where(w == 0, powers == 0, np.where(w == 0, 1.0, w) ** -powers))


@cache
def reference_element(kind: str) -> ReferenceElement:
    """The reference element of a kind: line2, line3, tri3, ..., pyramid13."""
    cell = CELLS[kind]
    corners = np.array(cell.shape.corners, float)
    middles = [(corners[a] + corners[b]) / 2 for a, b in cell.edges]
    nodes = np.vstack([corners, *middles])
    functions = np.array(_space(cell), dtype=np.int64)
    exponents, apex = functions[:, : cell.dim], functions[:, cell.dim]
    points, weights = _stiffness_rule(cell)
    bare = ReferenceElement(
        cell, nodes, exponents, apex, np.eye(cell.n_nodes), points, weights, _walls(cell.shape)
    )
    return replace(
        bare, coefficients=np.asarray(np.linalg.inv(bare.shapes(nodes)), dtype=np.float64)
    )


@lru_cache
def raised_rule(kind: str) -> tuple[Floats, Floats]:
    """Quadrature (points (n_q, dim), weights (n_q,)) with room for a further linear factor.

    For loads on facets: exact for shape functions times a linear pressure, also when turned about
    an axis. For the stiffness of bodies of revolution: see `kinematics`. Lines to quadrilaterals,
    straight-sided.
    """
    cell = CELLS[kind]
    if cell.shape.name == "tri":
        return _TRIANGLE_DEGREE_4 if cell.order == 2 else _simplex_degree_2(2)
    return _gauss(cell.dim, cell.order + 1)


def divided_rule(kind: str, parts: int) -> tuple[Floats, Floats]:
    """`raised_rule` of a face on each of so many parts along each of its edges.

    For what has a kink within the face, such as the pressure of water that reaches a part of it.
    """
    cell = CELLS[kind]
    points, weights = raised_rule(kind)
    if cell.shape.name == "tri":
        corners = [(i, j) for i in range(parts) for j in range(parts - i)]
        upright = [np.array(corner) + points for corner in corners]
        turned = [np.array(at) + 1.0 - points for at in corners if sum(at) < parts - 1]
        divided = np.concatenate(upright + turned) / parts
    else:
        centres = (2.0 * np.arange(parts) + 1.0 - parts) / parts
        steps = product(centres, repeat=cell.dim)
        divided = np.concatenate([np.array(step) + points / parts for step in steps])
    return divided, np.tile(weights, parts**cell.dim) / parts**cell.dim


def mass_rule(kind: str) -> tuple[Floats, Floats]:
    """Quadrature (points (n_q, dim), weights (n_q,)) for products of two shape functions.

    Exact on affine elements without pyramids; with the factor of a radius nearly so.
    """
    cell = CELLS[kind]
    match cell.shape.name:
        case "tri":
            return _TRIANGLE_DEGREE_4
        case "tet":
            # a cube that shrinks to the corner: x, y (1 - x), z (1 - x) (1 - y)
            unit, weights = _gauss(3, cell.order + 2)
            x, y, z = 0.5 * (1.0 + unit.T)
            points = np.column_stack([x, y * (1 - x), z * (1 - x) * (1 - y)])
            return points, weights / 8.0 * (1 - x) ** 2 * (1 - y)
        case _:
            return _stiffness_rule(cell)


def _space(cell: CellKind) -> list[tuple[int, ...]]:
    """Exponents of the coordinates, and how often it is divided by w, of every function."""
    name, p = cell.shape.name, cell.order
    exponents = product(range(p + 1), repeat=cell.dim)
    match name:
        case "tri" | "tet":
            return [(*e, 0) for e in exponents if sum(e) <= p]
        case "wedge":
            pairs = [(e, (e[0] + e[1], e[2])) for e in exponents]
            return [(*e, 0) for e, both in pairs if both[0] <= p and both.count(2) <= 1]
        case "pyramid":
            rational = [(1, 1, 0, 1)] if p == 1 else [(1, 1, 1, 1), (2, 1, 0, 1), (1, 2, 0, 1)]
            return [(*e, 0) for e in exponents if sum(e) <= p] + rational
        case _:
            return [(*e, 0) for e in exponents if e.count(2) <= 1]


def _walls(shape: CellShape) -> Floats:
    """(n_faces, dim + 1) rows (a, c): a . xi + c is 0 on the face, -1 at the farthest corner."""
    corners, rows = np.array(shape.corners, float), []
    for face in shape.faces:
        on = corners[list(face)]
        normal = np.linalg.svd(on[1:] - on[0])[2][-1]
        height = (corners - on[0]) @ normal
        normal = -normal / height[np.abs(height).argmax()]
        rows.append([*normal, -on[0] @ normal])
    return np.asarray(np.round(np.array(rows), 12) + 0.0, dtype=np.float64)  # simple fractions


def _stiffness_rule(cell: CellKind) -> tuple[Floats, Floats]:
    """Exact for the products of gradients on affine elements."""
    n = cell.order + 1
    match cell.shape.name:
        case "tri" | "tet":
            if cell.order == 2:
                return _simplex_degree_2(cell.dim)
            volume = 1 / 2 if cell.dim == 2 else 1 / 6
            return np.full((1, cell.dim), 1 / cell.n_corners), np.array([volume])
        case "wedge":
            triangle = _simplex_degree_2(2) if cell.order == 1 else _TRIANGLE_DEGREE_4
            return _tensor(triangle, _gauss(1, n))
        case "pyramid":
            return _conical(_gauss(2, n), cell.order)
        case _:
            return _gauss(cell.dim, n)


def _gauss(dim: int, n: int) -> tuple[Floats, Floats]:
    """Gauss points, n an axis, on the line, square or cube from -1 to 1."""
    x, w = np.polynomial.legendre.leggauss(n)
    points = np.array(list(product(x, repeat=dim)))
    weights = np.array([np.prod(ws) for ws in product(w, repeat=dim)])
    return points, weights


def _tensor(base: tuple[Floats, Floats], axis: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """A rule on a plane figure times a rule on a line."""
    places = [np.append(xy, z) for xy, z in product(base[0], axis[0][:, 0])]
    return np.array(places), np.outer(base[1], axis[1]).ravel()


def _conical(base: tuple[Floats, Floats], n: int) -> tuple[Floats, Floats]:
    """A rule on the base of a pyramid times n Gauss-Jacobi points in z, with the weight (1 - z)^2.

    On the line from -1 to 1, with (1 - r)^2 = 4 (1 - z)^2 and dr = 2 dz.
    """
    r, weight = roots_jacobi(n, 2, 0)
    w = (1 - r) / 2
    places = [[*(scale * st), 1 - scale] for st, scale in product(base[0], w)]
    return np.array(places), np.outer(base[1], weight / 8).ravel()


def _simplex_degree_2(dim: int) -> tuple[Floats, Floats]:
    """Points on the medians (Zienkiewicz & Taylor, The Finite Element Method, vol. 1)."""
    n, volume = dim + 1, 1 / 2 if dim == 2 else 1 / 6
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
