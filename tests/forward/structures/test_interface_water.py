"""Water in interfaces: uplift under a dam, buoyancy, drawdown; exact derivatives."""

from __future__ import annotations

import json
from dataclasses import replace
from math import radians, tan

import numpy as np
import pytest

from geoident.model.actions import HeadLine, Traction, Water
from geoident.model.case import Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.in_situ import GeostaticStress
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Beam
from tests.forward.structures.test_interfaces import NOTHING, meter, on_level
from tests.support.cases import material, model, rollers
from tests.support.commands import run_command
from tests.support.derivatives import assert_slopes
from tests.support.in_stages import write_msh
from tests.support.meshes import box, regroup

DAM = """\
format: geoident-case/1
title: A dam on its base
analysis: plane-strain
mesh: {file: dam.msh}
materials:
  concrete: {E: 100000 GPa, nu: 0, density: 2400 kg/m3}
  rock: {E: 100000 GPa, nu: 0}
groups: {low: rock, rock: absent}
supports: {y0: fixed}
gravity: 9.81 m/s2
interfaces:
  base: {along: joint, k_n: 10 GPa/m, k_s: 1 GPa/m, friction: 35 deg}
stages:
  - {name: built, install: {rock: concrete}}
  - name: filled
    loads: {lake: {on: upstream, water: {level: 1.1 m}}}
    water: {table: 1.1 m, groups: [WET]FALLS}
gauges:
  J: {kind: joint-meter, interface: base, point: [0.5 m, 0.1 m], component: slip, accuracy: 1 um,
      zero: built}
"""
FALLS = ", falls: {from: [0 m, 0.1 m], to: [1 m, 0.1 m], level: 0.1 m}"


def dam(folder, wet: str, falls: str):
    """Factors of safety of a square dam of 1 m under full water on a plane base."""
    mesh = on_level(box("quad4", (3, 11), size=(1.0, 1.1)), 0.1)
    left = mesh.facet_groups["x0"]
    nodes = np.concatenate([block.nodes for block in mesh.facets])
    high = left[mesh.points[nodes[left]][:, :, 1].min(axis=1) > 0.09]
    mesh = replace(mesh, facet_groups=mesh.facet_groups | {"upstream": high})
    write_msh(mesh, folder / "dam.msh", ["upstream", "y0", "joint"])
    text = DAM.replace("WET", wet).replace("FALLS", falls)
    (folder / "case.yaml").write_text(text)
    return run_command("simulate", folder / "case.yaml", "--safety", "--json")


@pytest.mark.parametrize(
    ("wet", "falls", "uplift", "how"),
    [
        ("low", FALLS, 0.5, "falls to the toe, water in the rock"),
        *(
            pytest.param("base", falls, uplift, how, marks=pytest.mark.slow)
            for falls, uplift, how in (
                (FALLS, 0.5, "falls to the toe, the joint is named"),
                ("", 1.0, "that of the lake up to the toe"),
            )
        ),
    ],
)
def test_a_dam_slides_at_the_friction_that_uplift_leaves_it(
    tmp_path, wet, falls, uplift, how, verification
):
    """F = (W - U) tan(phi) / thrust, whether the rock below has the water or the base is named."""
    exact = (2400 * 9.81 - uplift * 9.81e3) * tan(radians(35.0)) / (9.81e3 / 2)
    ended = dam(tmp_path, wet, falls)
    (one,) = json.loads(ended.stdout)["stages"]
    assert one["factor"] == pytest.approx(exact, rel=0.005)
    verification("dam-joint", f"pressure {how}", ["slides"], exact=exact, found=one["factor"])


GROUND = material("ground", 60e6, 0.3, 2000.0)


def column(k: float | None, **more):
    """A saturated column of two parts on each other, which can only move up and down."""
    joint = {} if k is None else {"joint": Interface("joint", Scalar(k), Scalar(k))}
    settings = {
        "materials": {"ground": GROUND},
        "groups": {"rock": "ground", "low": "ground"},
        "supports": (*rollers(2), Support("x1", (0,))),
        "gravity": (0.0, -9.81),
        "in_situ": GeostaticStress(Scalar(0.5)),
        "water": Water(Scalar(6.0)),
        "interfaces": joint,
        "stages": (Stage("drain", water=Water(Scalar(0.0))),),
    }
    mesh = on_level(box("quad8", (2, 4), size=(2.0, 8.0)), 4.0)
    return model(mesh, **{**settings, **more})


@pytest.mark.parametrize("groups", [None, ("low",), ("rock",), ("joint",)])
def test_the_virgin_state_is_in_balance_and_bears_the_effective_weight(groups):
    """t_n = -(weight above - pressure), whichever side has the water; nothing moves."""
    joints = replace(column(1e9).case.interfaces["joint"])
    staged = column(
        1e9, water=Water(Scalar(6.0), groups=groups), stages=(Stage("nothing"),),
        interfaces={"joint": joints},
    )  # fmt: skip
    assert staged.analysis.virgin(ParameterPoint({}, ()))[1].max() < 1e-12
    states = staged.survey(NOTHING, fields=False).interfaces
    expected = -(2000 * 9.81 * 4.0 - 9.81e3 * 2.0)
    np.testing.assert_allclose(states.normal_traction[:, 0], expected, rtol=1e-9)
    np.testing.assert_allclose(states.opening, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("groups", "wet"),
    [(None, (1, 1)), (("low",), (0, 1)), (("rock",), (1, 0)), (("joint",), (1, 1))],
)
def test_the_virgin_state_is_in_balance_beside_a_beam(groups, wet):
    """On each of its sides the traction is effective where the ground there has the water."""
    staged = column(
        1e9, water=Water(Scalar(6.0), groups=groups), stages=(Stage("nothing", build=("beam",)),),
        structures={"beam": Beam("joint", EA=Scalar(1e9), EI=Scalar(1e6))},
    )  # fmt: skip
    assert staged.contradictions() == []
    assert staged.analysis.virgin(ParameterPoint({}, ()))[1].max() < 1e-12
    states = staged.survey(NOTHING, fields=False).interfaces
    sides = states.normal_traction.reshape(2, -1)  # against the upper part, and the lower one
    expected = -(2000 * 9.81 * 4.0 - 9.81e3 * 2.0 * np.array(wet))
    np.testing.assert_allclose(sides, np.broadcast_to(expected[:, None], sides.shape), rtol=1e-9)
    np.testing.assert_allclose(states.opening, 0.0, atol=1e-12)


def test_a_table_drawn_down_closes_the_joint():
    """The column settles as one without joint, which closes by the pressure that left by k_n."""
    (whole, joined) = (column(k).survey(NOTHING, fields=True) for k in (None, 1e9))
    closed = 9.81e3 * 2.0 / 1e9
    np.testing.assert_allclose(joined.interfaces.opening[:, 0], -closed, rtol=1e-9)
    tops = [
        one.fields.displacement[1][one.fields.mesh.points[:, 1] > 7.9, 1] for one in (whole, joined)
    ]
    np.testing.assert_allclose(tops[1], tops[0] - closed, rtol=1e-9)


STARTS = {"k_n": 5e7, "c": 2e3, "phi": radians(10), "level": 6.2, "end": 3.0, "gamma": 9.9e3}


def test_derivatives_by_strength_and_by_the_water():
    """By the level, where it falls to and the weight of the water while the joint slips."""
    one = {name: Scalar(1.0, name) for name in STARTS}
    mesh = on_level(box("quad8", (4, 4), size=(2.0, 8.0)), 4.0)
    mesh = regroup(mesh, low=lambda x: x[:, 1] < 4.0)
    water = Water(
        one["level"], one["gamma"], ("low",), HeadLine((0.0, 4.0), (2.0, 4.0), one["end"])
    )
    push = Traction("y1", (Scalar(1.2e4), Scalar(-2e4)))
    staged = model(
        mesh,
        materials={"ground": GROUND},
        groups={"rock": "ground", "low": "ground"},
        supports=(Support("y0", (0, 1)),),
        gravity=(0.0, -9.81),
        parameters=tuple(Parameter(n, v, 0.1 * v, 10 * v) for n, v in STARTS.items()),
        interfaces={
            "joint": Interface(
                "joint", one["k_n"], Scalar(2e7), cohesion=one["c"], friction=one["phi"],
                dilation=one["phi"],
            )
        },
        stages=(
            Stage("wet", water=water),
            Stage("push", loads={"p": push}),
        ),
        channels=tuple(
            meter(f"{kind}{x}", (x, 4.0), kind)
            for x in (0.25, 1.75) for kind in ("slip", "opening")
        ),
    )  # fmt: skip
    start = np.array(list(STARTS.values()))
    response = staged.response([(c.name, s) for c in staged.case.channels for s in ("wet", "push")])
    _, jacobian = response.evaluate(start)
    assert (np.abs(jacobian).max(axis=0) > 0).all()
    states = staged.survey(start, fields=False).interfaces
    assert states.slips[:, 1].any() or states.parts[:, 1].any()
    assert_slopes(response.readings, start, jacobian, tuple(STARTS), step=2e-4)
