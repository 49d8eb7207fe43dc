"""What samplers are asked for and give back, and whether to rely on it (theory 11.5).

Pareto k of importance weights, effective size and R-hat of chains are ArviZ's. Needs the extra
``sample`` (arviz, emcee).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from geoident.errors import UsageError
from geoident.model.arrays import Floats

MOST_K = 0.7
"""Pareto k above which importance weights are not reliable (Vehtari and others 2024)."""

MOST_R_HAT = 1.01
"""R-hat above which chains have not mixed (Vehtari and others 2021)."""

LEAST_EFFECTIVE = 400.0
"""Effective size below which the ends of 95 % intervals are not reliable (the same)."""

FEW_WEIGHTS = 25
"""Below these the largest fifth is no tail to fit."""

_EQUAL_WEIGHTS = 1e-9
"""Logarithms of weights that differ by less are equal, and have no tail."""

OUT_OF_EVALUATIONS = "The evaluations that were allowed are used up."


@dataclass(frozen=True)
class SamplingRequest:
    """What is asked of a sampler.

    Args:
        draws: how many to hand over.
        effective: target effective sample size, at which it is enough.
        evaluations: of the model at most.
    """

    draws: int
    effective: float
    evaluations: int


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


SamplingWatch = Callable[[SamplingProgress], str | None]
"""Is shown the progress between evaluations; answers with a reason to stop now, or None."""


class Stopped(Exception):
    """Raised by a model that is asked when the time is up.

    Args:
        reason: a sentence.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


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

    def reliable(self, evaluations: int, *, wanted: float = LEAST_EFFECTIVE) -> bool:
        """Whether the diagnostics allow relying on the draws.

        Args:
            evaluations: of the model, over which k was found.
            wanted: effective size that was asked for, if that is less than what is usual.
        """
        if self.least_effective < min(LEAST_EFFECTIVE, wanted, self.logarithms.size):
            return False
        if np.isfinite(self.pareto_k):
            return self.pareto_k <= limit_of_k(evaluations)
        return self.largest_r_hat <= MOST_R_HAT


@cache
def library(name: str) -> Any:
    """One of the libraries of the extra ``sample``; neither has types.

    Raises:
        UsageError: it is not installed.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what arviz says of its own future
        try:
            return import_module(name)
        except ModuleNotFoundError as error:
            if error.name != name:
                raise
            msg = f'sampling needs {name}: pip install "geoident[sample]"'
            raise UsageError(msg) from error


def limit_of_k(count: int) -> float:
    """The k up to which this many weights are reliable; `MOST_K` from 2200 on.

    >>> round(limit_of_k(100), 2), limit_of_k(10_000)
    (0.5, 0.7)
    """
    return min(MOST_K, 1.0 - 1.0 / math.log10(max(count, 11)))


def smoothed(logarithms: Floats) -> tuple[Floats, float]:
    """Weights (k,) that add up to one, their tail smoothed, and Pareto k.

    Args:
        logarithms: (k,) of the weights, up to a constant; -inf for none.
    """
    weights, some = np.zeros(len(logarithms)), np.isfinite(logarithms)
    log_weights, k = logarithms[some], np.inf
    if len(log_weights) >= FEW_WEIGHTS:
        if np.ptp(log_weights) < _EQUAL_WEIGHTS:
            log_weights, k = np.zeros(len(log_weights)), 0.0
        else:
            smooth, shape = library("arviz").psislw(log_weights.copy())
            log_weights, k = np.asarray(smooth), float(shape)
    if len(log_weights):
        raw = np.exp(log_weights - log_weights.max())
        weights[some] = raw / raw.sum()
    return weights, k


def effective_of_weights(weights: Floats) -> float:
    """How many independent draws weighted ones (k,) are worth: 1 / sum of squares."""
    total = float(np.sum(weights**2))
    return 1.0 / total if total > 0.0 else 0.0


def diagnose_chains(chains: Floats, *, groups: int) -> tuple[Floats, Floats]:
    """Effective size (the smaller of bulk and tail) and R-hat, (n,) each, of chains (c, d, n).

    NaN of a parameter that never moves. R-hat is that of groups of chains, each taken as one:
    chains that are many and short would have to be long one by one.

    Args:
        chains: (c, d, n) draws, those of a group one after the other.
        groups: their number; those of different groups are independent.
    """
    arviz = library("arviz")
    size, r_hat = (np.full(chains.shape[2], np.nan) for _ in range(2))
    for i in range(chains.shape[2]):
        values = np.ascontiguousarray(chains[:, :, i])
        if np.ptp(values) > 0.0:
            size[i] = min(float(arviz.ess(values, method=kind)) for kind in ("bulk", "tail"))
            grouped = values.reshape(groups, -1, values.shape[1]).swapaxes(1, 2)
            r_hat[i] = float(arviz.rhat(grouped.reshape(groups, -1)))
    return size, r_hat
