"""Moduli of a rock mass by its GSI in elastic ground: derivatives forwards and by adjoints."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.derivatives import assert_exact
from support.meshes import box
from support.yielding import parameters, rock

from geoident.forward.affine import affine_obstacle
from geoident.model.actions import Traction
from geoident.model.case import Stage
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.parameter import Scalar


def pressed(**parts: Scalar):
    """A block of rock under a load."""
    modulus = RockMassModulus(GSI=Scalar(1.0, "GSI"), D=Scalar(1.0, "D"), **parts)
    names = {scalar.parameter for scalar in parts.values()} - {None}
    sizes = {"Ei": 20e9, "MR": 400.0, "sigci": 50e6}
    values = {"GSI": 45.0, "D": 0.3, **{n: x for n, x in sizes.items() if n in names}}
    staged = model(
        box("quad8", (2, 2)),
        materials={"rock": rock(modulus, 0.25)},
        groups={"all": "rock"},
        supports=rollers(2),
        stages=(Stage("load", loads={"q": Traction("y1", (Scalar(0.0), Scalar(-1e6)))}),),
        channels=(displacement("u", (0.7, 0.99), (0.0, 1.0)),),
        parameters=parameters(**values),
    )
    return staged, values


@pytest.mark.parametrize(
    "parts",
    [{"Ei": Scalar(1.0, "Ei")}, {"MR": Scalar(1.0, "MR"), "sigci": Scalar(0.5, "sigci")}, {}],
    ids=["Ei", "MR", "simplified"],
)
def test_derivatives_by_all_numbers(parts):
    staged, values = pressed(**parts)
    response = staged.response([("u", "load")])
    assert_exact(response, np.array([*values.values()]), tuple(values))


def test_motions_are_those_of_the_modulus():
    """E = 20 GPa (0.02 + 0.85 / (1 + e^(19.5 / 11))) for GSI 45, D 0.3, in proportion to Ei."""
    staged, values = pressed(Ei=Scalar(1.0, "Ei"))
    response = staged.response([("u", "load")])
    p = np.array([*values.values()])
    softer = p * [1.0, 1.0, 0.5]
    assert response.readings(softer) == pytest.approx(2.0 * response.readings(p))
    expected = 20e9 * (0.02 + 0.85 / (1.0 + np.exp(19.5 / 11.0)))
    modulus = RockMassModulus(GSI=Scalar(45.0), D=Scalar(0.3), Ei=Scalar(20e9))
    assert modulus.value({}) == pytest.approx(expected)


def test_condensation_says_why_it_cannot():
    staged, _ = pressed(Ei=Scalar(1.0, "Ei"))
    said = str(affine_obstacle(staged.analysis))
    assert "E of rock follows from its GSI" in said
