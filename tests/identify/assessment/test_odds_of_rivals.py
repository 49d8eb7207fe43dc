"""Odds of minima by Laplace's approximation, against quadrature of the posterior.

A dip whose readings are nearly the same after a quarter turn, alone and with a modulus. The
posterior is integrated over a grid between the bounds, and each point counts for the minimum whose
dip is nearer. The approximation is as good as the posterior is normal around each of them.
"""

from __future__ import annotations

import numpy as np
import pytest

from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter
from geoident.workflow.estimating.rivals import weighed_minima

DIP = Parameter("dip", 0.3, -1.55, 1.55, dimension="angle", period=np.pi)
SIZE = Parameter("E", 2.0, 0.5, 8.0, "log")
TURNS = np.radians([0.0, 25.0, 60.0])
TRUTH = np.radians(40.0)


def stiffness(a):
    """As strata have it: mostly by cos 4a, a little by cos 2a."""
    return 1.0 + 0.3 * np.cos(4.0 * (a - TURNS)) + TWO * np.cos(2.0 * (a - TURNS))


TWO = 0.012


def alone(p):
    return stiffness(p[0])


def with_size(p):
    return p[1] * stiffness(p[0])


def integral(formula, measured, sd, minima, n):
    """(k,) parts of exp(-phi/2) over the dip, and the size on its logarithm, of minima (k, m)."""
    dip = DIP.lower + (np.arange(n) + 0.5) / n * (DIP.upper - DIP.lower)
    points = dip[:, None]
    if formula is with_size:
        ends = np.log([SIZE.lower, SIZE.upper])
        size = np.exp(ends[0] + (np.arange(n) + 0.5) / n * (ends[1] - ends[0]))
        points = np.stack(np.meshgrid(dip, size, indexing="ij"), axis=-1).reshape(-1, 2)
    answers = formula(points.T[:, :, None])
    weight = np.exp(-0.5 * (((measured - answers) / sd) ** 2).sum(axis=1))
    dip = points[:, 0]
    apart = np.abs(np.angle(np.exp(2j * (dip[:, None] - np.asarray(minima)[None, :, 0]))))
    near = np.argmin(apart, axis=1)
    parts = np.bincount(near, weight, minlength=len(minima))
    return parts / parts.sum()


@pytest.mark.parametrize(
    ("formula", "parameters", "truth", "n"),
    [(alone, (DIP,), [TRUTH], 4000), (with_size, (DIP, SIZE), [TRUTH, 2.0], 160)],
    ids=["one parameter", "two parameters"],
)
@pytest.mark.parametrize("off", [0.0, 0.004, -0.006])
def test_the_odds_are_those_of_the_integral(make_problem, formula, parameters, truth, n, off):
    """Readings a little off make one minimum or the other the lower one."""
    measured = formula(np.array(truth)) + off * np.array([1.0, -1.0, 0.5])
    problem = make_problem(formula, parameters, measured, 0.02)
    outcome = gauss_newton(problem, GaussNewtonOptions(starts=8), lambda _: None)
    computed, jacobian = problem.response.evaluate(outcome.values)
    rivals, _ = weighed_minima(problem, outcome, computed, jacobian)
    assert len(rivals) == 2
    assert np.ptp(rivals.values[:, 0]) == pytest.approx(np.pi / 2, abs=0.05)
    assert 0.03 < rivals.odds[1] < 0.6
    expected = integral(formula, measured, 0.02, rivals.values, n)
    assert rivals.odds == pytest.approx(expected, abs=0.03)
