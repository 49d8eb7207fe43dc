"""Draws of a posterior: what ``geoident sample`` found."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.columns import Record, column

LEVELS = (0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975)
"""Quantiles that are told of parameters."""


class PosteriorDraws(Record):
    """Draws of the parameters from exp(-phi/2) within their bounds (theory 11).

    Args:
        names: of the n parameters.
        fields: n names of the fields of which they are modes; empty for a parameter of the case.
        values: (c, d, n) draws in c chains, SI. Of importance sampling one chain, resampled.
        log_density: (c, d) logarithm of the density that was sampled, up to a constant.
        sampler: ``importance``, ``adapted importance``, ``ensemble`` or ``preconditioned
            Crank-Nicolson``.
        pareto_k: of the importance weights; NaN of chains.
        effective: (n,) how many independent draws they are worth.
        r_hat: (n,) NaN of independent draws.
        acceptance: share of accepted steps; of importance sampling effective size by evaluations.
        evaluations: of the model, those that were discarded too.
        channels: (m,) channel of each predicted reading.
        stages: (m,) its stage.
        predicted: (c, k, m) readings that the draws predict, with the errors of readings, SI;
            NaN where the ground does not stand.
        taken: (k,) the draws of each chain of which these are.
    """

    names: tuple[str, ...] = column("parameter", name="parameter")
    fields: tuple[str, ...] = column("parameter")
    values: Floats = column(
        "chain", "draw", "parameter", dimension="parameter", sheet="{parameter}"
    )
    log_density: Floats = column("chain", "draw")
    sampler: str
    pareto_k: float
    effective: Floats = column("parameter", title="effective_size")
    r_hat: Floats = column("parameter")
    acceptance: float
    evaluations: int
    channels: tuple[str, ...] = column("reading")
    stages: tuple[str, ...] = column("reading")
    predicted: Floats = column("chain", "taken", "reading")
    taken: Ints = column("taken")

    @property
    def n_draws(self) -> int:
        """Number of draws in all chains."""
        return int(self.log_density.size)

    @property
    def flat(self) -> Floats:
        """(c d, n) draws of all chains, SI."""
        return np.asarray(self.values.reshape(-1, len(self.names)))

    @cached_property
    def mean(self) -> Floats:
        """(n,) SI."""
        return np.asarray(self.flat.mean(axis=0))

    @cached_property
    def sd(self) -> Floats:
        """(n,) SI."""
        return np.asarray(self.flat.std(axis=0))

    @cached_property
    def quantiles(self) -> Floats:
        """(n, 7) at `LEVELS`, SI."""
        return np.asarray(np.quantile(self.flat, LEVELS, axis=0).T)

    @property
    def least_effective(self) -> float:
        """The smallest effective size; 0 where there is none."""
        known = self.effective[np.isfinite(self.effective)]
        return float(known.min()) if len(known) else 0.0

    @property
    def largest_r_hat(self) -> float:
        """The largest R-hat; NaN of independent draws."""
        known = self.r_hat[np.isfinite(self.r_hat)]
        return float(known.max()) if len(known) else np.nan
