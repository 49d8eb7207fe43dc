"""The planes of one polyhedron as a complementarity problem in their multipliers.

    w = -psi* + A lam >= 0,  lam >= 0,  w^T lam = 0,   A = N E M^T + H

The matrix is that of the material, the same at all its strain points; only the yield functions psi*
of the trial stress differ. Planes are scaled so that A has a unit diagonal, which frees tolerances
from units and from the length of normals.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from geoident.fem.yielding.law import YieldPlanes
from geoident.model.arrays import Floats
from geoident.model.dual import Dual

_ROUNDING = 1e-13
"""Of the terms a yield function is the difference of: what is smaller counts as on the plane."""


class ScaledPlanes:
    """Scaled planes in one elasticity, with their derivatives at the scale of the values.

    Args:
        elasticity: E (s, s), Pa, symmetric, positive definite.
        planes: normals (y, s).

    Attributes:
        scale: (y,) what normals and distances were divided by, and multipliers multiplied with.
        elasticity: E (s, s).
        normals: N (y, s), scaled.
        flow: M (y, s), scaled.
        distances: k (y,), scaled.
        hardening: H (y, y), scaled; zero for none.
        by_parameter: E and the scaled planes with their derivatives.

    Raises:
        ValueError: E is not positive definite, or a plane has no normal or a flow against it.
    """

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        self.elasticity: Floats = np.asarray(0.5 * (elasticity.value + elasticity.value.T))
        _check_definite(self.elasticity)
        if not np.isfinite(planes.distances.value).all():
            raise ValueError("a plane without a finite distance is none")
        flow = planes.normals if planes.flow is None else planes.flow
        count = len(planes)
        hardening = np.zeros((count, count))
        if planes.hardening is not None:
            hardening = np.ascontiguousarray(planes.hardening.value)
        own = np.einsum("ys,st,yt->y", planes.normals.value, self.elasticity, flow.value)
        if np.any(own <= 0.0):
            raise ValueError(f"plane {int(np.argmin(own)) + 1} has no normal, or flows inwards")
        self.scale: Floats = np.sqrt(own + np.diag(hardening))
        length = self.scale[:, None]
        self.normals: Floats = np.ascontiguousarray(planes.normals.value) / length
        self.flow: Floats = np.ascontiguousarray(flow.value) / length
        self.distances: Floats = planes.distances.value / self.scale
        self.hardening: Floats = hardening / (length * length.T)
        self.by_parameter = (
            elasticity,
            planes.scaled(Dual.constant(1.0 / self.scale, planes.distances.n)),
        )

    @cached_property
    def moved(self) -> Floats:
        """E M^T (s, y): the stress that a unit multiplier takes away."""
        return np.asarray(self.elasticity @ self.flow.T)

    @cached_property
    def coupling(self) -> Floats:
        """A (y, y): the drop of yield functions by multipliers."""
        return np.asarray(self.normals @ self.moved + self.hardening)

    @cached_property
    def root(self) -> Floats:
        """B (s + y, y) with B^T B = A, for associated flow: columns whose angles count."""
        plain = np.linalg.cholesky(self.elasticity).T @ self.normals.T
        values, vectors = np.linalg.eigh(self.hardening)
        return np.concatenate([plain, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T])

    @cached_property
    def hardens(self) -> bool:
        """Whether H is not zero."""
        return bool(self.hardening.any())

    def limits(self, hardened: Floats | None) -> Floats:
        """Scaled distances k + H Lam (y, 1) or (y, m), of multipliers (y, m) as they are given."""
        if hardened is None or not self.hardens:
            return self.distances[:, None]
        return self.distances[:, None] + self.hardening @ (self.scale[:, None] * hardened)

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """Scaled yield functions (y, m) of stresses (s, m)."""
        return np.asarray(self.normals @ stress - self.limits(hardened))

    def tolerance(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """What rounding leaves of the scaled yield functions on the way from stresses, (y, m).

        Their terms are distances, the stress, and how far the way goes: couplings are at most 1.
        """
        largest = np.abs(stress).max(axis=0, initial=0.0)
        way = np.maximum(self.excess(stress, hardened).max(axis=0, initial=0.0), 0.0)
        lengths = np.abs(self.normals).sum(axis=1)[:, None]
        return np.asarray(_ROUNDING * (np.abs(self.limits(hardened)) + lengths * largest + way))


def _check_definite(elasticity: Floats) -> None:
    """Refuse an elasticity with which stresses have no norm."""
    try:
        np.linalg.cholesky(elasticity)
    except np.linalg.LinAlgError as error:
        raise ValueError("the elasticity matrix is not positive definite") from error
