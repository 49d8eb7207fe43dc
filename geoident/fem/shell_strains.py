"""Strains of shells by displacements and rotations: membrane strains, curvatures, drilling.

At each node the unknowns are u (3) and a rotation vector theta (3), in the axes of the mesh. Axes
1, 2 and n of a place on a shell are unit vectors, n its normal.
"""

from __future__ import annotations

import numpy as np

from geoident.fem.elements import ReferenceElement
from geoident.model.arrays import Floats

_MIDDLES = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])
"""Area coordinates of the middles of the sides 12, 23 and 31."""

_DEVIATION = 1.5 * np.sqrt(0.5)
"""3/2 sqrt(beta_0), with which deviations of the membrane strain count."""


_NEAR, _FAR, _INNER = 0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0), 1.0 / np.sqrt(3.0)
_TIES = (
    ((1.0, 0.0), ((_NEAR, 0.0), (_FAR, 0.0), (_NEAR, _INNER))),
    ((0.0, 1.0), ((0.0, _NEAR), (0.0, _FAR), (_INNER, _NEAR))),
    ((-1.0, 1.0), ((_FAR, _NEAR), (_NEAR, _FAR), (_NEAR, _NEAR))),
)
"""Directions in the reference triangle, and where the strain along each is taken."""


def flat_membrane(x: Floats, frames: Floats) -> Floats:
    """Strains e_11, e_22, g_12 (m, 3, 3, 3, 6) at the middles of the sides of flat triangles.

    The optimal triangle of Felippa (2003), by the unknowns of its three corners.

    Args:
        x: (m, 3, 3) corners, m.
        frames: (m, 3, 3) unit vectors 1, 2 and n.
    """
    plane = np.einsum("mik,mak->mai", frames[:, :2], x - x[:, :1])
    rows = _membrane(plane).reshape(len(x), 3, 3, 3, 3)  # by u_1, u_2 and theta_n
    moved = np.einsum("mqcni,mik->mqcnk", rows[..., :2], frames[:, :2])
    return np.concatenate([moved, rows[..., 2:] * frames[:, None, None, None, 2]], axis=4)


def curved_membrane(points: Floats, at: Floats, element: ReferenceElement, axis: Floats) -> Floats:
    """Strains e_11, e_22, g_12 (m, q, 3, k, 6) at places of curved faces of second order.

    The strain e_d = x,d . u,d along three directions d of the reference element gives all of it. In
    triangles each is linear through its values at three points, two on the side along d (MITC6 of
    Lee and Bathe, Computers and Structures 82, 2004, 945-962): elsewhere a face that bends without
    stretching would seem to stretch.

    Args:
        points: (m, k, 3) nodes, m.
        at: (q, 2) reference points.
        element: of the faces.
        axis: (3,) direction of axis 1.
    """
    strains = []
    for direction, ties in _TIES:
        places, onto = at, np.eye(len(at))
        if element.cell.shape.name == "tri":
            places = np.array(ties)
            onto = _linear(at) @ np.linalg.inv(_linear(places))
        slopes = element.gradients(places) @ np.array(direction)
        along = np.einsum("mkx,qk->mqx", points, slopes)
        strains.append(np.einsum("qp,pk,mpx->mqkx", onto, slopes, along))
    rr, ss, across = strains
    rs = (rr + ss - across) / 2
    _, _, frames, inverse = on_faces(points, at, element, axis)
    a, b = (inverse @ frames[:, :, i, :, None] for i in range(2))  # (m, q, 2, 1), of axes 1 and 2

    def component(one: Floats, other: Floats) -> Floats:
        (r, s), (p, q) = (np.moveaxis(each, 2, 0)[..., None] for each in (one, other))
        return np.asarray(r * p * rr + s * q * ss + (r * q + s * p) * rs)

    rows = np.stack([component(a, a), component(b, b), 2 * component(a, b)], axis=2)
    return np.concatenate([rows, np.zeros_like(rows)], axis=4)


def _linear(at: Floats) -> Floats:
    """1, r and s at reference points (n, 2)."""
    return np.column_stack([np.ones(len(at)), at])


def on_faces(
    points: Floats, at: Floats, element: ReferenceElement, axis: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """What is at places of curved faces.

    Args:
        points: (m, k, 3) nodes, m.
        at: (q, 2) reference points.
        element: of the faces.
        axis: (3,) direction of axis 1.

    Returns:
        Gradients of the shape functions along the surface (m, q, k, 3), 1/m; area per reference
        area (m, q), m2; unit vectors 1, 2 and n (m, q, 3, 3), n by the order of the nodes; and the
        gradients of the reference coordinates (m, q, 2, 3), 1/m.
    """
    gradients = element.gradients(at)
    along = np.einsum("mkx,qka->mqax", points, gradients)
    inverse = np.linalg.inv(along @ along.swapaxes(2, 3)) @ along
    normal = np.cross(along[:, :, 0], along[:, :, 1])
    slopes = np.einsum("qka,mqax->mqkx", gradients, inverse)
    return slopes, np.linalg.norm(normal, axis=2), axes_of(normal, axis), inverse


def axes_of(normal: Floats, axis: Floats) -> Floats:
    """Unit vectors 1, 2 and n (..., 3, 3) of normals (..., 3) of any length.

    Args:
        normal: n.
        axis: (3,) axis 1, before it is projected.
    """
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    first = axis - (normal @ axis)[..., None] * normal
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(normal, first), normal], axis=-2)


def spins(slopes: Floats, frames: Floats) -> Floats:
    """Rotation about the normal at each node less that of the surface, (m, k, k, 6).

    Args:
        slopes: (m, k, k, 3) gradients of the shape functions at the nodes, see `on_faces`.
        frames: (m, k, 3, 3) there.
    """
    t1, t2, normal = (frames[:, :, None, i] for i in range(3))
    along = np.einsum("mqkx,mqix->mqki", slopes, frames[:, :, :2])
    spin = 0.5 * (along[..., :1] * t2 - along[..., 1:] * t1)
    own = np.eye(slopes.shape[1])[None, :, :, None] * normal
    return np.concatenate([-spin, own], axis=3)


def curvatures(x: Floats, frames: Floats, normals: Floats) -> Floats:
    """Curvatures k_11, k_22, twice k_12 (m, 3, 3, 3, 6) at the middles of the sides of triangles.

    The discrete Kirchhoff triangle (Batoz, Bathe and Ho, 1980) with a rotation vector theta: it is
    quadratic, and in the middle of each side, with d along the side of length L, n the normal of
    the surface there and v = d x n, it turns about v as the cubic deflection of the side does,

        v . theta = 3/2 n . (u_j - u_i) / L - v . (theta_i + theta_j) / 4

    and otherwise as both ends do in the mean. With the normal of the triangle in the place of n, a
    cylinder that only widens would bend: its triangles lean against each other, and their nodes
    would move unevenly along the normals of the triangles.

    Args:
        x: (m, 3, 3) corners, m.
        frames: (m, 3, 3) unit vectors 1, 2 and n.
        normals: (m, 3, 3) unit normals of the surface in the middles of the sides 12, 23 and 31.
    """
    m = len(x)
    theta = np.zeros((m, 6, 3, 3, 6))  # at corners and middles; component; by node and unknown
    for i in range(3):
        j = (i + 1) % 3
        theta[:, i, :, i, 3:] = np.eye(3)
        side = x[:, j] - x[:, i]
        length = np.linalg.norm(side, axis=1)[:, None]
        side = side / length
        n = normals[:, i] - (normals[:, i] * side).sum(axis=1)[:, None] * side
        n /= np.linalg.norm(n, axis=1)[:, None]
        v = np.cross(side, n)
        theta[:, 3 + i, :, [i, j], 3:] = 0.5 * np.eye(3)
        turned = np.zeros((m, 3, 6))  # about v, beyond the mean of the ends
        turned[:, i, :3], turned[:, j, :3] = -n / length, n / length
        turned[:, i, 3:] = turned[:, j, 3:] = -0.5 * v
        theta[:, 3 + i] += 1.5 * v[:, :, None, None] * turned[:, None]
    plane = np.einsum("mik,mak->mai", frames[:, :2], x - x[:, :1])
    edges = np.roll(plane, -1, axis=1) - np.roll(plane, -2, axis=1)  # opposite to each corner
    doubled = edges[:, 2, 0] * edges[:, 0, 1] - edges[:, 2, 1] * edges[:, 0, 0]
    area = np.stack([edges[..., 1], -edges[..., 0]], axis=2) / doubled[:, None, None]
    rows = np.empty((m, 3, 3, 3, 6))
    t1, t2 = frames[:, 0], frames[:, 1]
    for q, L in enumerate(_MIDDLES):
        corner = [(4 * L[i] - 1) * area[:, i] for i in range(3)]
        middle = [4 * (L[i] * area[:, j] + L[j] * area[:, i]) for i, j in ((0, 1), (1, 2), (2, 0))]
        slopes = np.stack([*corner, *middle], axis=1)  # of the six functions by 1 and 2
        by = np.einsum("mna,mncku->macku", slopes, theta)
        along = np.einsum("mtc,macku->mtaku", np.stack([t1, t2], axis=1), by)
        rows[:, q] = np.stack([along[:, 1, 0], -along[:, 0, 1], along[:, 1, 1] - along[:, 0, 0]], 1)
    return rows


def _membrane(plane: Floats) -> Floats:
    """Strains e_11, e_22, g_12 (m, 3, 3, 9) at the middles, by u_1, u_2, theta_n of the corners.

    Args:
        plane: (m, 3, 2) corners in the plane, m.
    """
    m = len(plane)
    delta = plane[:, :, None] - plane[:, None]  # [:, i, j] = x_i - x_j
    X, Y = delta[..., 0], delta[..., 1]
    doubled = X[:, 1, 0] * Y[:, 2, 0] - X[:, 2, 0] * Y[:, 1, 0]
    mean = np.zeros((m, 3, 9))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        mean[:, 0, 3 * i] = mean[:, 2, 3 * i + 1] = Y[:, j, k]
        mean[:, 1, 3 * i + 1] = mean[:, 2, 3 * i] = X[:, k, j]
        a = 1.5 / 6.0
        mean[:, 0, 3 * i + 2] = a * Y[:, j, k] * (Y[:, i, k] - Y[:, j, i])
        mean[:, 1, 3 * i + 2] = a * X[:, k, j] * (X[:, k, i] - X[:, i, j])
        mean[:, 2, 3 * i + 2] = 2 * a * (X[:, k, i] * Y[:, i, k] - X[:, i, j] * Y[:, j, i])
    mean /= doubled[:, None, None]
    spin = np.zeros((m, 3, 9))  # rotations of the corners less that of the triangle
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        spin[:, :, 3 * i] = X[:, k, j, None] / (2 * doubled[:, None])
        spin[:, :, 3 * i + 1] = Y[:, k, j, None] / (2 * doubled[:, None])
        spin[:, i, 3 * i + 2] = 1.0
    squared = np.stack([X[:, b, a] ** 2 + Y[:, b, a] ** 2 for a, b in ((0, 1), (1, 2), (2, 0))], 1)
    betas = np.array([[1, 2, 1], [0, 1, -1], [-1, -1, -2]], dtype=np.float64)
    natural = []  # at the corners; each the one before, with the corners one further
    for corner in range(3):
        shifted = np.roll(betas, corner, axis=(0, 1))
        natural.append(shifted[None] * (doubled[:, None] / (3 * squared))[:, :, None])
    by_natural = np.stack(
        [
            np.stack([Y[:, b, c] * Y[:, a, c], X[:, b, c] * X[:, a, c],
                      Y[:, b, c] * X[:, c, a] + X[:, c, b] * Y[:, a, c]], axis=1)
            * squared[:, n, None]
            for n, (a, b, c) in enumerate(((0, 1, 2), (1, 2, 0), (2, 0, 1)))
        ],
        axis=2,
    ) / doubled[:, None, None] ** 2  # fmt: skip
    strains = []
    for one, other in ((0, 1), (1, 2), (2, 0)):
        deviation = by_natural @ ((natural[one] + natural[other]) / 2) @ spin
        strains.append(mean + _DEVIATION * deviation)
    return np.stack(strains, axis=1)
