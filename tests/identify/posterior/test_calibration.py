"""Simulation-based calibration (Talts and others 2018): ranks of truths among draws are uniform.

Truths come from the prior, readings from truths, draws from the posterior of the readings: whatever
the problem, the rank of a truth among draws is then uniform, if prior, likelihood, change of
variables and sampler are all right. Each is broken once, to see that the ranks tell.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.posteriors import chance_of, ranks_of_truth

from geoident.identify.posterior.density import PosteriorDensity

LEAST_CHANCE = 1e-3


def without_the_prior_of_the_stress(problem):
    free = tuple(replace(q, prior=None) if q.name == "sigma_v" else q for q in problem.parameters)
    return PosteriorDensity(replace(problem, parameters=free))


def with_accuracies_too_good(problem):
    return PosteriorDensity(replace(problem, sd=0.6 * problem.sd))


def test_ranks_are_uniform():
    ranks = ranks_of_truth(16, density_of=PosteriorDensity)
    assert chance_of(ranks, 10).min() > LEAST_CHANCE


@pytest.mark.slow  # it tries this judge itself
@pytest.mark.parametrize(
    ("wrong", "runs"), [(without_the_prior_of_the_stress, 40), (with_accuracies_too_good, 60)]
)
def test_ranks_tell_what_is_wrong(wrong, runs):
    ranks = ranks_of_truth(runs, density_of=wrong)
    assert chance_of(ranks, 10).min() < LEAST_CHANCE


@pytest.mark.slow
def test_ranks_of_500_runs_are_uniform():
    ranks = ranks_of_truth(500, density_of=PosteriorDensity, seed=1)
    assert chance_of(ranks, 20).min() > LEAST_CHANCE
