"""From a problem to draws of its posterior: which sampler, and when to give way (theory 11).

importance sampling from Laplace's approximation        believed if k <= 0.7
the same from a mixture adapted to the draws            up to `MANY` parameters, none of a field
an affine-invariant ensemble, or preconditioned
Crank-Nicolson for fields and many parameters           else
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.identify.posterior.approximation import MANY, laplace
from geoident.identify.posterior.chains import crank_nicolson, ensemble, thinned
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.diagnosis import LEAST_EFFECTIVE, MOST_R_HAT, limit_of_k
from geoident.identify.posterior.draws import (
    OUT_OF_EVALUATIONS,
    Draws,
    SamplingWatch,
    Stopped,
    Wish,
)
from geoident.identify.posterior.importance import (
    LEAST_EFFICIENCY,
    ImportanceSampler,
    Weighted,
    resampled,
)
from geoident.model.arrays import Floats

WORTH_ADAPTING = 0.2
"""Efficiency of Laplace's approximation below which adapting it costs less than using it."""

ADAPTATIONS = 3
"""How often a mixture that turned out poor is adapted again."""


def sample_posterior(
    density: PosteriorDensity,
    minima: Sequence[Floats],
    wish: Wish,
    *,
    rng: np.random.Generator,
    watch: SamplingWatch,
) -> Draws:
    """Draws of a posterior, by the first sampler that can be believed.

    Args:
        density: of the posterior.
        minima: p (n,) of the fit and of its rivals, SI.
        wish: what is asked for.
        rng: of random numbers.
        watch: is told of the progress; may stop.

    Raises:
        ModelError: the model has no solution at the fit.
        Stopped: before there were any draws.
    """
    sampler = ImportanceSampler(density, rng, wish, watch)
    name = "importance"
    many = len(density) > MANY or has_fields(density)
    least = LEAST_EFFICIENCY if many else WORTH_ADAPTING
    found = sampler.of(laplace(density, minima), name, least=least)
    for _ in range(0 if many else ADAPTATIONS):
        if found.believable(least) or sampler.stopped:
            break
        name, least = "adapted importance", LEAST_EFFICIENCY
        found = sampler.of(sampler.adapt(), name)
    if sampler.stopped and not np.any(found.weights > 0.0):
        raise Stopped(sampler.stopped)
    if found.believable() or sampler.stopped:
        return replace(resampled(found, wish, rng, name), stopped=sampler.stopped)
    return _chains(density, found, wish, rng=rng, watch=watch, many=many)


def _chains(
    density: PosteriorDensity,
    begin: Weighted,
    wish: Wish,
    *,
    rng: np.random.Generator,
    watch: SamplingWatch,
    many: bool,
) -> Draws:
    run = crank_nicolson if many else ensemble
    found = run(density, begin, rng, wish, watch)
    if found is None:
        name = "importance"
        return replace(resampled(begin, wish, rng, name), stopped=OUT_OF_EVALUATIONS)
    return thinned(found, wish.draws)


def has_fields(density: PosteriorDensity) -> bool:
    """Whether some parameters are modes of a field."""
    return any(q.field for q in density.problem.parameters)


def trustworthy(draws: Draws, evaluations: int, *, wanted: float = LEAST_EFFECTIVE) -> bool:
    """Whether the diagnostics let the draws be believed.

    Args:
        draws: of a sampler.
        evaluations: of the model, over which k was found.
        wanted: effective size that was asked for, if that is less than what is usual.
    """
    if draws.least_effective < min(LEAST_EFFECTIVE, wanted, draws.logarithms.size):
        return False
    if np.isfinite(draws.pareto_k):
        return draws.pareto_k <= limit_of_k(evaluations)
    return draws.largest_r_hat <= MOST_R_HAT
