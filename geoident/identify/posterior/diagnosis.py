"""Whether draws are to be believed: Pareto k, effective size, R-hat (theory 11.5), by ArviZ.

Needs the extra ``sample`` (arviz, emcee).
"""

from __future__ import annotations

import math
import warnings
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from geoident.errors import UsageError
from geoident.model.arrays import Floats

MOST_K = 0.7
"""Pareto k above which importance weights are not to be believed (Vehtari and others 2024)."""

MOST_R_HAT = 1.01
"""R-hat above which chains have not met (Vehtari and others 2021)."""

LEAST_EFFECTIVE = 400.0
"""Effective size below which the ends of 95 % intervals are not to be believed (the same)."""

_EQUAL = 1e-9  # logarithms of weights that differ by less are equal


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
    """The k up to which this many weights are to be believed; `MOST_K` from 2200 on.

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
    given = logarithms[some]
    if len(given) < 25:  # no tail to speak of
        weights[some] = _normalised(given)
        return weights, np.inf
    if np.ptp(given) < _EQUAL:
        weights[some] = 1.0 / len(given)
        return weights, 0.0
    logs, k = library("arviz").psislw(given.copy())
    weights[some] = _normalised(np.asarray(logs))
    return weights, float(k)


def _normalised(logarithms: Floats) -> Floats:
    if not len(logarithms):
        return logarithms
    raw = np.exp(logarithms - logarithms.max())
    return np.asarray(raw / raw.sum())


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
        groups: their number; those of different groups know nothing of each other.
    """
    arviz = library("arviz")
    size, r_hat = (np.full(chains.shape[2], np.nan) for _ in range(2))
    for i in range(chains.shape[2]):
        values = np.ascontiguousarray(chains[:, :, i])
        if np.ptp(values) > 0.0:
            bulk, tail = (float(arviz.ess(values, method=kind)) for kind in ("bulk", "tail"))
            size[i] = min(bulk, tail)
            grouped = values.reshape(groups, -1, values.shape[1]).swapaxes(1, 2)
            r_hat[i] = float(arviz.rhat(grouped.reshape(groups, -1)))
    return size, r_hat
