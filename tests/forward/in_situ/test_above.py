"""What stands above places: loads on slopes, edges of bodies, and many places at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import NOWHERE, make_case, material
from support.meshes import box, regroup

from geoident.forward.in_situ.overburden import Overburden
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import HeadLine, Pressure, Traction, WaterPressure
from geoident.model.case import Analysis
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Scalar

ROCK, CLAY = material("rock", 1e9, 0.2, 2500.0), material("clay", 1e8, 0.3, 1900.0)
SLOPE = np.array([0.3, -0.2])
"""Rise of the upper face along x and y."""


def sloping(kind: str, n: int = 2):
    """A box from 0 to 1 and 0 to 2 in plan, from level 0 to 3 at its corner, sloping on top."""
    dim = 2 if kind in ("tri3", "quad8", "tri6") else 3
    mesh = box(kind, (n, n + 1, n + 2)[:dim], size=(1.0, 2.0, 3.0) if dim == 3 else (1.0, 3.0))
    lift = 1 + mesh.points[:, :-1] @ SLOPE[: dim - 1] / 3.0
    points = np.column_stack([mesh.points[:, :-1], mesh.points[:, -1] * lift])
    return replace(mesh, points=points)


def top_at(plan):
    return 3.0 + plan @ SLOPE[: plan.shape[-1]]


def above(mesh, places, *, elements=None, **changes):
    dim = mesh.dim
    settings = {
        "materials": {"rock": ROCK, "clay": CLAY},
        "groups": {"all": "rock"},
        "gravity": (*(0.0,) * (dim - 1), -10.0),
        "analysis": Analysis.SOLID if dim == 3 else Analysis.PLANE_STRAIN,
    }
    case = make_case(mesh, **{**settings, **changes})
    return Overburden(CaseOnMesh(case, mesh)).above(np.asarray(places), elements), case


def places_in(mesh, count=12):
    part = np.random.default_rng(3).uniform(0.03, 0.97, (count, mesh.dim))
    plan = part[:, :-1] * np.array([1.0, 2.0])[: mesh.dim - 1]
    return np.column_stack([plan, part[:, -1] * top_at(plan)])


KINDS = ("tri3", "quad8", "hex8", "tet10", "wedge6")


@pytest.mark.parametrize("kind", KINDS)
def test_loads_on_a_slope_are_counted_per_area_in_plan(kind):
    """A pressure p presses p per area in plan; a traction t on the slope t / cos of it."""
    mesh = sloping(kind)
    dim, places = mesh.dim, places_in(mesh)
    face = f"{'xyz'[dim - 1]}1"
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, face: _top(mesh)})
    plan, steep = places[:, :-1], np.sqrt(1.0 + (SLOPE[: dim - 1] ** 2).sum())
    ground = 25e3 * (top_at(plan) - places[:, -1])
    point = ParameterPoint({"q": 2.0, "w": 1.5}, ("q", "w"))
    for load, pressure, slope in (
        (Pressure(face, Scalar(3e3, "q")), 6e3 + 0.0 * ground, (3e3, 0.0)),
        (Traction(face, (*(Scalar(9e3),) * (dim - 1), Scalar(-4e3, "q"))),
         8e3 * steep + 0.0 * ground, (4e3 * steep, 0.0)),
        (WaterPressure(face, Scalar(3.1, "q"), Scalar(1e4, "w")),
         1.5e4 * np.maximum(6.2 - top_at(plan), 0.0), (3.1 * 1.5e4, 1e4 * (6.2 - top_at(plan)))),
    ):  # fmt: skip
        found, case = above(mesh, places, loads={"fill": load})
        weight = found.weight(case, point)
        np.testing.assert_allclose(weight.value, ground + pressure, rtol=1e-9)
        for column, exact in zip((1, 2), slope, strict=True):
            np.testing.assert_allclose(
                weight.columns[:, column], exact + 0.0 * ground, rtol=1e-9, atol=1e-6
            )
    np.testing.assert_allclose(found.top, top_at(plan), rtol=1e-9)
    assert not found.uncovered.any()


def _top(mesh):
    """Rows of the facets all of whose nodes are on the slope."""
    rows, first = [], 0
    for block in mesh.facets:
        x = mesh.points[block.nodes]
        on = np.abs(x[..., -1] - top_at(x[..., :-1])) < 1e-9
        rows.append(first + np.flatnonzero(on.all(axis=1)))
        first += len(block)
    return np.concatenate(rows)


def test_water_that_falls_along_a_slope_presses_by_its_level_there():
    mesh = sloping("hex8")
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, "z1": _top(mesh)})
    places = places_in(mesh)
    falls = HeadLine((0.0, 0.0, 0.0), (0.0, 2.0, 0.0), Scalar(3.4))
    load = WaterPressure("z1", Scalar(5.0), Scalar(1e4), falls)
    found, case = above(mesh, places, loads={"lake": load}, gravity=None)
    level = 5.0 - 0.8 * places[:, 1]
    exact = 1e4 * np.maximum(level - top_at(places[:, :-1]), 0.0)
    np.testing.assert_allclose(found.weight(case, NOWHERE).value, exact, rtol=1e-9)
    assert (exact > 0.0).all()


@pytest.mark.parametrize("across", [0, 1])
def test_a_slice_of_one_element_has_its_own_height_above_each_place(across):
    """Faces as wide as the model, which reach places at both of its edges."""
    n, size = [7, 7, 3], [7.0, 7.0, 3.0]
    n[across] = 1
    mesh = box("hex8", n, size=size)
    x = [np.linspace(0.4, side - 0.4, 20) for side in size]
    places = np.stack(np.meshgrid(*x), axis=-1).reshape(-1, 3)
    found, _ = above(mesh, places, groups={"all": "rock"})
    lengths = found.lengths[:, found.materials.index("rock")].toarray()
    np.testing.assert_allclose(lengths.ravel(), 3.0 - places[:, 2], rtol=1e-9)


def test_places_on_the_border_of_an_element_see_what_is_above_that_element():
    """The line between two columns: of the left element that of the left ground, else the right."""
    mesh = box("quad4", (2, 3), size=(2.0, 3.0))
    mesh = regroup(mesh, left=lambda c: c[:, 0] < 1.0)
    groups = {"left": "clay", "rock": "rock"}
    centres = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    low = np.flatnonzero(centres[:, 1] < 1.0)
    low = low[np.argsort(centres[low, 0])]
    found, _ = above(mesh, [[1.0, 0.5]] * 2, elements=low, groups=groups)
    lengths = found.lengths.toarray()
    np.testing.assert_allclose(lengths[:, found.materials.index("clay")], [2.5, 0.0], rtol=1e-9)
    np.testing.assert_allclose(lengths[:, found.materials.index("rock")], [0.0, 2.5], rtol=1e-9)
    corner, _ = above(mesh, [[0.0, 0.5], [2.0, 0.5]], elements=low, groups=groups)
    np.testing.assert_allclose(corner.lengths.sum(axis=1), 2.5, rtol=1e-9)
