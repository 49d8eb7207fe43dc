"""The history of a search, told to the observer as it grows."""

from __future__ import annotations

from geoident.identify.problem.problem import Observer
from geoident.identify.problem.protocols import Response
from geoident.model.arrays import Floats
from geoident.model.result import Iteration


class History:
    """Collects the iterations of one method and listens for a reason to stop.

    Args:
        method: name of the method, as users write it.
        response: the model, whose costs are noted.
        observe: is told of every iteration.

    Attributes:
        stop: the reason that the observer gave for stopping now, or None.
    """

    def __init__(self, method: str, response: Response, observe: Observer) -> None:
        self.stop: str | None = None
        self._method = method
        self._response = response
        self._observe = observe
        self._iterations: list[Iteration] = []

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        """All iterations so far."""
        return tuple(self._iterations)

    def record(self, values: Floats, objective: float, *, step: float, note: str) -> None:
        """Adds an iteration.

        Args:
            values: (n,) parameters, SI.
            objective: the discrepancy there.
            step: size of the step in scaled parameters.
            note: such as ``accepted``.
        """
        number = len(self._iterations)
        counts = self._response.counts
        entry = Iteration(self._method, number, objective, values.copy(), step, counts, note)
        self._iterations.append(entry)
        self.stop = self._observe(entry) or self.stop
