"""Yield planes, and what the march needs of a yield law at the strain points of one material.

Planes psi_i = n_i^T sigma - k_i - (H lam)_i <= 0, with lam >= 0 and psi^T lam = 0 (theory 5). For a
trial stress s* = sigma_old + E C du, the holonomic step ends at

    sigma = s* - E sum_i m_i dlam_i        (m_i = n_i: associated)

which for associated flow is the projection of s* on the polyhedron in the norm of E^-1. A law knows
numbers only: E and the planes, with their derivatives by the parameters. Where the numbers come
from is the forward model's business.

A polyhedron is a complementarity problem in the multipliers of its planes,

    w = -psi* + A lam >= 0,  lam >= 0,  w^T lam = 0,   A = N E M^T + H

The matrix is that of the material, the same at all its strain points; only the yield functions psi*
of the trial stress differ. Planes are scaled (`ScaledPlanes`) so that A has a unit diagonal, which
frees tolerances from units and from the length of normals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, joined


class YieldLimits(Protocol):
    """What outputs show of the strength of a material: the distance k of each of its y planes."""

    @property
    def distances(self) -> Dual:
        """k, (y,), Pa."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the y planes."""

    def __len__(self) -> int: ...


@dataclass(frozen=True, eq=False)
class YieldPlanes:
    """Yield planes n^T sigma <= k of one material with their derivatives by n parameters.

    Args:
        normals: n, (y, s); their products with a stress are in Pa. In a `PrincipalLaw` s is 3 and
            the components are those along the principal directions.
        distances: k, (y,), Pa.
        flow: m, (y, s) directions of plastic strain; None: the normals (associated).
        hardening: H, (y, y) symmetric, positive semidefinite, Pa; None: perfect plasticity.
        names: of the y planes, for outputs; empty where nobody asks.
    """

    normals: Dual
    distances: Dual
    flow: Dual | None = None
    hardening: Dual | None = None
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.distances.columns.shape[0])

    def scaled(self, factor: Dual) -> YieldPlanes:
        """The same planes with normals, distances and flow multiplied by factors (y,)."""
        rows = factor[:, None]
        hardening = self.hardening
        return YieldPlanes(
            self.normals * rows,
            self.distances * factor,
            None if self.flow is None else self.flow * rows,
            None if hardening is None else hardening * rows * factor[None],
            self.names,
        )

    def of_unit_length(self) -> YieldPlanes:
        """The same planes with normals of unit length; the flow keeps its angle to them."""
        squares = Dual((self.normals * self.normals).columns.sum(axis=1))
        return self.scaled(squares.root().reciprocal())


def common_inside(parts: Sequence[YieldPlanes]) -> YieldPlanes:
    """One polyhedron that lies inside several; none of them may have a flow of its own."""
    hardening = None
    if any(part.hardening is not None for part in parts):
        n = parts[0].distances.n
        blocks = [part.hardening or Dual.constant(np.zeros((len(part),) * 2), n) for part in parts]
        hardening = _block_diagonal(blocks)
    return YieldPlanes(
        joined([part.normals for part in parts]),
        joined([part.distances for part in parts]),
        hardening=hardening,
        names=tuple(name for part in parts for name in part.names),
    )


def _block_diagonal(blocks: Sequence[Dual]) -> Dual:
    ends = np.cumsum([0, *(block.columns.shape[0] for block in blocks)])
    columns = np.zeros((ends[-1], ends[-1], blocks[0].columns.shape[-1]))
    for block, first, last in zip(blocks, ends[:-1], ends[1:], strict=True):
        columns[first:last, first:last] = block.columns
    return Dual(columns)


class Projection(Protocol):
    """What a law makes of the trial stresses (s, m) of the strain points of its material."""

    @property
    def stress(self) -> Floats:
        """(s, m) admissible stress; the trial stress itself where nothing yields."""

    @property
    def yielded(self) -> Ints:
        """(q,) the points with an active plane, ascending."""

    @property
    def multipliers(self) -> Floats:
        """(q, y) dlam >= 0 of this step at those points."""

    @property
    def active(self) -> Bools:
        """(q, y) planes on which the derivatives are taken: linearly independent, dlam >= 0."""

    @property
    def biactive(self) -> Bools:
        """(q, y) planes that are reached with dlam = 0 (to rounding): a kink."""

    @property
    def reduction(self) -> Floats:
        """(q, s, s) T = dsigma/ds* on the active planes; the consistent tangent is T E."""

    @property
    def reserve(self) -> Floats:
        """(q,) 1/2 (s* - sigma)^T E^-1 (s* - sigma) + 1/2 dlam^T H dlam, J/m3.

        What the potential of theory 5 loses against the elastic one.
        """

    def derivatives(
        self, trial: Floats, hardened: Floats | None = None, *, of_law: bool
    ) -> tuple[Floats, Floats]:
        """Derivatives of stress and multipliers at the yielded points, on the active planes.

        Args:
            trial: (s, q, n + k) derivatives of the trial stress, all that is in it by dE included:
                by the n parameters first, then along k other directions.
            hardened: (y, q, n + k) derivatives of the multipliers of earlier steps; None for zero.
            of_law: the first n columns are by the law's own parameters, which also change E and
                the planes themselves; otherwise only the trial stress changes, in any columns.

        Returns:
            (s, q, n + k) and (y, q, n + k).
        """


class YieldLaw(Protocol):
    """The yield law of one material at one parameter vector."""

    @property
    def associated(self) -> bool:
        """Whether the tangents are symmetric and there is a potential."""

    @property
    def planes(self) -> YieldLimits:
        """The planes as they were given."""

    @property
    def hardens(self) -> bool:
        """Whether the multipliers of earlier steps count."""

    def at(self, points: Ints) -> YieldLaw:
        """The law at some of its points, (k,) by place."""

    def project(self, trial: Floats, hardened: Floats | None = None) -> Projection:
        """Bring trial stresses (s, m) to the yield surface.

        Args:
            trial: (s, m), Pa.
            hardened: (y, m) multipliers of earlier steps; None for zero.
        """

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""


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
