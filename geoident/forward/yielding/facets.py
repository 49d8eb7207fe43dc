"""Facets around round yield surfaces: directions spread evenly, and how far facets are from round.

On the sphere of any dimension the widest hole between some points is the lowest facet of their
convex hull: its normal points to the middle of the hole, its distance from the centre is the cosine
of the hole's radius. Putting a point there, with its mirror images, again and again gives an even
spread. A frame of three orthogonal directions is a point on the sphere of unit quaternions; to turn
its axes into each other changes nothing, so 48 points stand for one frame.

The deviators of stresses are a space of two dimensions and one for every shear stress. Facets with
normals D there find max_j D_j^T x for a deviator x, the round surface finds g(x), which is larger.
Dividing D by a factor kappa <= 1 shrinks the polyhedron. It lies inside where kappa is the smallest
ratio of the two; the ratio is smallest along the normal of a facet of the convex hull of the D, so
with h the facet's distance from the origin, kappa = min h / g(normal), exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import combinations, product
from math import sqrt
from typing import Any

import numpy as np

from geoident.fem.yielding.principal_axes import principal_values
from geoident.model.arrays import Floats
from geoident.model.yielding import Fit

_SAME_POINT = 1e-9
"""Of the unit sphere: rounding, within which two points or two holes are the same."""

Gauge = Callable[[Floats], Floats]
"""g (m,) of the coordinates (m, d) of deviators."""

_DRAWS = 4000
"""Deviators over which ratios are averaged: they scatter by 0.1 at most, their mean by 0.002."""

_SEED = 20  # any: the same faces in each run


@lru_cache(maxsize=32)
def spread_directions(count: int) -> Floats:
    """At least `count` directions (n, 3) in space, with their mirror images in x, y and z."""
    return _directions(count, _signs(3))


@lru_cache(maxsize=32)
def spread_deviators(count: int, n_strain: int) -> Floats:
    """At least `count` directions (n, d) of deviators, by the coordinates of `deviator_basis`.

    They keep their mirror images in the axes of the model: in a section (3 coordinates) all signs
    may change; in a solid (5) shear stresses change theirs in pairs.
    """
    if n_strain < 6:
        return _directions(count, _signs(3))
    x, y, z, both = _signs(4).T
    return _directions(count, np.stack([both, both, x * y * both, y * z * both, x * z * both], 1))


@lru_cache(maxsize=32)
def spread_frames(count: int) -> Floats:
    """At least `count` frames, with their mirror images; their axes are columns, (n, 3, 3).

    The model's own axes are among them.
    """
    octahedral = _octahedral()
    halves = np.eye(4)  # half turns about the axes of the model

    def images(middle: Floats) -> Floats:
        turned = _distinct(_times(halves, middle[None]))
        return _distinct(_times(turned[:, None], octahedral[None]).reshape(-1, 4))

    points = _fill(octahedral, images, count * len(octahedral))
    return _one_of_each(np.stack([_rotation(q) for q in points]))


def _directions(count: int, signs: Floats) -> Floats:
    d = signs.shape[1]
    seeds = np.concatenate([np.eye(d), -np.eye(d)])
    return _fill(seeds, lambda middle: _distinct(signs * middle), count)


def _fill(seeds: Floats, images: Callable[[Floats], Floats], count: int) -> Floats:
    """Points (n, d), at least `count`."""
    from scipy.spatial import ConvexHull  # noqa: PLC0415

    points = seeds
    hull = ConvexHull(points, incremental=True)
    while len(points) < count:
        new = images(_middle_of_widest_hole(hull))
        points = np.concatenate([points, new])
        hull.add_points(new)
    return points


def _middle_of_widest_hole(hull: Any) -> Floats:
    """A direction (d,); of several, always the same one."""
    distances = -hull.equations[:, -1]
    widest = hull.equations[distances < distances.min() + _SAME_POINT, :-1]
    first = np.lexsort(np.round(widest, 6).T)[-1]
    return np.array(widest[first])


def _distinct(points: Floats) -> Floats:
    """Each point once, in the order given."""
    near = points @ points.T > 1.0 - _SAME_POINT
    return points[~np.tril(near, -1).any(axis=1)]


def _one_of_each(axes: Floats) -> Floats:
    """One frame (n, 3, 3) of all that share their axes, in the order given.

    The sum of a a a a over the axes a does not change with their order and signs.
    """
    alike = np.einsum("nia,nja,nka,nla->nijkl", axes, axes, axes, axes).reshape(len(axes), -1)
    _, first = np.unique(np.round(alike, 6) + 0.0, axis=0, return_index=True)
    return axes[np.sort(first)]


def _signs(d: int) -> Floats:
    return np.array(list(product((1.0, -1.0), repeat=d)))


def _octahedral() -> Floats:
    """The 48 unit quaternions of the 24 rotations that turn the axes into each other."""
    half = sqrt(0.5)
    quaternions: list[Sequence[float]] = [*np.eye(4), *-np.eye(4)]
    for i, j in combinations(range(4), 2):
        for one, other in product((half, -half), repeat=2):
            quaternions.append([one if k == i else other if k == j else 0.0 for k in range(4)])
    quaternions += [[x / 2 for x in signs] for signs in product((1.0, -1.0), repeat=4)]
    return np.array(quaternions)


def _times(p: Floats, q: Floats) -> Floats:
    """Products of quaternions (..., 4): first the rotation q, then p."""
    a, b, c, d = np.moveaxis(p, -1, 0)
    w, x, y, z = np.moveaxis(q, -1, 0)
    parts = [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]
    return np.stack(parts, axis=-1)


def _rotation(q: Floats) -> Floats:
    """Rotation matrix (3, 3) of a unit quaternion."""
    w, *v = q
    x, y, z = v
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def deviator_basis(n_strain: int) -> Floats:
    """Coordinates of deviators, orthonormal as tensors: their products with a stress (d, s)."""
    n_shear = n_strain - 3
    basis = np.zeros((2 + n_shear, n_strain))
    basis[:2, :3] = [[sqrt(0.5), -sqrt(0.5), 0.0], [-1 / sqrt(6), -1 / sqrt(6), 2 / sqrt(6)]]
    basis[2:, 3:] = sqrt(2.0) * np.eye(n_shear)
    return basis


def principal_deviators(deviators: Floats) -> Floats:
    """Principal deviatoric stresses (3, m), descending, from coordinates (m, 5)."""
    components = deviators @ deviator_basis(6)
    components[:, 3:] *= 0.5  # in products with a stress each shear counts twice
    return principal_values(components.T)


def polygon_shrinkage(sides: int, fit: Fit) -> float:
    """The factor kappa of a regular polygon in place of a circle."""
    half = np.pi / sides
    if fit == "inscribed":
        return float(np.cos(half))
    return float(np.sin(half) / half) if fit == "best" else 1.0


def shrinkage(fit: Fit, normals: Floats, gauge: Gauge) -> float:
    """The factor kappa of facets around a round surface.

    Args:
        fit: how they are to lie; ``best``: of the same size on average over all deviators.
        normals: (y, s) deviators, as components whose products with stresses count.
        gauge: g of the round surface.
    """
    if fit == "circumscribed":
        return 1.0
    vectors = normals @ np.linalg.pinv(deviator_basis(normals.shape[1]))
    return _smallest(vectors, gauge) if fit == "inscribed" else _mean(vectors, gauge)


def _smallest(vectors: Floats, gauge: Gauge) -> float:
    from scipy.spatial import ConvexHull  # noqa: PLC0415

    equations = ConvexHull(vectors).equations
    return float((-equations[:, -1] / gauge(equations[:, :-1])).min())


def _mean(vectors: Floats, gauge: Gauge) -> float:
    draws = np.random.default_rng(_SEED).normal(size=(_DRAWS, vectors.shape[1]))
    return float(((draws @ vectors.T).max(axis=1) / gauge(draws)).mean())
