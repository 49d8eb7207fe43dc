"""Water in the pores, on faces and under them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import NOWHERE, displacement, imbalance, material, model, rollers, virgin
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.model.actions import HeadLine, Pressure, Water, WaterPressure
from geoident.model.case import Stage, Support
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar

GAMMA_W = 9810.0
SATURATED = 2100.0
WEIGHT = SATURATED * 9.81
SOIL = material("soil", 50e6, 0.3, SATURATED)
E, NU, HEIGHT = 50e6, 0.3, 8.0
OEDOMETER = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))


def still(table):
    return Water(table, Scalar(GAMMA_W))


def column(**more):
    """A column of soil, saturated to its top, that can only move up and down."""
    settings = {
        "materials": {"soil": SOIL},
        "groups": {"all": "soil"},
        "supports": (*rollers(2), Support("x1", (0,))),
        "gravity": (0.0, -9.81),
        "in_situ": HeimStress(
            K0=Scalar(0.5), unit_weight=Scalar(WEIGHT - GAMMA_W), surface=Scalar(HEIGHT)
        ),
        "water": still(Scalar(HEIGHT)),
    }
    mesh = box("quad8", (3, 8), size=(3.0, HEIGHT), distortion=0.1)
    return model(mesh, **{**settings, **more})


def test_the_skeleton_of_a_hydrostatic_column_bears_the_buoyant_weight():
    staged = column(stages=(Stage("nothing"),))
    survey = staged.survey(np.empty(0), fields=True)
    assert imbalance(staged) < 1e-12
    assert np.abs(survey.fields.displacement).max() < 1e-15
    assert any("effective" in note for note in staged.notes)


def test_without_in_situ_stress_the_first_step_finds_the_buoyant_weight():
    staged = column(in_situ=None)
    standing = virgin(staged)
    depth = HEIGHT - staged.discretization.points.position[:, 1]
    vertical = standing.stress[1, :, 0]
    # Quadratic elements hold a linear stress exactly where they are not distorted.
    np.testing.assert_allclose(vertical, -(WEIGHT - GAMMA_W) * depth, atol=2e-3 * WEIGHT * HEIGHT)
    total = staged.systems[0].volume @ vertical
    np.testing.assert_allclose(total, -(WEIGHT - GAMMA_W) * 3 * HEIGHT**2 / 2, rtol=1e-9)


def test_a_table_drawn_down_settles_the_ground(verification):
    """The pore pressure of the whole column goes: u(H) = -gamma_w H^2 / (2 M)."""
    survey = column(stages=(Stage("drain", water=still(Scalar(0.0))),)).survey(
        np.empty(0), fields=True
    )
    mesh = survey.fields.mesh
    top = np.isclose(mesh.points[:, 1], HEIGHT)
    expected = -GAMMA_W * HEIGHT**2 / (2 * OEDOMETER)
    found = survey.fields.displacement[1][top, 1]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    verification("drawdown", "", ["surface"], exact=-expected, found=-found.mean())


def test_water_only_in_the_named_groups():
    mesh = regroup(box("quad8", (2, 8), size=(2.0, 8.0)), sand=lambda c: c[:, 1] > 4)
    common = {
        "materials": {"soil": SOIL},
        "groups": {"sand": "soil", "rock": "soil"},
        "supports": (*rollers(2), Support("x1", (0,))),
    }
    wet = Water(Scalar(8.0), Scalar(GAMMA_W), ("sand",))
    staged = model(mesh, **common, stages=(Stage("rise", water=wet),))
    survey = staged.survey(np.empty(0), fields=True)
    top = np.isclose(survey.fields.mesh.points[:, 1], 8.0)
    # In the sand 4 m from its top; below the total stress, and so the rock, is unchanged.
    expected = GAMMA_W * 4.0**2 / (2 * OEDOMETER)
    np.testing.assert_allclose(survey.fields.displacement[1][top, 1], expected, rtol=1e-9)


def test_held_edges_bear_the_water_too():
    """Ground as heavy as water under a constant effective stress: the water carries its weight."""
    staged = column(
        materials={"soil": material("soil", E, NU, GAMMA_W / 9.81)},
        supports=(Support("y0", (0, 1)),),
        in_situ=HeimStress(K0=Scalar(1.3), vertical=Scalar(2e5)),
        water=still(Scalar(30.0)),
        stages=(Stage("nothing"),),
    )
    staged.survey(np.empty(0), fields=False)
    assert imbalance(staged) < 1e-12


# On faces ---------------------------------------------------------------------------------------


def dam(kind="quad4", n=16, slope=0.5):
    """A trapezoid 16 m high; its upstream face (x0) leans downstream by ``slope``."""
    mesh = box(kind, (n // 2, n), size=(12.0, 16.0))
    x, y = mesh.points.T
    return replace(mesh, points=np.stack([x + slope * y * (1 - x / 12.0), y], axis=1))


def acting(mesh, load, **more):
    staged = model(
        mesh,
        materials={"soil": SOIL},
        groups={"all": "soil"},
        supports=(Support("y0" if mesh.dim == 2 else "z0", tuple(range(mesh.dim))),),
        loads={"water": load},
        **more,
    )
    dim = mesh.dim
    return staged.mesh.points, staged.actions.forces(0, NOWHERE)[:, 0].reshape(-1, dim)


@pytest.mark.parametrize("kind", ["quad4", "quad8", "tri3", "tri6"])
@pytest.mark.parametrize("level", [16.0, 11.0, 20.0])
def test_water_on_an_inclined_face_has_its_resultant_and_centre_of_pressure(kind, level):
    slope = 0.5
    load = WaterPressure("x0", Scalar(level), Scalar(GAMMA_W))
    points, forces = acting(dam(kind, slope=slope), load)
    wet = min(level, 16.0)
    dry = level - wet  # depth of water over the crest
    push = GAMMA_W * (wet**2 / 2 + dry * wet)
    np.testing.assert_allclose(forces.sum(axis=0), [push, -slope * push], rtol=1e-12)
    moment = points[:, 0] @ forces[:, 1] - points[:, 1] @ forces[:, 0]
    lever = GAMMA_W * (wet**3 / 6 + dry * wet**2 / 2)  # integral of p y
    np.testing.assert_allclose(moment, -(1 + slope**2) * lever, rtol=1e-12)


def test_a_level_inside_an_element_converges():
    exact = GAMMA_W * 11.37**2 / 2
    load = WaterPressure("x0", Scalar(11.37), Scalar(GAMMA_W))
    errors = [abs(acting(dam(n=n), load)[1][:, 0].sum() / exact - 1) for n in (8, 32, 128)]
    assert errors[0] < 0.02
    assert errors[2] < errors[0] / 50


def test_water_on_a_solid():
    mesh = box("tet10", (3, 3, 4), size=(6.0, 6.0, 8.0))
    points, forces = acting(mesh, WaterPressure("x0", Scalar(8.0), Scalar(GAMMA_W)))
    push = GAMMA_W * 32 * 6
    np.testing.assert_allclose(forces.sum(axis=0), [push, 0, 0], atol=1e-9 * push)
    np.testing.assert_allclose(points[:, 2] @ forces[:, 0] / push, 8 / 3, rtol=1e-9)


def test_uplift_falls_linearly_from_heel_to_toe():
    line = HeadLine((0.0, 0.0), (12.0, 0.0), Scalar(4.0))
    load = WaterPressure("y0", Scalar(16.0), Scalar(GAMMA_W), line)
    points, forces = acting(dam(), load)
    lift = GAMMA_W * (16 + 4) / 2 * 12
    np.testing.assert_allclose(forces.sum(axis=0), [0, lift], atol=1e-9 * lift)
    centre = 12 / 3 * (16 + 2 * 4) / (16 + 4)
    np.testing.assert_allclose(points[:, 0] @ forces[:, 1] / lift, centre, rtol=1e-12)


# Derivatives -------------------------------------------------------------------------------------

VALUES = {
    "level": 13.3, "gamma_w": 9.7e3, "end": 3.2, "table": 9.4, "low": 5.7, "E": 50e6
}  # fmt: skip


def everything():
    def p(name):
        return Scalar(1.0, name)

    mesh = regroup(dam("quad8", 8), core=lambda c: c[:, 1] < 4)
    names = tuple(VALUES)
    line = HeadLine((12.0, 0.0), (12.0, 16.0), p("end"))
    return model(
        mesh,
        parameters=tuple(Parameter(n, VALUES[n], -np.inf, np.inf) for n in names),
        materials={"soil": material("soil", p("E"), 0.3, SATURATED)},
        groups=dict.fromkeys(("core", "rock"), "soil"),
        supports=(Support("y0", (0, 1)),),
        gravity=(0.0, -9.81),
        in_situ=HeimStress(
            K0=Scalar(0.7), unit_weight=Scalar(12e3), surface=Scalar(20.0), held=True
        ),
        water=Water(p("table"), p("gamma_w")),
        stages=(
            Stage("fill", loads={"lake": WaterPressure("x0", p("level"), p("gamma_w"))}),
            Stage("seep", loads={"up": WaterPressure("x1", p("level"), p("gamma_w"), line)}),
            Stage("drain", water=Water(p("low"), Scalar(1.1, "gamma_w"), ("rock",))),
            Stage("empty", remove=("lake",), loads={"q": Pressure("y1", Scalar(1e5))}),
        ),
        channels=(displacement("c", (6.0, 12.0), (0.6, 0.8)),),
    )


def test_every_number_of_the_water_is_differentiated_exactly():
    staged = everything()
    response = staged.response([("c", s) for s in ("fill", "seep", "drain", "empty")])
    assert_exact(response, np.array(list(VALUES.values())), staged.names, step=2e-4)


def filled(weight: Scalar, *parameters: Parameter):
    """A lake whose level is a parameter, against a dam of 16 m."""
    return model(
        dam(),
        parameters=parameters,
        materials={"soil": SOIL},
        groups={"all": "soil"},
        supports=(Support("y0", (0, 1)),),
        stages=(Stage("fill", loads={"lake": WaterPressure("x0", Scalar(1.0, "level"), weight)}),),
        channels=(displacement("c", (6.0, 12.0), (0.6, 0.8)),),
    ).response([("c", "fill")])


def test_a_level_that_crosses_the_face_is_an_obstacle():
    said = "the water ends at the level level, so its pressure is not linear in it"
    response = filled(Scalar(GAMMA_W), Parameter("level", 10.0, 0.0, 20.0))
    assert response.obstacle() == said


def test_a_level_above_the_whole_face_is_none():
    level = Parameter("level", 18.0, 16.5, 30.0)
    response = filled(Scalar(GAMMA_W), level)
    assert response.obstacle() is None
    measured = response.readings(np.array([24.0]))
    condensed = response.condense(np.array([17.0]), measured, np.array([1e-4]))
    np.testing.assert_allclose(condensed.vector / condensed.matrix[:, 0], 24.0, rtol=1e-9)
    both = filled(Scalar(1.0, "gamma_w"), level, Parameter("gamma_w", 9.8e3, 9e3, 11e3))
    assert "contains the product of level and gamma_w" in both.obstacle()
