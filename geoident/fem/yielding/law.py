"""Yield planes, and what the march needs of a yield law at the strain points of one material.

Planes psi_i = n_i^T sigma - k_i - (H lam)_i <= 0, with lam >= 0 and psi^T lam = 0 (theory 5). For a
trial stress s* = sigma_old + E C du, the holonomic step ends at

    sigma = s* - E sum_i m_i dlam_i        (m_i = n_i: associated)

which for associated flow is the projection of s* on the polyhedron in the norm of E^-1. A law knows
numbers only: E and the planes, with their derivatives by the parameters. Where the numbers come
from is the forward model's business.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

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
    def planes(self) -> YieldPlanes:
        """The planes as they were given."""

    @property
    def hardens(self) -> bool:
        """Whether the multipliers of earlier steps count."""

    def project(self, trial: Floats, hardened: Floats | None = None) -> Projection:
        """Bring trial stresses (s, m) to the yield surface.

        Args:
            trial: (s, m), Pa.
            hardened: (y, m) multipliers of earlier steps; None for zero.
        """

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
