"""What the march needs of a yield law at the strain points of one material (theory 5).

Planes psi_i = n_i^T sigma - k_i - (H lam)_i <= 0, with lam >= 0 and psi^T lam = 0. For a trial
stress s* = sigma_old + E C du, the holonomic step ends at

    sigma = s* - E sum_i m_i dlam_i        (m_i = n_i: associated)

which for associated flow is the projection of s* on the polyhedron in the norm of E^-1. A law knows
numbers only: E, the planes, their derivatives by parameters. Where the numbers come from is the
forward model's business.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from geoident.model.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Planes:
    """Yield planes of one material, for one parameter vector.

    Args:
        normals: n, (y, s); their products with a stress are in Pa. In a `PrincipalLaw` s is 3 and
            the components are those along the principal directions.
        distances: k, (y,), Pa.
        flow: m, (y, s) directions of plastic strain; None: the normals (associated).
        hardening: H, (y, y) symmetric, positive semidefinite, Pa; None: perfect plasticity.
    """

    normals: Floats
    distances: Floats
    flow: Floats | None = None
    hardening: Floats | None = None


@dataclass(frozen=True)
class LawSlopes:
    """Derivatives by one parameter of what a law is made of; None where there is none.

    Args:
        elasticity: dE, (s, s), of the full elasticity matrix.
        normals: (y, s).
        distances: (y,).
        flow: (y, s); None with associated flow (it follows the normals) or where there is none.
        hardening: (y, y).
    """

    elasticity: Floats | None = None
    normals: Floats | None = None
    distances: Floats | None = None
    flow: Floats | None = None
    hardening: Floats | None = None


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

    def slopes(
        self,
        trial: Floats,
        parameters: Sequence[LawSlopes | None] = (),
        hardened: Floats | None = None,
    ) -> tuple[Floats, Floats]:
        """Derivatives of stress and multipliers at the yielded points, on the active planes.

        Args:
            trial: (s, q, n) derivatives of the trial stress, all that is in it by dE included.
            parameters: for each of the n columns what else changes in the law; empty for nothing.
            hardened: (y, q, n) derivatives of the multipliers of earlier steps; None for zero.

        Returns:
            (s, q, n) and (y, q, n).
        """


class YieldLaw(Protocol):
    """The yield law of one material at one parameter vector."""

    @property
    def associated(self) -> bool:
        """Whether the tangents are symmetric and there is a potential."""

    @property
    def n_planes(self) -> int:
        """Number y of planes."""

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
