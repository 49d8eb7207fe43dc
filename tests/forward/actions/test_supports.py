"""Supports and loads on groups of a mesh: what they hold, what temperatures are, and faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import make_case, material, rollers
from support.meshes import box, regroup

from geoident.errors import InputError
from geoident.forward.actions.supports import (
    all_supports,
    fixed_dofs,
    group_nodes,
    support_nodes,
)
from geoident.forward.actions.thermal import interpolate
from geoident.forward.checks import check_on_mesh
from geoident.model.actions import PointForce, Pressure, TemperatureField
from geoident.model.case import Analysis, Stage, Support
from geoident.model.parameter import Scalar

ROCK = material("rock", 1e9, 0.25)


def _mesh(size=(4.0, 2.0)):
    mesh = regroup(box("quad4", (4, 2), size=size), fill=lambda x: x[:, 1] > 0.5 * size[1])
    return replace(mesh, node_groups={"pair": np.array([2, 7]), "outer": np.array([3])})


def _case(mesh, **changes):
    settings = {"materials": {"rock": ROCK}, "groups": {"rock": "rock", "fill": "rock"},
                "supports": rollers(2)}  # fmt: skip
    return make_case(mesh, **{**settings, **changes})


def _faults(mesh, **changes):
    with pytest.raises(InputError) as error:
        check_on_mesh(_case(mesh, **changes), mesh)
    return [(f.code, f.path, f.message, f.hint) for f in error.value.faults]


def test_groups_are_looked_for_among_faces_then_nodes_then_elements():
    mesh = _mesh()
    x, y = mesh.points.T
    assert group_nodes(mesh, "x1").tolist() == np.flatnonzero(x > 3.9).tolist()
    assert group_nodes(mesh, "pair").tolist() == [2, 7]
    outer = np.flatnonzero((x < 0.1) | (x > 3.9) | (y < 0.1) | (y > 1.9))
    assert group_nodes(mesh, "outer").tolist() == outer.tolist()
    assert group_nodes(mesh, "fill").tolist() == np.flatnonzero(y > 0.9).tolist()


@pytest.mark.parametrize(("part", "held"), [(0.9e-6, True), (1.1e-6, False)])
def test_a_support_at_a_point_holds_the_node_that_is_there(part, held):
    """To a millionth of the longer side of the mesh."""
    mesh = _mesh()
    node = int(np.linalg.norm(mesh.points - [3.0, 1.0], axis=1).argmin())
    for shift in ((4.0 * part, 0.0), (0.0, -4.0 * part)):
        at = (3.0 + shift[0], 1.0 + shift[1])
        found = support_nodes(mesh, Support("here", (0,), at=at))
        assert found.tolist() == ([node] if held else [])


def test_what_supports_hold_and_the_axis():
    mesh = _mesh()
    x, y = mesh.points.T
    supports = (Support("y0", (1,)), Support("pair", (0, 1)))
    for analysis in (Analysis.PLANE_STRAIN, Analysis.AXISYMMETRIC):
        on_mesh, _ = check_on_mesh(_case(mesh, supports=supports, analysis=analysis), mesh)
        exact = np.zeros((len(x), 2), dtype=bool)
        exact[y < 0.1, 1] = True
        exact[[2, 7]] = True
        if analysis is Analysis.AXISYMMETRIC:
            exact[x < 0.1, 0] = True
        np.testing.assert_array_equal(fixed_dofs(on_mesh), exact.ravel())


def test_groups_that_the_mesh_does_not_have_are_said():
    mesh = _mesh()
    force = PointForce("nothing", (Scalar(1.0), Scalar(0.0)))
    fine = PointForce("pair", (Scalar(1.0), Scalar(0.0)))
    found = _faults(
        mesh,
        supports=(*rollers(2), Support("side", (0,)), Support("here", (0,), at=(2.9, 1.1))),
        loads={"f": force, "g": fine, "q": Pressure("pair", Scalar(1.0))},
        stages=(Stage("one", loads={"p": Pressure("top", Scalar(1.0)), "e": PointForce("x0", (
            Scalar(1.0), Scalar(1.0)))}),),
    )  # fmt: skip
    faces = "its groups of faces: outer, x0, x1, y0, y1"
    both = "its groups of faces and nodes: outer, pair, x0, x1, y0, y1"
    name = mesh.file
    assert sorted(found) == sorted([
        ("missing-group", "supports.side", f"the mesh {name} has no group 'side'", both),
        ("no-node-there", "supports.here.at", f"no node of {name} is at (2.9, 1.1) m",
         "The nearest node is at (3, 1) m; write its coordinates."),
        ("missing-group", "loads.f.on", f"the mesh {name} has no group 'nothing'",
         "its groups of nodes: outer, pair"),
        ("missing-group", "loads.q.on", f"the mesh {name} has no group of faces 'pair'", faces),
        ("missing-group", "stages[0].loads.p.on", f"the mesh {name} has no group of faces 'top'",
         faces),
    ])  # fmt: skip


def test_loads_without_ground_or_a_free_face_are_said_of_the_stage():
    mesh = _mesh()
    on_fill = PointForce("pair", (Scalar(1.0), Scalar(0.0)))
    inner = np.flatnonzero(mesh.points[:, 1] > 1.9)[:2]
    mesh = replace(mesh, node_groups={"pair": inner})
    found = _faults(
        mesh,
        loads={"f": on_fill, "q": Pressure("y1", Scalar(1.0)), "p": Pressure("y0", Scalar(1.0))},
        stages=(Stage("wait"), Stage("dig", excavate=("fill",)), Stage("rest")),
    )
    assert sorted(found) == [
        ("no-free-face", "loads.q.on",
         "at stage 'dig' faces of 'y1' are not at the surface of the ground: elements stand on "
         "both sides, or on none",
         "let the load begin when the face is open, and 'remove' it before it is gone"),
        ("no-ground-there", "loads.f.on",
         "at stage 'dig' nodes of 'pair' lie in no ground that is present",
         "correct the place, or 'remove' the force before its ground is gone"),
    ]  # fmt: skip


TRIANGLE = TemperatureField(
    points=((0.0, 0.0), (4.0, 0.0), (0.0, 2.0), (4.0, 2.0)), values=(1.0, 9.0, 5.0, 13.0)
)


def test_temperatures_are_linear_between_points_and_the_nearest_beyond():
    places = np.array([[1.0, 0.5], [3.0, 1.75], [-1.0, 0.2], [9.0, 1.9]])
    np.testing.assert_allclose(interpolate(TRIANGLE, places), [4.0, 10.5, 1.0, 13.0])
    line = replace(TRIANGLE, points=((0.0, 0.0), (1.0, 1.0), (3.0, 3.0)), values=(1.0, 2.0, 7.0))
    np.testing.assert_array_equal(interpolate(line, places), [2.0, 7.0, 1.0, 7.0])
    one = replace(TRIANGLE, points=((0.0, 0.0),), values=(4.0,))
    np.testing.assert_array_equal(interpolate(one, places), [4.0] * 4)


def test_of_supports_of_one_name_the_last_counts():
    """By their groups: of the case, then of its stages; what lets go is none."""
    first, turned, later = Support("x0", (0,)), Support("y0", (1,)), Support("x0", (0, 1))
    case = _case(
        _mesh(),
        supports=(first, turned),
        stages=(Stage("one", supports={"x0": None}), Stage("two", supports={"x0": later})),
    )
    assert all_supports(case) == (later, turned)
    assert all_supports(replace(case, stages=())) == (first, turned)
