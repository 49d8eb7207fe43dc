"""Distance of points from faces: segments in the plane, triangles in space."""

from __future__ import annotations

import numpy as np

from geoident.fem.elements import reference_element
from geoident.fem.faces import FacetPatch
from geoident.model.arrays import Floats
from geoident.model.mesh import Mesh


def distance_to_faces(mesh: Mesh, patches: tuple[FacetPatch, ...], point: Floats) -> float:
    """Distance of a point (dim,) from the nearest of some faces, m; their edges count as straight.

    Infinite if there are none.
    """
    nearest = np.inf
    for patch in patches:
        n_corners = reference_element(patch.kind).n_corners
        for k in range(1, n_corners - 1) if mesh.dim == 3 else (1,):
            corners = mesh.points[patch.nodes[:, [0, k, k + 1] if mesh.dim == 3 else [0, 1]]]
            away = _to_triangles if mesh.dim == 3 else _to_segments
            nearest = min(nearest, float(away(corners, point).min(initial=np.inf)))
    return nearest


def _to_segments(ends: Floats, point: Floats) -> Floats:
    """(n,) distances of a point from segments (n, 2, dim)."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", point - start, along) / np.where(length > 0, length, 1.0)
    nearest = start + np.clip(t, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(point - nearest, axis=1))


def _to_triangles(corners: Floats, point: Floats) -> Floats:
    """(n,) distances of a point from triangles (n, 3, 3)."""
    a, b, c = corners.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    v = np.einsum("ij,ij->i", np.cross(point - a, c - a), normal) / area
    w = np.einsum("ij,ij->i", np.cross(b - a, point - a), normal) / area
    above = np.abs(np.einsum("ij,ij->i", point - a, normal)) / np.sqrt(area)
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    edges = [_to_segments(corners[:, pair], point) for pair in ([0, 1], [1, 2], [2, 0])]
    return np.asarray(np.where(inside, above, np.min(edges, axis=0)))
