"""What every identifier gives back: where it ended, and on which way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from geoident.model.arrays import Floats
from geoident.model.response import Response
from geoident.model.results.result import STOPPED, Grid, Iteration
from geoident.model.yielding import Certificate

OnIteration = Callable[[Iteration], str | None]
"""Is called with every iteration; returns a reason to stop now, or None to go on."""


@dataclass(frozen=True)
class LocalMinimum:
    """A minimum of the discrepancy that a search came to beside its best point.

    Args:
        values: (n,) parameters, SI.
        objective: the discrepancy there, with the prior's part.
    """

    values: Floats
    objective: float


@dataclass(frozen=True)
class Outcome:
    """Where an identifier ended.

    Args:
        values: (n,) the best parameters found, SI.
        objective: the discrepancy there, with the prior's part.
        status: ``converged``, ``not-converged`` or ``out-of-budget``.
        reason: why it stopped, a sentence; with its remedy where it did not converge.
        iterations: the history.
        grid: of a scan, else None.
        remarks: what else is to be known of how it was found, sentences without a full stop.
        certificate: what an identification of yield limits proved, else None.
        minima: the others that the search came to, lowest first.
    """

    values: Floats
    objective: float
    status: str
    reason: str
    iterations: tuple[Iteration, ...]
    grid: Grid | None = None
    remarks: tuple[str, ...] = ()
    certificate: Certificate | None = None
    minima: tuple[LocalMinimum, ...] = ()


class History:
    """Collects the iterations of one method and listens for a reason to stop.

    Args:
        method: name of the method, as users write it.
        response: the model, whose costs are noted.
        on_iteration: is called with every iteration.

    Attributes:
        stop: the reason to stop now that `on_iteration` gave, or None.
    """

    def __init__(self, method: str, response: Response, on_iteration: OnIteration) -> None:
        self.stop: str | None = None
        self._method = method
        self._response = response
        self._on_iteration = on_iteration
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
        self.stop = self._on_iteration(entry) or self.stop

    def outcome(self, values: Floats, objective: float, status: str, reason: str) -> Outcome:
        """The outcome of the method, whose status and reason give way to those of a stop.

        Args:
            values: (n,) the best parameters found, SI.
            objective: the discrepancy there.
            status: of a method that was not stopped.
            reason: why it ended, a sentence.
        """
        if self.stop is not None:
            status, reason = STOPPED, self.stop
        return Outcome(values, objective, status, reason, self.iterations)
