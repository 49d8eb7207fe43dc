"""Even spreads: every direction fills the widest hole; and how far facets are from round."""

from __future__ import annotations

from itertools import product
from math import cos, pi, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoident.forward.yielding.facets import (
    deviator_basis,
    polygon_shrinkage,
    principal_values,
    shrinkage,
    spread_deviators,
    spread_directions,
    spread_frames,
)

SPREADS = {
    "directions": (spread_directions, ()),
    "deviators of a section": (spread_deviators, (4,)),
    "deviators of a solid": (spread_deviators, (6,)),
}


def signs(d):
    """Changes of sign of coordinates that mirror images in the axes of the model make."""
    if d == 3:
        return np.array(list(product((1.0, -1.0), repeat=3)))
    # shears xy, yz, xz change sign with two of x, y, z; a deviator may also be turned round
    axes, both = product((1.0, -1.0), repeat=3), (1.0, -1.0)
    return np.array([[b, b, b * x * y, b * y * z, b * x * z] for x, y, z in axes for b in both])


def on_sphere(d, count=40_000):
    draws = np.random.default_rng(11).normal(size=(count, d))
    return draws / np.linalg.norm(draws, axis=1)[:, None]


@pytest.mark.parametrize("name", SPREADS)
def test_each_direction_comes_with_its_mirror_images_into_the_widest_hole(name):
    """No direction of many drawn is farther from all before than the one that came next."""
    spread, more = SPREADS[name]
    points = spread(60, *more)
    d = points.shape[1]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(points[: 2 * d], np.vstack([np.eye(d), -np.eye(d)]))
    nearest = np.sort(points @ points.T, axis=1)[:, -2]
    assert nearest.max() < 1.0 - 1e-6  # no two are the same
    drawn, at = on_sphere(d), 2 * d
    while at < len(points):
        images = signs(d) * points[at]
        around = points[at:] @ images.T > 1.0 - 1e-9
        orbit = int(np.argmin(np.append(around.any(axis=1), False)))
        assert len({tuple(np.round(image, 9) + 0.0) for image in images}) == orbit
        assert around[:orbit].any(axis=0).all()
        hole = (points[:at] @ points[at]).max()
        assert (drawn @ points[:at].T).max(axis=1).min() > hole - 1e-9
        at += orbit


def test_there_are_as_many_directions_as_asked_for_and_not_one_orbit_more():
    wanted = {1: 6, 6: 6, 7: 14, 14: 14, 15: 18}
    assert {n: len(spread_directions(n)) for n in wanted} == wanted
    corners = np.array(list(product((1.0, -1.0), repeat=3))) / sqrt(3.0)
    np.testing.assert_allclose(spread_directions(14)[6:], corners, rtol=1e-12)
    assert spread_deviators(7, 4).shape == (14, 3)
    assert spread_deviators(10, 6).shape == (10, 5)
    # of several holes that are as wide the highest comes first, of these the one along y
    first = spread_directions(15)[14]
    assert first[0] == 0.0
    assert 0.0 < first[1] < first[2]


def between(frames, others):
    """Largest cosines of half the angle between frames (n, m), by all ways to name their axes."""
    names = Rotation.create_group("O").as_matrix()
    ways = np.einsum("gij,mkj->gmik", names, others)
    traces = np.einsum("nij,gmji->ngm", frames, ways)
    return np.sqrt(np.maximum(0.0, (1.0 + traces.max(axis=1)) / 4.0))


def test_each_frame_comes_with_its_half_turns_into_the_widest_hole():
    frames = spread_frames(10)
    assert len(frames) == 10
    np.testing.assert_array_equal(frames[0], np.eye(3))
    np.testing.assert_allclose(
        frames @ frames.transpose(0, 2, 1), np.eye(3)[None] + 0 * frames, atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, rtol=1e-12)
    near = between(frames, frames) - np.eye(len(frames))
    assert near.max() < 1.0 - 1e-4  # no two have the same axes
    for turn in (np.diag(s) for s in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1])):
        np.testing.assert_allclose(between(turn @ frames, frames).max(axis=1), 1.0, rtol=1e-9)
    drawn = Rotation.random(1500, rng=np.random.default_rng(4)).as_matrix()
    held = between(drawn, frames)
    covered = [held[:, :k].max(axis=1).min() for k in (1, 2)]
    assert covered[0] > between(frames[1:2], frames[:1])[0, 0] - 1e-9
    # what is left uncovered by all of them is less wide than what the last one was put into
    assert held.max(axis=1).min() > between(frames[-1:], frames[:-1]).max() - 0.02
    assert [len(spread_frames(n)) for n in (1, 2, 5, 18)] == [1, 3, 5, 18]


# --- how far facets are from round ---


def tensor_of(row):
    """What a row of products with a stress is as a tensor: shears are in it twice."""
    xx, yy, zz, *shear = row
    xy, yz, xz = (half / 2.0 for half in (*shear, 0.0, 0.0)[:3])
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("n_strain", [4, 6])
def test_coordinates_of_deviators_are_orthonormal_as_tensors(n_strain):
    basis = deviator_basis(n_strain)
    assert basis.shape == (n_strain - 1, n_strain)
    tensors = [tensor_of(row) for row in basis]
    products = [[np.sum(a * b) for a in tensors] for b in tensors]
    np.testing.assert_allclose(products, np.eye(n_strain - 1), atol=1e-15)
    assert max(abs(np.trace(tensor)) for tensor in tensors) < 1e-15
    np.testing.assert_allclose(basis[0, :3], np.array([1, -1, 0]) / sqrt(2))
    np.testing.assert_allclose(basis[1, :3], np.array([-1, -1, 2]) / sqrt(6))
    np.testing.assert_allclose(np.diag(basis[2:, 3:]), sqrt(2.0))


def test_principal_values_are_those_of_the_tensor_of_the_coordinates():
    rng = np.random.default_rng(8)
    tensors = rng.normal(size=(6, 3, 3))
    tensors = tensors + tensors.transpose(0, 2, 1)
    tensors -= np.trace(tensors, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3.0
    stress = np.stack(
        [tensors[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))]
    )
    found = principal_values((deviator_basis(6) @ stress).T)
    np.testing.assert_allclose(found, np.linalg.eigvalsh(tensors), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("sides", [3, 4, 7, 20])
def test_a_polygon_is_shrunk_by_what_its_sides_reach(sides):
    """Least and mean, over all directions, of the largest product with a direction of a side."""
    turns = np.linspace(0.0, 2 * pi, 200 * sides, endpoint=False) + pi / (200 * sides)
    reached = np.cos(turns[:, None] - 2 * pi * np.arange(sides) / sides).max(axis=1)
    assert polygon_shrinkage(sides, "inscribed") == pytest.approx(cos(pi / sides), rel=1e-14)
    assert polygon_shrinkage(sides, "inscribed") == pytest.approx(reached.min(), rel=1e-2)
    assert polygon_shrinkage(sides, "best") == pytest.approx(reached.mean(), rel=1e-4)
    assert polygon_shrinkage(sides, "circumscribed") == 1.0


def length(x):
    return np.linalg.norm(x, axis=1)


@pytest.mark.parametrize("n_strain", [4, 6])
def test_facets_along_the_coordinates_are_shrunk_by_what_a_cross_reaches(n_strain):
    """The largest |x_i| on the sphere of d dimensions: 1 / sqrt d at least; its mean by drawing."""
    d = n_strain - 1
    normals = np.vstack([np.eye(d), -np.eye(d)]) @ deviator_basis(n_strain)
    # from products with a stress, where shears count once, back to tensors
    inside = shrinkage("inscribed", normals, length)
    assert inside == pytest.approx(1.0 / sqrt(d), rel=1e-12)
    mean = np.abs(on_sphere(d)).max(axis=1).mean()
    assert shrinkage("best", normals, length) == pytest.approx(mean, rel=4e-3)
    assert shrinkage("circumscribed", normals, length) == 1.0
    # all sizes are measured by the surface: one twice as large is reached half as far
    doubled = shrinkage("inscribed", normals, lambda x: 2.0 * length(x))
    assert doubled == pytest.approx(0.5 * inside, rel=1e-12)
    # and facets of another size by as much more
    assert shrinkage("inscribed", 1.7 * normals, length) == pytest.approx(1.7 * inside, rel=1e-12)
    ellipsoid = np.linspace(1.0, 2.0, d)
    longer = shrinkage("inscribed", normals, lambda x: length(x * ellipsoid))
    assert longer == pytest.approx(1.0 / np.linalg.norm(ellipsoid), rel=1e-12)


def test_the_size_of_a_round_surface_is_the_same_on_every_machine():
    """The draws of the mean are fixed ones: what is planned with one version is so in the next."""
    normals = np.vstack([np.eye(3), -np.eye(3)]) @ deviator_basis(4)
    assert shrinkage("best", normals, length) == pytest.approx(0.8315181565358089, rel=1e-12)
