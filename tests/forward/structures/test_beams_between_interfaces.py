"""Beams on the lines of interfaces: closed forms, what their nodes are, exact derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import cosh, radians, sqrt, tanh

import numpy as np
import pytest

from geoident.errors import InputError
from geoident.model.case import Stage, Support
from geoident.model.in_situ import GeostaticStress
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Beam, Bolts, Struts
from geoident.report.text.interfaces import interface_table
from tests.forward.structures.test_interfaces import meter
from tests.forward.structures.test_structures import NU, P0, RADIUS, E, _lined, _stress, _tunnel
from tests.support.cases import displacement, material, model
from tests.support.derivatives import assert_exact
from tests.support.force_gauges import gauge
from tests.support.inner_faces import with_inner_faces
from tests.support.meshes import box, regroup
from tests.support.slipping_ring import slipping_ring

NOTHING, ZERO = np.empty(0), Scalar(0.0)


@pytest.mark.parametrize(("k_n", "k_s"), [(5e9, 5e8), (1e13, 1e4)])
@pytest.mark.parametrize("along", ["wall", "own"])
def test_a_lining_that_slips(k_n, k_s, along, verification):
    """Springs, and full slip; the interface on the lines of the beam, or on lines of its own."""
    mesh = _tunnel(8)
    if along == "own":
        mesh = with_inner_faces(mesh, own=lambda x: abs(np.linalg.norm(x, axis=-1) - RADIUS) < 1e-6)
    EA, EI = 1.2e9, 4e8
    staged = _lined(
        mesh,
        (Stage("open", excavate=("core",), build=("lining",)),),
        in_situ=_stress(P0, 0.5 * P0),
        lining=Beam("wall", EA=Scalar(EA), EI=Scalar(EI), clamped_on=("x0", "y0")),
        interfaces={"slip": Interface(along, Scalar(k_n), Scalar(k_s))},
    )
    survey = staged.survey(NOTHING, fields=False)
    assert set(survey.interfaces.sides) == {"inside", "outside"}
    found = survey.members
    mean, vary, moment = slipping_ring(0.5, EA, EI, k_n, k_s, p=P0, radius=RADIUS, E=E, nu=NU)
    spring, crown = mean + vary, mean - vary
    order = np.argsort(np.arctan2(found.ends[..., 1], found.ends[..., 0]).mean(axis=1))
    axial, moments = found.axial[order, 0], found.moment[order].mean(axis=1)[:, 0]
    assert axial[[0, -1]] == pytest.approx([spring, crown], rel=0.01)
    assert moments[-1] == pytest.approx(abs(moment), rel=0.02)  # tension on the open side
    if along == "wall":
        variant = (
            "no shear stiffness"
            if k_s < 1e6
            else f"k_n {k_n / 1e9:g} GPa/m, k_s {k_s / 1e9:g} GPa/m"
        )
        places = ["N at the spring line", "N at the crown", "M at the crown"]
        verification(
            "slipping-lining", variant, places,
            exact=[spring, crown, abs(moment)], found=[*axial[[0, -1]], moments[-1]],
        )  # fmt: skip


# --- a strip in rigid rock -----------------------------------------------------------------------

LENGTH, EA, BOND, COHESION = 2.0, 4e9, 5e8, 1e5


def strip(pull: float, **limits) -> np.ndarray:
    """Motion of the loaded and of the free end of a beam that is pulled along its interfaces."""
    mesh = box("quad4", (40, 2), size=(LENGTH, 1.0))
    mesh = with_inner_faces(mesh, strip=lambda x: abs(x[..., 1] - 0.5) < 1e-9)
    ends = {"left": (0.0, 0.5), "right": (LENGTH, 0.5)}
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e16, 0.0)},
        groups={"all": "rock"},
        supports=(Support("y0", (0, 1)), Support("y1", (0, 1))),
        interfaces={"bond": Interface("strip", Scalar(1e12), Scalar(BOND), **limits)},
        structures={
            "strip": Beam("strip", EA=Scalar(EA), EI=Scalar(1e6)),
            "jack": Bolts((((LENGTH, 0.5), (LENGTH + 1.0, 0.5)),), spacing=Scalar(1.0),
                          EA=Scalar(1e9), prestress=Scalar(pull), second_end="fixed"),
        },
        stages=(Stage("built", build=("strip",)), Stage("pull", build=("jack",))),
        channels=tuple(displacement(n, at, (1.0, 0.0), zero="built") for n, at in ends.items()),
    )  # fmt: skip
    return staged.computed(NOTHING)[:, -1]


def test_a_strip_is_pulled_out(verification):
    """Both sides hold it: lambda^2 = 2 k_s / EA; at the limit of both it moves as a whole."""
    pull = 1e5
    lam = sqrt(2 * BOND / EA)
    whole = pull / (EA * lam * tanh(lam * LENGTH))
    exact, found = [whole / cosh(lam * LENGTH), whole], strip(pull)
    np.testing.assert_allclose(found, exact, rtol=1e-3)
    ends = ["free end", "loaded end"]
    verification("pull-out", "beam between two interfaces", ends, exact=exact, found=found)
    limits = {"cohesion": Scalar(COHESION), "friction": ZERO}
    assert strip(0.999 * 2 * COHESION * LENGTH, **limits)[0] < COHESION / BOND * 1.001
    assert np.isnan(strip(1.001 * 2 * COHESION * LENGTH, **limits)).all()


# --- a wall in a pit -----------------------------------------------------------------------------

STARTS = {
    "E": 4e7, "k_n": 2e9, "k_s": 4e7, "c": 3e3, "phi": radians(24), "R": 0.7, "K0": 0.55, "EI": 5e6,
    "P": 2e4,
}  # fmt: skip
AT_STRUT = (4.0, 7.5)


def pit(
    kind="quad8",
    *,
    interface: Interface | None,
    along="slip",
    more=(),
    soil=None,
    low=None,
    numbers=None,
    parts=(1.0,),
    in_situ=None,
    **limits,
):
    """A wall that is braced by a jacked strut, two digs; its interface goes on below its tip.

    Args:
        kind: of the elements.
        interface: None for none.
        along: its group of lines.
        more: channels in place of the usual ones.
        soil: material in place of elastic ground; below the wall it stays so.
        low: material below the wall.
        numbers: starts of further parameters.
        in_situ: in place of a K0.
        parts: of the stress of the second dig that are released, in as many stages.
        limits: of the wall, and `capacity` of the strut.
    """
    starts = STARTS | (numbers or {})
    mesh = with_inner_faces(
        box(kind, (8, 8), size=(8.0, 8.0)),
        wall=lambda x: (abs(x[..., 0] - 4.0) < 1e-9) & (x[..., 1] > 2.9),
        slip=lambda x: (abs(x[..., 0] - 4.0) < 1e-9) & (x[..., 1] > 0.9),
    )
    mesh = regroup(
        mesh,
        one=lambda x: (x[:, 0] < 4.0) & (x[:, 1] > 7.0),
        two=lambda x: (x[:, 0] < 4.0) & (x[:, 1] > 5.0) & (x[:, 1] < 7.0),
        low=lambda x: x[:, 1] < 3.0,
    )
    one = {name: Scalar(1.0, name) for name in STARTS}
    strut = Struts(
        ((AT_STRUT, (0.0, 7.5)),), spacing=Scalar(2.0), EA=Scalar(2e8), prestress=one["P"],
        second_end="symmetry", capacity=limits.pop("capacity", None),
    )  # fmt: skip
    return model(
        mesh,
        materials={
            "stiff": low or material("stiff", one["E"], 0.3, 1900.0),
            "soil": soil or material("soil", one["E"], 0.3, 1900.0),
        },
        groups=dict.fromkeys(("rock", "one", "two"), "soil") | {"low": "stiff"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        gravity=(0.0, -9.81),
        in_situ=in_situ or GeostaticStress(one["K0"]),
        parameters=tuple(Parameter(n, v, 0.1 * v, 10 * v) for n, v in starts.items()),
        interfaces={} if interface is None else {"slip": replace(interface, along=along)},
        structures={"wall": Beam("wall", EA=Scalar(2e9), EI=one["EI"], **limits), "strut": strut},
        stages=(
            Stage("wall", build=("wall",)),
            Stage("dig one", excavate=("one",)),
            Stage("strut", build=("strut",)),
            *(
                Stage(
                    f"dig two {n or ''}".strip(),
                    excavate=("two",) if n == 0 else (),
                    release={"two": Scalar(part)},
                )
                for n, part in enumerate(parts)
            ),
        ),
        channels=more
        or (
            displacement("top", (4.0, 8.0), (-1.0, 0.0), zero="wall"),
            displacement("at strut", AT_STRUT, (-1.0, 0.0), zero="wall"),
            displacement("behind", (5.0, 8.0), (0.0, -1.0), zero="wall"),
            gauge("load-cell", "force", AT_STRUT, dimension="force", structure="strut"),
            gauge(
                "load-cell", "M", (4.0, 5.5), "M", dimension="moment per length", structure="wall"
            ),
        ),
    )


def slips(**limits) -> Interface:
    one = {name: Scalar(1.0, name) for name in STARTS}
    more = {"cohesion": one["c"], "friction": one["phi"], "R_inter": one["R"]} | limits
    return Interface("slip", one["k_n"], one["k_s"], **more)


def test_a_wall_between_stiff_interfaces_is_joined_to_the_ground():
    """Motions, strut force and moment of the wall whose nodes are the ground's, in order 1 / k."""
    start = np.array(list(STARTS.values()))
    joined = pit(interface=None).computed(start)
    rigid = [Interface("slip", Scalar(k), Scalar(k)) for k in (1e12, 1e14)]
    for along in ("slip", "wall"):
        found = [pit(interface=one, along=along).computed(start) for one in rigid]
        size = np.nanmax(np.abs(joined), axis=1, keepdims=True)
        off = [np.nanmax(np.abs(one - joined) / size) for one in found]
        assert off[0] < 0.01
        assert off[1] < 0.02 * off[0]


def test_each_side_of_a_wall_has_its_own_rows():
    """Ground that is dug leaves those of its side; below the tip both sides are ground."""
    start = np.array(list(STARTS.values()))
    states = pit(interface=slips()).survey(start, fields=False).interfaces
    assert set(states.lines) == {("slip", "-x"), ("slip", "+x"), ("slip", "")}
    for side, stands in (("-x", False), ("+x", True)):
        own = states.of("slip", side)
        high = own[states.points[own, 1] > 5.1]
        assert len(high)
        assert (np.isfinite(states.normal_traction[high, -1]) == stands).all()
    assert states.points[states.of("slip", ""), 1].max() < 3.1
    named = {row[0] for row in interface_table(states).rows}
    assert named == {"slip, ground towards -x", "slip, ground towards +x", "slip"}


def test_a_dig_beside_a_wall_that_stays_is_released_in_parts():
    """With none released nothing moves, with half of it half, in the end as by one dig."""
    start = np.array(list(STARTS.values()))
    elastic = Interface("slip", Scalar(2e9), Scalar(4e7))
    for along in ("slip", "wall"):
        whole = pit(interface=elastic, along=along).computed(start)[:, -2:]
        parts = pit(interface=elastic, along=along, parts=(0.0, 0.5, 1.0)).computed(start)[:, -4:]
        change = whole[:, 1] - whole[:, 0]
        size = 1e-8 * np.abs(whole).max(axis=1)
        for k, part in enumerate((0.0, 0.5, 1.0)):
            moved = parts[:, k + 1] - parts[:, 0]
            assert (np.abs(moved - part * change) < size).all(), (along, part)


def test_derivatives_where_a_wall_slips():
    """By all constants to 1e-7; the strut of a wall that has no interface is stressed alike."""
    staged, start = pit(interface=slips()), np.array(list(STARTS.values()))
    pairs = [(c.name, s) for c in staged.case.channels for s in staged.case.stage_names[2:]]
    assert_exact(staged.response(pairs), start, tuple(STARTS), step=2e-4)


def test_a_joint_meter_does_not_know_the_side():
    """It is refused where a beam divides the interface."""
    with pytest.raises(InputError, match="across which of its two sides"):
        pit(interface=slips(), more=(replace(meter("m", (4.0, 7.0), "slip"), interface="slip"),))
