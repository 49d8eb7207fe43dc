"""Cohesion and friction free together: the ground may seem elastic with either of them far off."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement
from support.yielding import Cavity, constant, mohr, rock

from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.yield_limits.implicit import implicit
from geoident.model.case import Stage
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions
from geoident.model.parameter import Parameter, Scalar

TRUTH = np.array([3e9, 0.6e6, np.radians(25), -4e6])
NOISE = 4e-4
"""A fifth of the largest reading: strengths are seen, and no more than that."""


def _problem(seed: int) -> Problem:
    cavity = Cavity()
    parameters = (
        Parameter("E", 2.5e9, 0.5e9, 20e9, scale="log"),
        Parameter("c", 1e6, 0.05e6, 5e6, scale="log"),
        Parameter("phi", np.radians(30), np.radians(5), np.radians(55)),
        Parameter("sx", -5e6, -12e6, -2e6),
    )
    surface = mohr(Scalar(1.0, "c"), Scalar(1.0, "phi"))
    stages = tuple(
        Stage(f"s{n}", excavate=() if n else ("core",), release={"core": Scalar(part)})
        for n, part in enumerate((0.5, 0.8, 1.0))
    )
    where = [(r * np.cos(t), r * np.sin(t)) for r in (1.0, 1.3, 2.0) for t in (0.1, 0.8, 1.5)]
    channels = [
        displacement(f"g{n}{'xy'[k]}", place, (1.0 - k, float(k)))
        for n, place in enumerate(where)
        for k in (0, 1)
    ]
    staged = cavity.staged(
        cavity.mesh("quad8", n=2, layers=8, reach=10),
        materials={"rock": rock(Scalar(1.0, "E"), 0.25, surface)},
        in_situ=constant(Scalar(1.0, "sx"), -6e6, -5e6),
        parameters=parameters,
        stages=stages,
        channels=tuple(channels),
    )
    pairs = [(channel.name, stage.name) for stage in stages for channel in channels]
    response = staged.response(pairs)
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(pairs))
    measured = response.readings(TRUTH) + noise
    return Problem(response, measured, np.full(len(pairs), NOISE), parameters)


@pytest.mark.slow  # the next does more of it
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_answer_is_as_good_as_that_of_a_plain_descent(seed):
    problem = _problem(seed)
    plain = gauss_newton(problem, GaussNewtonOptions(), lambda _: None)
    found = implicit(problem, ComplementarityOptions(), lambda _: None)
    assert found.objective <= 1.001 * plain.objective


def test_a_search_that_ends_where_nothing_yields_goes_on_from_elsewhere():
    problem = _problem(0)
    strong = np.array([3e9, 5e6, np.radians(55), -4e6])
    assert problem.response.activity(strong).points.sum() == 0
    found = implicit(problem.begun_at(strong), ComplementarityOptions(), lambda _: None)
    assert found.objective <= Discrepancy(problem).objective(TRUTH)
