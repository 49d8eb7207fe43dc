"""Released parts by the reaction of a mesh's own opening: its wall moves as the profile says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import material
from support.derivatives import assert_exact
from support.inner_faces import with_inner_faces
from support.opening_grid import FLOOR, OpeningCase
from support.tunnels import walled
from support.yielding import constant, mohr, parameters, rock

from geoident.errors import CollapseError, InputError
from geoident.forward.analysis.analysis import RunOptions
from geoident.model.case import Stage
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar

from .test_advance import profile, stages
from .test_opening_model import (
    GAUGES,
    RADIUS,
    MPa,
    displacement,
    quarter,
    staged,
    without_mesh,
)

DISTANCES = (0.5, 4.0)
UNEVEN = constant(-7 * MPa, -11 * MPa, -9 * MPa)


def oval(n: int = 2, layers: int = 6, reach: float = 12.0, stretch: float = 1.3):
    """A quarter around an ellipse of the area of a circle; far away nothing is stretched."""
    mesh = walled("quad8", n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS)
    r = np.linalg.norm(mesh.points, axis=1)
    near = np.minimum(1.0, RADIUS / np.maximum(r, RADIUS))[:, None]
    ways = np.array([stretch - 1.0, 1.0 / stretch - 1.0])
    return replace(mesh, points=mesh.points * (1.0 + near * ways))


def wall_by_hand(mesh, displacement) -> float:
    """Mean motion inwards of the lines of the wall, by Simpson's rule on each of them."""
    nodes = mesh.facets[-1].nodes
    first, last, middle = mesh.points[nodes].transpose(1, 0, 2)
    slopes = [4 * middle - 3 * first - last, last - first, 3 * last + first - 4 * middle]
    moved = displacement[nodes[:, [0, 2, 1]]].transpose(1, 0, 2)
    swept, length = 0.0, 0.0
    for weight, slope, u, x in zip((1, 4, 1), slopes, moved, (first, middle, last), strict=True):
        normal = np.stack([slope[:, 1], -slope[:, 0]], axis=1)
        normal *= np.sign((normal * x).sum(axis=1))[:, None]
        swept -= weight / 6 * float((u * normal).sum())
        length += weight / 6 * float(np.linalg.norm(slope, axis=1).sum())
    return swept / length


@pytest.mark.parametrize(
    ("law", "psi"),
    [("chern", 0.3), pytest.param("vlachopoulos-diederichs", 0.0, marks=pytest.mark.slow)],
)
def test_the_mean_of_the_wall_moves_by_the_profile(law, psi):
    """An ellipse in uneven stress; by the circle it moves 2 to 7 hundredths too far."""
    mesh, ground = oval(), rock(5e9, 0.25, mohr(MPa, 0.5, psi=psi))
    off = {}
    for conversion in ("mesh", "reaction-curve"):
        found = staged(
            mesh, ground, face=profile(law, conversion=conversion), stages=stages(DISTANCES),
            in_situ=UNEVEN,
        )  # fmt: skip
        fields = found.survey(np.empty(0), fields=True).fields
        moved = [wall_by_hand(mesh, u) for u in fields.displacement[1:]]
        shares = [s.share for s in found.face_states({})]
        off[conversion] = np.array(moved[:-1]) / moved[-1] - shares
    np.testing.assert_allclose(off["mesh"], 0.0, atol=1e-9)
    assert off["reaction-curve"].max() > 0.02


def test_an_interface_into_the_wall_has_its_part_in_the_reaction():
    """A soft joint across the tunnel and the rock: its opened wall still moves by the profile."""
    whole = walled("quad8", n=2, layers=6, radius=RADIUS, reach=12.0 * RADIUS)
    mesh = with_inner_faces(whole, joint=lambda x: abs(x[..., 0] - x[..., 1]) < 1e-6)
    found = staged(
        mesh, rock(5e9, 0.25, mohr(MPa, 0.5, psi=0.3)), face=profile("chern", conversion="mesh"),
        stages=stages(DISTANCES), in_situ=UNEVEN,
        interfaces={"joint": Interface("joint", Scalar(1e9), Scalar(2e8))},
    )  # fmt: skip
    fields = found.survey(np.empty(0), fields=True).fields
    walls = replace(found.mesh, facets=found.mesh.facets[: len(whole.facets)])
    moved = [wall_by_hand(walls, u) for u in fields.displacement[1:]]
    shares = [s.share for s in found.face_states({})]
    np.testing.assert_allclose(np.array(moved[:-1]) / moved[-1], shares, atol=1e-3)


def test_a_circle_in_even_stress_releases_as_the_closed_form():
    """Up to the error of the mesh, which is a quarter as large on half the size."""
    ground = rock(5e9, 0.25, mohr(MPa, 0.5))
    law = "vlachopoulos-diederichs"
    exact = without_mesh(ground, face=profile(law), stages=stages(DISTANCES)).face_states({})
    meshed = staged(
        quarter(6, 20, 30.0), ground, face=profile(law, conversion="mesh"),
        stages=stages(DISTANCES),
    )  # fmt: skip
    for one, other in zip(meshed.face_states({}), exact, strict=True):
        assert one.share == pytest.approx(other.share, rel=1e-12)
        assert one.released == pytest.approx(other.released, abs=1.2e-3)


@pytest.mark.parametrize("kind", ["quad4", "quad8"])
def test_a_circle_in_uneven_stress_releases_as_kirsch_and_galin_say(kind):
    """K0 0.75, where the closed form of geoident has no value; ahead of the face nothing yields.

    There the wall moves in the mean as by Kirsch, lambda P R / 2G. At last Tresca's ground flows
    all around: the stresses of Galin (1946, Prikl. Mat. Mekh. 10; Hill, Mathematical Theory of
    Plasticity, IX.8), with an elliptic edge of the mean radius m = R exp(P / 2k - 1/2) and
    d = (s_h - s_v) / 2k. Their function Psi falls like -k (1 + d^2) m^2 / z^2, so ground that keeps
    its volume moves the wall in the mean by k (1 + d^2) m^2 / 2GR.
    """
    P, k, d = 10 * MPa, 4 * MPa, 0.35
    uneven = constant(-(P - k * d), -(P + k * d), -P)
    m = np.exp(P / (2 * k) - 0.5)  # in radii
    last = k * (1.0 + d**2) * m**2 / P  # of the motion of Kirsch
    fine = (16, 60) if kind == "quad4" else (8, 40)
    mesh = walled(kind, n=fine[0], layers=fine[1], radius=RADIUS, reach=40.0 * RADIUS)
    found = staged(
        mesh, rock(5e9, 0.499, mohr(k, 0.0)), face=profile("chern", conversion="mesh"),
        stages=stages((-1.5 * RADIUS,)), in_situ=uneven, channels=(),
    )  # fmt: skip
    (ahead,) = found.face_states({})
    assert ahead.released == pytest.approx(ahead.share * last, rel=0.01)
    assert ahead.released > 1.9 * ahead.share


def lost_area(staged_model, floor: float) -> np.ndarray:
    """Area that the wall of one half of a horseshoe loses, state by state, m2."""
    mesh = staged_model.mesh
    x, y = mesh.points.T
    on_arch = (np.abs(np.hypot(x, y) - 1.0) < 1e-9) & (y >= 0.0)
    on_side, on_floor = np.abs(x - 1.0) < 1e-9, np.abs(y - floor) < 1e-9
    wall = on_arch | (on_side & (y <= 0.0) & (y >= floor)) | (on_floor & (x <= 1.0 + 1e-9))
    wall = np.flatnonzero(wall & (np.hypot(x, y) < 2.0))
    wall = wall[np.argsort(np.arctan2(y[wall] - 0.5 * floor, x[wall]))]
    along = np.diff(mesh.points[wall], axis=0)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)  # out of the opening
    run = staged_model.at(np.empty(0), RunOptions(derivatives=False, explain=False))
    moved = np.array([end.u[:, 0].reshape(-1, 2)[wall] for end in run.states()][1:])
    return -np.sum(0.5 * (moved[:, 1:] + moved[:, :-1]) * normals, axis=(1, 2))


@pytest.mark.slow
def test_a_flat_floor_releases_what_another_mesh_asks_for():
    """Sharp corners, K0 2, no dilation: no closed form. Truth: other elements, parts by hand."""
    opening = OpeningCase("horseshoe", "tri6", 0.15, 30.0, 0.0, 0.15, K0=2.0)
    face = replace(profile("chern", conversion="mesh"), radius=Scalar(1.0))
    states = opening.staged(stages=stages((0.5,)), face=face).face_states({})
    parts = tuple(state.released for state in states)
    shares = np.array([state.share for state in states])
    assert np.all(parts > shares + 0.05)
    other = replace(opening, kind="quad8", size=0.1, released=(*parts, 1.0))
    area = lost_area(other.staged(), FLOOR)
    np.testing.assert_allclose(area[:-1] / area[-1], shares, atol=0.02)


@pytest.mark.slow
def test_readings_are_smooth_where_stages_end_with_a_residual():
    """Flat floor, weak ground, no dilation: once no parts were found, or such that are off by 2 %.

    Radius 5 m, readings in mm; readings at near cohesions lie on a line, with its slope.
    """
    opening = OpeningCase("horseshoe", "tri6", 0.15, 30.0, 0.0, 0.05, K0=0.7)
    face = replace(profile("chern", conversion="mesh"), radius=Scalar(1.0))
    ground = rock(3e9, 0.25, mohr(Scalar(1.0, "c"), np.pi / 6, psi=0.0))
    points = {"crown": (0.0, 1.0), "side": (1.0, 0.0), "floor": (0.0, FLOOR)}
    gauges = {"crown": (0.0, -1.0), "side": (-1.0, 0.0), "floor": (0.0, 1.0)}
    found = opening.staged(
        stages=stages((0.2, 1.0, 3.0))[:3], face=face, materials={"rock": ground},
        parameters=parameters(c=0.5 * MPa),
        channels=[displacement(name, points[name], way, zero="0") for name, way in gauges.items()],
    )  # fmt: skip
    response = found.response([(name, stage) for name in gauges for stage in ("1", "2")])
    ends = [response.evaluate(0.5 * MPa * np.array([part])) for part in (1.0, 1.003, 1.006)]
    first, between, last = (5e3 * values for values, _ in ends)
    np.testing.assert_allclose(between, 0.5 * (first + last), rtol=0, atol=0.02)
    slope = 5e3 * ends[1][1][:, 0] * 0.006 * 0.5 * MPa
    np.testing.assert_allclose(last - first, slope, rtol=0.05)


@pytest.mark.parametrize("law", ["vlachopoulos-diederichs", "chern"])
def test_elastic_ground_is_released_by_the_share_itself(law):
    found = staged(
        oval(), material("rock", 5e9, 0.25), face=profile(law, conversion="mesh"),
        stages=stages(DISTANCES), in_situ=UNEVEN,
    )  # fmt: skip
    assert all(s.released == s.share for s in found.face_states({}))
    assert found.counts.factorizations == 0


def test_derivatives_are_exact():
    """By strength, distance and constants of the profile; larger steps would meet kinks."""
    numbers = {"c": MPa, "x": 1.4, "two": 1.6}
    own = {name: Scalar(1.0, name) for name in numbers}
    face = profile("chern", constants=(Scalar(1.1), own["two"]), conversion="mesh")
    found = staged(
        oval(), rock(5e9, 0.25, mohr(own["c"], 0.5)), face=face,
        stages=stages((own["x"], 4.0))[:2], parameters=parameters(**numbers), in_situ=UNEVEN,
    )  # fmt: skip
    pairs = [(c.name, stage) for c in GAUGES for stage in ("0", "1")]
    p = np.array(list(numbers.values()))
    assert_exact(found.response(pairs), p, tuple(numbers), rtol=1e-6, step=2e-5)


def test_what_was_asked_before_changes_nothing():
    """A start from the last answer leads to the same parts; forgotten, to the same bits."""
    c = Scalar(1.0, "c")
    found = staged(
        oval(), rock(5e9, 0.25, mohr(c, 0.5)),
        face=profile("chern", conversion="mesh"), stages=stages(DISTANCES),
        parameters=parameters(c=MPa),
    )  # fmt: skip
    pairs = [(GAUGES[0].name, "0")]
    first = found.response(pairs).readings(np.array([MPa]))
    found.response(pairs).readings(np.array([1.3 * MPa]))
    again = found.response(pairs).readings(np.array([MPa]))
    np.testing.assert_allclose(again, first, rtol=1e-9)
    np.testing.assert_array_equal(found.response(pairs).evaluate(np.array([MPa]))[0], again)
    found.forget()
    np.testing.assert_array_equal(found.response(pairs).readings(np.array([MPa])), first)


def test_what_is_built_in_later_stages_has_no_part_in_it():
    """Stages without a distance, linings among them, are not of the reaction without support."""
    ground, stiff = rock(5e9, 0.25, mohr(MPa, 0.5)), material("lining", 30e9, 0.2)
    face = profile("chern", conversion="mesh")
    bare, plain = stages((0.5,)), oval()
    lined = (bare[0], Stage("line", install={"core": "lining"}), *bare[1:])
    settings = {"face": face, "materials": {"rock": ground, "lining": stiff}, "in_situ": UNEVEN}
    one = staged(plain, ground, stages=bare, **settings).face_states({})
    other = staged(plain, ground, stages=lined, **settings).face_states({})
    assert {(s.distance, s.released) for s in one} == {(s.distance, s.released) for s in other}


def test_an_earlier_tunnel_counts_and_its_motion_does_not():
    """What moved before the tunnel is no part of the motion that the profile shares out."""
    mesh = oval()
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    rest = mesh.groups["rock"]
    niche = rest[(np.abs(centre[rest] - (12.0, 12.0)) < 5.0).all(axis=1)]
    mesh = replace(mesh, groups={**mesh.groups, "niche": niche, "rock": np.setdiff1d(rest, niche)})
    found = staged(
        mesh,
        rock(5e9, 0.25, mohr(2 * MPa, 0.5)),
        face=profile("chern", conversion="mesh"),
        groups={"core": "rock", "rock": "rock", "niche": "rock"},
        stages=(
            Stage("niche", excavate=("niche",), release={"niche": Scalar(0.3)}),
            *stages(DISTANCES),
        ),
        in_situ=UNEVEN,
    )
    u = found.survey(np.empty(0), fields=True).fields.displacement
    before, *moved = (wall_by_hand(mesh, one) for one in u[1:])
    shares = [s.share for s in found.face_states({})]
    assert abs(before) > 0.001 * moved[-1]
    np.testing.assert_allclose((np.array(moved[:-1]) - before) / (moved[-1] - before), shares)


@pytest.mark.parametrize("before", [True, False])
def test_only_ground_before_the_tunnel_makes_its_wall_yield(before):
    """Where nothing yields before it is dug, the part is the share itself."""
    hard, soft = material("rock", 9e9, 0.25), rock(5e9, 0.25, mohr(MPa, 0.5), name="soft")
    soften = Stage("soften", change={"rock": "soft"})
    dug = stages((0.5,))[:1]
    found = staged(
        oval(1, 3), hard, face=profile("chern", conversion="mesh"), channels=(),
        stages=(soften, *dug) if before else (*dug, soften), materials={"rock": hard, "soft": soft},
    )  # fmt: skip
    (note,) = [note for note in found.notes if "face" in note]
    assert ("in the mesh, without support" in note) == before


def test_a_tunnel_that_does_not_stand_alone_says_so():
    found = staged(
        oval(), rock(5e9, 0.25, mohr(0.01 * MPa, 0.2, psi=0.2)),
        face=profile("chern", conversion="mesh"), stages=stages((0.5,))[:1],
    )  # fmt: skip
    with pytest.raises(CollapseError, match=r"(?s)has none without support.*conversion: direct"):
        found.survey(np.empty(0), fields=False)


@pytest.mark.parametrize("waits", [False, True])
def test_branches_have_no_one_reaction(waits):
    first, other = stages((0.5, 2.0))[:2]
    apart = (replace(first, independent=True), replace(other, excavate=("core",)))
    if waits:
        apart = (Stage("wait"), first, Stage("line"), replace(other, base="0"),
                 Stage("aside", distance=Scalar(3.0), base="line"))  # fmt: skip
    settings = {"face": profile("chern", conversion="mesh"), "stages": apart}
    with pytest.raises(InputError) as caught:
        staged(oval(), rock(5e9, 0.25, mohr(MPa, 0.5)), **settings)
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == ("branches", "face.conversion")
    assert fault.message == (
        "stages with a distance to the face do not all build on each other, so that the mesh has "
        "no one reaction to the face"
    )
    assert fault.hint == (
        "Let each of them build on the one before, or write 'conversion: reaction-curve'."
    )
