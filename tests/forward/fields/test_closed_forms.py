"""Graded ground against closed forms, and fields that are refused in words."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, field_on, material, model_with_fields, rollers
from support.meshes import box

from geoident.model.actions import Pressure, Traction
from geoident.model.case import Analysis, Stage, Support
from geoident.model.parameter import Parameter, Scalar

E0, SLOPE, LOAD = 2e9, 0.8, 1e6


def graded(on_mesh, constant="E"):
    """E = E0 (1 + SLOPE x) at one unit of the only mode."""
    return [field_on(on_mesh, "rock", constant, lambda x: np.log1p(SLOPE * x[:, :1]))]


def test_bar_whose_modulus_grows_along_it(verification):
    """u(L) = integral of sigma / E = sigma / (E0 SLOPE) log(1 + SLOPE L)."""
    mesh = box("quad8", (40, 1), size=(4.0, 1.0))
    staged = model_with_fields(
        mesh,
        graded,
        materials={"rock": material("rock", E0, 0.0)},
        groups={"all": "rock"},
        supports=rollers(2),
        parameters=(Parameter("rock.E.mode-1", 1.0, -9.0, 9.0),),
        stages=(Stage("pull", loads={"q": Traction("x1", (Scalar(LOAD), Scalar(0.0)))}),),
        channels=(displacement("end", (4.0, 0.5), (1.0, 0.0)),),
    )
    response = staged.response([("end", "pull")])
    value, slope = response.evaluate(np.ones(1))
    exact = LOAD / (E0 * SLOPE) * np.log1p(SLOPE * 4.0)
    np.testing.assert_allclose(value, exact, rtol=1e-5)
    # d/dxi of the integral of sigma / (E0 (1 + a x)^xi) at xi = 1: -log^2(1 + a L) / (2 a)
    by_mode = -LOAD / (E0 * SLOPE) * np.log1p(SLOPE * 4.0) ** 2 / 2
    np.testing.assert_allclose(slope[0, 0], by_mode, rtol=1e-5)
    verification("graded-bar", "", ["end of the bar"], exact=exact, found=value)
    assert response.adjoints.cost_less(100)


def test_thick_cylinder_whose_modulus_is_a_power_of_the_radius(verification):
    """E = E0 (r / a)^m, plane strain along the axis; inner pressure p.

    u = A r^s + B r^t with s, t the roots of x^2 + m x + m nu / (1 - nu) - 1 = 0 (C. O. Horgan and
    A. M. Chan, 1999, The pressurized hollow cylinder problem for functionally graded isotropic
    linearly elastic materials, J. Elasticity 55).
    """
    a, b, m, nu = 1.0, 3.0, 1.3, 0.3
    mesh = box("quad8", (24, 1), size=(b - a, 0.5))
    mesh.points[:, 0] += a
    staged = model_with_fields(
        mesh,
        lambda on_mesh: [field_on(on_mesh, "rock", "E", lambda x: np.log(x[:, :1] / a))],
        analysis=Analysis.AXISYMMETRIC,
        materials={"rock": material("rock", E0, nu)},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        parameters=(Parameter("rock.E.mode-1", m, -9.0, 9.0),),
        stages=(Stage("press", loads={"p": Pressure("x0", Scalar(LOAD))}),),
        channels=tuple(
            displacement(f"r{k}", (r, 0.2), (1.0, 0.0)) for k, r in enumerate((1.0, 2.0))
        ),
    )
    found = staged.survey(np.array([m]), fields=False).computed[:, 0]
    root = np.sqrt(m**2 / 4 - m * nu / (1 - nu) + 1)
    s, t = -m / 2 + root, -m / 2 - root
    size = E0 / ((1 + nu) * (1 - 2 * nu))

    def radial(x, r):  # sigma_rr of u = r^x
        return size * (r / a) ** m * ((1 - nu) * x + nu) * r ** (x - 1)

    equations = [[radial(s, a), radial(t, a)], [radial(s, b), radial(t, b)]]
    A, B = np.linalg.solve(equations, [-LOAD, 0.0])
    exact = [A * r**s + B * r**t for r in (1.0, 2.0)]
    np.testing.assert_allclose(found, exact, rtol=2e-5)
    verification("graded-cylinder", "", [1.0, 2.0], exact=exact, found=found)


def refused():
    return model_with_fields(
        box("quad8", (4, 2), size=(4.0, 1.0)),
        graded,
        materials={"rock": material("rock", E0, 0.2)},
        groups={"all": "rock"},
        supports=rollers(2),
        parameters=(Parameter("rock.E.mode-1", 1.0, -9.0, 9.0),),
        stages=(Stage("pull", loads={"q": Traction("x1", (Scalar(LOAD), Scalar(0.0)))}),),
        channels=(displacement("end", (4.0, 0.5), (1.0, 0.0)),),
    ).response([("end", "pull")])


@pytest.mark.parametrize("why", ["obstacle", "system_obstacle"])
def test_methods_that_need_affine_equations_say_that_a_field_is_not(why):
    assert "is a field" in getattr(refused(), why)()


def test_a_field_beyond_all_measure_is_outside_the_domain():
    response = refused()
    assert response.admissible(np.ones(1)) is None
    assert "too large to compute with" in response.admissible(np.array([1e4]))
