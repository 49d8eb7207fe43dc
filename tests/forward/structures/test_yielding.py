"""Structures that yield: plastic hinges, limits of bars and rings against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.errors import CollapseError
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Anchors, Beam, Bolts, SectionLimits, Struts
from tests.support.cases import displacement, material, model, rollers
from tests.support.derivatives import assert_exact, assert_slopes
from tests.support.meshes import box, regroup
from tests.support.tunnels import walled
from tests.support.yielding import mohr, rock

ZERO, NOTHING = Scalar(0.0), np.empty(0)
LENGTH, M_P = 8.0, 150e3
EA, EI = 4e9, 3e7
N_BEAM = 16
HINGES = SectionLimits(M=Scalar(M_P))


def _beam_on_air(ends, *loads, limits=HINGES, n=N_BEAM, **changes):
    """A beam on a layer without strength or stiffness to speak of, loaded stage by stage."""
    mesh = box("quad4", (n, 1), size=(LENGTH, 0.5))
    held = {"fixed": ("x0", "x1"), "propped": ("x0",)}[ends]
    beam = Beam("y1", EA=Scalar(EA), EI=Scalar(EI), clamped_on=held, limits=limits)
    stages = [Stage("build", build=("beam",))]
    for number, load in enumerate(loads):
        remove = (f"p{number - 1}",) if number else ()
        down = Traction("y1", (ZERO, Scalar(-load)))
        stages.append(Stage(f"load {number}", loads={f"p{number}": down}, remove=remove))
    settings = {
        "materials": {"air": material("air", 1.0, 0.0)},
        "groups": {"all": "air"},
        "supports": (Support("x0", (0, 1)), Support("x1", (0, 1))),
        "structures": {"beam": beam},
        "stages": tuple(stages),
    }
    return model(mesh, **{**settings, **changes})


def _sag(staged, p=()):
    survey = staged.survey(np.array(p), fields=True)
    middle = np.argmin(np.abs(staged.mesh.points - [LENGTH / 2, 0.5]).sum(axis=1))
    return -survey.fields.displacement[:, middle, 1], survey


@pytest.mark.parametrize("ends", [pytest.param("fixed", marks=pytest.mark.slow), "propped"])
def test_beam_collapses_at_the_load_of_its_mechanism(ends):
    """p = 16 M_p / L^2 of a fixed beam; of a propped cantilever with a hinge at c from its prop

    2 M_p (1 + c / L) / (c (L - c)), which is least, 11.66 M_p / L^2, at c = 0.414 L.
    """
    n = N_BEAM if ends == "fixed" else 12  # 5 / 12 is near that
    c = np.arange(1, n) / n
    limit = (2 * (1 + c) / (c * (1 - c))).min() if ends == "propped" else 16.0
    assert ends == "fixed" or limit == pytest.approx(6 + 4 * np.sqrt(2), rel=1e-4)
    limit *= M_P / LENGTH**2
    _sag(_beam_on_air(ends, 0.999 * limit, n=n))
    with pytest.raises(CollapseError, match="'beam' cannot carry the loads: plastic collapse") as e:
        _sag(_beam_on_air(ends, 1.001 * limit, n=n))
    assert e.value.fraction == pytest.approx(1 / 1.001, rel=1e-3)


def test_hinges_of_a_fixed_beam_form_one_after_the_other():
    """Fixed up to 12 M_p / L^2, then as on simple supports for what is added.

    Nodal loads p h: the moments of fixed ends and the sags are those of a beam with such loads.
    """
    first = 12.0 * M_P / LENGTH**2 / (1 - 1 / N_BEAM**2)
    loads = [0.6 * first, first, 1.15 * first]
    sag, survey = _sag(_beam_on_air("fixed", *loads))
    fixed, simple = LENGTH**4 / (384 * EI), 5 * LENGTH**4 / (384 * EI)
    expected = np.array([0.6 * first, first, first]) * fixed
    expected[2] += 0.15 * first * simple
    np.testing.assert_allclose(sag[2:], expected, rtol=0.005)
    moment, x = survey.members.moment, survey.members.ends[..., 0]
    for end in (0.0, LENGTH):
        at_end = np.abs(moment[x == end])[0, 1:]
        np.testing.assert_allclose(at_end, [0.6 * M_P, M_P, M_P], rtol=1e-6)
    assert np.abs(moment[..., 1:]).max() <= M_P * (1 + 1e-9)
    used = survey.members.utilisation.max(axis=0)
    np.testing.assert_allclose(used[1:], [0.6, 1.0, 1.0], rtol=1e-6)


SECTION = {"compressive_strength": Scalar(20e6), "tensile_strength": Scalar(4e6)}


@pytest.mark.parametrize(
    ("limits", "N", "M"),
    [
        (SectionLimits(Scalar(1e6), Scalar(M_P)), -0.5e6, 0.75 * M_P),
        pytest.param(
            SectionLimits(Scalar(1e6), Scalar(M_P)), 0.75e6, 0.4375 * M_P, marks=pytest.mark.slow
        ),
        (SectionLimits(Scalar(1e6), Scalar(M_P), "linear"), -0.6e6, 0.4 * M_P),
        (SectionLimits(Scalar(1e6), Scalar(M_P), "none"), -0.6e6, M_P),
        # blocks of 20 MPa on c = 0.1 m and of 4 MPa on the other 0.1 m
        (SectionLimits(**SECTION), 4e6 * 0.1 - 20e6 * 0.1, 24e6 * 0.1 * 0.1 / 2),
    ],
)
def test_axial_force_takes_its_part_of_the_section(limits, N, M):
    """A jack holds N while the load of the mechanism 16 M / L^2 is approached."""
    beam = Beam("y1", E=Scalar(2e10), thickness=Scalar(0.2), clamped_on=("x0", "x1"), limits=limits)
    ends = (((LENGTH, 0.5), (LENGTH + 1.0, 0.5)),)
    jack = Struts(ends, Scalar(1.0), EA=Scalar(1e9), second_end="fixed")

    def at(load):
        down = Traction("y1", (ZERO, Scalar(-load)))
        force = {"jack": Scalar(abs(N))}
        stages = (
            Stage("build", build=("beam", "jack"), prestress=force),
            Stage("load", loads={"p": down}, prestress=force),
        )
        bars = jack if N < 0 else Bolts(ends, Scalar(1.0), EA=Scalar(1e9), second_end="fixed")
        return _beam_on_air(
            "fixed",
            structures={"beam": beam, "jack": bars},
            stages=stages,
            supports=(Support("x0", (0, 1)), Support("x1", (1,))),
        ).survey(NOTHING, fields=False)

    limit = 16.0 * M / LENGTH**2
    forces = at(0.998 * limit).members
    np.testing.assert_allclose(forces.axial[:N_BEAM, 1], N, rtol=1e-6)
    with pytest.raises(CollapseError):
        at(1.002 * limit)


FORCE, EA_BAR, SPACING, BAR, E = 60e3, 6e7, 3.0, 1.5, 1e8


def _wall(bars, *pushes, dim=2, **changes):
    """A square metre of ground that is held at x = 0 and does not widen, two bars at x = 1."""
    mesh = box("quad4", (1, 1))
    stages = [Stage("build", build=("bars",))]
    for number, push in enumerate(pushes):
        load = {f"p{number}": Traction("x1", (Scalar(push), ZERO))}
        remove = (f"p{number - 1}",) if number else ()
        stages.append(Stage(f"push {number}", loads=load, remove=remove))
    settings = {
        "materials": {"rock": material("rock", E, 0.0)},
        "groups": {"all": "rock"},
        "supports": rollers(2),
        "structures": {"bars": bars},
        "stages": tuple(stages),
    }
    return model(mesh, **{**settings, **changes})


PAIR = (((1.0, 0.0), (1.0 + BAR, 0.0)), ((1.0, 1.0), (1.0 + BAR, 1.0)))


def test_struts_bear_their_capacity_and_no_more():
    """A spring E with 2 EA / (L s), then the ground alone; unloaded, a motion and forces stay."""
    struts = Struts(
        PAIR, Scalar(SPACING), EA=Scalar(EA_BAR), second_end="fixed", capacity=Scalar(FORCE)
    )
    spring = 2 * EA_BAR / BAR / SPACING
    pushes = [1e5, 2e5, 0.0]
    survey = _wall(struts, *pushes).survey(NOTHING, fields=True)
    bears = 2 * FORCE / SPACING
    first = pushes[0] / (E + spring)
    assert spring * first < bears
    flows = (pushes[1] - bears) / E
    back = flows - pushes[1] / (E + spring)
    left = bears - spring * pushes[1] / (E + spring)
    moved = survey.fields.displacement[2:, -1, 0]
    np.testing.assert_allclose(moved, [first, flows, back], rtol=1e-9)
    forces = -survey.members.axial[:, 1:] * 2 / SPACING
    np.testing.assert_allclose(forces, [[spring * first, bears, left]] * 2, rtol=1e-9)


def _wedged(**changes):
    """Struts that only press, jacked to 30 kN."""
    given = {"EA": Scalar(EA_BAR), "prestress": Scalar(30e3), **changes}
    return Struts(PAIR, Scalar(SPACING), second_end="fixed", compression_only=True, **given)


def test_a_wedged_strut_keeps_its_gap_and_presses_again():
    """The wall is a spring E, the struts are another one k as far as they touch it.

    Jacked by P they press it back to u_0 = -P / E, and leave it where u < u_0 - P / k: there they
    touch it again, however often.
    """
    q = np.array([1e5, -3e5, -1e5, 2e5, -5e5, 1e5])
    survey = _wall(_wedged(), *q).survey(NOTHING, fields=True)
    P, spring = 2 * 30e3 / SPACING, 2 * EA_BAR / BAR / SPACING
    touches = q / E > -P / E - P / spring
    assert touches.tolist() == [True, False, False, True, False, True]
    u = np.where(touches, (q - P - spring * P / E) / (E + spring), q / E)
    np.testing.assert_allclose(survey.fields.displacement[2:, -1, 0], u, rtol=1e-9)
    force = np.where(touches, P + spring * (u + P / E), 0.0)
    found = -survey.members.axial[:, 1:] * 2 / SPACING
    np.testing.assert_allclose(found, [force] * 2, rtol=1e-9, atol=1e-5)


def test_a_wedged_strut_is_squashed_and_a_jack_closes_its_gap():
    """What it was squashed by opens sooner; jacked anew it presses with that force at once."""
    stages = [Stage("build", build=("bars",))]
    for name, push, more in (
        ("squash", 3e5, {}), ("open", -1e5, {}), ("touch", 2e5, {}), ("open again", 0.0, {}),
        ("jack", 0.0, {"prestress": {"bars": Scalar(20e3)}}), ("press", 1e5, {}),
    ):  # fmt: skip
        stages.append(Stage(name, loads={"p": Traction("x1", (Scalar(push), ZERO))}, **more))
    staged = _wall(_wedged(capacity=Scalar(FORCE)), stages=tuple(stages))
    survey = staged.survey(NOTHING, fields=True)
    spring, bears, jack = (2 * x / SPACING for x in (EA_BAR / BAR, FORCE, 20e3))
    squashed = (3e5 - bears) / E
    touches = squashed - bears / spring
    again = (2e5 + spring * touches) / (E + spring)
    pressed = -jack / E + 1e5 / (E + spring)
    u = [squashed, -1e-3, again, 0.0, -jack / E, pressed]
    assert 0.0 < touches < again
    moved = survey.fields.displacement[2:, -1, 0]
    np.testing.assert_allclose(moved, u, rtol=1e-9, atol=1e-15)
    force = [bears, 0.0, spring * (again - touches), 0.0, jack, jack + spring * (pressed - u[4])]
    found = -survey.members.axial[0, 1:] * 2 / SPACING
    np.testing.assert_allclose(found, force, rtol=1e-9, atol=1e-5)


def test_derivatives_of_a_wedged_strut_that_opens_and_closes():
    values = {"E": E, "EA": EA_BAR, "P": 30e3}
    staged = _wall(
        _wedged(EA=_tied("EA"), prestress=_tied("P")), 1e5, -3e5, 2e5,
        parameters=tuple(Parameter(n, x, 0.5 * x, 2 * x) for n, x in values.items()),
        materials={"rock": rock(_tied("E"), 0.0)},
        channels=(displacement("u", (1.0, 1.0), (1.0, 0.0)),),
    )  # fmt: skip
    pairs = [("u", f"push {n}") for n in range(3)]
    assert_exact(staged.response(pairs), np.array(list(values.values())), tuple(values))


def test_prestressed_anchors_yield_at_what_is_left_of_their_capacity():
    """Locked off at P, they take the rest of the capacity and then nothing more."""
    anchors = Anchors(
        (((1.0, 0.5), (3.0, 0.5)),),
        Scalar(SPACING),
        EA=Scalar(EA_BAR),
        prestress=Scalar(40e3),
        capacity=Scalar(FORCE),
        grouted=1.0,
    )
    mesh = regroup(box("quad4", (6, 2), size=(3.0, 1.0)), ground=lambda c: c[:, 0] > 1)
    stages = [Stage("build", build=("bars",))]
    for number, pull in enumerate((5e3, 3e5, 4e5)):
        load = {f"p{number}": Traction("x0", (Scalar(-pull), ZERO))}
        stages.append(Stage(f"pull {number}", loads=load))
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e7, 0.0)},
        groups={"ground": "rock", "rock": "rock"},
        supports=(Support("x1", (0,)), Support("y0", (1,))),
        structures={"bars": anchors},
        stages=tuple(stages),
    )
    forces = staged.survey(NOTHING, fields=False).members.axial[0]
    assert forces[0] == pytest.approx(40e3, rel=1e-12)
    assert 40e3 < forces[1] < FORCE
    np.testing.assert_allclose(forces[2:], FORCE, rtol=1e-9)


@pytest.mark.parametrize("part", [0.3, 0.9])
def test_ring_presses_with_its_strength_at_most(part):
    """Ground u = (p0 - p) R / (2 G), with p = N_p / R of a ring that yields, whatever its EA."""
    radius, p0, nu, modulus = 3.0, 5e6, 0.3, 2e9
    mesh = walled("quad8", n=5, layers=25, radius=radius, reach=40 * radius)
    limit = part * p0 * radius / 3
    lining = Beam(
        "wall", EA=Scalar(4e10), EI=Scalar(3e7), clamped_on=("x0", "y0"),
        limits=SectionLimits(Scalar(limit), Scalar(2e5)),
    )  # fmt: skip
    stress = ConstantStress((*(Scalar(-p0),) * 2, Scalar(-2 * nu * p0), *(ZERO,) * 3))
    survey = model(
        mesh,
        materials={"rock": material("rock", modulus, nu)},
        groups={"core": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=stress,
        structures={"lining": lining},
        stages=(Stage("open", excavate=("core",), build=("lining",)),),
    ).survey(NOTHING, fields=True)
    wall = np.unique(mesh.facets[-1].nodes)
    inwards = -np.sum(survey.fields.displacement[1, wall] * mesh.points[wall] / radius, axis=1)
    G = modulus / 2 / (1 + nu)
    np.testing.assert_allclose(inwards, (p0 - limit / radius) * radius / 2 / G, rtol=0.01)
    np.testing.assert_allclose(survey.members.axial[:, 0], -limit, rtol=0.01)


def test_limits_that_are_not_reached_change_nothing():
    loads = [1e3, 2e3]
    yielding = _beam_on_air("fixed", *loads, limits=SectionLimits(Scalar(1e6), Scalar(M_P)))
    elastic = _beam_on_air("fixed", *loads, limits=None)
    one, other = (_sag(staged)[1] for staged in (yielding, elastic))
    np.testing.assert_allclose(one.members.moment, other.members.moment, rtol=1e-6, atol=1e-3)
    size = np.abs(other.fields.displacement).max()
    np.testing.assert_allclose(
        one.fields.displacement, other.fields.displacement, rtol=0.0, atol=1e-7 * size
    )


def _tied(name, factor=1.0):
    return Scalar(factor, name)


VALUES = {
    "E": 3e7, "E_b": 2e10, "t": 0.25, "f_c": 8e6, "f_t": 2e6, "F": 60e3, "d": 0.01, "q": 3e5,
    "c": 30e3, "N": 4e5, "M": 6e4,
}  # fmt: skip


def _trench(limits, *yields, **values):
    """Beams on both sides of a strip of soft ground, propped, with loads that make hinges."""
    values = {**VALUES, **values}
    mesh = regroup(box("quad4", (16, 6), size=(8.0, 3.0)), soft=lambda c: abs(c[:, 0] - 4) < 1.5)
    centres = np.concatenate([mesh.points[b.nodes].mean(axis=1) for b in mesh.facets])
    loaded = np.flatnonzero((centres[:, 1] > 2.99) & (abs(centres[:, 0] - 4.6) < 1.0))
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, "load": loaded})
    beam = Beam("y1", E=_tied("E_b"), thickness=_tied("t"), clamped_on=("x0",), limits=limits)
    bars = Bolts(
        (((4.0, 3.0), (4.0, 0.5)), ((6.5, 3.0), (7.0, 0.5))),
        Scalar(1.0), E=Scalar(2e11), diameter=_tied("d"), capacity=_tied("F"),
    )  # fmt: skip
    down = Traction("load", (ZERO, _tied("q", -1.0)))
    more = Traction("load", (_tied("q", 0.2), _tied("q", -1.3)))
    names = tuple(values)
    staged = model(
        mesh,
        parameters=tuple(
            Parameter(name, values[name], 0.5 * values[name], 2 * values[name]) for name in names
        ),
        materials={
            "firm": rock(_tied("E"), 0.3, *yields, name="firm"),
            "soft": material("soft", _tied("E", 0.1), 0.3),
        },
        groups={"soft": "soft", "rock": "firm"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        structures={"beam": beam, "bars": bars},
        stages=(
            Stage("build", build=("beam", "bars")),
            Stage("load", loads={"q": down}),
            Stage("more", loads={"r": more}, remove=("q",)),
            Stage("off", remove=("r",)),
        ),
        channels=(
            displacement("a", (4.0, 3.0), (0.0, 1.0)),
            displacement("b", (2.5, 3.0), (0.0, 1.0)),
            displacement("c", (5.5, 2.0), (1.0, 0.0)),
        ),
    )
    return staged, np.array([values[name] for name in names])


@pytest.mark.parametrize(
    ("limits", "yields", "idle"),
    [
        (
            SectionLimits(compressive_strength=_tied("f_c"), tensile_strength=_tied("f_t")),
            (),
            ("N", "M", "c"),
        ),
        (SectionLimits(_tied("N"), _tied("M")), (), ("f_c", "f_t", "c")),
        pytest.param(
            SectionLimits(_tied("N"), _tied("M"), "linear"),
            (),
            ("f_c", "f_t", "c"),
            marks=pytest.mark.slow,
        ),
        (SectionLimits(M=_tied("M")), (mohr(_tied("c"), 0.4),), ("f_c", "f_t", "N")),
    ],
)
def test_derivatives_by_limits_and_all_else(limits, yields, idle):
    staged, p = _trench(limits, *yields, q=2.7e5 if yields else 3e5)
    response = staged.response([(c, s) for c in "abc" for s in ("load", "more", "off")])
    _, jacobian = response.evaluate(p)
    for name in idle:
        assert not jacobian[:, staged.names.index(name)].any()
    size = np.abs(jacobian * p).max(axis=0)
    acting = [name for name in staged.names if name not in idle]
    for name in acting:
        assert size[staged.names.index(name)] > 1e-5, name
    assert_slopes(response.readings, p, jacobian, staged.names, step=3e-4, rtol=1e-7)
