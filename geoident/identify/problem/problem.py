"""What every identifier is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from geoident.identify.problem.protocols import Response
from geoident.model.arrays import Floats
from geoident.model.certificate import Certificate
from geoident.model.methods import LossOptions, SquaredOptions
from geoident.model.parameter import Parameter
from geoident.model.result import Grid, Iteration

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
