"""Each in-situ stress at a few places by hand, with its derivatives; covers and surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import make_case, material
from support.meshes import box, regroup

from geoident.forward.in_situ.stress import (
    InSituStress,
    StressPlaces,
    edges_held,
    in_situ_models,
    surface_faults,
    zone_faults,
)
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Water
from geoident.model.case import Analysis, Material, Stage
from geoident.model.dual import ParameterPoint
from geoident.model.ground import Growth, Isotropic, WithDepth
from geoident.model.in_situ import ConstantStress, GeostaticStress, HeimStress, ProfileStress
from geoident.model.parameter import Scalar

VALUES = {
    "sv": 7e6, "K": 1.3, "L": 0.7, "a": 0.6, "w": 26e3, "h": 11.0, "t": -1e5, "u": 4e4, "r": 2200.0,
    "q": 5e3, "c": 19e3, "g": 30.0, "z": 9.8e3,
}  # fmt: skip
PARTS = tuple(VALUES)
POINT = ParameterPoint(VALUES, PARTS)


def p(name, factor=1.0):
    return Scalar(factor, name)


def components(**given):
    names = ("xx", "yy", "zz", "xy", "yz", "xz")
    return tuple(given.get(name, Scalar(0.0)) for name in names)


def solid():
    """6 m by 5 m by 8 m; clay below 4 m, rock above, in two groups of which one is far along x."""
    mesh = box("hex8", (3, 2, 4), size=(6.0, 5.0, 8.0))
    return regroup(mesh, clay=lambda c: c[:, 2] < 4, east=lambda c: c[:, 0] > 4)


def plane():
    mesh = box("quad4", (3, 4), size=(6.0, 8.0))
    return regroup(mesh, clay=lambda c: c[:, 1] < 4, east=lambda c: c[:, 0] > 4)


GROUPS = {"rock": "rock", "east": "rock", "clay": "clay"}
MATERIALS = {
    "rock": Material("rock", Isotropic(E=Scalar(1e9), nu=Scalar(0.2)), p("r")),
    "clay": material("clay", 1e8, 0.3, 1900.0),
}


def on(mesh, **changes):
    settings = {"materials": MATERIALS, "groups": GROUPS}
    return CaseOnMesh(make_case(mesh, **{**settings, **changes}), mesh)


def places(found, *where):
    groups = [found.sequence.groups.index(name) for name, *_ in where]
    return StressPlaces(np.array([at for _, *at in where]), np.array(groups))


WHERE = (("clay", 1.0, 1.5, 2.5), ("rock", 3.1, 2.2, 6.5), ("east", 5.5, 4.0, 7.25))
FLAT = tuple((name, x, z) for name, x, _, z in WHERE)
Z = np.array([2.5, 6.5, 7.25])


def check(found, by_hand, *, where=WHERE):
    """Values and derivatives by differences of fourth order of the formula by hand."""
    stress = InSituStress(found, places(found, *where))
    columns = stress.columns(POINT)
    np.testing.assert_allclose(columns[..., 0], by_hand(VALUES), rtol=1e-9, atol=1e-6)
    for k, (name, value) in enumerate(VALUES.items()):
        h = 1e-3 * abs(value)
        a, b, c, d = (np.asarray(by_hand({**VALUES, name: value + j * h})) for j in (-2, -1, 1, 2))
        slope = (a - 8 * b + 8 * c - d) / (12 * h)
        np.testing.assert_allclose(columns[..., 1 + k], slope, rtol=1e-7, atol=1e-6 / h + 1e-9)
    return stress


def turned(along, across, azimuth):
    """xx, yy, xy of a stress along (sin, cos) of an azimuth and one across it."""
    way = np.array([np.sin(azimuth), np.cos(azimuth)])
    side = np.array([way[1], -way[0]])
    tensor = np.multiply.outer(np.outer(way, way), along)
    tensor = tensor + np.multiply.outer(np.outer(side, side), across)
    return tensor[0, 0], tensor[1, 1], tensor[0, 1]


TECTONIC = components(xx=p("t"), yy=p("t", 2.0), zz=p("t", 0.5), xy=p("u"), yz=p("u", 3.0),
                      xz=p("u", -2.0))  # fmt: skip


def tectonic(v, n=6):
    return np.array([v["t"], 2 * v["t"], 0.5 * v["t"], v["u"], 3 * v["u"], -2 * v["u"]])[:n, None]


def test_heims_stress_in_space():
    model = HeimStress(
        p("K"), vertical=p("sv"), K0_across=p("L"), azimuth=p("a"), tectonic=TECTONIC
    )

    def by_hand(v):
        vertical = np.full(3, -v["sv"])
        xx, yy, xy = turned(vertical * v["K"], vertical * v["L"], v["a"])
        return np.array([xx, yy, vertical, xy, 0 * xx, 0 * xx]) + tectonic(v)

    found = check(on(solid(), in_situ=model), by_hand)
    assert found.n_outside == 0
    plain = replace(model, azimuth=None, tectonic=None, K0_across=None)

    def even(v):
        vertical = np.full(3, -v["sv"])
        return np.array([vertical * v["K"], vertical * v["K"], vertical, *np.zeros((3, 3))])

    check(on(solid(), in_situ=plain), even)


def test_heims_stress_in_a_section_of_some_depth():
    """Above the surface there is none."""
    model = HeimStress(p("K"), unit_weight=p("w"), surface=p("h", 0.6), K0_across=p("L"),
                       tectonic=TECTONIC)  # fmt: skip

    def by_hand(v):
        vertical = -v["w"] * np.maximum(0.6 * v["h"] - Z, 0.0)
        found = np.array([vertical * v["K"], vertical, vertical * v["L"], 0 * vertical])
        return found + tectonic(v, 4)

    found = check(on(plane(), in_situ=model), by_hand, where=FLAT)
    assert found.n_outside == 0


def test_a_profile_goes_on_above_its_surface():
    model = ProfileStress(
        components(xx=p("t"), yy=p("t", 2.0), xy=p("u")),
        components(yy=p("w", -1.0), zz=p("w", -0.5), xy=p("q")), p("h", 0.6),
    )  # fmt: skip

    def by_hand(v):
        depth = 0.6 * v["h"] - Z
        one = np.ones(3)
        return np.array([v["t"] * one, 2 * v["t"] - v["w"] * depth, -0.5 * v["w"] * depth,
                         v["u"] + v["q"] * depth])  # fmt: skip

    check(on(plane(), in_situ=model), by_hand, where=FLAT)


def test_groups_may_have_a_stress_of_their_own_or_none():
    everywhere = ConstantStress(components(xx=p("t"), yy=p("t", 3.0), yz=p("u")))
    own = HeimStress(p("K"), vertical=p("sv"))
    found = on(solid(), in_situ=everywhere, in_situ_of={"east": own})

    def by_hand(v):
        table = np.zeros((6, 3))
        table[[0, 1, 4], :2] = np.array([[v["t"]], [3 * v["t"]], [v["u"]]])
        table[:3, 2] = -v["sv"] * np.array([v["K"], v["K"], 1.0])
        return table

    assert check(found, by_hand).n_outside == 0
    alone = on(solid(), in_situ_of={"east": own})
    columns = InSituStress(alone, places(alone, *WHERE)).columns(POINT)
    assert not columns[:, :2].any()
    np.testing.assert_allclose(columns[:, 2, 0], by_hand(VALUES)[:, 2])
    assert [path for path, _ in in_situ_models(found.case)] == [
        ("in_situ",), ("in_situ", "groups", "east")
    ]  # fmt: skip
    assert list(in_situ_models(on(solid()).case)) == []


def test_the_weight_of_layers_cover_and_surcharge_less_the_water():
    """Clay to 4 m, rock to 8 m, a cover to 13.2 m, a surcharge; ratios by groups."""
    ratios = {"rock": p("K"), "clay": Scalar(0.5), "east": p("K", 2.0)}
    model = GeostaticStress(
        ratios, surface=p("h", 1.2), cover=p("c"), surcharge=p("q"), K0_across=p("L"),
        azimuth=p("a"), tectonic=TECTONIC,
    )  # fmt: skip
    water = Water(p("h", 0.6), p("z"), groups=("clay", "rock"))
    found = on(solid(), in_situ=model, gravity=(0.0, 0.0, -10.0), water=water)

    def by_hand(v):
        rock = 10 * v["r"] * np.minimum(8 - Z, 4.0)
        clay = 19e3 * np.maximum(4 - Z, 0.0)
        total = rock + clay + v["q"] + v["c"] * (1.2 * v["h"] - 8.0)
        pores = v["z"] * np.maximum(0.6 * v["h"] - Z, 0.0) * [1, 1, 0]
        vertical = pores - total
        K = np.array([0.5, v["K"], 2 * v["K"]])
        xx, yy, xy = turned(vertical * K, vertical * v["L"], v["a"])
        return np.array([xx, yy, vertical, xy, 0 * xx, 0 * xx]) + tectonic(v)

    stress = check(found, by_hand)
    assert stress.n_outside == 0
    alike = on(solid(), in_situ=replace(model, K0_across=None, azimuth=None, tectonic=None),
               gravity=(0.0, 0.0, -10.0))  # fmt: skip
    columns = InSituStress(alike, places(alike, *WHERE)).columns(POINT)
    np.testing.assert_allclose(columns[0], columns[1], rtol=1e-12)
    K = np.array([0.5, 1.3, 2.6])
    np.testing.assert_allclose(columns[0, :, 0], K * columns[2, :, 0], rtol=1e-12)


def test_a_surface_below_the_top_of_the_mesh_takes_nothing_off():
    bare, low = (
        on(plane(), in_situ=GeostaticStress(Scalar(1.0), **cover), gravity=(0.0, -10.0))
        for cover in ({}, {"surface": Scalar(7.0), "cover": Scalar(2e4)})
    )
    stress, same = (InSituStress(one, places(one, *FLAT)).columns(POINT) for one in (bare, low))
    np.testing.assert_allclose(same, stress, rtol=1e-12)


def test_places_beside_the_surface_are_counted():
    """Faces of the top as far as x = 4 m give the level; what is further along has their edge's."""
    mesh = plane()
    top = mesh.facet_groups["y1"]
    centres = np.concatenate([mesh.points[f.nodes].mean(axis=1) for f in mesh.facets])
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, "part": top[centres[top, 0] < 4.0]})
    for model in (
        HeimStress(Scalar(1.0), unit_weight=Scalar(1.0), surface="part"),
        ProfileStress(components(), components(), "part"),
        GeostaticStress(Scalar(1.0), surface="part", cover=Scalar(1.0)),
    ):
        found = on(mesh, in_situ=model, gravity=(0.0, -10.0))
        assert InSituStress(found, places(found, *FLAT)).n_outside == 1
        assert InSituStress(found, places(found, *FLAT[:2])).n_outside == 0
    two = on(mesh, in_situ=HeimStress(Scalar(1.0), unit_weight=Scalar(1.0), surface="part"),
             in_situ_of={"east": ProfileStress(components(), components(), "part")})  # fmt: skip
    more = (*FLAT, ("clay", 5.0, 1.0))
    assert InSituStress(two, places(two, *more)).n_outside == 2


@pytest.mark.parametrize(
    ("model", "held"),
    [
        (None, False),
        (ConstantStress(components()), True),
        (ConstantStress(components(), held=False), False),
        (HeimStress(Scalar(1.0), vertical=Scalar(1.0)), True),
        (HeimStress(Scalar(1.0), unit_weight=Scalar(1.0), surface=Scalar(0.0)), False),
        (GeostaticStress(Scalar(1.0), held=True), True),
    ],
)
def test_stresses_that_the_edges_hold(model, held):
    assert edges_held(model) == held


def test_surfaces_that_the_mesh_lacks_and_zones_that_are_not_there():
    growth = Growth("rock", "E", Scalar(1e9), WithDepth(Scalar(1.0), "hill"), path=("materials",))
    water = Water("lake", Scalar(1.0))
    heavy = HeimStress(Scalar(1.0), unit_weight=Scalar(1.0), surface="ridge")
    found = on(
        solid(), in_situ=heavy, in_situ_of={"east": heavy, "clay": replace(heavy, surface="z1")},
        materials={**MATERIALS, "rock": replace(MATERIALS["rock"], growths=(growth,))},
        water=water, stages=(Stage("a"), Stage("b", water=replace(water, table="pond")),
                             Stage("c", water=replace(water, table="z1"))),
    )  # fmt: skip
    assert [(f.path, f.message.rpartition(" no ")[2]) for f in surface_faults(found)] == [
        ("in_situ.surface", "group of faces 'ridge'"),
        ("in_situ.groups.east.surface", "group of faces 'ridge'"),
        ("materials.surface", "group of faces 'hill'"),
        ("water.table", "group of faces 'lake'"),
        ("stages[1].water.table", "group of faces 'pond'"),
    ]
    assert zone_faults(found) == []
    gone = on(solid(), in_situ_of={"east": heavy}, groups={**GROUPS, "east": None})
    assert [fault.path for fault in zone_faults(gone)] == ["in_situ.groups.east"]
    assert surface_faults(on(plane(), analysis=Analysis.PLANE_STRAIN)) == []
