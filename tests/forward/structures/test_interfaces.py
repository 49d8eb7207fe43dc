"""Interfaces against closed forms, through Python and through a case file; exact derivatives."""

from __future__ import annotations

import json
from dataclasses import replace
from math import cos, cosh, radians, sin, sinh, sqrt, tan, tanh

import numpy as np
import pytest

from geoident.errors import ModelError
from geoident.forward.model import StagedModel
from geoident.model.actions import Traction
from geoident.model.case import Analysis, Stage, Support
from geoident.model.gauges import Channel
from geoident.model.in_situ import ConstantStress, GeostaticStress
from geoident.model.interfaces import Interface
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Scalar
from geoident.report.text.interfaces import interface_table
from tests.support.cases import material, model
from tests.support.commands import run_command
from tests.support.in_stages import write_msh
from tests.support.inner_faces import with_inner_faces
from tests.support.meshes import KINDS, KINDS_2D, box, regroup

NOTHING = np.empty(0)
ZERO = Scalar(0.0)
RIGID = material("stone", 1e16, 0.0)


def on_level(mesh: Mesh, level: float) -> Mesh:
    """The mesh with an inner group of faces ``joint`` at a height, and the group ``low`` below."""
    mesh = with_inner_faces(mesh, joint=lambda x: abs(x[..., -1] - level) < 1e-9)
    return regroup(mesh, low=lambda x: x[:, -1] < level)


def meter(name: str, point: tuple[float, ...], quantity: str, zero: str = "virgin") -> Channel:
    """A channel that reads the opening or the slip of the interface ``joint`` at a point."""
    return Channel(
        name, name, "joint-meter", None, point, (0.0,) * len(point), 1e-5, zero,
        ("gauges", name), quantity=quantity, interface="joint",
    )  # fmt: skip


def pulled(staged) -> np.ndarray:
    """What all channels read at the last stage."""
    return staged.computed(NOTHING)[:, -1]


# --- elastic: what holds, what opens -----------------------------------------------------------


def pulled_apart(kind: str) -> StagedModel:
    """A column with a joint that is pulled; beside that its upper half is dug."""
    dim = 2 if kind in KINDS_2D else 3
    top, base = ("y1", "y0") if dim == 2 else ("z1", "z0")
    load = Traction(top, (*(ZERO,) * (dim - 1), Scalar(2e5)))
    return model(
        on_level(box(kind, (2,) * dim), 0.5),
        materials={"rock": material("rock", 1e9, 0.0)},
        groups={"rock": "rock", "low": "rock"},
        supports=(Support(base, tuple(range(dim))),),
        interfaces={"joint": Interface("joint", Scalar(1e9), Scalar(3e8))},
        stages=(
            Stage("pull", loads={"pull": load}),
            Stage("dig", excavate=("rock",), base="virgin"),
        ),
        channels=(
            meter("middle", (*(0.5,) * (dim - 1), 0.5), "opening"),
            meter("corner", (*(0.1,) * (dim - 1), 0.5), "opening"),
        ),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_column_pulled_apart(kind):
    """t and t / k_n on the whole area, alike in all elements; both halves stretch alike.

    Nothing is said once a side is dug.
    """
    survey = pulled_apart(kind).survey(NOTHING, fields=True)
    np.testing.assert_allclose(survey.computed[:, 0], 2e5 / 1e9, rtol=1e-9)
    fields, states = survey.fields, survey.interfaces
    assert states.areas.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(states.normal_traction[:, 0], 2e5, rtol=1e-9)
    np.testing.assert_allclose(states.opening[:, 0], 2e-4, rtol=1e-9)
    np.testing.assert_allclose(states.slip[:, 0], 0.0, atol=1e-13)
    assert np.isnan(states.normal_traction[:, 1]).all()
    assert [row[:2] for row in interface_table(states).rows] == [["joint", "pull"]]
    above = fields.mesh.points[:, -1] > 0.9
    expected = 2e5 / 1e9 + 2e5 / 1e9  # stretch of a metre, and the opening
    np.testing.assert_allclose(fields.displacement[1][above, -1], expected, rtol=1e-9)


def test_an_end_inside_stays_joined():
    """A node at an end has no copy, and no traction is said there."""
    mesh = box("quad4", (4, 4))
    crack = with_inner_faces(
        mesh, crack=lambda x: (abs(x[..., 1] - 0.5) < 1e-9) & (x[..., 0] < 0.51)
    )
    staged = model(
        crack,
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=(Support("y0", (0, 1)),),
        interfaces={"crack": Interface("crack", Scalar(1e9), Scalar(1e9), friction=Scalar(0.5))},
        stages=(Stage("s", loads={"p": Traction("y1", (ZERO, Scalar(-1e5)))}),),
    )
    assert staged.mesh.n_nodes == mesh.n_nodes + 2
    states = staged.survey(NOTHING, fields=False).interfaces
    end = abs(states.points[:, 0] - 0.5) < 1e-9
    np.testing.assert_array_equal(np.isnan(states.normal_traction[:, 0]), end)
    assert not states.parts.any()


@pytest.mark.parametrize(("kind", "copies"), [("tri3", 11), ("tri6", 19), ("tet10", 171)])
def test_uniform_stress_goes_through_joints_that_cross(kind, copies):
    """Where two interfaces cross a node has three copies; each bears the stress on its face."""
    dim = 2 if kind in KINDS_2D else 3
    mesh = with_inner_faces(
        box(kind, (4,) * dim),
        level=lambda x: abs(x[..., -1] - 0.5) < 1e-9,
        upright=lambda x: abs(x[..., 0] - 0.5) < 1e-9,
    )
    lean = np.eye(dim)
    lean[0, -1], lean[-1, 0] = 0.3, -0.2
    mesh = replace(mesh, points=mesh.points @ lean.T)
    stress = np.array([[-1e6, 2e5, 1e5], [2e5, -3e6, -2e5], [1e5, -2e5, -2e6]])[:dim, :dim]
    loads = {}
    for axis, way in enumerate(np.linalg.inv(lean)):
        pull = stress @ way / np.linalg.norm(way)
        for end, sign in enumerate((-1.0, 1.0)):
            name = f"{'xyz'[axis]}{end}"
            loads[name] = Traction(name, tuple(Scalar(sign * float(part)) for part in pull))
    held = {(0.0,) * dim: tuple(range(dim)), (0.25,): tuple(range(1, dim)), (0.0, 0.25): (2,)}
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e10, 0.2)},
        groups={"all": "rock"},
        supports=tuple(
            Support(f"{n}", ways, at=tuple(lean[:, : len(at)] @ at))
            for n, (at, ways) in enumerate(held.items())
            if max(ways) < dim
        ),
        interfaces={n: Interface(n, Scalar(2e9), Scalar(7e8)) for n in ("level", "upright")},
        stages=(Stage("s", loads=loads),),
    )
    assert staged.mesh.n_nodes == mesh.n_nodes + copies
    states = staged.survey(NOTHING, fields=False).interfaces
    traction = states.normals @ stress
    normal = (traction * states.normals).sum(axis=1)
    shear = np.linalg.norm(traction - normal[:, None] * states.normals, axis=1)
    np.testing.assert_allclose(states.normal_traction[:, 0], normal, rtol=1e-9)
    np.testing.assert_allclose(np.abs(states.shear_traction[:, 0]), shear, rtol=1e-9)


@pytest.mark.parametrize("analysis", list(Analysis))
def test_a_stiff_interface_is_none(analysis):
    """With k growing, displacements are those of the mesh that is not split, in order 1 / k."""
    dim = 3 if analysis is Analysis.SOLID else 2
    mesh = on_level(box({2: "quad8", 3: "hex20"}[dim], (3,) * (dim - 1) + (2,)), 0.5)
    load = (Scalar(1e6), *(ZERO,) * (dim - 2), Scalar(-2e6))
    axis = () if dim == 3 or analysis is Analysis.PLANE_STRAIN else (Support("x0", (0,)),)
    settings = {
        "analysis": analysis,
        "materials": {"rock": material("rock", 1e9, 0.3)},
        "groups": {"rock": "rock", "low": "rock"},
        "supports": (Support("xyz"[dim - 1] + "0", tuple(range(dim))), *axis),
        "stages": (Stage("push", loads={"p": Traction("xyz"[dim - 1] + "1", load)}),),
    }

    def top(k: float | None) -> np.ndarray:
        one = {} if k is None else {"joint": Interface("joint", Scalar(k), Scalar(k))}
        fields = model(mesh, interfaces=one, **settings).survey(NOTHING, fields=True).fields
        above = fields.mesh.points[:, -1] > 0.99
        return fields.displacement[-1][above]

    whole = top(None)
    off = [np.abs(top(k) - whole).max() / np.abs(whole).max() for k in (1e12, 1e14)]
    assert off[0] < 0.01
    assert off[1] < 0.011 * off[0]


# --- pull-out ------------------------------------------------------------------------------------

STRIP, THICK, BOND, PULL = 2.0, 0.01, 1e9, 4e5
MODULUS = 4e11


def bonded_strip(pull: float, **limits):
    """A strip that is bonded to rock, pulled at its right end."""
    mesh = on_level(box("quad4", (60, 2), size=(STRIP, 2 * THICK)), THICK)
    traction = Traction("end", (Scalar(pull / THICK), ZERO))
    ends = abs(mesh.points[:, 0] - STRIP) < 1e-9
    right = mesh.facet_groups["x1"]
    high = [f for f in right if mesh.points[_facet(mesh, f)][:, 1].min() > 0.99 * THICK]
    assert ends.any()
    mesh = replace(mesh, facet_groups=mesh.facet_groups | {"end": np.array(high)})
    return model(
        mesh,
        materials={"strip": material("strip", MODULUS, 0.0), "rock": RIGID},
        groups={"rock": "strip", "low": "rock"},
        supports=(Support("y0", (0, 1)), Support("y1", (1,))),
        interfaces={"joint": Interface("joint", Scalar(1e13), Scalar(BOND), **limits)},
        stages=(Stage("pull", loads={"pull": traction}),),
        channels=tuple(
            meter(f"m{n}", (x, THICK), "slip") for n, x in enumerate((STRIP, STRIP / 2, 0.0))
        ),
    )


def strip(pull: float, **limits) -> np.ndarray:
    """Slips at the loaded end, the middle and the free end of a strip."""
    return -pulled(bonded_strip(pull, **limits))  # seen from below the strip moves to the right


def _facet(mesh: Mesh, facet: int) -> np.ndarray:
    first = 0
    for block in mesh.facets:
        if facet < first + len(block):
            return block.nodes[facet - first]
        first += len(block)
    raise AssertionError


def test_pull_out_of_a_bonded_strip(verification):
    """u = P cosh(lambda x) / (E t lambda sinh(lambda L)), lambda^2 = k_s / (E t)."""
    rate = sqrt(BOND / (MODULUS * THICK))
    x = np.array([STRIP, STRIP / 2, 0.0])
    expected = PULL / (MODULUS * THICK * rate) * np.cosh(rate * x) / sinh(rate * STRIP)
    found = strip(PULL)
    np.testing.assert_allclose(found, expected, rtol=2e-3)
    verification("pull-out", "strip", x, exact=expected, found=found)


def test_pull_out_of_a_strip_that_slips():
    """A bond of limited strength: the loaded part of the length a slides, P = tau a + rest."""
    bond, slid = 1e5, 0.8
    rate, stiff = sqrt(BOND / (MODULUS * THICK)), MODULUS * THICK
    held = bond / rate * tanh(rate * (STRIP - slid))
    pull = held + bond * slid
    found = strip(pull, cohesion=Scalar(bond), friction=ZERO, tensile_strength=Scalar(1e9))
    end = bond / BOND + held * slid / stiff + bond * slid**2 / (2 * stiff)
    free = bond / BOND / cosh(rate * (STRIP - slid))
    np.testing.assert_allclose(found[[0, 2]], [end, free], rtol=3e-3)


# --- a wedge in a roof ---------------------------------------------------------------------------

HALF, HIGH, PRESS = radians(20.0), 2.0, 1e6
K_N, K_S = 4e9, 1e9


def roof(weight: float, friction: float) -> StagedModel:
    """A symmetric wedge of half angle HALF under horizontal stress, both sides stiff."""
    wide = HIGH * tan(HALF)
    points = np.array([[0, 0], [wide, 0], [0, HIGH], [3, 0], [3, 4], [0, 4]], float)
    nodes = np.array([[0, 1, 2], [1, 3, 4], [1, 4, 2], [2, 4, 5]])
    facets = ElementBlock("line2", np.array([[1, 2], [0, 1], [2, 0]]), np.arange(1, 4))
    mesh = Mesh(
        points,
        (ElementBlock("tri3", nodes, np.arange(1, 5)),),
        (facets,),
        {"wedge": np.array([0]), "rock": np.array([1, 2, 3])},
        {"joint": np.array([0]), "below": np.array([1]), "plane": np.array([2])},
        {"far": np.array([3, 4, 5])},
    )
    stress = ConstantStress((Scalar(-PRESS), ZERO, ZERO, ZERO), held=True)
    load = Traction("below", (ZERO, Scalar(-0.5 * weight / wide)))
    return model(
        mesh,
        materials={"stone": RIGID},
        groups={"wedge": "stone", "rock": "stone"},
        supports=(Support("far", (0, 1)), Support("plane", (0,))),
        in_situ=stress,
        imbalance_accepted=True,
        interfaces={
            "joint": Interface("joint", Scalar(K_N), Scalar(K_S), friction=Scalar(friction))
        },
        stages=(Stage("hang", loads={"weight": load}),),
        channels=(meter("slip", (0.5 * wide, 0.5 * HIGH), "slip"),),
    )  # fmt: skip


def held_by_friction(friction: float) -> float:
    """Weight that the wedge bears: 2 p H M.

    M = (k_s cos^2 a + k_n sin^2 a) sin(phi - a) / (k_s cos a cos phi + k_n sin a sin phi): J. W.
    Bray's relaxation in B. H. G. Brady and E. T. Brown, Rock mechanics for underground mining,
    section 8.4.
    """
    stiff = K_S * cos(HALF) ** 2 + K_N * sin(HALF) ** 2
    whole = K_S * cos(HALF) * cos(friction) + K_N * sin(HALF) * sin(friction)
    return 2.0 * PRESS * HIGH * stiff * sin(friction - HALF) / whole


def test_a_wedge_in_a_roof(verification):
    """It sinks elastically up to the weight that it holds, and has no equilibrium beyond."""
    found, exact = [], []
    for friction in map(radians, (25.0, 35.0, 45.0)):
        stiff, held = K_S * cos(HALF) ** 2 + K_N * sin(HALF) ** 2, held_by_friction(friction)
        sunk = 0.5 * 0.99 * held / (HIGH / cos(HALF)) / stiff
        found.append(abs(pulled(roof(0.99 * held, friction))[0]))
        exact.append(sunk * cos(HALF))
        assert np.isnan(pulled(roof(1.01 * held, friction))).all()
    np.testing.assert_allclose(found, exact, rtol=1e-4)
    degrees = np.array([25.0, 35.0, 45.0])
    verification("roof-wedge", "wedge", degrees, exact=np.array(exact), found=np.array(found))


def test_the_width_of_a_slice_does_not_matter():
    """Of a block that slips in parts on its joint: slip times the area of faces is no strain."""
    moved = []
    for wide in (2.0, 20.0):
        mesh = with_inner_faces(
            box("hex8", (2, 1, 3), size=(40.0, wide, 60.0)),
            joint=lambda x: abs(x[..., -1] - 20.0) < 1e-9,
        )
        staged = model(
            regroup(mesh, block=lambda x: x[:, -1] > 20.0),
            materials={"rock": material("rock", 5e9, 0.2, 2400.0)},
            groups={"rock": "rock", "block": "rock"},
            supports=(Support("y0", (1,)), Support("y1", (1,)), Support("z0", (0, 1, 2))),
            gravity=(0.0, 0.0, -9.81),
            in_situ=GeostaticStress(ZERO),
            interfaces={
                "joint": Interface(
                    "joint", Scalar(1e9), Scalar(2e7), friction=Scalar(radians(30.0))
                )
            },
            stages=(Stage("push", loads={"p": Traction("z1", (Scalar(3e5), ZERO, ZERO))}),),
            channels=(meter("slip", (20.0, 1.0, 20.0), "opening"),),
        )
        survey = staged.survey(NOTHING, fields=True)
        slips = survey.interfaces.slips[:, -1]
        assert slips.any()
        assert not slips.all()
        moved.append(survey.fields.displacement[-1])
    np.testing.assert_allclose(moved[1], moved[0], rtol=1e-6, atol=1e-9)


def test_a_joint_that_does_not_bear_the_virgin_stress_is_refused():
    """Its sides are steeper than the friction: it would slip before anything is done."""
    assert np.isfinite(pulled(roof(1.0, HALF + 1e-3))).all()
    with pytest.raises(ModelError, match=r"beyond what the interface 'joint' bears near .* slip"):
        roof(1.0, HALF - 1e-3).survey(NOTHING, fields=False)


# --- a block on a slope, as users write it -------------------------------------------------------

SLOPE = """\
format: geoident-case/1
title: A block on a slope
analysis: plane-strain
mesh: {file: block.msh}
parameters:
  k_s: {start: 0.2 GPa/m, bounds: [0.02 GPa/m, 2 GPa/m], scale: log}
  phi: {start: 40 deg, bounds: [20 deg, 60 deg]}
materials:
  stone: {elastic: isotropic, E: 100000 GPa, nu: 0, density: 2500 kg/m3}
  base: {elastic: isotropic, E: 100000 GPa, nu: 0}
groups: {low: base, rock: absent}
supports: {y0: fixed}
gravity: [GX, -9.81 m/s2]
interfaces:
  joint: {along: joint, k_n: 10 GPa/m, k_s: $k_s, friction: $phi}
stages:
  - {name: placed, install: {rock: stone}}
  - {name: pushed, loads: {push: {on: x0, traction: [PUSH, 0 kPa]}}}
gauges:
  J: {kind: joint-meter, interface: joint, point: [0.5 m, 0.1 m], component: slip, accuracy: 1 um,
      zero: placed}
  D: {kind: joint-meter, interface: joint, point: [0.5 m, 0.1 m], direction: [1, 0],
      towards: [0.5 m, 0.2 m], accuracy: 1 um, zero: placed}
"""


def slope(folder, *, lean: float = 0.0, push: str = "1 kPa", text: str = SLOPE, more: str = ""):
    """A flat block of 1 m by 0.1 m on a rigid base."""
    mesh = on_level(box("quad4", (10, 2), size=(1.0, 0.2)), 0.1)
    write_msh(mesh, folder / "block.msh", ["x0", "y0", "joint"])
    path = folder / "case.yaml"
    text = text.replace("GX", f"{lean:.9g} m/s2" if lean else "0 m/s2").replace("PUSH", push)
    path.write_text(text + more)
    return path


def said(folder, **changes) -> dict[str, dict[str, float]]:
    """Gauge, then stage, to what ``simulate`` reads."""
    ended = run_command("simulate", slope(folder, **changes), "--json")
    assert ended.exit_code == 0, ended.output
    table: dict[str, dict[str, float]] = {}
    for one in json.loads(ended.stdout)["readings"]:
        table.setdefault(one["gauge"], {})[one["stage"]] = one["value"]
    return table


def test_a_sliding_block(tmp_path):
    """It slips elastically by T / k_s, both ways of reading agree, and not at all beyond friction.

    Pushed along the base against its weight G tan(phi).
    """
    read = said(tmp_path, push="10 kPa")
    assert read["J"]["pushed"] == pytest.approx(-10e3 * 0.1 / 0.2e9, rel=1e-4)
    assert read["D"]["pushed"] == pytest.approx(10e3 * 0.1 / 0.2e9, rel=1e-4)
    strength = 2500 * 9.81 * 0.1 * tan(radians(40.0)) / 1e3  # kPa m
    said(tmp_path, push=f"{0.97 * strength / 0.1} kPa")
    ended = run_command("simulate", slope(tmp_path, push=f"{1.03 * strength / 0.1} kPa"))
    assert ended.exit_code == 5, ended.output
    assert "the interface 'joint'" in ended.output


def test_a_block_on_a_slope(tmp_path):
    """It stands up to tan(slope) = tan(phi)."""
    said(tmp_path, lean=9.81 * tan(radians(39.5)), push="0 kPa")
    ended = run_command("simulate", slope(tmp_path, lean=9.81 * tan(radians(40.5)), push="0 kPa"))
    assert ended.exit_code == 5, ended.output
    assert "stage 'placed'" in ended.output
