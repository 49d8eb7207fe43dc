"""The covariance of shared errors piece by piece, against dense matrices."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.problem.shared_errors import Covariance, ErrorStructure, SharedErrors

SD = np.array([0.3, 0.2, 0.5, 0.4, 0.15, 0.25, 0.35])
B = np.zeros((7, 4))
B[[5, 1], 2] = [0.7, -0.4]  # hang together through the second, in no order
B[[1, 3], 0] = [0.3, 0.6]
B[[0, 6, 2], 3] = [0.2, 0.9, -0.5]
# the fifth reading shares nothing, and the second error belongs to nothing
SIGMA = np.diag(SD**2) + B @ B.T
TABLE = np.random.default_rng(2).normal(size=(7, 3))


def covariance():
    return Covariance(SD, SharedErrors(sp.csr_array(B)))


@pytest.mark.parametrize("values", [TABLE, TABLE[:, 0]], ids=["table", "vector"])
def test_what_is_solved_is_solved_with_the_whole(values):
    found = covariance()
    inverse = np.linalg.inv(SIGMA)
    np.testing.assert_allclose(found.solve(values), inverse @ values)
    white = found.whiten(values)
    np.testing.assert_allclose(white.T @ white, values.T @ inverse @ values)
    np.testing.assert_allclose(found.expected_shared(values), B.T @ inverse @ values, atol=1e-15)
    assert found.expected_shared(values).shape == (4, *values.shape[1:])


def test_determinant_inverse_and_diagonal():
    found = covariance()
    assert found.log_determinant() == pytest.approx(np.linalg.slogdet(SIGMA)[1])
    np.testing.assert_allclose(found.inverse, np.linalg.inv(SIGMA), atol=1e-13)
    np.testing.assert_allclose(found.inverse_diagonal, np.diag(np.linalg.inv(SIGMA)))


def test_what_readings_leave_of_shared_errors():
    """I - B^T Sigma^-1 B of the shared ones, seen through any rows of sizes."""
    left = np.eye(4) - B.T @ np.linalg.solve(SIGMA, B)
    rows = np.array([[0.3, 0.0, 0.5, 0.0], [0.0, 2.0, 0.0, 0.0], [0.1, -0.7, 0.0, 0.9]])
    found = covariance()
    np.testing.assert_allclose(
        found.conditional_covariance(sp.csr_array(rows)), rows @ left @ rows.T, atol=1e-15
    )
    np.testing.assert_allclose(
        found.conditional_variance(sp.csr_array(rows)), np.diag(rows @ left @ rows.T)
    )


@pytest.mark.parametrize("rows", [[3], [4], [6, 1, 3], [0, 2, 4, 5], list(range(7))])
def test_what_others_leave_of_some_readings(rows):
    rows = np.array(rows)
    block = np.linalg.inv(SIGMA)[np.ix_(rows, rows)]
    for values in (TABLE[: len(rows)], TABLE[: len(rows), 1]):
        found = covariance().without_others(rows, values)
        np.testing.assert_allclose(found, np.linalg.solve(block, values), atol=1e-14)


@pytest.mark.parametrize("copies", [1, 60], ids=["few", "many"])
def test_the_inverse_along_some_directions_is_sparse_less_a_product(copies):
    """Of many readings there is also an error that all share."""
    columns, sd = sp.block_diag([B] * copies, format="csr"), np.tile(SD, copies)
    if copies > 1:
        columns = sp.csr_array(sp.hstack([columns, 0.3 * np.ones((len(sd), 1))]))
    directions = sp.csc_array(sp.random_array((len(sd), 5), density=0.4, rng=1))
    between, taken = Covariance(sd, SharedErrors(columns)).inverse_along(directions)
    dense = directions.toarray()
    sigma = np.diag(sd**2) + (columns @ columns.T).toarray()
    np.testing.assert_allclose(
        between.toarray() - taken @ taken.T, dense.T @ np.linalg.solve(sigma, dense), atol=1e-12
    )


def test_rounding_leaves_a_diagonal_above_zero():
    """1 - c^2 / (2 + c^2) with c = 1e9: the smallest that rounding can tell from zero."""
    columns = SharedErrors(sp.csr_array(np.array([[2e8], [0.1]])))
    found = Covariance(np.array([0.2, 0.1]), columns).inverse_diagonal
    assert 0.0 < found[0] * 0.2**2 <= np.finfo(float).eps
    assert found[1] * 0.1**2 == pytest.approx(1.0)


STRUCTURE = ErrorStructure(
    SD, np.array([0, -1, 1, 1, -1, 0, 2]), sp.csr_array(B), np.array([-1, 2, 1, 0]), ("a", "b", "c")
)
LOG = np.log([4.0, 9.0, 0.25])  # standard deviations times 2, 3 and 0.5


def test_sizes_follow_the_logarithms_of_their_factors():
    sd, shared = STRUCTURE.at(LOG)
    np.testing.assert_allclose(sd, SD * [2.0, 1.0, 3.0, 3.0, 1.0, 2.0, 0.5])
    np.testing.assert_allclose(shared.columns.toarray(), B * [1.0, 0.5, 3.0, 2.0])
    sd, shared = STRUCTURE.stated
    np.testing.assert_array_equal(sd, SD)
    np.testing.assert_array_equal(shared.columns.toarray(), B)
    alone = ErrorStructure(SD, STRUCTURE.component, sp.csr_array((7, 0)), np.zeros(0, int), "abc")
    assert alone.at(LOG)[1] is None


def test_structures_are_made_of_others():
    more = STRUCTURE.with_component(sp.csr_array(TABLE[:, :2]), "d")
    assert more.names == ("a", "b", "c", "d")
    assert more.column_component.tolist() == [-1, 2, 1, 0, 3, 3]
    np.testing.assert_allclose(more.columns.toarray(), np.hstack([B, TABLE[:, :2]]))
    sd, shared = more.at(np.append(LOG, np.log(16.0)))
    np.testing.assert_allclose(sd, STRUCTURE.at(LOG)[0])
    sizes = np.hstack([B * [1.0, 0.5, 3.0, 2.0], 4.0 * TABLE[:, :2]])
    np.testing.assert_allclose(shared.columns.toarray(), sizes)
    one = STRUCTURE.with_one_factor("all")
    sd, shared = one.at(np.log([4.0]))
    np.testing.assert_allclose(sd, 2.0 * SD)
    np.testing.assert_allclose(shared.columns.toarray(), 2.0 * B)
    assert one.names == ("all",)
    rows = np.array([6, 0, 3])
    some = STRUCTURE.rows(rows)
    sd, shared = some.at(LOG)
    np.testing.assert_allclose(sd, STRUCTURE.at(LOG)[0][rows])
    np.testing.assert_allclose(shared.columns.toarray(), (B * [1.0, 0.5, 3.0, 2.0])[rows])
    assert some.names == STRUCTURE.names


# Many readings: small blocks, and what many of them share on top -------------------------------

CHANNELS, STAGES = 40, 12


@pytest.fixture(scope="module")
def many():
    """Zeros of channels, set-ups of stages, and a model error of a few columns in all readings."""
    rng = np.random.default_rng(5)
    g = CHANNELS * STAGES + 3  # three more of the first channel at the first stage
    channel = np.append(np.repeat(np.arange(CHANNELS), STAGES), [0] * 3)
    stage = np.append(np.tile(np.arange(STAGES), CHANNELS), [0] * 3)
    zero, epoch = np.eye(CHANNELS)[channel], np.eye(STAGES)[stage]
    two = zero * rng.uniform(0.1, 0.4, g)[:, None]  # another error of each channel
    columns = np.hstack([0.5 * zero, 0.3 * epoch, two, rng.normal(size=(g, 7))])
    order = rng.permutation(columns.shape[1])
    sd = rng.uniform(0.2, 0.6, g)
    return sd, columns[:, order], np.diag(sd**2) + columns @ columns.T


def test_many_readings_are_treated_as_dense_matrices_say(many):
    sd, columns, sigma = many
    g, K = columns.shape
    shared = SharedErrors(sp.csr_array(columns))
    found, inverse = Covariance(sd, shared), np.linalg.inv(sigma)
    values = np.random.default_rng(6).normal(size=(g, 3))
    np.testing.assert_allclose(found.solve(values), inverse @ values, atol=1e-9)
    white = found.whiten(values)
    np.testing.assert_allclose(white.T @ white, values.T @ inverse @ values, rtol=1e-10)
    assert found.log_determinant() == pytest.approx(np.linalg.slogdet(sigma)[1], rel=1e-12)
    np.testing.assert_allclose(found.inverse_diagonal, np.diag(inverse), rtol=1e-9)
    rows = np.random.default_rng(7).normal(size=(5, K)) * (np.arange(K) % 3 == 0)
    left = rows @ (np.eye(K) - columns.T @ inverse @ columns) @ rows.T
    given = sp.csr_array(rows)
    np.testing.assert_allclose(found.conditional_covariance(given), left, atol=1e-9)
    np.testing.assert_allclose(found.conditional_variance(given), np.diag(left), rtol=1e-9)
    expected = columns.T @ inverse @ values
    np.testing.assert_allclose(found.expected_shared(values), expected, atol=1e-9)
    for some in ([7], [0, 480, 481, 482], [3, 14, 200]):
        block = inverse[np.ix_(some, some)]
        others = found.without_others(np.array(some), values[some])
        np.testing.assert_allclose(others, np.linalg.solve(block, values[some]), atol=1e-9)
