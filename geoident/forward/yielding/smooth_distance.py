"""How far polyhedra are from the round surfaces that they stand for.

The deviators of stresses are a space of two dimensions and one for every shear stress. Facets with
normals D there find max_j D_j^T x for a deviator x, the round surface finds g(x), which is larger.
Dividing D by a factor kappa <= 1 shrinks the polyhedron. It lies inside where kappa is the smallest
ratio of the two; the ratio is smallest along the normal of a facet of the convex hull of the D, so
with h the facet's distance from the origin, kappa = min h / g(normal), exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.yielding import Fit

Gauge = Callable[[Floats], Floats]
"""g (m,) of the coordinates (m, d) of deviators."""

_DRAWS = 4000
_SEED = 20
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def deviator_basis(n_strain: int) -> Floats:
    """Coordinates of deviators, orthonormal as tensors: their products with a stress (d, s)."""
    n_shear = n_strain - 3
    basis = np.zeros((2 + n_shear, n_strain))
    basis[:2, :3] = [[sqrt(0.5), -sqrt(0.5), 0.0], [-1 / sqrt(6), -1 / sqrt(6), 2 / sqrt(6)]]
    basis[2:, 3:] = sqrt(2.0) * np.eye(n_shear)
    return basis


def principal_values(deviators: Floats) -> Floats:
    """Principal deviatoric stresses (m, 3), ascending, from coordinates (m, 5)."""
    components = deviators @ deviator_basis(6)
    tensor = np.zeros((len(deviators), 3, 3))
    for k, (i, j) in enumerate(_PAIRS):
        tensor[:, i, j] = tensor[:, j, i] = components[:, k] / (1 if i == j else 2)
    return np.asarray(np.linalg.eigvalsh(tensor), dtype=np.float64)


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
