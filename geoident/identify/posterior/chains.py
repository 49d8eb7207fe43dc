"""Markov chains where Laplace's approximation does not serve (theory 11.4).

Both samplers work in rounds. After each the first half of all draws is left out, and the rest is
judged: R-hat and effective size of all chains. Chains begin spread out: at draws of the
approximation, taken by the root of their weights.

* The affine-invariant ensemble of Goodman & Weare (2010), by emcee: some independent ensembles.
  Every walker is a chain; R-hat is that of the ensembles, since walkers are many and short.
* Preconditioned Crank-Nicolson steps (Cotter and others 2013; Rudolf & Sprungk 2018). In
  coordinates t in which the prior N(0, 1) of the modes is N(0, 1) and Laplace's covariance is
  diagonal, c_k,

      t' = sqrt(1 - b^2 c) t + b sqrt(c) n ,   n ~ N(0, 1)

  accepted with min(1, w(t') / w(t)), w = pi / N(0, 1): steps are as long as the posterior is wide
  and leave the prior as it is, so acceptance depends on the readings alone, not on the number of
  modes. Parameters that are no modes get a normal density over their prior or bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import (
    MOST_R_HAT,
    OUT_OF_EVALUATIONS,
    Draws,
    SamplingProgress,
    SamplingRequest,
    SamplingWatch,
    Stopped,
    diagnose_chains,
    library,
)
from geoident.identify.posterior.importance import WeightedDraws
from geoident.model.arrays import Floats

ENSEMBLES = 4
"""Independent ensembles, as many as R-hat is usually made of."""

CHAINS = 8
"""Of preconditioned Crank-Nicolson steps: more would spend the budget on their beginnings."""

ROUND = 100
"""Steps between two judgements, at least; later a quarter of what is there."""

_STEPS = 10
"""Between two questions whether to go on."""

_TUNING_ROUNDS, _TUNING_STEPS = 10, 20
"""Of the warm-up in which the step length is found, by 160 trials each."""

_ACCEPTANCE = (0.2, 0.4)
"""Share of accepted steps, about the best one of random walks (0.234 in many dimensions)."""

_SHORTER, _LONGER = 0.6, 1.5
"""Factors on the step length in the warm-up."""

Advance = Callable[[int], tuple[Floats, Floats]]
"""Goes on by some steps: u (c, steps, m) and log density (c, steps) of these."""


def ensemble(
    density: PosteriorDensity,
    begin: WeightedDraws,
    request: SamplingRequest,
    rng: np.random.Generator,
    watch: SamplingWatch,
) -> Draws:
    """Draws by the affine-invariant ensemble.

    Args:
        density: of the posterior.
        begin: draws to begin from.
        request: what is asked for.
        rng: of random numbers.
        watch: is shown the progress.

    Raises:
        Stopped: before there were enough to be judged.
    """
    emcee = library("emcee")
    m = len(density)
    walkers = 2 * max(m + 1, 4)
    moves = [(emcee.moves.StretchMove(), 0.5), (emcee.moves.DEMove(), 0.5)]
    samplers, states = [], []
    for start in np.split(_starting_points(begin, rng, ENSEMBLES * walkers), ENSEMBLES):
        samplers.append(
            emcee.EnsembleSampler(walkers, m, density.logarithms, vectorize=True, moves=moves)
        )
        state = np.random.RandomState(int(rng.integers(2**31))).get_state()
        states.append(emcee.State(start, random_state=state))

    def advance(steps: int) -> tuple[Floats, Floats]:
        u, logarithms = [], []
        for k, sampler in enumerate(samplers):
            before = sampler.iteration
            states[k] = sampler.run_mcmc(states[k], steps, skip_initial_state_check=True)
            u.append(sampler.get_chain(discard=before).transpose(1, 0, 2))
            logarithms.append(sampler.get_log_prob(discard=before).T)
        return np.concatenate(u), np.concatenate(logarithms)

    def accepted() -> float:
        return float(np.mean([np.mean(sampler.acceptance_fraction) for sampler in samplers]))

    return _until_mixed("ensemble", density, request, watch, advance, accepted, ENSEMBLES)


def crank_nicolson(
    density: PosteriorDensity,
    begin: WeightedDraws,
    request: SamplingRequest,
    rng: np.random.Generator,
    watch: SamplingWatch,
) -> Draws:
    """Draws by preconditioned Crank-Nicolson steps.

    Args:
        density: of the posterior.
        begin: draws to begin from; of its proposal the first component gives the steps.
        request: what is asked for.
        rng: of random numbers.
        watch: is shown the progress.

    Raises:
        Stopped: before there were enough to be judged.
    """
    centre, sd = density.reference()
    root = begin.proposal.roots[0] / sd[:, None]
    variance, axes = np.linalg.eigh(root @ root.T)
    variance = np.clip(variance, 0.0, 1.0)
    t = ((_starting_points(begin, rng, CHAINS) - centre) / sd) @ axes
    log_pi = np.full(CHAINS, -np.inf)
    b, accepted, tried = 0.5, 0, 0

    def coordinates(t: Floats) -> Floats:
        return np.asarray(centre + (t @ axes.T) * sd)

    def advance(steps: int) -> tuple[Floats, Floats]:
        nonlocal t, log_pi, accepted, tried
        u, logarithms = [], []
        for _ in range(steps):
            size = b**2 * variance
            trial = np.sqrt(1.0 - size) * t + np.sqrt(size) * rng.standard_normal(t.shape)
            log_trial = density.logarithms(coordinates(trial))
            with np.errstate(invalid="ignore"):
                gain = log_trial - log_pi + 0.5 * np.sum(trial**2 - t**2, axis=1)
            gain = np.where(np.isfinite(log_pi), gain, np.inf)  # anything is better than nothing
            gain = np.where(np.isfinite(log_trial), gain, -np.inf)
            taken = np.log(rng.uniform(size=CHAINS)) < gain
            t = np.where(taken[:, None], trial, t)
            log_pi = np.where(taken, log_trial, log_pi)
            accepted, tried = accepted + int(taken.sum()), tried + CHAINS
            u.append(coordinates(t))
            logarithms.append(log_pi)
        return np.stack(u, axis=1), np.stack(logarithms, axis=1)

    log_pi = density.logarithms(coordinates(t))
    for _ in range(_TUNING_ROUNDS):
        if density.evaluations >= request.evaluations:
            break
        accepted = tried = 0
        advance(_TUNING_STEPS)
        if accepted < _ACCEPTANCE[0] * tried:
            b *= _SHORTER
        elif accepted > _ACCEPTANCE[1] * tried and b < 1.0:
            b = min(1.0, _LONGER * b)
        else:
            break
    accepted = tried = 0
    name = "preconditioned Crank-Nicolson"
    return _until_mixed(
        name, density, request, watch, advance, lambda: accepted / max(tried, 1), CHAINS
    )


def _until_mixed(
    name: str,
    density: PosteriorDensity,
    request: SamplingRequest,
    watch: SamplingWatch,
    advance: Advance,
    accepted: Callable[[], float],
    groups: int,
) -> Draws:
    """Rounds of steps until chains have mixed and are long enough, or the budget is spent.

    Args:
        name: of the sampler.
        density: of the posterior.
        request: what is asked for.
        watch: is shown the progress.
        advance: goes on.
        accepted: share of accepted steps so far.
        groups: independent ones among the chains, for R-hat.
    """
    parts: list[tuple[Floats, Floats]] = []
    effective, length = 0.0, ROUND
    while True:
        stopped = ""
        for _ in range(length // _STEPS):
            if density.evaluations >= request.evaluations:
                stopped = OUT_OF_EVALUATIONS
                break
            try:
                parts.append(advance(_STEPS))
            except Stopped as stop:
                stopped = stop.reason
                break
            progress = SamplingProgress(name, density.evaluations, effective, request.effective)
            if reason := watch(progress):
                stopped = reason
                break
        if stopped and len(parts) < 2:
            raise Stopped(stopped)
        u, logarithms = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
        half = u.shape[1] // 2
        u, logarithms = u[:, half:], logarithms[:, half:]
        size, r_hat = diagnose_chains(u, groups=groups)
        draws = Draws(name, u, logarithms, size, r_hat, np.nan, accepted(), stopped)
        effective = draws.least_effective
        mixed = draws.largest_r_hat <= MOST_R_HAT and effective >= request.effective
        if stopped or (mixed and logarithms.size >= request.draws):
            return draws
        length = max(ROUND, len(parts) * _STEPS // 4)


def thinned(draws: Draws, count: int) -> Draws:
    """About as many draws as are asked for, evenly spaced in each chain."""
    chains, length = draws.logarithms.shape
    each = max(1, min(length, count // chains))
    taken = np.linspace(0, length - 1, each).round().astype(np.int64)
    return replace(draws, x=draws.x[:, taken], logarithms=draws.logarithms[:, taken])


def _starting_points(begin: WeightedDraws, rng: np.random.Generator, count: int) -> Floats:
    """Different draws (count, m), likely by the root of their weights."""
    likely = np.sqrt(begin.weights)
    some = np.flatnonzero(likely > 0.0)
    if len(some) < count:  # hardly any has a weight: those of the highest density
        order = np.argsort(-begin.logarithms)[:count]
        some = order[np.isfinite(begin.logarithms[order])]
        likely = np.ones(len(begin.x))
    size = min(count, len(some))
    x = np.empty((0, begin.proposal.centres.shape[1]))
    if size:
        x = begin.x[rng.choice(some, size=size, replace=False, p=likely[some] / likely[some].sum())]
    more = begin.proposal.draw(rng, count - size)
    return np.asarray(rng.permutation(np.concatenate([x, more])))
