"""Importance sampling from Laplace's approximation (theory 11.2, 11.3).

At each known minimum, with the rows A of residuals and priors (theory 6.2), each parameter measured
by its range R, A R = U S V^T, a direction v_k has the standard deviation min(1/S_k, L_k / 2),
L_k = 1 / max_i |v_ik| its admissible extent: a direction that nothing determines is drawn all along
its extent. Tails are those of Student's t. Draws outside the bounds are thrown away, which leaves
the density inside them as it is, up to a constant.

Draws of this proposal q get the weights pi/q. Their largest are smoothed by a generalised Pareto
distribution whose shape k says whether the weights are reliable (Vehtari and others 2024). Where
they are not, or hardly any draw counts, as along a bent ridge, rounds of a few hundred draws put
kernels at draws that count; the draws that are handed over come from the best of these proposals
alone, which depends on none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import gammaln, logsumexp

from geoident.errors import ModelError
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import (
    OUT_OF_EVALUATIONS,
    Draws,
    SamplingProgress,
    SamplingRequest,
    SamplingWatch,
    Stopped,
    effective_of_weights,
    limit_of_k,
    smoothed,
)
from geoident.model.arrays import Floats

UNBOUNDED_RANGE = 10.0
"""Range in u of a parameter without finite bounds, as in theory 6.2."""

DEGREES = 5.0
"""Degrees of freedom of the tails: heavier than those of a normal posterior, so that no weight is
large far out; beyond `MANY` parameters they are normal."""

MANY = 12
"""Parameters from which on heavy tails cost more draws than they save."""

UNIFORM = 0.1
"""Weight of a uniform component: a tenth of the draws looks for what no minimum covers, ..."""

FEW = 4
"""... up to so many parameters: in more dimensions it would find nothing."""

EVEN = 0.5
"""Part of the weight that all minima share alike, as their masses are rough."""

FIRST = 300
"""Draws after which the weights are first judged: 60 of them are the tail that k is fitted to."""

LEAST_EFFICIENCY = 0.02
"""Effective size by draws below which chains cost less: they take 40 evaluations for one effective
draw at best."""

WORTH_ADAPTING = 0.2
"""Efficiency below which other proposals are tried: some rounds cost less than what they save."""

ADAPTING = "adapting"
"""Name of the sampler, in the progress, while other proposals are tried."""

ADAPTATIONS, ROUNDS = 3, 6
"""How often others are tried again after one that turned out poor, and rounds each time: what had
not become efficient by then did not in twice as many either."""

KERNELS = 100
"""A third of the draws of a round: more do not follow a bent ridge any better."""

_WIDE, _WIDE_PART = 4.0, 0.3
"""Width and weight of a second, wider kernel at each draw: else weights beyond them are large."""

_FIRST_PART = 0.1
"""Weight of the first proposal beside the kernels."""

_PER_PARAMETER = 50.0
"""Effective draws by parameters to which weights are flattened, so that kernels reach the tails."""

_POWERS = 40
"""Of weights that are tried; the last is 0.0002, which makes nearly all alike."""

_LINE = 1e-9
"""Part of the mean variance that is added, as draws may lie on a line up to rounding."""

_AT_ONCE = 50
"""Evaluations between two questions whether to go on."""

_MOST_MORE = 2000
"""Draws between two judgements, so that a mistaken efficiency does not cost the whole budget."""

_MOST_TRIALS = 1000
"""Draws of the proposal for each one that is to lie inside the bounds."""


@dataclass(frozen=True)
class Proposal:
    """Components of a multivariate t each, and a uniform one over the bounds.

    Args:
        weights: (K,) of the components; with ``uniform`` they add up to one.
        centres: (K, m) in u.
        roots: (K, m, m) lower triangular, the root of each scale matrix.
        degrees: of freedom; infinite for normal ones.
        lower, upper: (m,) bounds in u.
        uniform: weight of the uniform component; 0 where a bound is infinite.
    """

    weights: Floats
    centres: Floats
    roots: Floats
    degrees: float
    lower: Floats
    upper: Floats
    uniform: float = 0.0

    @classmethod
    def laplace(cls, density: PosteriorDensity, minima: Sequence[Floats]) -> Proposal:
        """Laplace's approximation of the posterior at some minima of phi.

        Args:
            density: to be approximated.
            minima: p (n,) of each, SI; the first is the fit.

        Raises:
            ModelError: the model has no solution at the first.
        """
        centres, roots, masses = [], [], []
        width = density.upper - density.lower
        width = np.where(np.isfinite(width), width, UNBOUNDED_RANGE)
        for k, p in enumerate(minima):
            try:
                A, phi = density.rows(p)
            except ModelError:
                if k == 0:
                    raise
                continue
            rows = np.zeros((max(A.shape), A.shape[1]))  # at least as many as parameters
            rows[: len(A)] = A * width
            _, S, Vt = np.linalg.svd(rows)
            extent = 1.0 / np.abs(Vt).max(axis=1)
            with np.errstate(divide="ignore"):
                sd = np.minimum(1.0 / S, 0.5 * extent)
            root = np.linalg.cholesky((Vt.T * sd**2) @ Vt * np.outer(width, width))
            centres.append(density.coordinates(p))
            roots.append(root)
            masses.append(-0.5 * phi + float(np.sum(np.log(np.diag(root)))))
        shares = np.exp(np.array(masses) - logsumexp(masses))
        shares = (1.0 - EVEN) * shares + EVEN / len(shares)
        bounded = bool(np.all(np.isfinite(density.upper - density.lower)))
        uniform = UNIFORM if bounded and len(density) <= FEW else 0.0
        return cls(
            weights=(1.0 - uniform) * shares,
            centres=np.array(centres),
            roots=np.array(roots),
            degrees=DEGREES if len(density) <= MANY else np.inf,
            lower=density.lower,
            upper=density.upper,
            uniform=uniform,
        )

    def kernels_at(self, x: Floats, weights: Floats, rng: np.random.Generator) -> Proposal:
        """Kernels at weighted draws, as wide as Silverman's rule has it (West 1993).

        The first proposal stays a part of it, so that no place is lost that it reaches.

        Args:
            x: (k, m) draws; none leave the proposal as it is.
            weights: (k,) adding up to one.
            rng: of random numbers.
        """
        m = x.shape[1]
        if len(x) <= m:
            return self
        gap = x - weights @ x
        covariance = (gap * weights[:, None]).T @ gap
        covariance += _LINE * np.trace(covariance) / m * np.eye(m)
        count = min(float(KERNELS), effective_of_weights(weights))
        width = (4.0 / ((m + 2.0) * count)) ** (1.0 / (m + 4.0))
        root = width * np.linalg.cholesky(covariance)
        centres = x[rng.choice(len(x), KERNELS, p=weights)]
        share = (1.0 - self.uniform) / KERNELS * np.ones(KERNELS)
        roots = np.tile(root, (KERNELS, 1, 1))
        parts = (1.0 - _WIDE_PART - _FIRST_PART) * share, _WIDE_PART * share
        return replace(
            self,
            weights=np.concatenate([*parts, _FIRST_PART * self.weights]),
            centres=np.concatenate([centres, centres, self.centres]),
            roots=np.concatenate([roots, _WIDE * roots, self.roots]),
        )

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        """Draws (count, m) inside the bounds.

        Raises:
            ModelError: hardly any lie there.
        """
        m, kept, tried = self.centres.shape[1], np.empty((0, self.centres.shape[1])), 0
        shares = np.append(self.weights, self.uniform)
        while len(kept) < count:
            if tried > _MOST_TRIALS * count:
                raise ModelError(
                    "The posterior cannot be sampled: its approximation lies outside the bounds.",
                    "Look at the fit: is it converged, and are its bounds meant?",
                )
            tried += 2 * count
            which = rng.choice(len(shares), size=2 * count, p=shares / shares.sum())
            z = rng.standard_normal((2 * count, m))
            if np.isfinite(self.degrees):
                z *= np.sqrt(self.degrees / rng.chisquare(self.degrees, 2 * count))[:, None]
            anywhere = which == len(self.weights)
            which[anywhere] = 0
            x = self.centres[which] + np.einsum("kij,kj->ki", self.roots[which], z)
            if anywhere.any():
                x[anywhere] = rng.uniform(self.lower, self.upper, (np.count_nonzero(anywhere), m))
            inside = np.all((x >= self.lower) & (x <= self.upper), axis=1)
            kept = np.concatenate([kept, x[inside]])
        return np.asarray(kept[:count])

    def logarithms(self, x: Floats) -> Floats:
        """Log density (k,) at x (k, m) inside the bounds, up to one constant."""
        m, nu = x.shape[1], self.degrees
        parts = np.empty((len(self.weights) + 1, len(x)))
        for k, (centre, root) in enumerate(zip(self.centres, self.roots, strict=True)):
            distance = np.sum(np.linalg.solve(root, (x - centre).T) ** 2, axis=0)
            size = np.log(self.weights[k]) - np.sum(np.log(np.diag(root)))
            if np.isfinite(nu):
                size += gammaln(0.5 * (nu + m)) - gammaln(0.5 * nu) - 0.5 * m * np.log(nu * np.pi)
                parts[k] = size - 0.5 * (nu + m) * np.log1p(distance / nu)
            else:
                parts[k] = size - 0.5 * m * np.log(2.0 * np.pi) - 0.5 * distance
        with np.errstate(divide="ignore"):  # no uniform component where a bound is infinite
            parts[-1] = np.log(self.uniform / np.prod(self.upper - self.lower))
        return np.asarray(logsumexp(parts, axis=0))


@dataclass
class WeightedDraws:
    """Draws of a proposal with their weights.

    Args:
        proposal: that they are drawn from.
        x: (k, m) draws.
        logarithms: (k,) log density of the posterior.
        proposed: (k,) log density of the proposal.
        weights: (k,) adding up to one, smoothed.
        pareto_k: of the weights.
    """

    proposal: Proposal
    x: Floats
    logarithms: Floats
    proposed: Floats
    weights: Floats = field(init=False)
    pareto_k: float = field(init=False)

    def __post_init__(self) -> None:
        with np.errstate(invalid="ignore"):
            self.weights, self.pareto_k = smoothed(self.logarithms - self.proposed)

    @classmethod
    def none_of(cls, proposal: Proposal) -> WeightedDraws:
        """No draws yet."""
        return cls(proposal, np.empty((0, proposal.centres.shape[1])), np.empty(0), np.empty(0))

    def more(
        self, density: PosteriorDensity, rng: np.random.Generator, count: int
    ) -> WeightedDraws:
        """With further draws of the proposal.

        Args:
            density: of the posterior.
            rng: of random numbers.
            count: how many.
        """
        x = self.proposal.draw(rng, count)
        return WeightedDraws(
            self.proposal,
            np.concatenate([self.x, x]),
            np.concatenate([self.logarithms, density.logarithms(x)]),
            np.concatenate([self.proposed, self.proposal.logarithms(x)]),
        )

    @property
    def effective(self) -> float:
        """Effective size."""
        return effective_of_weights(self.weights)

    @property
    def efficiency(self) -> float:
        """Effective size by draws."""
        return self.effective / max(len(self.x), 1)

    def reliable(self, least: float) -> bool:
        """The weights are, by k, and their efficiency is not below the least that is wanted."""
        return self.pareto_k <= limit_of_k(len(self.x)) and self.efficiency >= least

    def resampled(self, draws: int, rng: np.random.Generator, *, name: str, stopped: str) -> Draws:
        """So many draws without weights, by systematic resampling, without order.

        Args:
            draws: how many.
            rng: of random numbers.
            name: of the sampler.
            stopped: why it has stopped early, or empty.
        """
        steps = (np.arange(draws) + rng.uniform()) / draws
        ends = np.cumsum(self.weights)
        taken = np.minimum(np.searchsorted(ends / ends[-1], steps), len(ends) - 1)
        taken = rng.permutation(taken)
        m = self.x.shape[1]
        return Draws(
            sampler=name,
            x=self.x[taken][None],
            logarithms=self.logarithms[taken][None],
            effective=np.full(m, min(self.effective, float(draws))),
            r_hat=np.full(m, np.nan),
            pareto_k=self.pareto_k,
            acceptance=self.efficiency,
            stopped=stopped,
        )


class ImportanceSampler:
    """Weighted draws of a posterior.

    Args:
        density: of the posterior.
        request: what is asked for.
        rng: of random numbers.
        watch: is shown the progress.

    Attributes:
        stopped: the reason for having stopped early, or empty.
        rounds: all draws so far, proposal by proposal.
    """

    def __init__(
        self,
        density: PosteriorDensity,
        request: SamplingRequest,
        rng: np.random.Generator,
        watch: SamplingWatch,
    ) -> None:
        self._density, self._request, self._rng, self._watch = density, request, rng, watch
        self.stopped = ""
        self.rounds: list[WeightedDraws] = []

    def until_enough(self, proposal: Proposal, name: str, least: float) -> WeightedDraws:
        """Draws of a proposal: until they are enough, not reliable, or stopped.

        Args:
            proposal: to draw from.
            name: of the sampler, for the progress.
            least: efficiency below which another sampler is tried.
        """
        drawn = self._more(WeightedDraws.none_of(proposal), FIRST, name)
        while not self.stopped and drawn.reliable(least):
            left = self._request.effective - drawn.effective
            if left <= 0.0:
                break
            count = int(np.clip(1.05 * left / drawn.efficiency, FIRST / 3, _MOST_MORE))
            drawn = self._more(drawn, count, name)
        self.rounds.append(drawn)
        return drawn

    def adapted(self) -> Proposal:
        """The most efficient proposal of some rounds, each of kernels at the draws before."""
        first, begun = self.rounds[0].proposal, len(self.rounds)
        while len(self.rounds) < begun + ROUNDS and not self.stopped:
            recent = self.rounds[:1] + self.rounds[1:][-ROUNDS:]
            kernels = first.kernels_at(*_pooled(recent), self._rng)
            self.rounds.append(self._more(WeightedDraws.none_of(kernels), FIRST, ADAPTING))
            if self.rounds[-1].reliable(WORTH_ADAPTING):
                break
        tried = self.rounds[begun:] or self.rounds[:1]
        return max(tried, key=lambda drawn: drawn.efficiency).proposal

    def _more(self, drawn: WeightedDraws, count: int, name: str) -> WeightedDraws:
        """With so many further draws, in parts between which the watch is asked."""
        density, request = self._density, self._request
        while count > 0 and not self.stopped:
            part = min(_AT_ONCE, count, request.evaluations - density.evaluations)
            if part <= 0:
                self.stopped = OUT_OF_EVALUATIONS
                break
            try:
                drawn = drawn.more(density, self._rng, part)
            except Stopped as stop:
                self.stopped = stop.reason
                break
            count -= part
            progress = SamplingProgress(
                name, density.evaluations, drawn.effective, request.effective
            )
            self.stopped = self._watch(progress) or ""
        return drawn


def _pooled(rounds: Sequence[WeightedDraws]) -> tuple[Floats, Floats]:
    """Draws of all rounds (k, m) that have a density, and their weights (k,), adding up to one.

    Weights are by the mixture of all proposals (balance heuristic, Veach & Guibas 1995), to the
    largest of the powers 1, 4/5, (4/5)^2 .. that leaves enough of them.
    """
    x, logarithms = (np.concatenate([getattr(r, k) for r in rounds]) for k in ("x", "logarithms"))
    some = np.isfinite(logarithms)
    x, logarithms = x[some], logarithms[some]
    counts = np.array([len(r.x) for r in rounds], dtype=np.float64)
    proposed = [r.proposal.logarithms(x) + np.log(n) for r, n in zip(rounds, counts, strict=True)]
    log_weight = logarithms - logsumexp(proposed, axis=0)
    least = min(_PER_PARAMETER * x.shape[1], len(x) / 3.0)
    for power in 0.8 ** np.arange(_POWERS):
        raw = np.exp(power * (log_weight - log_weight.max(initial=-np.inf)))
        if effective_of_weights(raw / raw.sum()) >= least:
            break
    return x, raw / raw.sum()
