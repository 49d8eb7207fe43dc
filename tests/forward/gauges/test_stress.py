"""Gauges of stress, pressure and pore pressure: closed forms, exact derivatives, when they read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.force_gauges import gauge
from support.meshes import box, opening, regroup
from support.revolved import revolve, section

from geoident.errors import InputError
from geoident.forward.gauges.stress import principal_values
from geoident.model.actions import Pressure, Traction, Water
from geoident.model.case import Stage, Support
from geoident.model.gauges import Reads
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import MohrCoulomb

ZERO = Scalar(0.0)
NOTHING = np.empty(0)
RADIUS, P0, K = 2.0, 10e6, 0.5


def _constant(*components):
    return ConstantStress(tuple(Scalar(float(c)) for c in components))


def _kirsch(r, t):
    """Stresses xx, yy, xy around a round hole, tension positive (Kirsch 1898; Brady & Brown, 7.2).

    The vertical pressure far away is P0, the horizontal one K P0.
    """
    s, c2, s2 = (RADIUS / r) ** 2, np.cos(2 * t), np.sin(2 * t)
    rr = P0 / 2 * ((1 + K) * (1 - s) - (1 - K) * (1 - 4 * s + 3 * s**2) * c2)
    tt = P0 / 2 * ((1 + K) * (1 + s) + (1 - K) * (1 + 3 * s**2) * c2)
    rt = P0 / 2 * (1 - K) * (1 + 2 * s - 3 * s**2) * s2
    turn = np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]])
    found = -turn @ np.array([[rr, rt], [rt, tt]]) @ turn.T
    return found[0, 0], found[1, 1], found[0, 1]


def _beside_a_hole(kind, n, *channels):
    """What channels read when the hole is opened in stressed rock."""
    reach, nu = 40, 0.25
    layers = int(np.ceil(np.log(reach) / np.log(1 + np.pi / 4 / n))) + 1
    staged = model(
        opening(kind, 2, n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS),
        materials={"rock": material("rock", 1e10, nu)},
        groups={"core": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=_constant(-K * P0, -P0, -nu * (1 + K) * P0, 0, 0, 0),
        stages=(Stage("open", excavate=("core",)),),
        channels=channels,
    )
    return staged.survey(NOTHING, fields=False).computed[:, 0]


@pytest.mark.parametrize(("kind", "n", "largest"), [("quad8", 4, 0.06), ("quad8", 8, 0.012),
                                                    ("tri3", 10, 0.05)])  # fmt: skip
def test_overcoring_beside_a_hole_reads_kirschs_stresses(kind, n, largest):
    places = [(2.6, 0.3), (3.1, 0.8), (4.0, 1.3), (6.0, 0.1)]
    channels = [
        gauge("stress", f"{k}.{c}", (r * np.cos(t), r * np.sin(t)), c)
        for k, (r, t) in enumerate(places)
        for c in ("xx", "yy", "xy")
    ]
    found = _beside_a_hole(kind, n, *channels).reshape(-1, 3)
    exact = [_kirsch(r, t) for r, t in places]
    np.testing.assert_allclose(found, exact, atol=largest * P0)


def test_a_flat_jack_in_the_wall_reads_the_hoop_stress(verification):
    """3 K P0 - P0 and 3 P0 - K P0 of compression at crown and spring line."""
    jacks = [
        gauge("stress", "crown", (0.0, RADIUS), direction=(1.0, 0.0), compression=True),
        gauge("stress", "side", (RADIUS, 0.0), direction=(0.0, 1.0), compression=True),
    ]
    crown, side = _beside_a_hole("quad8", 12, *jacks)
    exact = [(3 * K - 1) * P0, (3 - K) * P0]
    assert crown == pytest.approx(exact[0], rel=0.03)
    assert side == pytest.approx(exact[1], rel=0.02)
    verification("flat-jack", "", ["crown", "spring line"], exact=exact, found=[crown, side])


WEIGHT, GAMMA_W = 20e3, 10e3


def _in_water(*channels, level=4.0, **changes):
    """Soil of 20 kN/m3 up to y = 4 m, full of water to a level; its top is dug off."""
    water = Water(Scalar(1.0, "level"), Scalar(GAMMA_W))
    skeleton = HeimStress(Scalar(0.5), unit_weight=Scalar(WEIGHT - GAMMA_W), surface=Scalar(4.0))
    mesh = regroup(box("quad8", (4, 4), size=(4.0, 4.0)), top=lambda x: x[:, 1] > 3.0)
    settings = {
        "parameters": (Parameter("level", level, -10.0, 10.0),),
        "materials": {"soil": material("soil", 1e8, 0.3, WEIGHT / 10.0)},
        "gravity": (0.0, -10.0),
        "groups": {"rock": "soil", "top": "soil"},
        "supports": (Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        "in_situ": skeleton,
        "water": water,
        "stages": (Stage("dig", excavate=("top",)), Stage("rest")),
        "channels": channels,
    }
    return model(mesh, **{**settings, **changes})


PLACE = (1.3, 1.7)
LEVEL = np.array([4.0])


def test_stress_is_of_skeleton_and_water_together_unless_the_skeleton_is_asked_for():
    staged = _in_water(
        gauge("stress", "total", PLACE, "yy", reads=Reads.VIRGIN),
        gauge("stress", "skeleton", PLACE, "yy", reads=Reads.VIRGIN, effective=True),
        gauge("pressure-cell", "cell", PLACE, direction=(0.6, 0.8), compression=True),
        gauge("piezometer", "water", PLACE),
        gauge("stress", "shear", PLACE, "xy", reads=Reads.VIRGIN),
    )
    found = staged.survey(LEVEL, fields=False)
    total, skeleton, cell, water, shear = found.computed[:, 0]
    depth = 4.0 - PLACE[1]
    assert total == pytest.approx(-WEIGHT * depth, rel=1e-9)
    assert skeleton == pytest.approx(-(WEIGHT - GAMMA_W) * depth, rel=1e-9)
    assert water == pytest.approx(GAMMA_W * depth, rel=1e-12)
    assert abs(shear) < 1e-6 * WEIGHT
    # n . S n of horizontal and vertical pressures after one metre was dug off
    dug = _in_water(
        gauge("stress", "x", PLACE, "xx"), gauge("stress", "y", PLACE, "yy"),
        gauge("stress", "xy", PLACE, "xy"),
    )  # fmt: skip
    x, y, xy = dug.survey(LEVEL, fields=False).computed[:, 0]
    assert y == pytest.approx(-WEIGHT * depth + WEIGHT, rel=1e-6)
    assert cell == pytest.approx(-(0.36 * x + 0.64 * y + 0.96 * xy), rel=1e-12)


def test_a_value_of_the_virgin_state_is_read_whenever_it_is():
    staged = _in_water(
        gauge("stress", "v", PLACE, "yy", reads=Reads.VIRGIN),
        gauge("stress", "gone", (1.3, 3.6), "xx", reads=Reads.VIRGIN),
        gauge("stress", "now", PLACE, "yy"),
        gauge("stress", "since", PLACE, "yy", zero="virgin"),
        gauge("stress", "top", (1.3, 3.6), "xx"),
    )
    found = staged.survey(LEVEL, fields=False).computed
    assert found[0, 0] == found[0, 1]
    assert np.isfinite(found[1]).all()
    np.testing.assert_allclose(found[3], found[2] - found[0], rtol=1e-12)
    assert np.isnan(found[4]).all()
    assert staged.unreadable("top", "dig") == "the ground at its point is not there then"
    assert staged.unreadable("top", "virgin") is None


def test_a_level_of_water_that_is_a_parameter_is_differentiated():
    staged = _in_water(
        gauge("piezometer", "p", PLACE),
        gauge("stress", "t", PLACE, "yy"),
        gauge("pressure-cell", "c", (2.6, 0.4), direction=(1.0, 0.0), compression=True),
        level=3.3,
    )
    pairs = [(name, stage) for name in ("p", "t", "c") for stage in ("dig", "rest")]
    response = staged.response(pairs)
    assert_exact(response, np.array([3.3]), ("level",))
    assert response.evaluate(np.array([3.3]))[1][0, 0] == pytest.approx(GAMMA_W)


def test_a_piezometer_where_no_water_is_is_a_fault():
    wet = Water(Scalar(4.0), Scalar(GAMMA_W), groups=("top",))
    with pytest.raises(InputError) as error:
        _in_water(gauge("piezometer", "p", PLACE), water=wet, parameters=())
    (fault,) = error.value.faults
    assert fault.code == "no-water-there"
    assert fault.message == (
        "gauge 'p' reads the pressure of the water in the pores at (1.3, 1.7) m, but the case has "
        "such water only in 'top'"
    )


def test_a_gauge_of_stress_outside_the_mesh_is_a_fault():
    with pytest.raises(InputError) as error:
        _in_water(gauge("stress", "s", (9.0, 1.0), "xx"))
    (fault,) = error.value.faults
    assert fault.code == "gauge-outside"


COMPONENTS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}


def _tensor(*components):
    xx, yy, zz, xy, yz, xz = components
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_every_quantity_of_a_stress_is_that_of_its_tensor():
    stress = 1e6 * np.array([-9.0, -4.0, -6.0, 1.5, -0.8, 2.1])
    n, point = np.array([0.36, 0.48, 0.8]), (0.3, 0.6, 0.2)
    principal = ("major", "intermediate", "minor", "plane-major", "plane-minor")
    channels = [
        *(gauge("stress", name, point, name, reads=Reads.VIRGIN) for name in COMPONENTS),
        *(gauge("stress", name, point, name, reads=Reads.VIRGIN) for name in principal),
        *(gauge("stress", f"pressed {name}", point, name, reads=Reads.VIRGIN, compression=True)
          for name in ("xy", "minor")),
        gauge("stress", "n", point, direction=tuple(n), reads=Reads.VIRGIN),
    ]  # fmt: skip
    staged = model(
        box("hex8", (2, 2, 2)),
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=rollers(3),
        in_situ=_constant(*stress),
        stages=(Stage("wait"),),
        channels=tuple(channels),
    )
    S = _tensor(*stress)
    major, middle, minor = np.linalg.eigvalsh(S)
    flat = np.linalg.eigvalsh(S[:2, :2])
    exact = [*stress, major, middle, minor, *flat, -stress[3], -minor, n @ S @ n]
    np.testing.assert_allclose(staged.survey(NOTHING, fields=False).computed[:, 0], exact)


def test_across_the_axis_of_revolution_a_stress_is_mirrored():
    normal = {"a": (0.6, 0.8), "b": (-0.6, 0.8)}
    channels = [
        *(
            gauge("stress", f"{x} {q}", (x, 0.9), q)
            for x in (2.1, -2.1)
            for q in ("xx", "zz", "xy")
        ),
        gauge("pressure-cell", "here", (2.1, 0.9), direction=normal["a"]),
        gauge("pressure-cell", "there", (-2.1, 0.9), direction=normal["b"]),
    ]
    staged = revolve(
        section("quad8", (4, 3), (3.0, 2.0), inner=0.5),
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=(Support("x0", (0,)), Support("y0", (0, 1))),
        stages=(Stage("load", loads={"q": Pressure("x1", Scalar(3e5))}),),
        channels=tuple(channels),
    )
    found = staged.survey(NOTHING, fields=False).computed[:, 0]
    np.testing.assert_allclose(found[3:6], found[:3] * [1, 1, -1], rtol=1e-12)
    assert found[7] == pytest.approx(found[6], rel=1e-12)
    assert abs(found[2]) > 1e3


def test_principal_values_and_their_derivatives():
    """Where some coincide they part as the parameter grows."""
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    slope = _tensor(1, 2, -1, 0.5, 0.2, -0.7)
    for values in ([-3.0, 0.5, 1.0], [-3.0, -3.0, 1.0], [-3.0, 1.0, 1.0], [2.0, 2.0, 2.0]):
        base = turn @ np.diag(values) @ turn.T
        found, equal = principal_values(np.stack([base, slope], axis=2))
        assert equal.tolist() == [values.count(v) > 1 for v in values]
        np.testing.assert_allclose(found[:, 0], values, atol=1e-12)
        later = np.linalg.eigvalsh(base + 1e-7 * slope)
        np.testing.assert_allclose(found[:, 1], (later - found[:, 0]) / 1e-7, atol=1e-5)
    for apart, same in ((0.9e-9, True), (1.1e-9, False)):  # of the largest of them
        _, equal = principal_values(np.diag([-5.0, 1.0, 1.0 + 5.0 * apart])[:, :, None])
        assert equal.any() == same


VALUES = {"E": 5e9, "nu": 0.28, "v": 8e6, "K0": 0.6, "c": 2.6e6}
QUANTITIES = ("xx", "zz", "xy", "major", "intermediate", "minor", "plane-major", "plane-minor")


@pytest.mark.parametrize(
    ("analysis", "yields"),
    [("plane", False), ("plane", True), ("axisymmetric", False), ("axisymmetric", True),
     ("solid", False)],
)  # fmt: skip
def test_stresses_are_differentiated_exactly(analysis, yields):
    values = VALUES | ({"c": 1.5e6} if analysis == "axisymmetric" else {})
    # Where ground yields, equilibrium to 1e-11 leaves too little of the weak effect of E and nu.
    names = ("v", "K0", "c") if yields else ("E", "nu", "v", "K0")
    number = {n: Scalar(1.0, n) if n in names else Scalar(v) for n, v in values.items()}
    if analysis == "axisymmetric":
        mesh = section("quad8", (4, 3), (3.0, 2.0), inner=0.5)
        build = revolve
    else:
        dim = 3 if analysis == "solid" else 2
        mesh = box("hex8" if dim == 3 else "quad8", (3,) * dim, size=(3.0,) * dim)
        build = model
    mesh = regroup(
        mesh, core=lambda x: (x[:, 0] < 1.5) & (x[:, -1] > 1.0), base=lambda x: x[:, -1] < 0.9
    )
    place = (2.1, 0.7, 0.8)[: mesh.dim]
    rock = material("rock", number["E"], number["nu"])
    if yields:
        surface = MohrCoulomb(cohesion=number["c"], friction=Scalar(0.5), planes=8)
        rock = replace(rock, yields=(surface,))
    channels = [gauge("stress", q, place, q) for q in QUANTITIES]
    normal = (0.6, 0.8, 0.0)[: mesh.dim]
    channels.append(gauge("pressure-cell", "cell", place, direction=normal, compression=True))
    staged = build(
        mesh,
        parameters=tuple(Parameter(n, values[n], *sorted((values[n] / 2, values[n] * 2)))
                         for n in names),
        materials={"rock": rock, "hard": material("hard", 2e10, 0.2)},
        groups={"rock": "rock", "core": "rock", "base": "hard"},
        supports=(Support("x0", (0,)), Support("y0", tuple(range(mesh.dim)))),
        in_situ=HeimStress(number["K0"], vertical=number["v"]),
        stages=(Stage("dig", excavate=("core",)),
                Stage("load", loads={"q": Pressure("x1", Scalar(3e5))})),
        channels=tuple(channels),
    )  # fmt: skip
    p = np.array([values[n] for n in names])
    response = staged.response([(c.name, s) for c in channels for s in ("dig", "load")])
    if yields:
        assert any(end.yielded.any() for end in staged.at(p).states())
    assert_exact(response, p, names, step=2e-4 if yields else 2e-3)
    assert "something else" in response.obstacle()
    reason = "rock yields" if yields else "a channel reads a principal stress"
    assert response.adjoints.obstacle == reason


def test_equal_principal_values_of_states_that_are_not_read_are_not_said():
    """Pressed along x the horizontal stress grows to the vertical one; in situ it was less."""
    now, before = (
        gauge("stress", name, (0.4, 0.4), "major", reads=reads)
        for name, reads in (("now", Reads.VALUE), ("before", Reads.VIRGIN))
    )
    staged = model(
        box("quad4", (3, 3)),
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=rollers(2),
        in_situ=_constant(-1e6, -2e6, -1.5e6, 0, 0, 0),
        stages=(Stage("press", loads={"q": Pressure("x1", Scalar(1e6))}),),
        channels=(now, before),
    )
    (note,) = staged.survey(NOTHING, fields=False).notes
    assert note.startswith("gauge 'now' reads one of several equal principal stresses at 'press'")


def test_equal_principal_values_are_said():
    staged = model(
        box("quad4", (3, 3)),
        parameters=(Parameter("K0", 1.0, 0.2, 4.0),),
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=rollers(2),
        in_situ=HeimStress(Scalar(1.0, "K0"), vertical=Scalar(1e6), K0_across=Scalar(0.7)),
        stages=(Stage("load", loads={"t": Traction("x1", (ZERO, Scalar(1e4)))}),),
        channels=(
            gauge("stress", "one", (0.4, 0.4), "major", reads=Reads.VIRGIN),
            gauge("stress", "xx", (0.4, 0.4), "xx", reads=Reads.VIRGIN),
            displacement("u", (0.5, 0.5), (1.0, 0.0)),
        ),
    )
    said = staged.survey(np.array([1.0]), fields=False).notes
    assert any("'one' reads one of several equal principal stresses" in note for note in said)
    apart = staged.survey(np.array([1.3]), fields=False).notes
    assert not any("principal" in note for note in apart)
