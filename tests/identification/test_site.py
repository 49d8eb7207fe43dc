"""Stress of a site found again, with noise: two ratios and their azimuth."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.meshes import box, regroup

from geoident.identify.assessment.uncertainty import assess
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.case import Stage, Support
from geoident.model.in_situ import HeimStress
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Scalar

TRUTH = {"K0": 1.7, "K0_across": 0.6, "azimuth": np.radians(35.0)}
PARAMETERS = (
    Parameter("K0", 1.1, 0.2, 4.0),
    Parameter("K0_across", 1.0, 0.2, 4.0),
    Parameter("azimuth", np.radians(60.0), 0.0, np.pi / 2),
)


def cavern():
    """A cavern opened in two steps in a block of 12 m; two gauges on each of its walls."""

    def p(name):
        return Scalar(1.0, name)

    def step(low, high):
        return lambda c: (
            np.all(np.abs(c - 6.0) < [3, 2, 2], axis=1) & (c[:, 2] > low) & (c[:, 2] < high)
        )

    mesh = regroup(
        box("hex8", (8, 8, 8), size=(12.0, 12.0, 12.0)), top=step(6, 9), bench=step(3, 6)
    )
    zero = Scalar(0.0)
    places = [(6, 3, 7), (6, 9, 7), (2, 6, 7), (10, 6, 7), (4, 4, 9), (8, 8, 9), (3, 8, 6)]
    return model(
        mesh,
        parameters=PARAMETERS,
        materials={"rock": material("rock", 12e9, 0.25, 2600.0)},
        groups=dict.fromkeys(("rock", "top", "bench"), "rock"),
        supports=(*rollers(3), Support("x1", (0,)), Support("y1", (1,))),
        in_situ=HeimStress(
            K0=p("K0"),
            K0_across=p("K0_across"),
            azimuth=p("azimuth"),
            unit_weight=Scalar(26e3),
            surface=Scalar(300.0),
            tectonic=(Scalar(-1.2e6), zero, zero, zero, zero, zero),
            held=True,
        ),
        stages=(Stage("top", excavate=("top",)), Stage("bench", excavate=("bench",))),
        channels=tuple(
            displacement(f"c{k}{axis}", tuple(map(float, place)), tuple(direction))
            for k, place in enumerate(places)
            for axis, direction in zip("xyz", np.eye(3), strict=True)
        ),
    )


@pytest.fixture(scope="module")
def found():
    staged = cavern()
    response = staged.response(
        [(c.name, s.name) for s in staged.case.stages for c in staged.case.channels]
    )
    truth = np.array(list(TRUTH.values()))
    sd = 2e-5
    measured = response.readings(truth)
    measured = measured + np.random.default_rng(11).normal(0.0, sd, len(measured))
    problem = Problem(response, measured, np.full(len(measured), sd), PARAMETERS)
    outcome = identify(problem, (GaussNewtonOptions(),), lambda _: None)
    return outcome, assess(problem, outcome.values, response.evaluate(outcome.values)[1])


def test_the_stress_of_the_site_is_found_within_its_intervals(found):
    outcome, assessment = found
    assert outcome.status == "converged"
    truth = np.array(list(TRUTH.values()))
    sd = np.sqrt(np.diag(assessment.covariance))
    assert np.all(np.abs(outcome.values - truth) < 1.96 * sd), (outcome.values, sd)
    assert assessment.determined.all()


def test_the_azimuth_is_known_to_a_few_degrees(found):
    _, assessment = found
    assert 0 < np.degrees(np.sqrt(assessment.covariance[2, 2])) < 5
