"""Importance sampling, from Laplace's approximation or from one adapted to the draws (theory 11.3).

Draws of a mixture q get the weights pi/q. Their largest are smoothed by a generalised Pareto
distribution whose shape k says whether the weights are to be believed (Vehtari and others 2024).
Where Laplace's approximation is poor, rounds of a few hundred draws adapt the mixture; the draws
that are handed over are then those of the last mixture alone, which is a fixed one, so that their
weights are right whatever the adaptation did.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geoident.identify.posterior.approximation import Mixture, adapted
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.diagnosis import effective_of_weights, limit_of_k, smoothed
from geoident.identify.posterior.draws import (
    OUT_OF_EVALUATIONS,
    Draws,
    SamplingProgress,
    SamplingWatch,
    Stopped,
    Wish,
)
from geoident.model.arrays import Floats

FIRST = 300
"""Draws after which the weights are first judged."""

LEAST_EFFICIENCY = 0.05
"""Effective size by draws below which another approximation is looked for."""

ADAPTING = "adapting"
"""Name of the sampler, in the progress, while a mixture is adapted."""

_MOST_ROUNDS = 8  # of adaptation
_GOOD = 0.35  # efficiency at which adaptation ends
_MOST_COMPONENTS = 8
_MOST_AT_ONCE = 2000
_LEAST_DRAWS = 10.0  # effective ones for each parameter of a component that is fitted


@dataclass
class Weighted:
    """Draws of one mixture with their weights.

    Args:
        mixture: that they are drawn from.
        x: (k, m) draws.
        logarithms: (k,) log density of the posterior.
        proposal: (k,) log density of the mixture.
        weights: (k,) adding up to one, smoothed.
        pareto_k: of the weights.
    """

    mixture: Mixture
    x: Floats
    logarithms: Floats
    proposal: Floats
    weights: Floats = field(init=False)
    pareto_k: float = field(init=False)

    def __post_init__(self) -> None:
        with np.errstate(invalid="ignore"):
            self.weights, self.pareto_k = smoothed(self.logarithms - self.proposal)

    @property
    def effective(self) -> float:
        """Effective size."""
        return effective_of_weights(self.weights)

    @property
    def efficiency(self) -> float:
        """Effective size by draws."""
        return self.effective / max(len(self.x), 1)

    def believable(self, least: float = LEAST_EFFICIENCY) -> bool:
        """The weights are, by k, and their efficiency is not below the least that is wanted."""
        return self.pareto_k <= limit_of_k(len(self.x)) and self.efficiency >= least

    def more(self, density: PosteriorDensity, rng: np.random.Generator, count: int) -> Weighted:
        """With further draws of the mixture.

        Args:
            density: of the posterior.
            rng: of random numbers.
            count: how many.
        """
        x = self.mixture.draw(rng, count)
        return Weighted(
            self.mixture,
            np.concatenate([self.x, x]),
            np.concatenate([self.logarithms, density.logarithms(x)]),
            np.concatenate([self.proposal, self.mixture.logarithms(x)]),
        )


def none_yet(mixture: Mixture) -> Weighted:
    """No draws of a mixture."""
    m = mixture.centres.shape[1]
    return Weighted(mixture, np.empty((0, m)), np.empty(0), np.empty(0))


class ImportanceSampler:
    """Draws of a posterior with weights.

    Args:
        density: of the posterior.
        rng: of random numbers.
        wish: what is asked for.
        watch: is told of the progress.

    Attributes:
        stopped: the reason for having stopped early, or empty.
        rounds: all draws so far, mixture by mixture.
    """

    def __init__(
        self, density: PosteriorDensity, rng: np.random.Generator, wish: Wish, watch: SamplingWatch
    ) -> None:
        self._density = density
        self._rng = rng
        self._wish = wish
        self._watch = watch
        self.stopped = ""
        self.rounds: list[Weighted] = []

    def of(self, mixture: Mixture, name: str, *, least: float = LEAST_EFFICIENCY) -> Weighted:
        """Draws of a mixture: until they are enough, or not to be believed, or stopped.

        Args:
            mixture: to draw from.
            name: of the sampler, for the progress.
            least: efficiency below which another mixture is worth looking for.
        """
        found = none_yet(mixture)
        while not self.stopped:
            found = self._more(found, self._missing(found), name)
            if not found.believable(least) or found.effective >= self._wish.effective:
                break
        self.rounds.append(found)
        return found

    def adapt(self) -> Mixture:
        """A mixture fitted to the posterior in some rounds, from all draws so far."""
        first = self.rounds[0].mixture
        begun = len(self.rounds)
        for number in range(begun + 1, begun + 1 + _MOST_ROUNDS):
            components = min(_MOST_COMPONENTS, number)
            x, weights = _together(self.rounds, _LEAST_DRAWS * components * len(self._density))
            if self.stopped or not len(x):
                break
            mixture = adapted(first, x, weights, components=components, rng=self._rng)
            self.rounds.append(self._more(none_yet(mixture), FIRST, ADAPTING))
            if self.rounds[-1].believable(_GOOD):
                break
        return max(self.rounds[begun:] or self.rounds[:1], key=lambda r: r.efficiency).mixture

    def _missing(self, found: Weighted) -> int:
        """How many draws are still needed, by the efficiency of those that are there."""
        if not len(found.x):
            return FIRST
        rest = self._wish.effective - found.effective
        return int(np.clip(1.05 * rest / found.efficiency, FIRST / 3, _MOST_AT_ONCE))

    def _more(self, found: Weighted, count: int, name: str) -> Weighted:
        """With further draws, in parts between which the watch is asked."""
        for part in _parts(count):
            left = self._wish.evaluations - self._density.evaluations
            if left <= 0:
                self.stopped = OUT_OF_EVALUATIONS
                break
            try:
                found = found.more(self._density, self._rng, min(part, left))
            except Stopped as stop:
                self.stopped = stop.reason
                break
            progress = SamplingProgress(
                name, self._density.evaluations, found.effective, self._wish.effective
            )
            self.stopped = self._watch(progress) or ""
            if self.stopped:
                break
        return found


_PART = 50  # evaluations between two questions whether to go on


def _parts(count: int) -> list[int]:
    whole, rest = divmod(count, _PART)
    return [_PART] * whole + ([rest] if rest else [])


def _together(rounds: list[Weighted], least: float) -> tuple[Floats, Floats]:
    """Draws of all rounds (k, m) and their weights by the mixture of all mixtures (k,).

    The weights are raised to the largest power up to one that leaves them an effective size.

    Args:
        rounds: of draws.
        least: this size, or a third of the draws.
    """
    x = np.concatenate([r.x for r in rounds])
    logarithms = np.concatenate([r.logarithms for r in rounds])
    counts = np.array([len(r.x) for r in rounds], dtype=float)
    parts = np.stack([r.mixture.logarithms(x) for r in rounds])
    top = parts.max(axis=0)
    proposal = top + np.log(np.exp(parts - top).T @ (counts / counts.sum()))
    some = np.isfinite(logarithms)
    return x[some], _tempered(logarithms[some] - proposal[some], min(least, some.sum() / 3.0))


def _tempered(logarithms: Floats, least: float) -> Floats:
    """Weights (k,) to the largest power up to one with an effective size of at least ``least``."""
    low, high = 0.0, 1.0
    weights, _ = smoothed(logarithms)
    if effective_of_weights(weights) >= least:
        return weights
    for _ in range(30):
        power = 0.5 * (low + high)
        raw = np.exp(power * (logarithms - logarithms.max()))
        weights = raw / raw.sum()
        low, high = (power, high) if effective_of_weights(weights) >= least else (low, power)
    return np.asarray(weights)


def resampled(found: Weighted, wish: Wish, rng: np.random.Generator, name: str) -> Draws:
    """As many draws without weights as are asked for, by systematic resampling, without order.

    Args:
        found: weighted draws.
        wish: how many.
        rng: of random numbers.
        name: of the sampler.
    """
    steps = (np.arange(wish.draws) + rng.uniform()) / wish.draws
    ends = np.cumsum(found.weights)
    taken = np.minimum(np.searchsorted(ends / ends[-1], steps), len(ends) - 1)
    taken = rng.permutation(taken)
    m = found.x.shape[1]
    return Draws(
        sampler=name,
        x=found.x[taken][None],
        logarithms=found.logarithms[taken][None],
        effective=np.full(m, min(found.effective, float(wish.draws))),
        r_hat=np.full(m, np.nan),
        pareto_k=found.pareto_k,
        acceptance=found.efficiency,
    )
