"""What stands against a closed form of an opening: each reason by itself, and where it begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, rollers
from support.meshes import opening
from support.tunnels import with_lines
from support.yielding import given, mohr, rock

from geoident.errors import InputError
from geoident.forward.openings.model import OpeningModel, opening_in_mesh
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Pressure, Traction, Water
from geoident.model.case import Analysis, Stage, Support
from geoident.model.ground import Attitude, Growth, RandomField, WithDepth
from geoident.model.in_situ import GeostaticStress, HeimStress
from geoident.model.parameter import Scalar

from .test_opening_model import GAUGES, RADIUS, MPa, gauge, quarter, without_mesh

PLAIN = material("rock", 5e9, 0.25)
HARD = material("hard", 9e9, 0.2)
GROUPS = {"core": "rock", "bench": "rock", "rock": "rock", "far": "rock"}
BOTH = Stage("both", excavate=("core", "bench"))


def obstacles(*stages, **changes):
    """Why a gauge cannot be read at each stage."""
    settings = {"groups": GROUPS, "materials": {"rock": PLAIN, "hard": HARD}}
    found = without_mesh(PLAIN, **{**settings, "stages": stages, **changes})
    return [found.unreadable("up", stage.name) for stage in stages]


PART = "at stage 'top' only a part of the opening is excavated"
TOP = Stage("top", excavate=("core",))
PULL = Traction("wall", (Scalar(1.0), Scalar(0.0)))
PRESS = Pressure("wall", Scalar(1.0))
WATER = Water(Scalar(0.0), Scalar(1e4))
AWAY = displacement("away", (3.0 * RADIUS, 1.0), (1.0, 0.0))


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
         (None, "the load 'wind' is not a pressure on the wall of the opening")),
        ((Stage("pull", loads={"wind": PRESS}), BOTH),
         ("the load 'wind' acts before the opening is excavated",) * 2),
        ((BOTH, Stage("pull", loads={"wind": PRESS}), Stage("on")), (None, None, None)),
    ],
)  # fmt: skip
def test_a_stage_without_a_closed_form_says_why_and_so_do_those_upon_it(stages, expected):
    assert obstacles(*stages) == [*expected]


def test_what_there_is_from_the_beginning_stands_against_all_stages():
    for changes, why in (
        ({"water": WATER}, "there is water in the pores"),
        ({"loads": {"roof": PRESS}}, "the load 'roof' acts before the opening is excavated"),
    ):
        assert obstacles(BOTH, Stage("on"), **changes) == [why] * 2


def test_structures_support_the_ground():
    stages = (BOTH, Stage("bolt", build=("nails", "bolts")))
    found = obstacles(*stages, structures={"nails": None, "bolts": None})
    assert found == [None, "'bolts' supports the ground at stage 'bolt'"]


def test_why_a_channel_is_not_covered():
    inner = gauge("inner", (0.0, 0.0), (0.0, 3 * RADIUS))
    cell = replace(GAUGES[0], name="cell", kind="load-cell", structure="nails")
    opened = without_mesh(
        PLAIN, groups=GROUPS, stages=(Stage("wait"), BOTH, Stage("flood", water=WATER)),
        channels=(GAUGES[1], inner, cell),
    )  # fmt: skip
    other = "it reads something else than displacements"
    gone = "a point of it lies in excavated ground"
    wet = "there is water in the pores"
    for name, expected in (
        ("up", [None, None, wet]),
        ("inner", [None, gone, wet]),
        ("cell", [other, other, other]),
    ):
        stages = ("wait", "both", "flood")
        assert [opened.unreadable(name, stage) for stage in stages] == expected
        (row,) = opened.survey(np.empty(0), fields=False).computed[
            [opened.rule.channels.index(name)]
        ]
        np.testing.assert_array_equal(np.isfinite(row), [why is None for why in expected])


@pytest.mark.parametrize(("part", "inside"), [(0.949, True), (0.951, False)])
def test_a_point_nearer_than_its_tolerance_is_in_the_opening_and_others_on_the_wall(part, inside):
    r"""u_r = -p0 a / (2 G) of the wall, wherever the point stands within 0.05 radii of it."""
    side = displacement("side", (0.8 * part * RADIUS, -0.6 * part * RADIUS), (0.8, -0.6))
    opened = without_mesh(PLAIN, channels=(side,), stages=(Stage("open", excavate=("core",)),))
    assert (opened.unreadable("side", "open") is not None) == inside
    (found,) = opened.survey(np.empty(0), fields=False).computed
    exact = np.nan if inside else -10 * MPa * RADIUS * 1.25 / 5e9
    assert found[0] == pytest.approx(exact, rel=1e-12, nan_ok=True)


GROWTH = Growth("rock", "E", Scalar(5e9), WithDepth(Scalar(1e7), Scalar(0.0)))
FIELD = RandomField(
    "rock", "E", Scalar(5e9), 0.3, (4.0,), Attitude(Scalar(0.0), Scalar(np.pi / 2)), modes=2
)
LIMITS = "'rock' has other yield limits than one of Mohr-Coulomb or Hoek-Brown"


@pytest.mark.parametrize(
    ("ground", "words"),
    [
        (replace(PLAIN, growths=(GROWTH,)), "'rock' varies from place to place"),
        (replace(PLAIN, fields=(FIELD,)), "'rock' varies from place to place"),
        (rock(5e9, 0.2, mohr(MPa, 0.5), mohr(2 * MPa, 0.1)), LIMITS),
        (rock(5e9, 0.2, given(np.eye(6)[:1], [1.0])), LIMITS),
    ],
)
def test_ground_without_a_closed_form(ground, words):
    """Other reasons: `test_said_of_openings.py`."""
    with pytest.raises(InputError, match=f"there is no closed form of this case: {words}"):
        without_mesh(ground)


@pytest.mark.parametrize(
    "changes",
    [
        {"in_situ": GeostaticStress(K0=Scalar(0.5)), "gravity": (0.0, -9.81)},
        {"in_situ": HeimStress(K0=Scalar(1.0), unit_weight=Scalar(1.0), surface="wall")},
    ],
)
def test_a_mesh_knows_the_stress_of_layers_and_of_surfaces(changes):
    found = opening_in_mesh(on(quarter(3, 10, 12.0), **changes), *ROUND)
    assert isinstance(found, OpeningModel)


MIXED = {"core": "rock", "a": "sand", "bench": "marl", "b": "clay", "c": "chalk", "d": "silt",
         "e": "rock"}  # fmt: skip


def test_without_a_mesh_the_opening_is_all_that_is_excavated():
    def why(groups, **changes):
        names = {*groups.values(), "rock"}
        with pytest.raises(InputError) as caught:
            without_mesh(
                PLAIN, groups=groups, stages=(TOP, Stage("rest", excavate=("bench",))),
                materials={name: replace(PLAIN, name=name) for name in names}, **changes,
            )  # fmt: skip
        return caught.value.faults[0].message.removeprefix("there is no closed form of this case: ")

    assert why(MIXED) == (
        "the ground around the opening is of several materials: 'chalk', 'clay', 'rock', 'sand' "
        "and 1 more"
    )
    four = dict(zip("abcd", ("p", "q", "r", "s"), strict=True))
    assert why({"core": "rock", "bench": "rock", **four}).endswith(": 'p', 'q', 'r', 's'")
    given = "without a mesh 'fit.closed-form' must give the centre and the radius"
    assert why(MIXED, centre=None) == why(MIXED, radius=None) == given


def on(mesh, *stages, groups=None, **changes):
    settings = {
        "materials": {"rock": PLAIN, "hard": HARD},
        "groups": groups or {name: "rock" for name in mesh.groups if name != "all"},
        "supports": rollers(2),
        "stages": stages or (Stage("open", excavate=("core",)),),
    }
    return CaseOnMesh(make_case(mesh, **{**settings, **changes}), mesh)


ROUND = (0.0, 0.0), RADIUS


def model_of(mesh, *stages, circle=ROUND, **changes):
    """The closed form of a case on a mesh, or why there is none."""
    return opening_in_mesh(on(mesh, *stages, **changes), *circle)


def all_round():
    """All round, of few elements."""
    return opening("quad8", 2, n=1, layers=6, radius=RADIUS, reach=12 * RADIUS, whole=True)


def moved(mesh, by, factor=1.0):
    return replace(mesh, points=mesh.points * factor + np.asarray(by))


def test_the_circle_that_a_case_gives_is_looked_at_in_its_mesh():
    """Not about the origin; a quarter shows all of it; its face group is the wall."""
    mesh = moved(quarter(3, 10, 12.0), (5.0, -7.0))
    press = Stage("press", loads={"grout": Pressure("wall", Scalar(1.0))})
    found = model_of(mesh, TOP, press, circle=((5.0, -7.0), RADIUS), channels=(AWAY,))
    assert found.notes == (
        "closed form of a circular opening of radius 2 m about (5, -7) m in 'rock'",
    )
    assert found.unreadable("away", "press") is None
    assert isinstance(model_of(mesh, circle=((5.035, -7.0), RADIUS)), OpeningModel)
    for circle in ((None, None), ((5.0, -7.0), None), (None, RADIUS)):
        assert model_of(mesh, circle=circle) == (
            "the case does not say where the opening is: give its centre and radius, as in "
            "'fit: {closed-form: {centre: [0 m, 0 m], radius: 2.5 m}}'"
        )
    assert model_of(mesh, circle=((5.0, -7.0), 1.0)) == (
        "no group that is excavated lies within 1 m of (5, -7) m"
    )
    revolved = model_of(mesh, analysis=Analysis.AXISYMMETRIC)
    assert revolved == "its formulas are those of plane strain"


def test_a_wall_may_lie_off_its_circle_by_two_hundredths():
    mesh = quarter(3, 10, 12.0)
    for radius in (2.0 / 1.0195, 2.0 / 0.9805):
        assert isinstance(model_of(mesh, circle=((0.0, 0.0), radius)), OpeningModel)
    assert model_of(mesh, circle=((0.0, 0.0), 2.0 / 0.9795)) == (
        "the wall of 'core' is not the circle of radius 2.042 m about (0, 0) m: it lies 2 to 2 m "
        "from there"
    )


@pytest.mark.parametrize(
    ("reach", "words"),
    [
        (2.99, "the model, or another opening, ends 3.0 radii from the centre of the opening; at "
               "least 3 are needed"),
        (3.01, "the model ends 3.0 radii from the centre, where the closed form continues: "
               "displacements differ by some 11 %"),
        (9.99, "the model ends 10.0 radii from the centre, where the closed form continues: "
               "displacements differ by some 1 %"),
        (10.01, None),
    ],
)  # fmt: skip
def test_how_far_a_model_goes(reach, words):
    found = model_of(quarter(3, 10, reach))
    if isinstance(found, str):
        assert found == words
    else:
        assert found.notes[1:] == (() if words is None else (words,))


def parted(inner: float):
    """A quarter whose rock beyond a distance, in radii, is another group."""
    mesh = quarter(3, 10, 12.0)
    centre = np.linalg.norm(mesh.points[mesh.blocks[0].nodes].mean(axis=1), axis=1)
    rest = mesh.groups["rock"]
    far = centre[rest] > inner * RADIUS
    return replace(mesh, groups={**mesh.groups, "rock": rest[~far], "far": rest[far]})


def test_ground_away_from_the_wall_may_be_another():
    mesh = parted(4.0)
    found = model_of(mesh, groups={"far": "hard", "core": "hard", "rock": "rock"})
    assert found.notes[0].endswith("in 'rock'")
    assert found.notes[1:] == ("the closed form leaves out 'hard': all is rock",)
    later = Stage("later", ("core",), change={"far": "hard"})
    assert model_of(mesh, later, groups=dict.fromkeys(mesh.groups, "rock")).notes[1:] == ()


def test_ground_of_several_materials_at_the_wall():
    mesh = quarter(3, 10, 12.0)
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    rest = mesh.groups["rock"]
    high = centre[rest, 1] > centre[rest, 0]
    mesh = replace(mesh, groups={**mesh.groups, "rock": rest[~high], "roof": rest[high]})
    found = model_of(mesh, groups={"core": "rock", "rock": "rock", "roof": "hard"})
    assert found == "the ground at the wall is of several materials: 'hard', 'rock'"


def test_of_what_is_excavated_counts_what_lies_within_the_circle():
    """A pit is far away; the opening is dug in two stages."""
    assert model_of(quarter(2, 6, 12.0), Stage("wait")) == "no stage excavates anything"
    mesh, core = parted(6.0), parted(6.0).groups["core"]
    split = replace(mesh, groups={**mesh.groups, "core": core[:3], "bench": core[3:]})
    stages = Stage("pit", excavate=("far",)), TOP, Stage("rest", excavate=("bench",))
    assert isinstance(model_of(split, *stages), OpeningModel)
    assert model_of(split, *stages[:2]).startswith("the wall of 'core' is not")
    everything = Stage("all", excavate=("core", "rock"))
    found = model_of(quarter(2, 6, 12.0), everything, circle=((0.0, 0.0), 99.0))
    assert found == "'core', 'rock' border no ground that stays"


def test_a_half_of_a_circle_needs_the_plane_of_symmetry_to_be_held():
    whole, up = quarter(3, 10, 12.0), Support("x0", (0,))
    free = model_of(whole, supports=(up,))
    assert free.startswith("the model, or another opening, ends 0.1 radii")
    assert model_of(whole, supports=(up, Support("y0", (0,)))) == free
    assert isinstance(model_of(whole, supports=(up, Support("y0", (1,)))), OpeningModel)
    assert isinstance(model_of(replace(whole, points=-whole.points)), OpeningModel)


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
    found = model_of(mesh, in_situ=stress)
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
    found = model_of(mesh, *stages, channels=(AWAY,))
    why = "the load 'side' is not a pressure on the wall of the opening"
    assert [found.unreadable("away", s.name) for s in stages] == [None, None, why]
