"""Points in elements: each is found, in the right one, with the shape functions there."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial import Delaunay
from support.meshes import KINDS, box, mixed_box

from geoident.fem.elements import reference_element
from geoident.fem.location import REACH, Locator
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh


@cache
def distorted(kind):
    if kind == "mixed":
        return mixed_box(1, distortion=0.1)
    return box(kind, (3,) * CELLS[kind].dim, distortion=0.15)


@pytest.mark.parametrize("kind", KINDS)
def test_inside_and_outside_are_told_on_the_reference_domain(kind):
    element = reference_element(kind)
    corners = np.array(CELLS[kind].shape.corners, float)
    hull = Delaunay(corners)
    random = np.random.default_rng(1)
    for xi in random.uniform(-1.4, 1.4, (150, element.dim)):
        assert (element.outside(xi) <= 0) == (hull.find_simplex(xi) >= 0)
    for corner in corners:
        assert element.outside(corner) == 0
    assert element.outside(corners.mean(axis=0)) < -0.1


@pytest.mark.parametrize("kind", [*KINDS, "mixed"])
def test_points_are_found_where_they_are(kind):
    mesh = distorted(kind)
    locator = Locator(mesh)
    for x in np.random.default_rng(2).uniform(0.0, 1.0, (20, mesh.dim)):
        site = locator.sites(tuple(x))[0]
        assert site.outside <= 1e-9
        assert site.shapes.sum() == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(site.shapes @ mesh.points[site.nodes], x, atol=1e-9)


@pytest.mark.parametrize("kind", [*KINDS, "mixed"])
def test_a_node_is_found_in_every_element_that_has_it(kind):
    """Also the apex of pyramids, where their functions have no derivatives."""
    mesh = distorted(kind)
    locator = Locator(mesh)
    corners = [block.nodes[:, : CELLS[block.kind].n_corners] for block in mesh.blocks]
    holders = np.concatenate([np.full(rows.size, 1) for rows in corners])
    nodes = np.concatenate([rows.ravel() for rows in corners])
    for node in np.random.default_rng(3).choice(np.unique(nodes), 6, replace=False):
        sites = [s for s in locator.sites(tuple(mesh.points[node])) if s.outside <= 1e-9]
        assert len(sites) == holders[nodes == node].sum()
        for site in sites:
            assert site.shapes[site.nodes == node] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("kind", [*KINDS, "mixed"])
def test_a_point_just_outside_is_taken_and_one_further_off_is_not(kind):
    mesh = distorted(kind)
    locator = Locator(mesh)
    near = np.full(mesh.dim, 0.41)
    near[0] = 1.0 + 0.005
    site = locator.sites(tuple(near))[0]
    assert 0 < site.outside <= REACH
    np.testing.assert_allclose(site.shapes @ mesh.points[site.nodes], near, atol=1e-9)
    assert locator.sites((1.3, *near[1:])) == ()


@pytest.mark.parametrize(
    ("kind", "xi", "outside"),
    [
        ("wedge6", (1 / 3, 1 / 3, 1.1), 0.05),  # above the triangle on top: parts of the height
        ("wedge6", (0.55, 0.55, 0.0), 0.1),  # beyond the slanting side
        ("pyramid5", (0.0, 0.0, -0.05), 0.05),  # below the base
        ("pyramid5", (0.6, 0.0, 0.5), 0.05),  # beyond a slanting face
        ("pyramid13", (0.0, 0.0, 1.05), 0.025),  # over the apex: beyond all slanting faces
    ],
)
def test_how_far_outside_is_in_parts_of_the_height_over_the_face(kind, xi, outside):
    element = reference_element(kind)
    assert element.outside(np.array(xi)) == pytest.approx(outside)
    nodes = element.nodes * [2.0, 3.0, 4.0] + 5.0
    mesh = Mesh(nodes, (ElementBlock(kind, np.arange(len(nodes))[None], np.array([1])),))
    (site,) = Locator(mesh).sites(tuple(np.array(xi) * [2.0, 3.0, 4.0] + 5.0))
    assert site.outside == pytest.approx(outside, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_points_are_found_in_small_elements_far_from_the_origin(kind):
    """Coordinates of a national grid, 5000 km, are rounded to 1e-9 m: 1e-7 of these elements."""
    mesh = distorted(kind)
    small = Mesh(5e6 + 0.03 * mesh.points, mesh.blocks)
    locator = Locator(small)
    for x in np.random.default_rng(4).uniform(5e6 + 0.001, 5e6 + 0.029, (20, mesh.dim)):
        site = locator.sites(tuple(x))[0]
        assert site.outside <= 1e-6
        local = small.points[site.nodes] - 5e6
        np.testing.assert_allclose(site.shapes @ local, x - 5e6, atol=1e-12)
