"""What lies near what is found as by comparing all with all."""

import numpy as np
import pytest

from geoident.fem.near import pairs_within, points_in_boxes


def test_points_far_off_are_in_no_box_without_an_overflow():
    """A coordinate in a wrong unit; warnings are errors here."""
    low = np.array([[0.0, 0.0]])
    row, box = points_in_boxes(np.array([[1e308, 0.5], [0.5, 0.5]]), low, low + 1.0)
    assert (row.tolist(), box.tolist()) == ([1], [0])


def compared(points, low, high):
    inside = np.all((points[:, None] >= low) & (points[:, None] <= high), axis=2)
    return {(int(p), int(b)) for p, b in np.argwhere(inside)}


def as_pairs(first, second):
    pairs = list(zip(first.tolist(), second.tolist(), strict=True))
    assert len(set(pairs)) == len(pairs)
    return set(pairs)


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 7, 800])
def test_points_are_found_in_all_boxes_that_hold_them(dim, n):
    random = np.random.default_rng(dim * 1000 + n)
    points = random.uniform(-3.0, 5.0, (n, dim))
    low = random.uniform(-4.0, 5.0, (900, dim))
    high = low + random.exponential(0.3, (900, dim))
    low[:30] -= 20.0
    high[:15] += 40.0  # larger than all of them, and beside them
    assert as_pairs(*points_in_boxes(points, low, high)) == compared(points, low, high)


def test_points_on_borders_of_boxes_and_cells_belong_to_them():
    axis = np.arange(9.0)
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    low = points[np.all(points < 8.0, axis=1)]
    found = as_pairs(*points_in_boxes(points, low, low + 1.0))
    assert found == compared(points, low, low + 1.0)
    assert len(found) == 8 * len(low)
    flat = np.array([[1.0, 2.0, 3.0]] * 4)  # all at one place: the grid has no extent
    assert as_pairs(*points_in_boxes(flat, flat[:1], flat[:1])) == {(n, 0) for n in range(4)}


@pytest.mark.parametrize("dim", [2, 3])
def test_pairs_at_one_place_are_those_of_all_distances(dim):
    random = np.random.default_rng(dim)
    grid = np.stack(np.meshgrid(*[np.arange(12.0)] * dim), axis=-1).reshape(-1, dim)
    extra = random.permutation(grid)[:60] + random.uniform(-6e-4, 6e-4, (60, dim))
    points = random.permutation(np.concatenate([grid, extra, extra[:9] + 5e-4]))
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    expected = {(int(i), int(j)) for i, j in np.argwhere(apart <= 1e-3) if i < j}
    assert 60 < len(expected) < 90
    pairs = pairs_within(points, 1e-3)
    assert {tuple(pair) for pair in pairs.tolist()} == expected
    assert pairs.tolist() == sorted(pairs.tolist())
