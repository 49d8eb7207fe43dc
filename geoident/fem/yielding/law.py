"""What the march needs of a yield law at the strain points of one material.

For a trial stress s* = sigma_old + E C du the holonomic step of theory 5 ends at an admissible
stress sigma, with multipliers dlam >= 0 of the planes of the law. A law knows numbers only: E and
the planes, or the constants of a curve, with their derivatives by the parameters. Where the numbers
come from is the forward model's business.
"""

from __future__ import annotations

from typing import Protocol

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual


class YieldLimits(Protocol):
    """What outputs show of the strength of a material: the distance k of each of its y planes."""

    @property
    def distances(self) -> Dual:
        """k, (y,), Pa."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the y planes."""

    def __len__(self) -> int: ...


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
