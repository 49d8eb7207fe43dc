"""Views of solids in space: where the eye is, the frame, faces in their light, what is hidden."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from geoident.fem.near import points_in_boxes
from geoident.model.arrays import Bools, Floats

Box = tuple[Floats, Floats]
"""Lower and upper corner (dim,), m."""
_SHORT = 0.3
"""Of the longest side of a box: along a shorter one numbers would stand on each other."""
_ROUNDED = 1e-9
"""Part of the size of a surface by which the boxes of its triangles are wider, for rounding."""
_AHEAD = 1e-3
"""Part of the size of a surface from which on it lies before a point, and not at it."""


def towards(angles: tuple[float, float]) -> Floats:
    """(3,) direction from a model to the eye, by its elevation and azimuth, degrees."""
    elevation, azimuth = np.radians(angles)
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def frame(axes: Any, box: Box, angles: tuple[float, float], *, zoom: float = 1.0) -> None:
    """Limits, names and numbers of the axes of a view, and the eye; few numbers on short sides.

    Args:
        axes: of the view.
        box: what is shown.
        angles: elevation and azimuth of the eye, degrees.
        zoom: of the box in its room.
    """
    low, high = box
    for name, first, last in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(first, last)
        getattr(axes, f"set_{name}label")(f"{name} (m)")
        share = (last - first) / float((high - low).max())
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4 if share > _SHORT else 1))
    axes.set_box_aspect(high - low, zoom=zoom)
    axes.set_proj_type("ortho")
    axes.view_init(*angles)


def add_faces(axes: Any, corners: list[Floats], colours: Floats, **style: Any) -> None:
    """Faces (k, 3) in their colours, all as one, since far ones are drawn first only within one.

    Args:
        axes: of the view.
        corners: of each face, m.
        colours: (n, 4) red, green, blue, opacity.
        style: of their edges.
    """
    if corners:
        look = {"facecolors": colours, "rasterized": True, "zorder": 1, **style}
        axes.add_collection3d(Poly3DCollection(corners, **look))


def add_lines(axes: Any, ends: Floats, colour: Any, width: float) -> None:
    """Lines (k, 2, 3), m, over the faces."""
    if len(ends):
        style: dict[str, Any] = {"colors": [colour], "linewidths": width, "zorder": 2}
        axes.add_collection3d(Line3DCollection(list(ends), **style))


def hidden(points: Floats, triangles: Floats, towards: Floats) -> Bools:
    """(k,) which points in space are hidden behind a surface, seen from far away.

    Only triangles are asked in whose box a point lies as the eye sees them. The ray from a point to
    the eye meets the plane of a triangle at two weights and at a distance that are linear in the
    point; the distance is found only where the ray goes through the triangle.

    Args:
        points: (k, 3) points.
        triangles: (m, 3, 3) corners of the triangles of the surface.
        towards: (3,) direction to the eye.
    """
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(towards, v)
    volume = np.einsum("ij,ij->i", u, across)
    met = np.flatnonzero(np.abs(volume) > 1e-200)  # others are seen from their edge
    covered = np.zeros(len(points), dtype=bool)
    if not len(met):
        return covered
    a, u, v, over = triangles[met, 0], u[met], v[met], 1.0 / volume[met, None]
    first, second, depth = across[met] * over, np.cross(u, towards) * over, np.cross(u, v) * over
    origin = a.mean(axis=0)  # near all, for the sake of rounding
    a = a - origin
    start = [np.einsum("ij,ij->i", normal, a) for normal in (first, second)]
    size = float((triangles.max(axis=(0, 1)) - triangles.min(axis=(0, 1))).max())
    seen = np.linalg.svd(towards[None])[2][1:].T  # two directions across
    corners = (triangles[met] - origin) @ seen
    low, high = corners.min(axis=1) - _ROUNDED * size, corners.max(axis=1) + _ROUNDED * size
    point, triangle = points_in_boxes((points - origin) @ seen, low, high)
    here = points[point] - origin
    s, t = (
        np.einsum("ij,ij->i", here, normal[triangle]) - at[triangle]
        for normal, at in zip((first, second), start, strict=True)
    )
    through = np.flatnonzero((s >= 0) & (t >= 0) & (s + t <= 1))
    point, triangle, here = point[through], triangle[through], here[through]
    ahead = np.einsum("ij,ij->i", depth[triangle], here - a[triangle])
    covered[point[ahead > _AHEAD * size]] = True
    return covered
