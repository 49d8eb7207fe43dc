"""What every model of readings offers, whatever stands behind it."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from geoident.model.arrays import Floats
from geoident.model.result import Counts


@runtime_checkable
class Response(Protocol):
    """A model that answers with readings: gauss-newton, simplex and scan need only this.

    Parameter vectors p are in SI, in the order of ``names``; readings v(p) in one fixed order.
    """

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
