"""What the responses of all models have in common: parameters, domain and costs are the model's."""

from __future__ import annotations

from typing import Protocol

from geoident.model.arrays import Floats
from geoident.model.results.costs import Counts


class AsksModel(Protocol):
    """What a response asks of its model beside readings."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""

    @property
    def counts(self) -> Counts:
        """Costs so far."""

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""


class ModelResponse:
    """Readings of a model as a function of its parameters: a `Response` but for the readings.

    Args:
        model: that is asked.
    """

    def __init__(self, model: AsksModel) -> None:
        self._asked = model

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self._asked.names

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self._asked.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return self._asked.admissible(p)
