"""From a problem to draws of its posterior: which sampler, and when the next (theory 11).

importance sampling from Laplace's approximation         if reliable: k <= 0.7, and efficient
the same from kernels at draws that count                up to `MANY` parameters, none of a field
an affine-invariant ensemble, or preconditioned
Crank-Nicolson for fields and many parameters            else
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.identify.posterior.chains import crank_nicolson, ensemble, thinned
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import Draws, SamplingRequest, SamplingWatch, Stopped
from geoident.identify.posterior.importance import (
    ADAPTATIONS,
    LEAST_EFFICIENCY,
    MANY,
    WORTH_ADAPTING,
    ImportanceSampler,
    Proposal,
)
from geoident.model.arrays import Floats


def sample_posterior(
    density: PosteriorDensity,
    minima: Sequence[Floats],
    request: SamplingRequest,
    *,
    rng: np.random.Generator,
    watch: SamplingWatch,
) -> Draws:
    """Draws of a posterior, by the first sampler that is reliable.

    Args:
        density: of the posterior.
        minima: p (n,) of the fit and of its rivals, SI.
        request: what is asked for.
        rng: of random numbers.
        watch: is shown the progress; may stop.

    Raises:
        ModelError: the model has no solution at the fit.
        Stopped: before there were any draws.
    """
    sampler, name = ImportanceSampler(density, request, rng, watch), "importance"
    many = len(density) > MANY or any(q.field for q in density.problem.parameters)
    least = LEAST_EFFICIENCY if many else WORTH_ADAPTING
    drawn = sampler.until_enough(Proposal.laplace(density, minima), name, least)
    for _ in range(0 if many else ADAPTATIONS):
        if sampler.stopped or drawn.reliable(least):
            break
        adapted = sampler.adapted()
        if sampler.stopped:
            break
        name, least = "adapted importance", LEAST_EFFICIENCY
        drawn = sampler.until_enough(adapted, name, least)
    stopped = sampler.stopped
    if not (stopped or drawn.reliable(LEAST_EFFICIENCY)):
        chains = crank_nicolson if many else ensemble
        try:
            return thinned(chains(density, drawn, request, rng, watch), request.draws)
        except Stopped as stop:
            stopped = stop.reason
    if not np.any(drawn.weights > 0.0):
        raise Stopped(stopped)
    return drawn.resampled(request.draws, rng, name=name, stopped=stopped)
