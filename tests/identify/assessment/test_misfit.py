"""Residuals against what their errors explain: false alarms and power, by repetition.

The judge of the squared loss without priors is the chi-squared distribution itself.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.stats import chi2

from geoident.identify.assessment.misfit import misfit
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.methods import GaussNewtonOptions, HuberOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter, Prior

S = 0.1
LOSSES = [SquaredOptions(), HuberOptions(), StudentOptions()]


def fitted(make_problem, A, y, *, loss, prior=None, shared=None):
    """The misfit of a linear model with two parameters at its estimate."""
    q = (Parameter("a", 1.0, -50.0, 50.0), Parameter("b", 1.0, -50.0, 50.0, prior=prior))
    made = make_problem(lambda p: A @ p, q, y, S)
    problem = Problem(made.response, y, np.full(len(y), S), q, loss, shared)
    values = gauss_newton(problem, GaussNewtonOptions(), lambda it: None).values
    return misfit(problem, values, A @ values, A)


def chances(make_problem, repetitions, *, g, loss, prior=None, share=0.0, times=1.0, seed=5):
    """Probabilities by chance, of readings whose errors are so many times as large as stated."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(repetitions):
        A, z = rng.normal(size=(g, 2)), rng.normal(size=2)
        truth = np.array([1.0, prior.mean + prior.sd * rng.normal() if prior else 1.0])
        B = share * np.repeat(np.eye(2), g, axis=0)[::2]
        shared = SharedErrors(sp.csr_array(B)) if share else None
        y = A @ truth + times * (S * rng.normal(size=g) + B @ z)
        found.append(fitted(make_problem, A, y, loss=loss, prior=prior, shared=shared).above)
    return np.array(found)


def test_without_priors_it_is_chi_squared(make_problem):
    rng = np.random.default_rng(1)
    A = rng.normal(size=(10, 2))
    y = A @ np.ones(2) + 2.0 * S * rng.normal(size=10)
    found = fitted(make_problem, A, y, loss=SquaredOptions())
    left = y - A @ np.linalg.lstsq(A, y)[0]
    squares = left @ left / S**2
    assert found.freedom == pytest.approx(8.0)
    assert found.squares == pytest.approx(squares)
    assert found.above == pytest.approx(chi2(8).sf(squares))
    assert found.below == pytest.approx(chi2(8).cdf(squares))
    assert found.scale == pytest.approx(np.sqrt(squares / 8.0))


def test_a_parameter_on_its_bound_is_not_fitted(make_problem):
    A = np.random.default_rng(1).normal(size=(10, 2))
    q = (Parameter("a", 1.0, 1.0, 50.0), Parameter("b", 1.0, -50.0, 50.0))
    problem = make_problem(lambda p: A @ p, q, np.zeros(10), S)
    assert misfit(problem, np.ones(2), A @ np.ones(2), A).freedom == pytest.approx(9.0)


def test_as_many_parameters_as_readings_leave_nothing_to_judge(make_problem):
    A = np.eye(2)
    found = fitted(make_problem, A, np.array([3.0, 4.0]), loss=SquaredOptions())
    assert found.above == found.below == 1.0


def test_an_absurd_reading_overflows_nothing(make_problem):
    A = np.random.default_rng(1).normal(size=(10, 2))
    for loss in LOSSES:
        y = A @ np.ones(2)
        y[3] = 1e140
        assert (fitted(make_problem, A, y, loss=loss).above < 1e-4) == (loss == SquaredOptions())


@pytest.mark.parametrize(
    "loss",
    [*LOSSES[:2], pytest.param(LOSSES[2], marks=pytest.mark.slow)],
    ids=lambda loss: type(loss).__name__,
)
def test_a_right_model_is_blamed_as_seldom_as_stated(make_problem, loss):
    """With a prior and without, with shared errors and without: each alone, and all together."""
    kinds = [(prior, share) for prior in (None, Prior(1.0, 0.2)) for share in (0.0, 0.15)]
    alone = [
        chances(make_problem, 25, g=10, loss=loss, prior=prior, share=share, seed=seed)
        for seed, (prior, share) in enumerate(kinds)
    ]
    # four standard deviations of binomial proportions; the robust ones are cautious
    for found in [*alone, np.concatenate(alone)]:
        assert np.mean(found < 0.1) <= 0.1 + 4.0 * np.sqrt(0.09 / len(found))
        assert np.mean(found < 0.01) <= 0.01 + 4.0 * np.sqrt(0.0099 / len(found))
        assert found.min() > 1e-4


@pytest.mark.parametrize(("loss", "power"), [(LOSSES[0], 0.9), (LOSSES[1], 0.6), (LOSSES[2], 0.5)])
def test_ten_readings_tell_that_errors_are_twice_as_large(make_problem, loss, power):
    found = chances(make_problem, 20, g=10, loss=loss, times=2.0)
    assert np.mean(found < 0.01) > 0.6 * power
    found = chances(make_problem, 20, g=10, loss=loss, times=3.0)
    assert np.mean(found < 0.01) > power


def test_a_few_wrong_readings_are_no_misfit_of_a_robust_loss(make_problem):
    rng = np.random.default_rng(2)
    A = rng.normal(size=(20, 2))
    y = A @ np.ones(2) + S * rng.normal(size=20)
    y[[3, 7]] += 1.0
    assert fitted(make_problem, A, y, loss=SquaredOptions()).above < 1e-4
    assert fitted(make_problem, A, y, loss=StudentOptions()).above > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("g", [4, 10, 50])
@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: type(loss).__name__)
@pytest.mark.parametrize("share", [0.0, 0.15])
def test_false_alarms_in_thousands_of_repetitions(make_problem, g, loss, share):
    found = chances(make_problem, 2000, g=g, loss=loss, share=share)
    assert np.mean(found < 0.01) < 0.02
    assert np.mean(found < 1e-4) < 0.003
