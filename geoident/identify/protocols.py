"""What an identifier needs of a model. The model behind it can be anything.

Parameter vectors p are in natural units (SI), in the order of ``names``. Readings v(p) are ordered
as the measured values that the identifier was given.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from geoident.model.arrays import Floats
from geoident.model.condensed import Condensed
from geoident.model.result import Counts

__all__ = ["AffineElastic", "Condensed", "Response"]


@runtime_checkable
class Response(Protocol):
    """A model that answers with readings: gauss-newton, simplex and scan need only this."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""

    @property
    def counts(self) -> Counts:
        """Costs so far."""

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain of the model, or None if it is inside."""

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,). Raises `geoident.errors.ModelError` where the model has no solution."""

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its exact Jacobian, (g, n)."""


@runtime_checkable
class AffineElastic(Response, Protocol):
    """A model whose equations are affine in its parameters: condensation needs this."""

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, a sentence, or None if they are."""

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        """Condensed equations at p for the measured readings (g,) of standard deviation sd (g,)."""
