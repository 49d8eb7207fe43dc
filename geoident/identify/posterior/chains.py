"""Markov chains where no approximation serves: an ensemble, or many dimensions (theory 11.4).

Both work in rounds. After each the first half of what is there is left out, and the rest is
judged: R-hat and effective size of all chains. Chains begin spread out: at draws of the
approximation, taken by the root of their weights.

* The affine-invariant ensemble of Goodman & Weare (2010), by emcee: some ensembles that know
  nothing of each other. Every walker is a chain; R-hat is that of the ensembles, since walkers are
  many and short.
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
from dataclasses import dataclass
from typing import Any

import numpy as np

from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.diagnosis import MOST_R_HAT, diagnose_chains, library
from geoident.identify.posterior.draws import (
    OUT_OF_EVALUATIONS,
    Draws,
    SamplingProgress,
    SamplingWatch,
    Stopped,
    Wish,
)
from geoident.identify.posterior.importance import Weighted
from geoident.model.arrays import Floats

_ENSEMBLES = 4
_CHAINS = 8  # of preconditioned Crank-Nicolson
_ROUND = 100  # steps between two judgements
_STEP = 10  # steps between two questions whether to go on
_WARM_UP = 10  # rounds of `_TUNING` steps in which the step length is found
_TUNING = 20
_ACCEPTANCE = (0.2, 0.4)  # wanted share of accepted steps

Advance = Callable[[int], tuple[Floats, Floats]]
"""Goes on by some steps: x (c, steps, m) and log density (c, steps) of these."""


@dataclass
class Chains:
    """Chains as they grow.

    Args:
        name: of the sampler.
        density: of the posterior.
        wish: what is asked for.
        watch: is told of the progress.
        advance: goes on.
        accepted: share of accepted steps so far.
        groups: of how many chains that depend on each other the chains consist.
        effective: size so far.
    """

    name: str
    density: PosteriorDensity
    wish: Wish
    watch: SamplingWatch
    advance: Advance
    accepted: Callable[[], float]

    groups: int
    effective: float = 0.0

    def run(self) -> Draws | None:
        """Rounds until the chains have met and are long enough, or the budget is spent.

        None where it was spent before there was anything.
        """
        parts: list[tuple[Floats, Floats]] = []
        length = _ROUND
        while True:
            stopped = self._round(parts, length)
            if stopped and len(parts) < 2:
                return None
            found = self._judged(parts, stopped)
            if stopped or self._enough(found):
                return found
            length = max(_ROUND, len(parts) * _STEP // 4)

    def _round(self, parts: list[tuple[Floats, Floats]], length: int) -> str:
        """Go on by some steps; the reason for stopping meanwhile, or empty."""
        for _ in range(length // _STEP):
            if self.density.evaluations >= self.wish.evaluations:
                return OUT_OF_EVALUATIONS
            try:
                parts.append(self.advance(_STEP))
            except Stopped as stop:
                return stop.reason
            progress = SamplingProgress(
                self.name, self.density.evaluations, self.effective, self.wish.effective
            )
            if reason := self.watch(progress):
                return reason
        return ""

    def _judged(self, parts: list[tuple[Floats, Floats]], stopped: str) -> Draws:
        x = np.concatenate([part for part, _ in parts], axis=1)
        logarithms = np.concatenate([part for _, part in parts], axis=1)
        half = x.shape[1] // 2
        x, logarithms = x[:, half:], logarithms[:, half:]
        effective, r_hat = diagnose_chains(x, groups=self.groups)
        found = Draws(self.name, x, logarithms, effective, r_hat, np.nan, self.accepted(), stopped)
        self.effective = found.least_effective
        return found

    def _enough(self, found: Draws) -> bool:
        met = found.largest_r_hat <= MOST_R_HAT
        long_enough = found.least_effective >= self.wish.effective
        return met and long_enough and found.logarithms.size >= self.wish.draws


def thinned(found: Draws, draws: int) -> Draws:
    """About as many draws as are asked for, evenly spaced in each chain."""
    chains, length = found.logarithms.shape
    each = max(1, min(length, draws // chains))
    taken = np.linspace(0, length - 1, each).round().astype(np.int64)
    return Draws(
        found.sampler, found.x[:, taken], found.logarithms[:, taken],
        found.effective, found.r_hat, found.pareto_k, found.acceptance, found.stopped,
    )  # fmt: skip


def ensemble(
    density: PosteriorDensity,
    begin: Weighted,
    rng: np.random.Generator,
    wish: Wish,
    watch: SamplingWatch,
) -> Draws | None:
    """Draws by the affine-invariant ensemble.

    Args:
        density: of the posterior.
        begin: draws to begin from.
        rng: of random numbers.
        wish: what is asked for.
        watch: is told of the progress.
    """
    emcee = library("emcee")
    m = len(density)
    walkers = 2 * max(m + 1, 4)
    moves = [(emcee.moves.StretchMove(), 0.5), (emcee.moves.DEMove(), 0.5)]
    samplers, states = [], []
    for start in np.split(_starts(begin, rng, _ENSEMBLES * walkers), _ENSEMBLES):
        sampler = emcee.EnsembleSampler(walkers, m, density.logarithms, vectorize=True, moves=moves)
        state = np.random.RandomState(int(rng.integers(2**31))).get_state()
        samplers.append(sampler)
        states.append(emcee.State(start, random_state=state))

    def advance(steps: int) -> tuple[Floats, Floats]:
        found = []
        for k, sampler in enumerate(samplers):
            before = sampler.iteration
            states[k] = sampler.run_mcmc(states[k], steps, skip_initial_state_check=True)
            found.append(_of(sampler, before))
        x, logarithms = (np.concatenate(part) for part in zip(*found, strict=True))
        return x, logarithms

    def accepted() -> float:
        return float(np.mean([np.mean(s.acceptance_fraction) for s in samplers]))

    return Chains("ensemble", density, wish, watch, advance, accepted, _ENSEMBLES).run()


def _of(sampler: Any, before: int) -> tuple[Floats, Floats]:
    """What an ensemble has done since a step: (walkers, steps, m) and (walkers, steps)."""
    x = sampler.get_chain(discard=before)
    logarithms = sampler.get_log_prob(discard=before)
    return x.transpose(1, 0, 2).copy(), logarithms.T.copy()


def _starts(begin: Weighted, rng: np.random.Generator, count: int) -> Floats:
    """Different draws (count, m), likely by the root of their weights."""
    chance = np.sqrt(begin.weights)
    some = np.flatnonzero(chance > 0.0)
    if len(some) < count:  # no weight left to most: those of the best density
        order = np.argsort(-begin.logarithms)[: max(count, 1)]
        some = order[np.isfinite(begin.logarithms[order])]
        chance = np.ones(len(begin.x))
    if not len(some):
        return begin.mixture.draw(rng, count)
    size, share = min(count, len(some)), chance[some] / chance[some].sum()
    x = begin.x[rng.choice(some, size=size, replace=False, p=share)]
    more = begin.mixture.draw(rng, count - size)
    return np.asarray(rng.permutation(np.concatenate([x, more])))


def crank_nicolson(
    density: PosteriorDensity,
    begin: Weighted,
    rng: np.random.Generator,
    wish: Wish,
    watch: SamplingWatch,
) -> Draws | None:
    """Draws by preconditioned Crank-Nicolson steps as long as Laplace's approximation is wide.

    Args:
        density: of the posterior.
        begin: draws to begin from.
        rng: of random numbers.
        wish: what is asked for.
        watch: is told of the progress.
    """
    chain = _CrankNicolson(density, begin, rng)
    try:
        chain.begin()
        chain.tune(lambda: density.evaluations < wish.evaluations)
    except Stopped:
        return None
    name = "preconditioned Crank-Nicolson"
    advance, accepted = chain.advance, lambda: chain.acceptance
    return Chains(name, density, wish, watch, advance, accepted, _CHAINS).run()


class _CrankNicolson:
    """Chains of preconditioned Crank-Nicolson steps in lockstep."""

    def __init__(
        self, density: PosteriorDensity, begin: Weighted, rng: np.random.Generator
    ) -> None:
        self._density = density
        self._rng = rng
        self._centre, self._sd = density.reference()
        root = begin.mixture.roots[0] / self._sd[:, None]
        variance, self._axes = np.linalg.eigh(root @ root.T)
        self._variance = np.clip(variance, 0.0, 1.0)
        self._t = self._whitened(_starts(begin, rng, _CHAINS))
        self._log = np.full(_CHAINS, -np.inf)
        self._size = 0.5
        self._accepted = self._steps = 0

    @property
    def acceptance(self) -> float:
        """Share of accepted steps."""
        return self._accepted / max(self._steps, 1)

    def begin(self) -> None:
        """The density where the chains begin."""
        self._log = self._density.logarithms(self._coordinates(self._t))

    def tune(self, go_on: Callable[[], bool]) -> None:
        """Find the length of a step; the chains go on meanwhile."""
        low, high = _ACCEPTANCE
        for _ in range(_WARM_UP):
            self._accepted = self._steps = 0
            if not go_on():
                return
            self.advance(_TUNING)
            if self.acceptance < low:
                self._size *= 0.6
            elif self.acceptance > high and self._size < 1.0:
                self._size = min(1.0, 1.5 * self._size)
            else:
                break
        self._accepted = self._steps = 0

    def advance(self, steps: int) -> tuple[Floats, Floats]:
        """Some steps: u (c, steps, m) and log density (c, steps)."""
        u, logarithms = [], []
        for _ in range(steps):
            self._step()
            u.append(self._coordinates(self._t))
            logarithms.append(self._log.copy())
        return np.stack(u, axis=1), np.stack(logarithms, axis=1)

    def _step(self) -> None:
        size = self._size**2 * self._variance
        noise = self._rng.standard_normal(self._t.shape)
        trial = np.sqrt(1.0 - size) * self._t + np.sqrt(size) * noise
        found = self._density.logarithms(self._coordinates(trial))
        with np.errstate(invalid="ignore"):
            gain = found - self._log + 0.5 * np.sum(trial**2 - self._t**2, axis=1)
        gain = np.where(np.isfinite(self._log), gain, np.inf)
        gain = np.where(np.isfinite(found), gain, -np.inf)
        taken = np.log(self._rng.uniform(size=len(trial))) < gain
        self._t = np.where(taken[:, None], trial, self._t)
        self._log = np.where(taken, found, self._log)
        self._accepted += int(taken.sum())
        self._steps += len(taken)

    def _whitened(self, u: Floats) -> Floats:
        return np.asarray(((u - self._centre) / self._sd) @ self._axes)

    def _coordinates(self, t: Floats) -> Floats:
        return np.asarray(self._centre + (t @ self._axes.T) * self._sd)
