"""What makes bases of columns: orthonormal ones, triangular factors, loads of one each."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.forward.reduced import projection as under_test
from geoident.forward.reduced.projection import (
    GalerkinProjection,
    orthonormal_columns,
    triangular_factor,
)


def test_columns_of_any_size_are_made_orthonormal_without_those_that_depend():
    random = np.random.default_rng(5)
    free = random.standard_normal((11, 4)) * np.array([1e6, 1.0, 3e4, 2e5])
    depends = free @ np.array([[2.0, 0.0], [1.0, -1.0], [0.0, 0.5], [-3.0, 1.0]])
    columns = np.hstack([free[:, :2], depends[:, :1], free[:, 2:], depends[:, 1:]])
    turn = orthonormal_columns(columns)
    assert turn.shape == (6, 4)
    Q = columns @ turn
    np.testing.assert_allclose(Q.T @ Q, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(Q @ (Q.T @ columns), columns, atol=1e-9 * np.abs(columns).max())


def test_nearly_dependent_columns_are_orthogonal_too():
    random = np.random.default_rng(6)
    one, other = random.standard_normal((2, 9))
    turn = orthonormal_columns(np.stack([one, one + 3e-9 * other, other + 1e-7 * one], axis=1))
    columns = np.stack([one, one + 3e-9 * other, other + 1e-7 * one], axis=1) @ turn
    np.testing.assert_allclose(columns.T @ columns, np.eye(turn.shape[1]), atol=1e-12)


@pytest.mark.parametrize(("new", "count"), [(0.9e-3, 2), (1.1e-3, 3)])
def test_how_much_of_a_column_must_be_new(new, count):
    """Relative to its size; of three directions, each ten times the one before."""
    columns = np.diag([1.0, 0.1, 1.0]) @ np.array(
        [[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, new]]
    )
    assert orthonormal_columns(columns, 1e-3).shape == (3, count)
    assert orthonormal_columns(columns).shape == (3, 3)


@pytest.mark.parametrize(("size", "count"), [(0.9e-5, 1), (1.1e-5, 2)])
def test_small_columns_may_be_noise(size, count):
    """What is smaller than a hundredth of the largest counts as that part of it."""
    columns = np.array([[7.0, 0.0], [0.0, 7.0 * size], [0.0, 0.0]])
    assert orthonormal_columns(columns, 1e-3).shape == (2, count)
    assert orthonormal_columns(columns[:, 1:], 1e-3).shape == (1, 1)


@pytest.mark.parametrize(("new", "count"), [(0.9e-10, 1), (1.1e-10, 2)])
def test_what_is_new_is_judged_to_a_part_in_ten_thousand_millions(new, count):
    assert orthonormal_columns(np.array([[2.0, 3.0], [0.0, 3.0 * new]])).shape == (2, count)


def test_of_nothing_there_is_no_column():
    assert orthonormal_columns(np.zeros((4, 3))).shape == (3, 0)
    assert orthonormal_columns(np.zeros((4, 0))).shape == (0, 0)


@pytest.mark.parametrize(("rows", "columns"), [(3, 5), (500, 3), (513, 3), (2100, 7), (700, 300)])
def test_a_triangular_factor_has_the_products_of_the_columns(rows, columns):
    matrix = np.random.default_rng(rows).standard_normal((rows, columns))
    R = triangular_factor(matrix)
    assert R.shape == (min(rows, columns), columns)
    np.testing.assert_allclose(R.T @ R, matrix.T @ matrix, atol=1e-10 * rows)
    assert not np.tril(R, -1).any()


def test_points_are_taken_some_at_a_time_and_as_slices_where_they_stand_together():
    points = np.concatenate([np.arange(5, 1029), np.arange(1030, 2053), [2060], [3000, 3001]])
    runs = list(under_test._runs_of(points))
    assert runs[0] == slice(5, 1029)
    np.testing.assert_array_equal(runs[1], points[1024:2048])
    assert runs[2] == slice(3000, 3002)
    assert len(runs) == 3
    assert list(under_test._runs_of(np.array([4]))) == [slice(4, 5)]
    assert list(under_test._runs_of(np.array([], dtype=np.int64))) == []


def _combination(*psi):
    made = GalerkinProjection.__new__(GalerkinProjection)
    made._snapshots = tuple(SimpleNamespace(psi=np.array(part)) for part in psi)
    return made._combination()


def test_columns_are_combined_to_loads_of_one_each_and_to_none():
    """Loads of very different sizes, in two snapshots of three and two columns."""
    one = [[2e6, 1e5, 0.0], [3.0, 0.0, 1.0]]
    other = [[1e6, 4e5], [5.0, -2.0]]
    particular, free = _combination(one, other)
    psi = np.hstack([one, other])
    assert particular.shape == (5, 2)
    assert free.shape == (5, 3)
    np.testing.assert_allclose(psi @ particular, np.eye(2), atol=1e-9)
    scaled = psi / np.abs(psi).max(axis=1)[:, None]
    np.testing.assert_allclose(scaled @ free, 0.0, atol=1e-14)
    np.testing.assert_allclose(free.T @ free, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(
        particular, np.linalg.pinv(scaled) / np.abs(psi).max(axis=1), rtol=1e-9, atol=1e-20
    )


@pytest.mark.parametrize(("apart", "spans"), [(0.5e-9, False), (4e-9, True)])
def test_loads_that_do_not_span_those_of_the_case(apart, spans):
    """From a relative difference of about 1e-9 on they do."""
    found = _combination([[1.0, 1.0 - apart], [3.0, 3.0 + 3.0 * apart]])
    assert (found is not None) == spans
    assert _combination([[1.0, 2.0], [0.0, 0.0]]) is None


def test_without_loads_every_column_is_free():
    particular, free = _combination(np.zeros((0, 2)), np.zeros((0, 1)))
    assert particular.shape == (3, 0)
    np.testing.assert_array_equal(free, np.eye(3))
