"""Yield planes: as given, and scaled in one elasticity, with mirror images where they need them.

Planes psi_i = n_i^T sigma - k_i - (H lam)_i <= 0, with lam >= 0 and psi^T lam = 0 (theory 5). For a
trial stress s* = sigma_old + E C du, the return mapping ends at

    sigma = s* - E sum_i m_i dlam_i        (m_i = n_i: associated)

which for associated flow is the projection of s* on the polyhedron in the norm of E^-1. It is a
complementarity problem in the multipliers of the planes,

    w = -psi* + A lam >= 0,  lam >= 0,  w^T lam = 0,   A = N E M^T + H

The matrix is that of the material, the same at all its strain points; only the yield functions psi*
of the trial stress differ. Planes are scaled (`ScaledPlanes`) so that A has a unit diagonal, which
frees tolerances from units and from the length of normals.

An isotropic surface is the same in all six orders of the principal stresses. Stated are planes for
sigma_1 >= sigma_2 >= sigma_3; those of the other orders, their images, make its edges and its apex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, joined


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

    @property
    def associated(self) -> bool:
        """Whether plastic strains follow the normals."""
        return self.flow is None or np.array_equal(self.flow.value, self.normals.value)

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m), Pa, of stresses (s, m) and earlier multipliers (y, m)."""
        excess = self.normals.value @ stress - self.distances.value[:, None]
        if hardened is not None and self.hardening is not None:
            excess -= self.hardening.value @ hardened
        return np.asarray(excess)

    def of_unit_length(self) -> YieldPlanes:
        """The same planes with normals of unit length; the flow keeps its angle to them."""
        squares = Dual((self.normals * self.normals).columns.sum(axis=1))
        factor = squares.root().reciprocal()
        rows, hardening = factor[:, None], self.hardening
        return YieldPlanes(
            self.normals * rows,
            self.distances * factor,
            None if self.flow is None else self.flow * rows,
            None if hardening is None else hardening * rows * factor[None],
            self.names,
        )


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


_ON_PLANE = 1e-13
"""Of the terms of a yield function: their rounding, within which a stress is on the plane."""

_ORDERS = np.array(list(permutations(range(3))))
_CYCLES = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1)])
"""Orders of a plane's components, of which the images of a cone's plane meet in its apex."""


class ScaledPlanes:
    """Scaled planes in one elasticity, with their derivatives at the scale of the values.

    Args:
        elasticity: E (s, s), Pa, symmetric, positive definite.
        planes: normals (i, s), those of images included.
        owner: (i,) the stated plane of which each is an image; None where each stands for itself.
        for_apex: (i,) planes used only for the return to the apex, where flow may have any
            direction; they get associated flow, so that three of them are independent.

    Attributes:
        scale: (i,) what normals and distances were divided by, and multipliers multiplied with.
        elasticity: E (s, s).
        normals: N (i, s), scaled.
        flow: M (i, s), scaled.
        distances: k (i,), scaled.
        hardening: H (i, i), scaled; zero for none.
        hardens: whether H is not zero.
        by_parameter: E, N, M, k and H with their derivatives.

    Raises:
        ValueError: E is not positive definite, or a plane has no normal or a flow against it.
    """

    def __init__(
        self,
        elasticity: Dual,
        planes: YieldPlanes,
        owner: Ints | None = None,
        for_apex: Bools | None = None,
    ) -> None:
        count, n = len(planes), planes.distances.n
        self.owner = np.arange(count) if owner is None else owner
        self.for_apex = np.zeros(count, dtype=np.bool_) if for_apex is None else for_apex
        self._total: Floats | None = None
        if owner is not None:
            self._total = (owner == np.arange(owner.max() + 1)[:, None]).astype(np.float64)

        self.elasticity: Floats = np.asarray(0.5 * (elasticity.value + elasticity.value.T))
        try:
            np.linalg.cholesky(self.elasticity)
        except np.linalg.LinAlgError as error:
            raise ValueError("the elasticity matrix is not positive definite") from error
        if not np.isfinite(planes.distances.value).all():
            raise ValueError("a plane without a finite distance is none")
        flow = planes.normals if planes.flow is None else planes.flow
        hardening = planes.hardening or Dual.constant(np.zeros((count, count)), n)
        normals, directions = planes.normals.value, flow.value
        own = np.einsum("ys,st,yt->y", normals, self.elasticity, directions)
        if np.any(own <= 0.0):
            raise ValueError(f"plane {int(np.argmin(own)) + 1} has no normal, or flows inwards")
        self.scale: Floats = np.sqrt(own + np.diag(hardening.value))
        factor, rows = 1.0 / self.scale, 1.0 / self.scale[:, None]
        scaled = planes.normals * rows, flow * rows, planes.distances * factor
        self.by_parameter = elasticity, *scaled, hardening * (rows * factor)
        self.normals, self.flow, self.distances, self.hardening = (
            np.ascontiguousarray(part.value) for part in self.by_parameter[1:]
        )
        self.hardens = bool(self.hardening.any())

    @classmethod
    def of_sorted(cls, elasticity: Dual, planes: YieldPlanes) -> ScaledPlanes:
        """Planes (y, 3) for sorted principal stresses with their different images.

        Args:
            elasticity: E (3, 3) of principal stresses and strains.
            planes: with descending components of normals; they do not harden.

        Raises:
            ValueError: a normal does not descend, so the surface would not be convex.
        """
        given_flow = planes.normals if planes.flow is None else planes.flow
        normals, flow = planes.normals.value, given_flow.value
        if np.any(np.diff(normals, axis=1) > 0.0):
            raise ValueError("normals for sorted principal stresses must descend")
        rows: list[tuple[int, Ints, bool]] = []
        for p in range(len(normals)):
            both = np.concatenate([normals[p][_ORDERS], flow[p][_ORDERS]], axis=1)
            _, first = np.unique(both, axis=0, return_index=True)
            rows += [(p, order, False) for order in _ORDERS[np.sort(first)]]
            is_cone = np.ptp(normals[p]) > 0.0 and normals[p].sum() > 0.0
            if is_cone and np.any(flow[p] != normals[p]):
                rows += [(p, order, True) for order in _CYCLES]
        owner, orders, for_apex = (np.array(column) for column in zip(*rows, strict=True))

        def turned(directions: Dual) -> Dual:
            return Dual(np.take_along_axis(directions.columns[owner], orders[..., None], axis=1))

        image_normals, image_flow = turned(planes.normals), turned(given_flow)
        image_flow = Dual(
            np.where(for_apex[:, None, None], image_normals.columns, image_flow.columns)
        )
        images = YieldPlanes(image_normals, planes.distances[owner], image_flow)
        return cls(elasticity, images, owner, for_apex)

    def summed(self, values: Floats) -> Floats:
        """Sums (y, ...) over the images of each stated plane of values (i, ...)."""
        return values if self._total is None else np.tensordot(self._total, values, axes=1)

    @cached_property
    def moved(self) -> Floats:
        """E M^T (s, i): the stress that a unit multiplier takes away."""
        return np.asarray(self.elasticity @ self.flow.T)

    @cached_property
    def coupling(self) -> Floats:
        """A (i, i): the drop of yield functions by multipliers."""
        return np.asarray(self.normals @ self.moved + self.hardening)

    @cached_property
    def root(self) -> Floats:
        """B (s + i, i) with B^T B = A, for associated flow: columns whose angles count."""
        plain = np.linalg.cholesky(self.elasticity).T @ self.normals.T
        values, vectors = np.linalg.eigh(self.hardening)
        return np.concatenate([plain, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T])

    def limits(self, hardened: Floats | None) -> Floats:
        """Scaled distances k + H Lam, (i, 1) or (i, m), of unscaled multipliers (i, m)."""
        if hardened is None or not self.hardens:
            return self.distances[:, None]
        return self.distances[:, None] + self.hardening @ (self.scale[:, None] * hardened)

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """Scaled yield functions (i, m) of stresses (s, m)."""
        return np.asarray(self.normals @ stress - self.limits(hardened))

    def tolerance(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """What rounding leaves of the scaled yield functions on the way from stresses, (i, m).

        Their terms are distances, the stress, and how far the way goes: couplings are at most 1.
        """
        largest = np.abs(stress).max(axis=0, initial=0.0)
        way = np.maximum(self.excess(stress, hardened).max(axis=0, initial=0.0), 0.0)
        lengths = np.abs(self.normals).sum(axis=1)[:, None]
        return np.asarray(_ON_PLANE * (np.abs(self.limits(hardened)) + lengths * largest + way))
