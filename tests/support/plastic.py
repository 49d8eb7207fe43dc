"""Yield planes, elasticities and an independent solver for tests of yield laws."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
import piqp

from geoident.fem.yielding.plane_laws import PolyhedralLaw, PrincipalLaw
from geoident.fem.yielding.planes import YieldPlanes
from geoident.model.dual import Dual


@dataclass(frozen=True)
class Planes:
    """Yield planes as plain arrays, or (with ``elasticity``) their changes by one parameter."""

    normals: np.ndarray | None = None
    distances: np.ndarray | None = None
    flow: np.ndarray | None = None
    hardening: np.ndarray | None = None
    elasticity: np.ndarray | None = None

    def dual(self, slopes=()):
        """As the program has them, with derivatives by the parameters of some changes."""
        parts = {
            name: with_slopes(getattr(self, name), [getattr(s, name) for s in slopes])
            for name in ("normals", "distances", "flow", "hardening")
        }
        return YieldPlanes(**parts)


def with_slopes(value, slopes=()):
    """A value with derivatives, None for zero; None stays None."""
    if value is None:
        return None
    given = [np.zeros_like(value) if slope is None else slope for slope in slopes]
    return Dual(np.stack([value, *given], axis=-1))


def polyhedral(elasticity, planes, slopes=()):
    """The law of planes in the space of stresses."""
    moduli = with_slopes(elasticity, [s.elasticity for s in slopes])
    return PolyhedralLaw(moduli, planes.dual(slopes))


def principal(elasticity, planes, slopes=()):
    """The law of planes in sorted principal stresses."""
    moduli = with_slopes(elasticity, [s.elasticity for s in slopes])
    return PrincipalLaw(moduli, planes.dual(slopes))


def definite(rng, size):
    """A symmetric positive definite matrix of moderate condition."""
    half = rng.normal(size=(size, size))
    return half @ half.T + size * np.eye(size)


def isotropic(lame, shear, size):
    """Isotropic elasticity of 4 or 6 stress components."""
    elasticity = np.diag([2.0 * shear] * 3 + [shear] * (size - 3))
    elasticity[:3, :3] += lame
    return elasticity


def random_planes(rng, count, size, *, hardening=0.0):
    """Planes around the origin; hardening couples them."""
    half = rng.normal(size=(count, max(1, count // 2)))
    return Planes(
        normals=rng.normal(size=(count, size)),
        distances=rng.uniform(0.3, 1.5, count),
        hardening=hardening * half @ half.T if hardening else None,
    )


def coulomb(friction, cohesion, *, tension=None, dilation=None):
    """Exact Mohr-Coulomb in sorted principal stresses."""

    def along(angle):
        return [1.0 + np.sin(angle), 0.0, np.sin(angle) - 1.0]

    cut = [] if tension is None else [[1.0, 0.0, 0.0]]
    distances = [2.0 * cohesion * np.cos(friction)] + ([] if tension is None else [tension])
    return Planes(
        normals=np.array([along(friction), *cut]),
        distances=np.array(distances),
        flow=None if dilation is None else np.array([along(dilation), *cut]),
    )


def projection_by_piqp(elasticity, planes, trial, hardened=None):
    """One point: the stress nearest to trial (s,), by an interior-point method in (stress, lam)."""
    size, count = planes.normals.shape[1], len(planes.normals)
    hardening = np.zeros((count, count)) if planes.hardening is None else planes.hardening
    limits = planes.distances + (0.0 if hardened is None else hardening @ hardened)
    inverse = np.linalg.inv(elasticity)
    hessian = np.zeros((size + count, size + count))
    hessian[:size, :size] = inverse
    hessian[size:, size:] = hardening
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_duality_gap_abs = 1e-14
    solver.settings.eps_rel = solver.settings.eps_duality_gap_rel = 1e-14
    solver.settings.max_iter = 500
    rows = np.hstack([planes.normals, -hardening])
    cost = np.concatenate([-inverse @ trial, np.zeros(count)])
    solver.setup(
        np.asfortranarray(hessian), cost, None, None, np.asfortranarray(rows),
        np.full(count, -1e30), limits,
    )  # fmt: skip
    solver.solve()
    return np.array(solver.result.x)[:size]


def images(planes):
    """All permutations of planes (y, 3), without thought for repeated ones, and their owners."""
    flow = planes.normals if planes.flow is None else planes.flow
    orders = [list(p) for p in permutations(range(3))]
    count = len(planes.normals)
    return (
        np.array([planes.normals[y][o] for y in range(count) for o in orders]),
        np.array([flow[y][o] for y in range(count) for o in orders]),
        np.repeat(planes.distances, 6),
        np.repeat(np.arange(count), 6),
    )


def brute_force_return(elasticity, planes, values):
    """Principal stresses (3,) of sorted trial ones by all active sets of all images, or None.

    Nothing is shared with the program but the statement of the problem.
    """
    normals, flow, distances, _ = images(planes)
    small = 1e-9 * (1.0 + np.abs(values).max())
    if np.all(normals @ values - distances <= small):
        return values
    for size in (1, 2, 3):
        for some in map(list, combinations(range(len(normals)), size)):
            coupling = normals[some] @ elasticity @ flow[some].T
            if np.linalg.cond(coupling) > 1e9:
                continue
            lam = np.linalg.solve(coupling, normals[some] @ values - distances[some])
            stress = values - elasticity @ flow[some].T @ lam
            if lam.min() >= -small and np.all(normals @ stress - distances <= small):
                return stress
    return None


def matrix_of(stress):
    """Stress (4,) or (6,) as a matrix."""
    xx, yy, zz, xy = stress[:4]
    yz, xz = (0.0, 0.0) if len(stress) == 4 else stress[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
