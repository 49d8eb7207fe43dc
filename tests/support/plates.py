"""Small plane-strain blocks of ground under staged loads, as complementarity systems."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.fem.kinematics import block_geometry, kinematics_of, strain_points
from geoident.forward.equation_arrays import (
    Affine,
    EquationArrays,
    LoadStage,
    PointLaw,
    PointSet,
    fixed,
)
from geoident.model.arrays import Floats
from geoident.model.case import Analysis

from .meshes import box

E, NU = 1000.0, 0.3


def tresca(k: Affine, n: int, *, planes: int = 8) -> PointLaw:
    """Tresca in plane strain as planes around the circle of shear; k (1,) or (planes,)."""
    angle = 2.0 * np.pi * np.arange(planes) / planes
    normals = np.zeros((planes, 4))
    normals[:, 0], normals[:, 1] = 0.5 * np.cos(angle), -0.5 * np.cos(angle)
    normals[:, 3] = np.sin(angle)
    distances = (
        k
        if len(k.constant) == planes
        else Affine(np.repeat(k.constant, planes), np.repeat(k.slopes, planes, axis=0))
    )
    return PointLaw(fixed(elasticity(), n), normals, distances, fixed(np.zeros((planes,) * 2), n))


def elasticity() -> Floats:
    lam, mu = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
    D = np.zeros((4, 4))
    D[:3, :3] = lam
    D += np.diag([2 * mu, 2 * mu, 2 * mu, mu])
    return D


def footing(
    cells: tuple[int, int],
    laws: tuple[PointLaw, ...],
    names: tuple[str, ...],
    pressures: tuple[float, ...],
    *,
    kind: str = "tri3",
) -> EquationArrays:
    """A block loaded on the left third of its top, pressure by pressure; laws layer by layer.

    The readings are settlements along the top and side movements of the right edge, of every
    stage, each against the stage before.
    """
    mesh = box(kind, cells, size=(3.0, 2.0), distortion=0.2)
    kinematics = kinematics_of(Analysis.PLANE_STRAIN)
    points = strain_points(
        mesh, (block_geometry(mesh.points, mesh.blocks[0], kinematics),), kinematics
    )
    x, y = mesh.points.T
    held = np.concatenate(
        [2 * np.flatnonzero((x < 1e-9) | (x > 3.0 - 1e-9)), 2 * np.flatnonzero(y < 1e-9) + 1]
    )
    held = np.union1d(held, 2 * np.flatnonzero(y < 1e-9))
    free = np.setdiff1d(np.arange(2 * len(x)), held)
    n, count = len(names), len(laws)
    layer = np.minimum((points.position[:, 1] / 2.0 * count).astype(int), count - 1)
    sets = tuple(
        _some(points, np.flatnonzero(layer == k), n, f"layer {k + 1}") for k in range(count)
    )
    pull = _top_pressure(x, y)
    every = {k: k for k in range(count)}
    stages = tuple(
        LoadStage(f"stage {j + 1}", j - 1, every, frozenset(), free, fixed(q * pull, n))
        for j, q in enumerate(pressures)
    )
    top = np.flatnonzero(y > 2.0 - 1e-9)
    middle = np.flatnonzero((np.abs(x - 1.5) < 0.3) & (y < 2.0 - 1e-9) & (y > 0.5))[:6]
    dofs = np.concatenate([2 * top[:-1] + 1, 2 * middle])
    one = sp.csr_array(
        (np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), 2 * len(x))
    )
    rows = sp.csr_array(sp.vstack([one] * len(pressures)))
    active = np.kron(np.eye(len(pressures)), np.ones((1, len(dofs))))
    return EquationArrays(
        names, sets, laws, stages, rows, active, fixed(np.zeros(len(active.T)), n)
    )


def _some(points: Any, which: Any, n: int, name: str) -> PointSet:
    C = points.compatibility(which)
    return PointSet(name, C, points.volume[which], fixed(np.zeros((4, len(which))), n))


def _top_pressure(x: Floats, y: Floats) -> Floats:
    """Nodal forces of a unit pressure downwards on the left third of the top."""
    nodes = np.flatnonzero((y > 2.0 - 1e-9) & (x < 1.0 + 1e-6))
    nodes = nodes[np.argsort(x[nodes])]
    forces = np.zeros(2 * len(x))
    for a, b in pairwise(nodes):
        forces[[2 * a + 1, 2 * b + 1]] -= 0.5 * (x[b] - x[a])
    return forces
