"""GSI and the strength of intact rock from readings of a tunnel that another mesh gives."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.meshes import opening
from support.yielding import constant, hoek, rock

from geoident.forward.model import StagedModel
from geoident.identify import Problem, assess, identify
from geoident.model.case import Stage
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions, MethodOptions
from geoident.model.parameter import Parameter, Scalar

RADIUS, FAR = 3.0, 12e6
PARTS = (0.5, 0.8, 0.95)
DEPTHS = (0.0, 1.0, 3.0, 6.0)
ACCURACY = 0.3e-3
PARAMETERS = (
    Parameter("GSI", 45.0, 15.0, 80.0),
    Parameter("sigci", 60e6, 10e6, 150e6, "log"),
)
TRUTH = np.array([33.0, 38e6])
METHODS = pytest.mark.parametrize(
    "method",
    [GaussNewtonOptions(), ComplementarityOptions(restarts=1, max_evaluations=30)],
    ids=["gauss-newton", "complementarity"],
)


def tunnel(n: int, layers: int) -> StagedModel:
    """A quarter of a round tunnel; GSI says strength and stiffness."""
    mesh = opening("quad8", 2, n=n, layers=layers, radius=RADIUS, reach=25 * RADIUS)
    GSI, sigci = Scalar(1.0, "GSI"), Scalar(1.0, "sigci")
    modulus = RockMassModulus(GSI=GSI, D=Scalar(0.0), Ei=Scalar(15e9))
    surface = hoek(sigci, mi=9.0, GSI=GSI, D=0.0, psi=np.radians(4.0))
    stages = tuple(
        Stage(f"s{k}", excavate=() if k else ("core",), release={"core": Scalar(part)})
        for k, part in enumerate(PARTS)
    )
    channels = tuple(
        displacement(f"d{depth:g}", (RADIUS + depth, 0.0), (1.0, 0.0)) for depth in DEPTHS
    )
    return model(
        mesh,
        parameters=PARAMETERS,
        materials={"rock": rock(modulus, 0.25, surface)},
        groups={"core": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=constant(*(-FAR,) * 3),
        stages=stages,
        channels=channels,
    )


@METHODS
def test_truth_lies_in_the_intervals(method: MethodOptions):
    pairs = [(f"d{depth:g}", f"s{k}") for depth in DEPTHS for k in range(len(PARTS))]
    measured = tunnel(3, 40).response(pairs).readings(TRUTH)
    measured = measured + ACCURACY * np.random.default_rng(7).standard_normal(len(measured))
    response = tunnel(2, 24).response(pairs)
    problem = Problem(response, measured, np.full(len(measured), ACCURACY), PARAMETERS)
    outcome = identify(problem, (method,), lambda iteration: None)
    assert outcome.status == "converged"
    known = assess(problem, outcome.values, response.evaluate(outcome.values)[1])
    assert known.determined.all()
    assert np.all(known.lower95 <= TRUTH)
    assert np.all(known.upper95 >= TRUTH)
    assert np.all(known.upper95 - known.lower95 < 0.3 * TRUTH)
    assert response.activity(outcome.values).points.max() > 5
