"""Cuts, outlines and averages against what is known of squares and cubes."""

from dataclasses import replace

import numpy as np
import pytest
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from geoident.fem.faces import face_table
from geoident.model.case import Stage
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.results.result import FieldSeries
from geoident.report.drawing.model.figure import model_figure
from geoident.report.drawing.scene import Scene, principal_stresses, round_down
from geoident.report.drawing.sheets import Plane, SheetMaker
from geoident.report.drawing.solid import _means, _View, surface_figure
from geoident.report.drawing.style import MM
from tests.support.cases import make_case, material, rollers
from tests.support.meshes import KINDS_2D, KINDS_3D, box, mixed_box
from tests.support.results import example_result, grid_mesh


def area(sheet, keep=slice(None)):
    corners = sheet.xy[sheet.triangles[keep]]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return float(0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())


def length(trace, points):
    ends = trace.at(points)
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


@pytest.mark.parametrize("height", [0.1, 0.5, 0.8])
def test_a_tetrahedron_is_cut_in_a_triangle_similar_to_its_base(height):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    mesh = Mesh(points, (ElementBlock("tet4", np.array([[0, 1, 2, 3]]), np.array([1])),))
    sheet = SheetMaker(mesh).cut(Plane(2, height))
    assert area(sheet) == pytest.approx(0.5 * (1 - height) ** 2)


def test_a_plane_between_two_edges_cuts_a_tetrahedron_in_a_quadrilateral():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1], [0, -1, 1]], dtype=float)
    mesh = Mesh(points, (ElementBlock("tet4", np.array([[0, 1, 2, 3]]), np.array([1])),))
    sheet = SheetMaker(mesh).cut(Plane(2, 0.5))
    assert len(sheet.triangles) == 2
    assert area(sheet) == pytest.approx(0.5)  # 0.5 along x by 1 along y


@pytest.mark.parametrize("kind", KINDS_3D)
@pytest.mark.parametrize("plane", [Plane(0, 0.37), Plane(1, 0.5), Plane(2, 1e-6)])
def test_a_cut_through_a_box_has_its_area_outline_and_linear_fields(kind, plane):
    mesh = box(kind, (2, 3, 4), size=(1.0, 2.0, 3.0), distortion=0.1)
    sheet = SheetMaker(mesh).cut(plane)
    sides = [(1.0, 2.0, 3.0)[axis] for axis in plane.axes]
    everything = np.ones(mesh.n_elements, dtype=bool)
    if kind.startswith("tet") or plane.value < 1e-3:  # distorted hexahedra have no flat faces
        assert area(sheet) == pytest.approx(sides[0] * sides[1])
    assert length(sheet.outline(everything), mesh.points) == pytest.approx(2 * sum(sides))
    found = sheet.of_nodes(mesh.points @ [1.0, 2.0, 3.0] + 4.0)
    across, up = plane.axes
    at = np.empty((len(found), 3))
    at[:, [across, up]], at[:, plane.axis] = sheet.xy, plane.value
    np.testing.assert_allclose(found, at @ [1.0, 2.0, 3.0] + 4.0, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS_2D)
def test_a_plane_mesh_is_its_own_sheet(kind):
    mesh = box(kind, (3, 2), size=(3.0, 2.0), distortion=0.1)
    sheet = SheetMaker(mesh).flat()
    assert area(sheet) == pytest.approx(6.0)
    assert length(sheet.outline(np.ones(mesh.n_elements, dtype=bool)), mesh.points) == (
        pytest.approx(10.0)
    )


@pytest.mark.parametrize("kind", ["quad8", "tri6"])
def test_curved_elements_are_drawn_curved(kind):
    """A quarter of a ring: area and outline, where corners alone would miss 4 % of the area."""
    straight = box(kind, (2, 3), size=(1.0, 1.0))
    r, angle = 1.0 + straight.points[:, 0], np.pi / 2 * straight.points[:, 1]
    mesh = replace(straight, points=np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1))
    sheet = SheetMaker(mesh).flat()
    assert area(sheet) == pytest.approx(0.75 * np.pi, rel=0.012)
    outline = sheet.outline(np.ones(mesh.n_elements, dtype=bool))
    assert length(outline, mesh.points) == pytest.approx(1.5 * np.pi + 2.0, rel=0.004)


@pytest.mark.parametrize("kind", ["tet10", "hex20", "wedge15"])
def test_quadratic_fields_are_followed_inside_elements(kind):
    mesh = box(kind, (1, 1, 1), size=(1.0, 1.0, 1.0))
    sheet = SheetMaker(mesh).cut(Plane(2, 0.4))
    assert len(sheet.triangles) > 8
    found = sheet.of_nodes(mesh.points[:, 0] ** 2)
    middle = sheet.xy[:, 0]
    assert np.abs(found - middle**2).mean() < 0.04  # 0.12 from the corners alone


def test_the_outline_follows_what_is_dug():
    mesh = grid_mesh(2)  # 20 m square of 2 m elements
    present = np.ones(mesh.n_elements, dtype=bool)
    present[mesh.groups["upper"]] = False  # from 6 m to 14 m, 4 m deep
    sheet = SheetMaker(mesh).flat()
    assert length(sheet.outline(present), mesh.points) == pytest.approx(80.0 + 2 * 4.0)
    assert area(sheet, present[sheet.element]) == pytest.approx(400.0 - 8.0 * 4.0)


def test_groups_meet_at_borders_and_only_there():
    mesh = grid_mesh(2)
    maker = SheetMaker(mesh)
    borders = maker.flat().borders(maker.label)
    assert length(borders, mesh.points) == pytest.approx(8.0 + 2 * 4.0 + 2 * 4.0 + 8.0)
    assert length(maker.flat().borders(np.zeros(mesh.n_elements)), mesh.points) == 0.0


def test_averages_jump_between_groups_and_nowhere_else():
    mesh = grid_mesh(2)
    maker = SheetMaker(mesh)
    values = np.full(mesh.n_elements, 5.0)
    values[mesh.groups["upper"]] = 1.0
    present = np.ones(mesh.n_elements, dtype=bool)
    found = maker.corners.average(values, present)
    assert set(found) == {1.0, 5.0}
    present[mesh.groups["upper"]] = False
    assert np.isnan(maker.corners.average(values, present)).sum() == 5 * 3


def test_principal_stresses_are_those_of_mohrs_circle():
    stress = example_result(2).fields.stress[1]
    xx, yy, zz, xy = np.moveaxis(stress[:, :4], -1, 0)
    centre, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    known = np.isfinite(xx)
    expected = np.sort(np.stack([centre - radius, centre + radius, zz], axis=1)[known], axis=1)
    found = principal_stresses(stress)
    np.testing.assert_allclose(found[known], expected, rtol=1e-10)
    turned = stress[:, [2, 0, 1, 5, 3, 4]]  # the same tensors, with x, y, z renamed
    np.testing.assert_allclose(principal_stresses(turned)[known], expected, rtol=1e-10)


def test_stresses_of_a_section_are_means_over_all_elements_around_it():
    result = example_result(3)
    scene = Scene(result, result.fields)
    every = principal_stresses(result.fields.stress)
    present = result.fields.present
    for view in scene.views:
        sheet = view.sheet
        assert 0 < len(sheet.elements_behind) < result.fields.mesh.n_elements
        for state in range(scene.n_states):
            for which in (0, 2):
                means = sheet.corners.average(every[state, :, which], present[state])
                expected = sheet.of_corners(means)
                np.testing.assert_array_equal(view.stress(state, which), expected)


def test_the_stress_of_ground_that_is_gone_is_not_shown():
    result = example_result(2)
    scene = Scene(result, result.fields)
    (view,) = scene.views
    sheet = view.sheet
    for state in range(scene.n_states):
        gone = ~result.fields.present[state][sheet.element]
        inside = sheet.triangles[~gone]
        values = view.stress(state, 0)
        assert np.isfinite(values[inside]).all()
        assert gone.any() == np.isnan(values).any()


def test_sections_go_through_the_gauges():
    result = example_result(3)
    scene = Scene(result, result.fields)
    assert str(scene.views[0].sheet.plane) == "y = 10 m"
    assert len(scene.views) == 2


def test_gauge_points_move_with_the_ground_and_not_where_it_is_gone():
    result = example_result(2)
    scene = Scene(result, result.fields)
    points, motion = scene.gauge_motion
    mesh = result.fields.mesh
    for point, moved in zip(points, np.moveaxis(motion, 1, 0), strict=True):
        node = np.flatnonzero(np.linalg.norm(mesh.points - point, axis=1) < 1e-9)
        if node.size:
            np.testing.assert_allclose(moved, scene.fields.displacement[:, node[0]], atol=1e-15)
    present = np.zeros_like(result.fields.present)
    present[0] = True
    fields = type(result.fields)(
        mesh, result.fields.displacement, result.fields.stress, present, result.fields.yielded
    )
    assert np.isnan(Scene(result, fields).gauge_motion[1][1:]).all()


def test_magnifications_are_round():
    assert [round_down(v) for v in (1.0, 1.99, 2.0, 4.9, 5.0, 99.0, 0.5)] == [
        1.0, 1.0, 2.0, 2.0, 5.0, 50.0, 0.5,
    ]  # fmt: skip


@pytest.mark.parametrize("order", [1, 2])
def test_solids_of_all_kinds_are_cut_and_drawn_together(order):
    mesh = mixed_box(order, distortion=0.1)
    everything = np.ones(mesh.n_elements, dtype=bool)
    for plane in (Plane(0, 0.1), Plane(0, 0.6), Plane(1, 0.47), Plane(2, 0.81)):
        sheet = SheetMaker(mesh).cut(plane)
        assert length(sheet.outline(everything), mesh.points) == pytest.approx(4.0)
        assert area(sheet) == pytest.approx(1.0, rel=0.02)  # distorted hexahedra have no flat faces
        found = sheet.of_nodes(mesh.points @ [1.0, 2.0, 3.0])
        at = np.full((len(found), 3), plane.value)
        at[:, list(plane.axes)] = sheet.xy
        np.testing.assert_allclose(found, at @ [1.0, 2.0, 3.0], rtol=1e-9)


def test_the_surface_of_solids_of_all_kinds_is_drawn_face_by_face():
    mesh = mixed_box(1)
    mesh = replace(mesh, points=20.0 * mesh.points)
    zeros = np.zeros((4, mesh.n_elements, 6))
    displacement = np.linspace(0, 1e-2, 4)[:, None, None] * mesh.points
    present = np.ones((4, mesh.n_elements), dtype=bool)
    present[1:, -4:] = False
    fields = FieldSeries(mesh, displacement, zeros, present, np.zeros_like(present))
    result = example_result(3)
    scene = Scene(replace(result, fields=fields), fields)
    table = face_table(mesh)
    for opened in (None, scene.views[0].sheet):
        figure = surface_figure(scene, opened, 0.0)
        figure.draw_without_rendering()
        (drawn,) = [c for c in figure.axes[-2].collections if isinstance(c, Poly3DCollection)]
        assert len(drawn.get_facecolor()) >= len(table.free(present[-1])) or opened is not None


@pytest.mark.parametrize("kind", ["tet4", "tet10", "hex8", "wedge6"])
def test_what_is_opened_is_closed_by_flat_cuts(kind):
    """The surface of the part that is left is that of a box, whatever the elements."""
    mesh = box(kind, (5, 4, 3), size=(20.0, 20.0, 20.0))
    zeros, present = np.zeros((2, mesh.n_elements, 6)), np.ones((2, mesh.n_elements), bool)
    motion = np.stack([0 * mesh.points, 1e-3 * mesh.points])
    fields = FieldSeries(mesh, motion, zeros, present, np.zeros_like(present))
    scene = Scene(replace(example_result(3), fields=fields), fields)
    view = _View(scene, scene.section(Plane(0, 7.3)))
    sides = view.box[1] - view.box[0]
    exact = 2 * (sides[0] * sides[1] + sides[1] * sides[2] + sides[0] * sides[2])
    polygons = view.polygons(1)
    open_sides = [
        axis for axis in range(3) for end in (0, 1)
        if abs(view.box[end][axis] - (0.0, 20.0)[end]) > 1e-9
        and all(sheet.plane != Plane(axis, view.box[end][axis]) for sheet in view.cuts)
    ]  # fmt: skip
    behind = sum(np.prod(np.delete(sides, axis)) for axis in open_sides)  # turned from the eye
    assert _means(polygons)[1].sum() == pytest.approx(exact - behind)
    value = MM * 1e-3 * np.linalg.norm(polygons.points[:, :, :3], axis=2)
    linear = np.abs(polygons.points[:, :, 6] - value)[polygons.filled]
    assert linear.max() < 0.35  # the size of a linear field is not linear
    areas = [_means(part)[1].sum() for _, part in polygons.in_bands(6, np.arange(0.0, 40.0, 3.0))]
    assert sum(areas) == pytest.approx(exact - behind)


def test_faces_of_all_kinds_hide_each_other_in_the_picture_of_a_case():
    """Those of each kind in a collection of their own would all lie over those of the others."""
    mesh = mixed_box(1)
    case = make_case(
        mesh,
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=rollers(3),
        stages=(Stage("nothing"),),
    )
    axes = model_figure(case, mesh).axes[0]
    (faces,) = [c for c in axes.collections if isinstance(c, Poly3DCollection)]
    table = face_table(mesh)
    assert len(faces.get_facecolor()) == len(table.free(np.ones(mesh.n_elements, dtype=bool)))
