"""Motions of supports: patch tests, closed forms, derivatives, reactions, and what cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import box, regroup
from support.shield import ring
from support.tunnels import with_lines
from support.yielding import mohr, parameters, rock

from geoident.errors import InputError
from geoident.forward.actions.motions import closed_line, interpolated
from geoident.forward.affine import affine_obstacle
from geoident.forward.checks import check_on_mesh
from geoident.forward.reduced.reduction import reduction_obstacle
from geoident.model.actions import Contraction, MotionField, Pressure
from geoident.model.case import Analysis, Stage, Support
from geoident.model.mesh import nodes_in
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam

E, NU = 2e8, 0.3


def number(value: float | str, factor: float = 1.0) -> Scalar:
    return Scalar(factor, value) if isinstance(value, str) else Scalar(value)


def moved(group: str, at=None, **along) -> Support:
    """A support that moves; a number or the name of a parameter along x, y, z."""
    motions = tuple(("xyz".index(k), number(v)) for k, v in along.items())
    return Support(group, tuple(c for c, _ in motions), at=at, motions=motions)


def surveyed(mesh, p=(), **changes):
    changes = {
        "materials": {"rock": material("rock", E, NU)},
        "groups": {"all": "rock"},
        **changes,
    }
    return model(mesh, **changes).survey(np.array(p), fields=True)


@pytest.mark.parametrize("kind", ["tri6", "quad8", "tet10", "hex8"])
def test_motions_of_a_side_strain_a_box_evenly(kind):
    dim = 3 if kind in ("tet10", "hex8") else 2
    mesh = box(kind, (2,) * dim, size=(2.0, 1.0, 1.0)[:dim], distortion=0.2)
    last = "xyz"[dim - 1]
    supports = (*rollers(dim), moved("x1", x=2e-3), moved(f"{last}1", **{last: -1e-3}))
    found = surveyed(mesh, supports=supports, stages=(Stage("push"), Stage("rest")))
    strain = np.zeros(3)
    strain[[0, dim - 1]] = 1e-3, -1e-3
    if dim == 3:  # free along y: no stress there
        strain[1] = -NU / (1 - NU) * (strain[0] + strain[2])
    lame, shear = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    stress = lame * strain.sum() + 2 * shear * strain
    for state in (1, 2):  # and nothing more happens later
        np.testing.assert_allclose(
            found.fields.displacement[state], mesh.points * strain[:dim], atol=1e-15
        )
        normal = found.fields.stress[state, :, :3]
        np.testing.assert_allclose(normal, np.tile(stress, (len(normal), 1)), atol=1e-4)
    assert not found.fields.displacement[0].any()
    across = np.prod(np.ptp(mesh.points, axis=0)[1:])
    held = found.reactions
    assert held.supports == tuple(s.group for s in supports)
    np.testing.assert_allclose(held.force[dim, 1, 0], stress[0] * across, rtol=1e-10)
    np.testing.assert_allclose(held.force[0, 2, 0], -stress[0] * across, rtol=1e-10)
    assert np.isnan(held.force[0, 1, 1])  # not held along y


def test_motions_about_an_axis_of_revolution():
    mesh = box("quad8", (3, 2), size=(2.0, 1.0))
    supports = (Support("y0", (1,)), Support("y1", (1,)), moved("x1", x=-2e-3))
    found = surveyed(
        mesh, analysis=Analysis.AXISYMMETRIC, supports=supports, stages=(Stage("squeeze"),)
    )
    np.testing.assert_allclose(
        found.fields.displacement[1, :, 0], -1e-3 * mesh.points[:, 0], atol=1e-15
    )
    radial = -1e-3 * E / ((1 + NU) * (1 - 2 * NU))
    np.testing.assert_allclose(found.fields.stress[1, :, 0], radial, rtol=1e-9)
    np.testing.assert_allclose(found.reactions.force[2, 1, 0], radial * 2 * np.pi * 2.0, rtol=1e-9)


def lame(r, inner, wall_motion, outer):
    """Radial displacement between a wall r = inner that moves by this and a fixed edge."""
    # u = A r + B / r with u(outer) = 0
    b = wall_motion / (1 / inner - inner / outer**2)
    return b / r - b * r / outer**2


def test_a_wall_that_is_moved_converges_to_the_thick_walled_cylinder():
    errors = []
    for n in (1, 2, 4):
        mesh = ring(n)
        wall = Support("wall", (0, 1), contraction=Contraction(Scalar(0.01), centre=(0.0, 0.0)))
        found = surveyed(
            mesh,
            groups={"rock": "rock", "core": "rock"},
            supports=(*rollers(2), Support("rim", (0, 1))),
            stages=(Stage("drive", excavate=("core",), supports={"wall": wall}),),
        )
        u, r = found.fields.displacement[1], np.linalg.norm(mesh.points, axis=1)
        out = r > 2.0 + 1e-9
        exact = lame(r[out], 2.0, -0.01, 8.0)
        radial = (u[out] * mesh.points[out]).sum(axis=1) / r[out]
        errors.append(np.abs(radial - exact).max() / 0.01)
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3
    assert errors[2] < 1e-3


def test_volume_loss_in_far_ground(verification):
    """Uniform convergence: u_r = -(V/2) a^2 / r in infinite ground."""
    mesh = ring(2, layers=14, reach=400.0, whole=True)
    mesh = replace(mesh, points=mesh.points + np.array([3.0, -20.0]))
    wall = Support("wall", (0, 1), contraction=Contraction(number("V")))
    found = surveyed(
        mesh,
        [0.02],
        parameters=parameters(V=0.02),
        groups={"rock": "rock", "core": "rock"},
        supports=(Support("rim", (0, 1)),),
        stages=(Stage("drive", excavate=("core",), supports={"wall": wall}),),
    )
    u, from_centre = found.fields.displacement[1], mesh.points - np.array([3.0, -20.0])
    r = np.linalg.norm(from_centre, axis=1)
    near = (r > 1.99) & (r < 20.0)
    exact = -0.01 * 4.0 * from_centre[near] / r[near, None] ** 2
    np.testing.assert_allclose(u[near], exact, atol=0.01 * 0.02)
    ray = np.flatnonzero(near & (from_centre[:, 0] > 0) & (np.abs(from_centre[:, 1]) < 1e-9))
    ray = ray[np.argsort(r[ray])]
    verification("volume-loss", "", r[ray], exact=-0.04 / r[ray], found=u[ray, 0])
    np.testing.assert_allclose(u[ray, 0], -0.04 / r[ray], atol=1e-3 * 0.02)


def _stages():
    """Two motions of a side and a wall, one that begins later, one that lets go again."""
    field = MotionField(
        ((2.0, 0.0), (2.0, 0.5), (2.0, 1.0)), (0,), ((1e-3,), (2e-3,), (1.5e-3,)), number("f")
    )
    side = Support("x1", (0,), measured=field)
    return (
        Stage("one"),
        Stage("two", supports={"y1": moved("y1", y="w"), "x1": side}),
        Stage("three", supports={"x1": None}, loads={"p": Pressure("x1", number("q"))}),
        Stage("four", independent=True, base="one", supports={"x1": moved("x1", x="v")}),
    )


def _problem(*yields, lining=False, **values):
    mesh = regroup(
        box("quad8", (4, 2), size=(2.0, 1.0)), cut=lambda c: (c[:, 0] > 1) & (c[:, 1] > 0.5)
    )
    values = {"E": E, "nu": 0.3, "v": 2e-3, "w": -1e-3, "f": 1.3, "q": 5e4, **values}
    points = [(1.5, 0.3), (0.7, 0.9), (2.0, 0.2), (1.1, 0.4)]
    channels = [
        displacement(f"g{k}", x, ((1.0, 0.0), (0.0, 1.0))[k % 2]) for k, x in enumerate(points)
    ]
    first, *others = _stages()
    stages = (first, *others, Stage("five", excavate=("cut",), base="two"))
    changes = {}
    if lining:
        changes["structures"] = {"lining": Beam("y1", EA=number("E", 0.5), EI=Scalar(1e6))}
        stages = (replace(first, build=("lining",)), *stages[1:-1])
    staged = model(
        mesh,
        parameters=parameters(**values),
        materials={"rock": rock(number("E"), number("nu"), *yields)},
        groups={"rock": "rock", "cut": "rock"},
        supports=(*rollers(2), moved("x1", x="v")),
        stages=stages,
        channels=tuple(channels),
        **changes,
    )
    pairs = [
        (c.name, s.name) for s in stages for c in channels if (c.name, s.name) != ("g1", "five")
    ]
    return staged.response(pairs), np.array(list(values.values())), tuple(values), staged


def test_derivatives_forwards_and_backwards_are_exact():
    for lining in (False, True):
        response, p, names, _ = _problem(lining=lining)
        assert_exact(response, p, names)


@pytest.mark.parametrize("flow", [None, 0.1])
def test_derivatives_where_ground_yields(flow):
    strength = (number("c"), number("phi"))
    law = mohr(*strength, planes=12) if flow is None else mohr(*strength, psi=Scalar(flow))
    response, p, names, staged = _problem(law, c=1e5, phi=0.5, v=-1e-3, f=-1.3)
    assert_exact(response, p, names, rtol=3e-7)
    assert staged.survey(p, fields=True).fields.yielded[1:].any()


def test_motions_that_forces_made_need_these_forces():
    """What a pressure moves, fed back as measured motions, is the same state of the ground."""
    mesh = ring(2)
    usual = {"groups": {"rock": "rock", "core": "rock"}}
    sides = (*rollers(2), Support("rim", (0, 1)))
    load = {"p": Pressure("wall", Scalar(1e5))}
    pushed = surveyed(
        mesh, supports=sides, stages=(Stage("one", excavate=("core",), loads=load),), **usual
    )
    wall = nodes_in(mesh.facets, mesh.facet_groups["wall"])
    u = pushed.fields.displacement[1, wall]
    field = MotionField(tuple(map(tuple, mesh.points[wall])), (0, 1), tuple(map(tuple, u)))
    support = Support("wall", (0, 1), measured=field)
    stages = (Stage("one", excavate=("core",), supports={"wall": support}),)
    moved_ = surveyed(mesh, supports=sides, stages=stages, **usual)
    scale = np.abs(u).max()
    np.testing.assert_allclose(
        moved_.fields.displacement[1], pushed.fields.displacement[1], atol=1e-9 * scale
    )
    np.testing.assert_allclose(moved_.fields.stress[1], pushed.fields.stress[1], atol=1e-4)
    names = moved_.reactions.supports
    force = moved_.reactions.force[names.index("wall"), 1]
    held = pushed.reactions.force[:, 1]  # in balance with p on the quarter of the wall
    np.testing.assert_allclose(np.nansum(held, axis=0), -2e5, rtol=1e-9)
    total = np.nansum(moved_.reactions.force[:, 1], axis=0)
    np.testing.assert_allclose(total, 0.0, atol=1e-6 * 2e5)
    assert (force > 0).all()


def test_what_cannot_be_is_said_with_place_and_remedy():
    mesh = ring(1)
    points = MotionField(((2.0, 0.0), (1.9, 0.5)), (0,), ((0.001,), (0.002,)))
    supports = (
        *rollers(2),
        Support("rim", (0, 1)),
        replace(moved("probe", at=(3.1, 0.2), x=1e-3)),
        Support("nowhere", (0,), motions=((0, Scalar(1e-3)),)),
    )
    case = make_case(
        mesh,
        materials={"rock": material("rock", E, NU)},
        groups={"rock": "rock", "core": "rock"},
        supports=supports,
        stages=(Stage("one"),),
    )
    with pytest.raises(InputError) as caught:
        check_on_mesh(case, mesh)
    found = {fault.code: fault for fault in caught.value.faults}
    assert set(found) == {"no-node-there", "missing-group"}
    assert "The nearest node is at" in found["no-node-there"].hint
    wall = Support("wall", (0, 1), contraction=Contraction(Scalar(0.01)))
    far = Support("rim", (0,), measured=points)
    case = replace(
        case, supports=(*rollers(2), far), stages=(Stage("one", supports={"wall": wall}),)
    )
    with pytest.raises(InputError) as caught:
        check_on_mesh(case, mesh)
    found = {fault.code: fault for fault in caught.value.faults}
    assert set(found) == {"open-wall", "not-covered"}
    message = "'wall' is not one closed line, so no area is within it"
    hint = "Name the whole wall, or give 'centre: [x, y]' where symmetry cuts it."
    assert (found["open-wall"].message, found["open-wall"].hint) == (message, hint)
    rim = nodes_in(mesh.facets, mesh.facet_groups["rim"])  # the points are far within
    said = f"the points do not cover 'rim': {len(rim)} of its {len(rim)} nodes lie beyond them, "
    assert found["not-covered"].message.startswith(said + "such as that at (")
    place = found["not-covered"].message.partition("at (")[2].removesuffix(") m").split(", ")
    assert np.abs(mesh.points[rim] - np.array(place, dtype=float)).max(axis=1).min() < 1e-3
    hint = "Give points as far as the group reaches, or a group that ends with the points."
    assert found["not-covered"].hint == hint
    twice = (*rollers(2), moved("rim", x=1e-3))
    with pytest.raises(InputError, match="both hold the node at") as caught:
        check_on_mesh(replace(case, supports=twice, stages=(Stage("one"),)), mesh)
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == ("two-motions", "supports.rim")


def test_motions_count_from_the_shape_at_which_their_support_began():
    """A side is pulled out by 1 mm, held by a support that goes on to 3 mm, and let go again."""
    pull = -1e-3 / 2.0 * E / (1 - NU**2)
    stages = (
        Stage("pull", loads={"p": Pressure("x1", Scalar(pull))}),
        Stage("hold", supports={"x1": moved("x1", x=0.0)}),
        Stage("on", supports={"x1": moved("x1", x=2e-3)}),
        Stage("further", supports={"x1": moved("x1", x=5e-3)}),
        Stage("back", supports={"x1": None}),
    )
    found = surveyed(box("quad4", (2, 1), size=(2.0, 1.0)), supports=rollers(2), stages=stages)
    at_end = found.fields.mesh.points[:, 0] == 2.0
    side = found.fields.displacement[1:, at_end, 0]
    np.testing.assert_allclose(side, 1e-3 * np.array([[1, 1], [1, 1], [3, 3], [6, 6], [1, 1]]))


def test_a_wall_moves_towards_the_centroid_of_its_area():
    """Not towards the mean of its nodes, which crowd at one side."""
    mesh = box("quad4", (4, 2), size=(2.0, 1.0))
    mesh = replace(mesh, points=mesh.points**2 / [2.0, 1.0])
    wall = Support("outer", (0, 1), contraction=Contraction(Scalar(0.02)))
    found = surveyed(mesh, supports=(wall,), stages=(Stage("in"),))
    exact = -0.01 * (mesh.points - np.array([1.0, 0.5]))
    np.testing.assert_allclose(found.fields.displacement[1], exact, atol=1e-15)


def test_a_wall_in_a_solid_moves_towards_its_axis():
    mesh = box("hex8", (2, 2, 1), size=(2.0, 2.0, 1.0))
    around = tuple(
        Support(side, (0, 1), contraction=Contraction(Scalar(0.02), (1.0, 1.0, 0.0)))
        for side in ("x0", "x1", "y0", "y1")
    )
    found = surveyed(
        mesh, supports=(*around, Support("z0", (2,)), Support("z1", (2,))), stages=(Stage("in"),)
    )
    exact = -0.01 * (mesh.points - np.array([1.0, 1.0, 0.0])) * np.array([1.0, 1.0, 0.0])
    np.testing.assert_allclose(found.fields.displacement[1], exact, atol=1e-15)


def test_who_does_not_cover_motions_says_so():
    response, _, _, staged = _problem()
    del response
    assert "the support 'x1' is moved" in (affine_obstacle(staged.analysis) or "")
    assert reduction_obstacle(staged.analysis) == "the support 'x1' is moved"


GRID = tuple((float(x), float(y)) for x in range(3) for y in range(3))


def plane(places):
    """Motions along two axes that are linear in the place."""
    x, y = np.asarray(places)[:, :2].T
    return np.stack([1.0 + x + 2.0 * y, 3.0 * x - y], axis=1)


def field_at(points):
    return MotionField(points, (0, 1), tuple(map(tuple, plane(points).tolist())))


def test_measured_motions_are_linear_between_their_points():
    places = np.random.default_rng(2).uniform(0.0, 2.0, (40, 2))
    found, far = interpolated(field_at(GRID), places)
    np.testing.assert_allclose(found, plane(places), rtol=1e-12)
    assert not far.any()


def test_places_a_little_beyond_take_the_nearest_between_the_points():
    """Towards the middle at (1, 1), up to half of the distance of 1 m between the points."""
    places = np.array([[2.49, 1.0], [2.51, 1.0], [1.0, -0.4], [2.3, 2.3], [2.4, 2.4]])
    rim = np.array([[2.0, 1.0], [2.0, 1.0], [1.0, 0.0], [2.0, 2.0], [2.0, 2.0]])
    found, far = interpolated(field_at(GRID), places)
    np.testing.assert_allclose(found, plane(rim), rtol=1e-9)
    assert far.tolist() == [False, True, False, False, True]  # 0.3 and 0.4 times the root of two


def test_points_on_a_line_are_looked_at_along_it():
    """Wherever places are across it; beyond its ends as in a plane, from one point on anywhere."""
    along = np.array([0.6, 0.8])
    points = tuple(tuple((k * along).tolist()) for k in (0.0, 1.0, 2.0, 4.0))
    t, off = np.array([0.5, 3.0, 4.4, 4.6, -0.6]), np.array([0.0, 0.7, 0.1, 0.0, 0.0])
    places = t[:, None] * along + off[:, None] * np.array([-0.8, 0.6])
    found, far = interpolated(field_at(points), places)
    foot = np.clip(t, 0.0, 4.0)[:, None] * along
    np.testing.assert_allclose(found, plane(foot), rtol=1e-9, atol=1e-9)
    assert far.tolist() == [False, False, False, True, True]
    one, apart = interpolated(field_at(points[1:2]), np.array([along, along + 0.1]))
    np.testing.assert_array_equal(one, plane([along, along]))
    assert apart.tolist() == [False, True]


def _lines(*pairs):
    mesh = box("quad4", (3, 3), size=(3.0, 3.0))
    return with_lines(mesh, "wall", np.array(pairs))


def test_a_closed_line_is_gone_around_with_its_middle_nodes():
    """From its first node; open ones, two of them and forks are none."""
    ring = [(4, 5), (9, 5), (9, 8), (8, 4)]
    assert closed_line(_lines(*ring), "wall").tolist() in ([4, 5, 9, 8], [4, 8, 9, 5])
    curved = [(4, 6, 5), (10, 6, 7), (10, 8, 9), (4, 8, 12)]
    found = closed_line(_lines(*curved), "wall").tolist()
    assert found in ([4, 5, 6, 7, 10, 9, 8, 12], [4, 12, 8, 9, 10, 7, 6, 5])
    assert closed_line(_lines(*ring[:3]), "wall") is None
    assert closed_line(_lines(*ring, (9, 10)), "wall") is None
    assert closed_line(_lines(*ring, (0, 1), (1, 2), (2, 0)), "wall") is None
    assert closed_line(_lines(*ring), "nothing") is None
    lens = [(4, 5, 1), (4, 5, 9)]
    assert closed_line(_lines(*lens), "wall").tolist() in ([4, 1, 5, 9], [4, 9, 5, 1])
    assert closed_line(_lines((4, 5), (4, 5)), "wall") is None
    assert closed_line(_lines((4, 5, 1), (4, 5, 1)), "wall") is None
    assert closed_line(_lines(*ring, *ring), "wall") is None
