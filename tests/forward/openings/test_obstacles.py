"""What stands against a closed form of an opening: each reason by itself, and where it begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, rollers
from support.meshes import opening
from support.tunnels import with_lines
from support.yielding import constant, given, hoek, mohr, rock

from geoident.forward.openings.field import unsuitable
from geoident.forward.openings.model import opening_in_mesh
from geoident.forward.openings.site import Circle, OpeningSite, site_in_mesh, site_without_mesh
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Pressure, Traction, Water
from geoident.model.case import Analysis, Stage, Support
from geoident.model.ground import Growth, TransverselyIsotropic, WithDepth
from geoident.model.in_situ import GeostaticStress, HeimStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar

from .test_opening_model import GAUGES, RADIUS, MPa, gauge, quarter, staged, without_mesh

PLAIN = material("rock", 5e9, 0.25)
HARD = material("hard", 9e9, 0.2)
GROUPS = {"core": "rock", "bench": "rock", "rock": "rock", "far": "rock"}
BOTH = Stage("both", excavate=("core", "bench"))


def obstacles(*stages, **changes):
    settings = {"groups": GROUPS, "materials": {"rock": PLAIN, "hard": HARD}}
    found = without_mesh(PLAIN, **{**settings, "stages": stages, **changes})
    return found.field.obstacles


PART = "at stage 'top' only a part of the opening is excavated"
TOP = Stage("top", excavate=("core",))
PULL = Traction("wall", (Scalar(1.0), Scalar(0.0)))
PRESS = Pressure("wall", Scalar(1.0))
WATER = Water(Scalar(0.0), Scalar(1e4))


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        ((TOP, Stage("rest", excavate=("bench",))), (PART, PART)),
        ((TOP, replace(BOTH, base="virgin"), Stage("on")), (PART, None, None)),
        (
            (replace(BOTH, release={"core": Scalar(0.5), "bench": Scalar(0.6)}),),
            ("at stage 'both' parts of the opening are released differently",),
        ),
        ((replace(BOTH, release=dict.fromkeys(("core", "bench"), Scalar(0.5))),), (None,)),
        (
            (BOTH, Stage("fill", install={"bench": "rock", "core": "hard"})),
            (None, "stage 'fill' installs 'core'"),
        ),
        (
            (BOTH, Stage("soak", change={"far": "hard", "rock": "hard"})),
            (None, "stage 'soak' changes 'rock', which is not part of the opening"),
        ),
        ((Stage("soak", change={"core": "hard"}), BOTH), (None, None)),
        ((BOTH, Stage("heat", temperature={"far": Scalar(3.0)})),
         (None, "the temperature of 'far' changes")),
        ((BOTH, Stage("flood", water=WATER)), (None, "there is water in the pores")),
        ((Stage("push", supports={"side": Support("side", (0,))}), BOTH),
         ("stage 'push' changes what is held",) * 2),
        (
            (Stage("push", supports={"x0": Support("x0", (0,), motions=((0, Scalar(1.0)),))}),
             replace(BOTH, base="virgin")),
            ("the support 'x0' is moved by what is given", None),
        ),
        ((BOTH, Stage("pull", loads={"wind": PULL})),
         (None, "the load 'wind' is no pressure on the wall of the opening")),
        ((Stage("pull", loads={"wind": PRESS}), BOTH),
         ("the load 'wind' acts before the opening is excavated",) * 2),
        ((BOTH, Stage("pull", loads={"wind": PRESS}), Stage("on")), (None, None, None)),
    ],
)  # fmt: skip
def test_a_stage_without_a_closed_form_says_why_and_so_do_those_upon_it(stages, expected):
    assert obstacles(*stages) == [None, *expected]


def test_what_there_is_from_the_beginning_stands_against_all_stages():
    for changes, why in (
        ({"water": WATER}, "there is water in the pores"),
        ({"loads": {"roof": PRESS}}, "the load 'roof' acts before the opening is excavated"),
    ):
        assert obstacles(BOTH, Stage("on"), **changes) == [why] * 3


def test_structures_support_the_ground():
    stages = (BOTH, Stage("bolt", build=("nails", "bolts")))
    found = obstacles(*stages, structures={"nails": None, "bolts": None})
    assert found[1:] == [None, "'bolts' supports the ground at stage 'bolt'"]


def test_why_a_channel_is_not_covered():
    inner = gauge("inner", (0.0, 0.0), (0.0, 3 * RADIUS))
    cell = replace(GAUGES[0], name="cell", kind="load-cell", structure="nails")
    stages = (BOTH, Stage("flood", water=WATER))
    field = without_mesh(
        PLAIN, groups=GROUPS, stages=stages, channels=(GAUGES[1], inner, cell)
    ).field
    other = "it reads something else than displacements"
    gone = "a point of it stands in ground that is no longer there"
    wet = "there is water in the pores"
    found = [[field.why_uncovered(n, k) for k in range(3)] for n in range(3)]
    assert found == [[None, None, other], [None, gone, other], [wet, wet, wet]]
    np.testing.assert_array_equal(field.covered, [[why is None for why in row] for row in found])


@pytest.mark.parametrize(("part", "inside"), [(0.949, True), (0.951, False)])
def test_a_point_nearer_than_its_tolerance_is_in_the_opening_and_others_on_the_wall(part, inside):
    r"""u_r = -p0 a / (2 G) of the wall, wherever the point stands within 0.05 radii of it."""
    side = displacement("side", (0.8 * part * RADIUS, -0.6 * part * RADIUS), (0.8, -0.6))
    opened = without_mesh(PLAIN, channels=(side,), stages=(Stage("open", excavate=("core",)),))
    assert (opened.unreadable("side", "open") is not None) == inside
    (found,) = opened.survey(np.empty(0), fields=False).computed
    exact = np.nan if inside else -10 * MPa * RADIUS * 1.25 / 5e9
    assert found[0] == pytest.approx(exact, rel=1e-12, nan_ok=True)


BEDDED = TransverselyIsotropic(
    *(Scalar(x) for x in (5e9, 4e9, 2e9, 0.2, 0.25)), frame=None
)  # fmt: skip
GEOSTATIC = GeostaticStress(K0=Scalar(0.5))
GROWTH = Growth("rock", "E", Scalar(5e9), WithDepth(Scalar(1e7), Scalar(0.0)))
FROM_FACES = HeimStress(K0=Scalar(1.0), unit_weight=Scalar(1.0), surface="top")


@pytest.mark.parametrize(
    ("ground", "changes", "words"),
    [
        (PLAIN, {}, None),
        (PLAIN, {"analysis": Analysis.AXISYMMETRIC}, "its formulas are those of plane strain"),
        (replace(PLAIN, elastic=BEDDED), {}, "'rock' is not isotropic"),
        (replace(PLAIN, growths=(GROWTH,)), {}, "'rock' varies from place to place"),
        (rock(5e9, 0.2, mohr(MPa, 0.5)), {}, None),
        (rock(5e9, 0.2, mohr(MPa, 0.5), hoek(30e6, psi=0.1, mb=2.0, s=0.1, a=0.5)), {},
         "'rock' has other yield limits than one of Mohr-Coulomb or Hoek-Brown"),
        (rock(5e9, 0.2, given(np.eye(6)[:1], [1.0])), {},
         "'rock' has other yield limits than one of Mohr-Coulomb or Hoek-Brown"),
        (rock(5e9, 0.2, hoek(30e6, psi=0.1, mb=2.0, s=0.1, a=0.5)), {}, None),
        (rock(5e9, 0.2, hoek(30e6, mb=2.0, s=0.1, a=0.5)), {},
         "'rock' flows along the normals of Hoek-Brown; with 'dilation' it has one"),
        (PLAIN, {"in_situ_of": {"far": constant(-1.0)}},
         "groups have in-situ stresses of their own"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("has_mesh", [True, False])
def test_ground_without_a_closed_form(ground, changes, words, has_mesh):
    case = make_case(quarter(1, 2), materials={"rock": ground, "hard": HARD}, **changes)
    assert unsuitable(case, "rock", has_mesh=has_mesh) == words
    if ground is not PLAIN:
        assert unsuitable(case, "hard", has_mesh=has_mesh) is None


@pytest.mark.parametrize(
    ("in_situ", "words"),
    [
        (None, None),
        (HeimStress(K0=Scalar(1.0), unit_weight=Scalar(1.0), surface=Scalar(3.0)), None),
        (GEOSTATIC, "the geostatic stress is the weight of the layers of a mesh"),
        (FROM_FACES, "the depth is counted from a group of faces, which needs a mesh"),
    ],
)
def test_a_stress_that_needs_a_mesh(in_situ, words):
    case = make_case(quarter(1, 2), materials={"rock": PLAIN}, in_situ=in_situ)
    assert unsuitable(case, "rock", has_mesh=False) == words
    assert unsuitable(case, "rock", has_mesh=True) is None


def test_ground_of_fields_or_in_another_analysis_has_none_on_a_mesh():
    """Asked of the mesh before anything is looked for in it."""
    case = make_case(quarter(1, 2), materials={"rock": replace(PLAIN, growths=(GROWTH,))})
    case = replace(case, groups={"core": "rock", "rock": "rock"}, analysis=Analysis.AXISYMMETRIC)
    found = opening_in_mesh(CaseOnMesh(case, quarter(1, 2)), ROUND)
    assert found == "its formulas are those of plane strain"


def sites(groups, *stages, circle=None):
    case = make_case(Mesh(np.empty((0, 2)), ()), groups=groups, stages=stages)
    circle = Circle((3.0, -4.0), 2.5) if circle is None else circle
    return site_without_mesh(CaseOnMesh(case, Mesh(np.empty((0, 2)), ())).sequence, circle)


MIXED = {"core": "soil", "a": "sand", "bench": "marl", "b": "clay", "c": "chalk", "d": "silt",
         "e": "rock"}  # fmt: skip


def test_the_site_of_a_case_without_mesh_is_all_that_is_excavated():
    two = Stage("top", excavate=("core",)), Stage("rest", excavate=("bench",))
    found = sites({"core": "soil", "bench": "marl", "a": "sand", "b": "sand"}, *two)
    assert found == OpeningSite((3.0, -4.0), 2.5, frozenset({0, 1}), 2)
    assert sites({"a": "sand", "core": "soil"}, two[0]).ground == 0
    assert sites(MIXED, *two) == (
        "the ground around the opening is of several materials: 'chalk', 'clay', 'rock', 'sand' "
        "and 1 more"
    )
    assert sites({"core": "soil", "a": "sand", "b": "clay"}, two[0]) == (
        "the ground around the opening is of several materials: 'clay', 'sand'"
    )
    four = dict(zip("abcd", ("p", "q", "r", "s"), strict=True))
    assert sites({"core": "soil", **four}, two[0]).endswith("'p', 'q', 'r', 's'")
    given = "without a mesh 'fit.closed-form' must give the centre and the radius"
    for circle in (Circle((3.0, 4.0), None), Circle(None, 2.0)):
        assert sites(MIXED, *two, circle=circle) == given
    assert sites({"a": "sand"}, Stage("wait")) == "no stage excavates anything"
    assert sites({"core": "sand"}, two[0]) == (
        "every group is excavated, none is left around the opening"
    )


def on(mesh, *stages, groups=None, **changes):
    settings = {
        "materials": {"rock": PLAIN, "hard": HARD},
        "groups": groups or {name: "rock" for name in mesh.groups if name != "all"},
        "supports": rollers(2),
        "stages": stages or (Stage("open", excavate=("core",)),),
    }
    return CaseOnMesh(make_case(mesh, **{**settings, **changes}), mesh)


def all_round():
    """All round, of few elements."""
    return opening("quad8", 2, n=1, layers=6, radius=RADIUS, reach=12 * RADIUS, whole=True)


def moved(mesh, by, factor=1.0):
    return replace(mesh, points=mesh.points * factor + np.asarray(by))


ROUND = Circle((0.0, 0.0), RADIUS)


def test_the_circle_that_a_case_gives_is_looked_at_in_its_mesh():
    """Not about the origin; a quarter shows all of it; its face group is the wall."""
    mesh = moved(quarter(3, 10, 12.0), (5.0, -7.0))
    found = site_in_mesh(on(mesh), Circle((5.0, -7.0), RADIUS))
    assert isinstance(found, OpeningSite)
    assert (found.centre, found.radius) == ((5.0, -7.0), RADIUS)
    assert found.walls == frozenset({"wall"})
    assert (found.remarks, len(found.groups)) == ((), 1)
    assert isinstance(site_in_mesh(on(mesh), Circle((5.035, -7.0), RADIUS)), OpeningSite)
    for circle in (Circle(), Circle((5.0, -7.0)), Circle(None, RADIUS)):
        assert site_in_mesh(on(mesh), circle) == (
            "the case does not say where the opening is: give its centre and radius, as in "
            "'fit: {closed-form: {centre: [0 m, 0 m], radius: 2.5 m}}'"
        )
    assert site_in_mesh(on(mesh), Circle((5.0, -7.0), 1.0)) == (
        "no group that is excavated lies within 1 m of (5, -7) m"
    )


@pytest.mark.parametrize("radius", [2.0 / 1.0195, 2.0 / 0.9805])
def test_a_wall_may_lie_off_its_circle_by_two_hundredths(radius):
    mesh = quarter(3, 10, 12.0)
    assert site_in_mesh(on(mesh), Circle((0.0, 0.0), radius)).radius == radius
    assert site_in_mesh(on(mesh), Circle((0.0, 0.0), 2.0 / 0.9795)) == (
        "the wall of 'core' is not the circle of radius 2.042 m about (0, 0) m: it lies 2 to 2 m "
        "from there"
    )


@pytest.mark.parametrize(
    ("reach", "words"),
    [
        (2.99, "the model, or another opening, ends 3.0 radii from the centre of the opening; at "
               "least 3 are needed"),
        (3.01, "the model ends 3.0 radii from the centre, where the closed form goes on: "
               "displacements differ by some 11 %"),
        (9.99, "the model ends 10.0 radii from the centre, where the closed form goes on: "
               "displacements differ by some 1 %"),
        (10.01, None),
    ],
)  # fmt: skip
def test_how_far_a_model_goes(reach, words):
    found = site_in_mesh(on(quarter(3, 10, reach)), ROUND)
    if isinstance(found, str):
        assert found == words
    else:
        assert found.remarks == (() if words is None else (words,))


def parted(inner: float):
    """A quarter whose rock beyond a distance, in radii, is another group."""
    mesh = quarter(3, 10, 12.0)
    centre = np.linalg.norm(mesh.points[mesh.blocks[0].nodes].mean(axis=1), axis=1)
    rest = mesh.groups["rock"]
    far = centre[rest] > inner * RADIUS
    return replace(mesh, groups={**mesh.groups, "rock": rest[~far], "far": rest[far]})


def test_ground_away_from_the_wall_may_be_another():
    mesh = parted(4.0)
    groups = {"far": "hard", "core": "hard", "rock": "rock"}
    found = site_in_mesh(on(mesh, groups=groups), ROUND)
    assert found.remarks == ("the closed form leaves out 'hard': all is rock",)
    assert (found.ground, found.groups) == (2, frozenset({1}))
    alike = on(mesh, Stage("later", ("core",), change={"far": "hard"}),
               groups={**groups, "far": "rock"})  # fmt: skip
    assert site_in_mesh(alike, ROUND).remarks == ()


def test_ground_of_several_materials_at_the_wall():
    mesh = quarter(3, 10, 12.0)
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    rest = mesh.groups["rock"]
    high = centre[rest, 1] > centre[rest, 0]
    mesh = replace(mesh, groups={**mesh.groups, "rock": rest[~high], "roof": rest[high]})
    groups = {"core": "rock", "rock": "rock", "roof": "hard"}
    found = site_in_mesh(on(mesh, groups=groups), ROUND)
    assert found == "the ground at the wall is of several materials: 'hard', 'rock'"
    assert isinstance(site_in_mesh(on(mesh), ROUND), OpeningSite)


def test_of_what_is_excavated_counts_what_lies_within_the_circle():
    """A pit is far away; the opening is dug in two stages."""
    assert site_in_mesh(on(quarter(2, 6, 12.0), Stage("wait")), ROUND) == (
        "no stage excavates anything"
    )
    mesh = parted(6.0)
    split = replace(mesh, groups={**mesh.groups, "core": mesh.groups["core"][:3],
                                  "bench": mesh.groups["core"][3:]})  # fmt: skip
    stages = (
        Stage("pit", excavate=("far",)),
        Stage("top", excavate=("core",)),
        Stage("rest", excavate=("bench",)),
    )
    found = site_in_mesh(on(split, *stages), ROUND)
    assert isinstance(found, OpeningSite)
    assert len(found.groups) == 2
    assert site_in_mesh(on(split, *stages[:2]), ROUND).startswith("the wall of 'core' is not")


def test_ground_that_borders_nothing_has_no_wall():
    mesh = quarter(2, 6, 12.0)
    everything = Stage("all", excavate=("core", "rock"))
    found = site_in_mesh(on(mesh, everything), Circle((0.0, 0.0), 99.0))
    assert found == "'core', 'rock' border no ground that stays"


def test_a_half_of_a_circle_needs_the_plane_of_symmetry_to_be_held():
    whole = quarter(3, 10, 12.0)
    up = Support("x0", (0,))
    free = site_in_mesh(on(whole, supports=(up,)), ROUND)
    assert free.startswith("the model, or another opening, ends 0.1 radii")
    across = site_in_mesh(on(whole, supports=(up, Support("y0", (0,)))), ROUND)
    assert across == free
    assert isinstance(site_in_mesh(on(whole, supports=(up, Support("y0", (1,)))), ROUND),
                      OpeningSite)  # fmt: skip
    flipped = replace(whole, points=-whole.points)
    blocks = tuple(replace(b, nodes=b.nodes) for b in flipped.blocks)
    assert isinstance(site_in_mesh(on(replace(flipped, blocks=blocks)), ROUND), OpeningSite)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_stress_that_grows_across_counts_at_both_sides_of_the_opening(side):
    """A surface that falls to one side by 1.497: there the stress is the furthest from its mean.

    Beyond its upper end the level is that of the end, 12 radii above the centre.
    """
    mesh = all_round()
    away = np.linalg.norm(mesh.points, axis=1)
    edge = np.flatnonzero(away > 11.9 * RADIUS)
    angle = np.arctan2(mesh.points[edge, 1], side * mesh.points[edge, 0])
    ends = [edge[np.argmin(np.abs(angle - at))] for at in (np.pi / 2, -np.pi / 8)]
    mesh = with_lines(mesh, "slope", np.array([ends]))
    stress = HeimStress(K0=Scalar(1.0), unit_weight=Scalar(1e4), surface="slope")
    found = opening_in_mesh(on(mesh, in_situ=stress), Circle((0.0, 0.0), RADIUS))
    (x0, y0), (x1, y1) = mesh.points[ends]
    assert x0 == pytest.approx(0.0, abs=1e-9)
    fall = (y0 - y1) / abs(x1)
    assert fall > 1.4
    (said,) = [note for note in found.notes if "in-situ stress around" in note]
    assert f"is up to {100 * fall * RADIUS / y0:.0f} % off its mean" in said


def test_a_pressure_elsewhere_is_no_pressure_on_the_wall():
    stages = (
        Stage("open", excavate=("core",)),
        Stage("press", loads={"grout": Pressure("wall", Scalar(1.0))}),
        Stage("push", loads={"side": Pressure("edge", Scalar(1.0))}),
    )
    mesh = quarter(3, 8, 12.0)
    lines = mesh.facets[0].nodes
    away = np.linalg.norm(mesh.points[lines], axis=2)
    mesh = with_lines(mesh, "edge", lines[(away > 11.9 * RADIUS).all(axis=1)])
    found = staged(mesh, PLAIN, stages=stages).response([(GAUGES[0].name, "open")])
    field = found.opening((0.0, 0.0), RADIUS)._model.field
    why = "the load 'side' is no pressure on the wall of the opening"
    assert field.obstacles == [None, None, None, why]
