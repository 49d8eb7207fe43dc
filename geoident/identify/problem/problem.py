"""What every identifier is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from geoident.identify.problem.protocols import Response
from geoident.model.arrays import Floats
from geoident.model.methods import LossOptions, SquaredOptions
from geoident.model.parameter import Parameter
from geoident.model.result import Grid, Iteration
from geoident.model.yielding import Certificate

Observer = Callable[[Iteration], str | None]
"""Is told of every iteration; answers with a reason to stop now, or None to go on."""


@dataclass(frozen=True)
class Problem:
    """Readings to be met by a model.

    Args:
        response: the model.
        measured: (g,) readings v*, SI.
        sd: (g,) their standard deviations s, SI; the weights are 1/s^2.
        parameters: the n unknowns with bounds, scale and prior; ``start`` is where to begin.
        loss: how much a large residual counts.
    """

    response: Response
    measured: Floats
    sd: Floats
    parameters: tuple[Parameter, ...]
    loss: LossOptions = field(default_factory=SquaredOptions)

    @property
    def start(self) -> Floats:
        """(n,) where to begin, SI."""
        return np.array([q.start for q in self.parameters], dtype=np.float64)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds (n,), (n,) of the parameters, SI."""
        ends = np.array([(q.lower, q.upper) for q in self.parameters], dtype=np.float64)
        return ends.reshape(-1, 2)[:, 0], ends.reshape(-1, 2)[:, 1]

    def begun_at(self, values: Floats) -> Problem:
        """The problem with another start (n,), SI, clipped into the bounds."""
        inside = np.clip(values, *self.bounds)
        parameters = (
            replace(q, start=float(value)) for q, value in zip(self.parameters, inside, strict=True)
        )
        return replace(self, parameters=tuple(parameters))


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
    """

    values: Floats
    objective: float
    status: str
    reason: str
    iterations: tuple[Iteration, ...]
    grid: Grid | None = None
    remarks: tuple[str, ...] = ()
    certificate: Certificate | None = None


STOPPED = "out-of-budget"
"""Status of an outcome that the observer ended."""


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
