"""Conjugate gradients for several right-hand sides, against dense solutions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.fem.solvers.conjugate_gradients import conjugate_gradients
from geoident.fem.solvers.direct import LowerPattern
from geoident.forward.march.held_factors import symmetric_product

N = 30


def random_stiffness(seed: int = 1) -> np.ndarray:
    made = np.random.default_rng(seed).normal(size=(N, N))
    return made @ made.T + np.eye(N)


K = random_stiffness()
RHS = np.random.default_rng(2).normal(size=(N, 4))


def solver(M):
    return lambda r: np.linalg.solve(M, r)


def test_columns_are_those_of_a_dense_solution():
    found = conjugate_gradients(
        lambda x: K @ x, RHS, solver(np.diag(np.diag(K))), tolerance=1e-12, most=200
    )
    assert found.reached
    np.testing.assert_allclose(found.x, np.linalg.solve(K, RHS), rtol=1e-9)
    for k in range(RHS.shape[1]):  # each as if it were alone
        alone = conjugate_gradients(
            lambda x: K @ x, RHS[:, [k]], solver(np.diag(np.diag(K))), tolerance=1e-12, most=200
        )
        np.testing.assert_allclose(alone.x[:, 0], found.x[:, k], rtol=1e-9)


@pytest.mark.parametrize("factor", [1.0, 7.0])
def test_one_step_on_the_factor_of_the_matrix_or_of_a_multiple(factor):
    found = conjugate_gradients(lambda x: K @ x, RHS, solver(factor * K), tolerance=1e-11, most=5)
    assert found.reached
    assert found.steps == 1


def test_a_change_of_rank_three_takes_four_steps():
    Z = np.random.default_rng(3).normal(size=(N, 3))
    changed = K + Z @ Z.T
    found = conjugate_gradients(lambda x: changed @ x, RHS, solver(K), tolerance=1e-9, most=9)
    assert found.reached
    assert found.steps <= 4
    np.testing.assert_allclose(found.x, np.linalg.solve(changed, RHS), rtol=1e-6)


def test_nothing_is_asked_for_a_column_of_zeros():
    rhs = RHS.copy()
    rhs[:, 2] = 0.0
    asked = []

    def product(x):
        asked.append(x.shape[1])
        return K @ x

    found = conjugate_gradients(product, rhs, solver(K), tolerance=1e-11, most=5)
    assert asked == [3]
    assert not found.x[:, 2].any()
    nothing = conjugate_gradients(product, 0.0 * rhs, solver(K), tolerance=1e-11, most=5)
    assert (nothing.steps, nothing.reached) == (0, True)


def test_what_is_cut_off_goes_down():
    """After each number of steps, the direction is one of descent, and the energy is lower."""
    b, last = RHS[:, :1], 0.0
    for most in range(1, 12):
        x = conjugate_gradients(lambda x: K @ x, b, lambda r: r, tolerance=1e-14, most=most).x
        energy = float((0.5 * x.T @ K @ x - b.T @ x).item())
        assert (x.T @ b).item() > 0.0
        assert energy < last
        last = energy


def test_a_matrix_without_stiffness_somewhere_gives_a_direction_of_descent():
    """What flows freely is left out; if there is nothing else, it is the direction."""
    V = np.linalg.qr(RHS)[0]
    flat = K - K @ V @ np.linalg.solve(V.T @ K @ V, V.T @ K)  # K V = 0
    b = RHS[:, :1]
    found = conjugate_gradients(lambda x: flat @ x, b, solver(K), tolerance=1e-10, most=40)
    assert not found.reached
    assert np.isfinite(found.x).all()
    assert (found.x.T @ b).item() > 0.0
    free = conjugate_gradients(lambda x: 0.0 * x, b, solver(K), tolerance=1e-10, most=40)
    assert not free.reached
    np.testing.assert_allclose(free.x, np.linalg.solve(K, b))


def test_products_with_a_lower_triangle():
    matrix = sp.csc_array(sp.tril(sp.csc_array(np.where(abs(K) > 3.0, K, 0.0))))
    matrix.sort_indices()
    lower = LowerPattern(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64))
    full = matrix.toarray()
    full = full + np.tril(full, -1).T
    np.testing.assert_allclose(symmetric_product(lower, matrix.data)(RHS), full @ RHS)
