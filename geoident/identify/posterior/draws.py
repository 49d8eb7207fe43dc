"""What samplers give back, and how they are watched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats


@dataclass(frozen=True)
class SamplingProgress:
    """Where a sampler is.

    Args:
        sampler: its name.
        evaluations: of the model so far.
        effective: size so far.
        wanted: the effective size that is asked for.
    """

    sampler: str
    evaluations: int
    effective: float
    wanted: float


class Stopped(Exception):
    """Raised by a model that is asked when the time is up.

    Args:
        reason: a sentence.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


SamplingWatch = Callable[[SamplingProgress], str | None]
"""Is told of the progress between evaluations; answers with a reason to stop now, or None."""


@dataclass(frozen=True)
class Wish:
    """What is asked of a sampler.

    Args:
        draws: how many to hand over.
        effective: the effective size at which it is enough.
        evaluations: of the model at most.
    """

    draws: int
    effective: float
    evaluations: int


@dataclass(frozen=True)
class Draws:
    """Draws of the posterior in the free scaled parameters.

    Args:
        sampler: ``importance``, ``adapted importance``, ``ensemble`` or ``preconditioned
            Crank-Nicolson``.
        x: (c, d, m) draws in c chains; of importance sampling one chain, without order.
        logarithms: (c, d) log density, up to a constant.
        effective: (m,) effective size of each parameter.
        r_hat: (m,) NaN of independent draws.
        pareto_k: of importance weights; NaN of chains.
        acceptance: share of accepted steps of chains, of weights effective size by draws.
        stopped: the reason of the watch or of the budget for stopping early; empty for none.
    """

    sampler: str
    x: Floats
    logarithms: Floats
    effective: Floats
    r_hat: Floats
    pareto_k: float
    acceptance: float
    stopped: str = ""

    @property
    def least_effective(self) -> float:
        """The smallest effective size of all parameters; 0 where there is none."""
        sizes = self.effective[np.isfinite(self.effective)]
        return float(sizes.min()) if len(sizes) else 0.0

    @property
    def largest_r_hat(self) -> float:
        """The largest R-hat of all parameters; NaN where there is none."""
        values = self.r_hat[np.isfinite(self.r_hat)]
        return float(values.max()) if len(values) else np.nan


OUT_OF_EVALUATIONS = "The evaluations that were allowed are used up."
