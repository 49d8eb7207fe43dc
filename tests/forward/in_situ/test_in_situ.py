"""In-situ stress: every model, every number, zones, topography and equilibrium."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import (
    NOWHERE,
    displacement,
    imbalance,
    material,
    model,
    rollers,
    virgin,
)
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.forward.in_situ.surfaces import Topography
from geoident.model.case import Stage, Support
from geoident.model.in_situ import ConstantStress, HeimStress, ProfileStress
from geoident.model.parameter import Parameter, Scalar

ROCK = material("rock", 8e9, 0.3, 2600.0)
WEIGHT = 2600.0 * 9.81
ZERO = Scalar(0.0)


def components(**given):
    names = ("xx", "yy", "zz", "xy", "yz", "xz")
    return tuple(given.get(name, ZERO) for name in names)


def p(name):
    return Scalar(1.0, name)


def block(kind="hex8", n=4):
    """A block of 8 m with a cavern (hole) and a fault zone."""
    mesh = box(kind, (n, n, n), size=(8.0, 8.0, 8.0), distortion=0.1)
    return regroup(
        mesh,
        hole=lambda c: np.all(np.abs(c - [3.0, 5.0, 3.0]) < 1.2, axis=1),
        fault=lambda c: c[:, 0] > 6,
    )


def cavern(mesh=None, **changes):
    """A model of the block, whose cavern is dug in its one stage."""
    usual = {
        "materials": {"rock": ROCK},
        "groups": dict.fromkeys(("rock", "hole", "fault"), "rock"),
        "supports": (Support("z0", (0, 1, 2)),),
        "stages": (Stage("open", excavate=("hole",)),),
    }
    return model(mesh or block(), **{**usual, **changes})


VALUES = {
    "sv": 7e6, "K0": 1.3, "K0h": 0.7, "azimuth": 0.6, "gamma": 26e3, "level": 11.3, "txx": -1e6,
    "tyy": -2e6, "txy": 0.4e6, "axx": -3e6, "azz": -0.5e6, "gxx": -20e3, "gxz": 20e3, "E": 8e9,
}  # fmt: skip
TECTONIC = components(xx=p("txx"), yy=p("tyy"), xy=p("txy"))
MODELS = {
    "azimuth": HeimStress(K0=p("K0"), K0_across=p("K0h"), azimuth=p("azimuth"), vertical=p("sv")),
    "across": HeimStress(K0=p("K0"), K0_across=p("K0h"), vertical=p("sv"), tectonic=TECTONIC),
    "depth": HeimStress(
        K0=p("K0"), K0_across=p("K0h"), azimuth=p("azimuth"), unit_weight=p("gamma"),
        surface=p("level"), tectonic=TECTONIC,
    ),
    "profile": ProfileStress(
        at_surface=components(xx=p("axx"), zz=p("azz")),
        gradient=components(xx=p("gxx"), yy=Scalar(0.7, "gxx"), zz=Scalar(-26e3), xz=p("gxz")),
        surface=p("level"),
    ),
    "profile-held": ProfileStress(
        at_surface=components(xx=p("axx")), gradient=components(xx=p("gxx")), surface=p("level"),
        held=True,
    ),
}  # fmt: skip


def names_of(model_):
    return tuple(name for name in VALUES if f"'{name}'" in repr(model_))


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("where", ["everywhere", "fault"])
def test_every_number_is_differentiated_exactly(kind, where):
    virgin = MODELS[kind]
    other = ConstantStress(components(xx=Scalar(-2e6), yy=Scalar(-3e6), zz=Scalar(-4e6)))
    names = names_of(virgin)
    staged = cavern(
        parameters=tuple(Parameter(n, VALUES[n], -np.inf, np.inf) for n in names),
        gravity=(0.0, 0.0, -9.81),
        in_situ=virgin if where == "everywhere" else other,
        in_situ_of={} if where == "everywhere" else {"fault": virgin},
        channels=tuple(
            displacement(f"c{n}", (5.0, 4.0, 6.0), direction)
            for n, direction in enumerate(np.eye(3))
        ),
    )
    response = staged.response([(f"c{n}", "open") for n in range(3)])
    values = np.array([VALUES[n] for n in names])
    assert_exact(response, values, names)


def test_a_turned_model_gives_the_turned_answer():
    """Mesh and azimuth turned by 0.7 rad clockwise: so are the displacements."""
    turn = 0.7
    R = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    mesh = block()
    turned = replace(mesh, points=mesh.points @ R.T)
    heim = HeimStress(K0=Scalar(1.5), K0_across=Scalar(0.6), vertical=Scalar(1e6))

    def moved(mesh, azimuth):
        staged = cavern(
            mesh,
            in_situ=replace(heim, azimuth=Scalar(azimuth)),
        )
        return staged.survey(np.empty(0), fields=True).fields.displacement[-1]

    one, other = moved(mesh, 0.3), moved(turned, 0.3 + turn)
    np.testing.assert_allclose(other, one @ R.T, atol=1e-10 * np.abs(one).max())


# Topography --------------------------------------------------------------------------------------


def hill(kind="quad4", n=24):
    """A box of 100 m by 40 m whose top is a valley with slopes to both sides; y1 is the surface."""
    mesh = box(kind, (n, n // 2), size=(100.0, 40.0))
    x, y = mesh.points.T
    top = level_of(x)
    return replace(mesh, points=np.stack([x, y / 40.0 * top], axis=1))


def level_of(x):
    """Level of the valley: linear from 60 m at its sides to 40 m in its middle."""
    return 40.0 + 20.0 * np.abs(x - 50.0) / 50.0


def heavy(mesh, surface, **more):
    return model(
        mesh,
        materials={"rock": ROCK},
        groups={"all": "rock"},
        supports=(*rollers(2), Support("x1", (0,))),
        in_situ=HeimStress(K0=Scalar(0.5), unit_weight=Scalar(WEIGHT), surface=surface),
        gravity=(0.0, -9.81),
        stages=(Stage("nothing"),),
        **more,
    )


@pytest.mark.parametrize("kind", ["tri3", "quad4", "quad8", "tri6"])
def test_depth_is_counted_vertically_below_the_topography(kind):
    staged = heavy(hill(kind), "y1")
    positions = staged.discretization.points.position
    stress = staged.analysis.in_situ.columns(NOWHERE)[1, :, 0]
    expected = -WEIGHT * (level_of(positions[:, 0]) - positions[:, 1])
    np.testing.assert_allclose(stress, expected, atol=1e-9 * WEIGHT * 60)
    assert staged.analysis.n_outside == 0


@pytest.mark.parametrize("kind", ["quad4", "quad8"])
def test_a_heavy_valley_is_in_equilibrium_after_the_first_step(kind):
    staged = heavy(hill(kind), "y1")
    standing = virgin(staged)
    assert imbalance(staged) > 1e-2  # Heim's stress does not know that slopes lean
    forces = staged.actions.forces(0, NOWHERE)
    system = staged.systems[0]
    rest = forces - staged.discretization.points.forces(standing.stress, system.volume)
    assert np.abs(rest[system.pattern.dofs]).max() < 1e-10 * np.abs(forces).max()
    survey = staged.survey(np.empty(0), fields=True)
    assert np.abs(survey.fields.displacement).max() < 1e-12
    assert any("out of balance" in note for note in survey.notes)


def test_surfaces_of_solids_and_ground_beside_their_footprint():
    mesh = box("tet10", (4, 4, 4), size=(8.0, 8.0, 8.0))
    x, y, z = mesh.points.T
    mesh = replace(mesh, points=np.stack([x, y, z * (1 + 0.05 * x + 0.02 * y)], axis=1))
    top = mesh.facet_groups["z1"]
    centres = np.concatenate([mesh.points[f.nodes].mean(axis=1) for f in mesh.facets])
    part = top[centres[top, 0] < 4.0]
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, "part": part})

    def heavy_under(surface):
        staged = model(
            mesh,
            materials={"rock": ROCK},
            groups={"all": "rock"},
            supports=rollers(3),
            in_situ=HeimStress(K0=Scalar(1.0), unit_weight=Scalar(1.0), surface=surface),
        )
        return (
            staged.discretization.points.position,
            staged,
            staged.analysis.in_situ.columns(NOWHERE),
        )

    where, _, stress = heavy_under("z1")
    expected = -(8 * (1 + 0.05 * where[:, 0] + 0.02 * where[:, 1]) - where[:, 2])
    np.testing.assert_allclose(stress[2, :, 0], expected, atol=1e-9)
    where, staged, half = heavy_under("part")
    left = where[:, 0] < 4
    np.testing.assert_allclose(half[2, left, 0], expected[left], atol=1e-9)
    assert staged.analysis.n_outside == np.count_nonzero(~left)
    beside = np.flatnonzero(~left & (half[2, :, 0] < 0))
    level = -half[2, beside, 0] + where[beside, 2]
    rim = 8 * (1 + 0.05 * 4 + 0.02 * where[beside, 1])
    assert np.abs(level - rim).max() < 8 * 0.02 * 1.0 + 1e-9  # of the node nearest in plan
    assert (
        f"{np.count_nonzero(~left)} strain points lie beside the faces that give the level of the "
        "ground or of the water; the level of the nearest node of these faces was taken"
    ) in staged.notes


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "hex20", "tri3", "quad8"])
def test_every_kind_of_face_gives_the_level_all_over_its_plan(kind):
    dim = 2 if kind in ("tri3", "quad8") else 3
    mesh = box(kind, (3,) * dim)
    slope = np.array([0.3, -0.2])[: dim - 1]
    lift = mesh.points[:, :-1] @ slope
    mesh = replace(mesh, points=mesh.points + np.outer(lift, np.eye(dim)[-1]))
    places = np.random.default_rng(3).uniform(0, 1, (500, dim))
    levels, outside = Topography(mesh, f"{'xyz'[dim - 1]}1").levels(places)
    assert not outside.any()
    np.testing.assert_allclose(levels, 1 + places[:, :-1] @ slope, rtol=1e-9)


@pytest.mark.parametrize("kind", ["tet4", "hex8", "tri3"])
@pytest.mark.parametrize("axis", [0, 1])
def test_faces_on_both_sides_of_a_ridge_do_not_reach_beyond_it(kind, axis):
    """The plane of a face on one side, continued, lies above the other side."""
    dim = 2 if kind == "tri3" else 3
    axis = min(axis, dim - 2)
    mesh = box(kind, (3,) * dim)

    def level(places):
        return 1 - 0.6 * np.abs(places[:, axis] - 1 / 3)

    points = mesh.points.copy()
    points[:, -1] *= level(points)
    mesh = replace(mesh, points=points)
    places = np.random.default_rng(4).uniform(0, 1, (500, dim))
    levels, outside = Topography(mesh, f"{'xyz'[dim - 1]}1").levels(places)
    assert not outside.any()
    np.testing.assert_allclose(levels, level(places), rtol=1e-9)


@pytest.mark.parametrize(("kind", "n"), [("hex8", (3, 7, 9)), ("quad4", (3, 30))])
@pytest.mark.parametrize("height", [1.0, 1e-3])
def test_beside_a_cliff_the_level_is_that_of_its_edge(kind, n, height):
    """The nodes of the cliff stand above each other, so all are nearest: the top one counts."""
    dim = len(n)
    mesh = box(kind, n)
    up = mesh.points[:, -1] * height * (2 - mesh.points[:, 0])
    mesh = replace(mesh, points=np.column_stack([mesh.points[:, :-1], up]))
    faces = [mesh.facet_groups[name] for name in (f"{'xyz'[dim - 1]}1", "x1")]
    mesh = replace(mesh, facet_groups={"cliff": np.sort(np.concatenate(faces))})
    places = np.random.default_rng(5).uniform(-0.5, 1.5, (300, dim))
    places[:, 0] = 1.1 + abs(places[:, 0])
    levels, outside = Topography(mesh, "cliff").levels(places)
    assert outside.all()
    np.testing.assert_allclose(levels, height, rtol=1e-12)


# What is refused ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("virgin", "free", "words"),
    [
        (MODELS["azimuth"], {"azimuth"}, "the horizontal stress turns with the azimuth azimuth"),
        (MODELS["azimuth"], {"sv", "K0h"}, "the in-situ stress contains the product of K0h and sv"),
        (MODELS["depth"], {"level"}, "the in-situ stress ends at the level level of the surface"),
        (
            MODELS["profile"],
            {"level", "gxz"},
            "the in-situ stress contains the product of gxz and level",
        ),
        (MODELS["profile"], {"level", "axx"}, None),
        (MODELS["across"], {"sv", "txx"}, None),
    ],
)
def test_the_obstacle_is_named(virgin, free, words):
    names = tuple(sorted(free))
    fixed = {n: v for n, v in VALUES.items() if n not in free}

    def given(scalar):
        return (
            Scalar(scalar.factor * fixed[scalar.parameter]) if scalar.parameter in fixed else scalar
        )

    def resolve(value):
        if isinstance(value, Scalar):
            return given(value)
        return tuple(map(given, value)) if isinstance(value, tuple) else value

    virgin = replace(virgin, **{k: resolve(v) for k, v in vars(virgin).items()})
    staged = cavern(
        parameters=tuple(Parameter(n, VALUES[n], -np.inf, np.inf) for n in names),
        in_situ=virgin,
        channels=(displacement("c", (5.0, 4.0, 6.0), (1.0, 0.0, 0.0)),),
    )
    found = staged.response([("c", "open")]).obstacle()
    assert (found is None) if words is None else (words in found)


def held(stress, *sides):
    """A block in a stress that is the same everywhere, its faces held by rollers."""
    supports = tuple(Support(side, ("xyz".index(side[0]),)) for side in sides)
    return model(
        box("hex8", (2, 2, 2)), materials={"rock": ROCK}, groups={"all": "rock"},
        supports=supports, in_situ=ConstantStress(components(**stress)),
    )  # fmt: skip


ALL_SIDES = ("x0", "x1", "y0", "y1", "z0", "z1")
PRESSED = {"xx": Scalar(-8e6), "yy": Scalar(-6e6), "zz": Scalar(-7e6)}


@pytest.mark.parametrize(
    ("stress", "sides", "acts"),
    [
        (PRESSED, ALL_SIDES, False),
        (PRESSED, ALL_SIDES[:-1], True),
        (PRESSED | {"xy": Scalar(1e6)}, ALL_SIDES, True),  # rollers do not hold shear
    ],
)
def test_tractions_that_hold_the_edges_are_noted_where_they_act_on_anything(stress, sides, acts):
    assert any("by tractions" in note for note in held(stress, *sides).notes) is acts
