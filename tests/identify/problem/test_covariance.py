"""The covariance of shared errors piece by piece, against dense matrices."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.problem import errors
from geoident.identify.problem.errors import (
    Covariance,
    ErrorStructure,
    SharedErrors,
    products,
    row_squares,
    scaled_rows,
)

SD = np.array([0.3, 0.2, 0.5, 0.4, 0.15, 0.25, 0.35])
B = np.zeros((7, 4))
B[[5, 1], 2] = [0.7, -0.4]  # hang together through the second, in no order
B[[1, 3], 0] = [0.3, 0.6]
B[[0, 6, 2], 3] = [0.2, 0.9, -0.5]
# the fifth reading shares nothing, and the second error belongs to nothing
SIGMA = np.diag(SD**2) + B @ B.T
TABLE = np.random.default_rng(2).normal(size=(7, 3))


@pytest.fixture(params=["few", "many", "sparse"], autouse=True)
def way(request, monkeypatch):
    """By dense factors, by those of what is shared, and with sparse blocks of them."""
    monkeypatch.setattr(errors, "FEW", 300 if request.param == "few" else 0)
    if request.param == "sparse":
        monkeypatch.setattr(errors, "_SMALL", 1)
    return request.param


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


@pytest.mark.parametrize(("limit", "inverted"), [(2, True), (1, False)])
def test_a_few_rows_are_taken_from_the_inverse_itself(monkeypatch, limit, inverted):
    found = covariance()
    asked = []
    part = found._part
    found._part = lambda rows: asked.append(rows.tolist()) or part(rows)
    monkeypatch.setattr(errors, "FEW", limit)
    found.without_others(np.array([3, 6]), TABLE[:2])
    assert asked == [[3, 6]] * inverted


def test_blocks_are_what_hangs_together():
    shared = SharedErrors(sp.csr_array(B))
    blocks = {tuple(rows.tolist()): tuple(k.tolist()) for rows, k in shared.blocks}
    assert blocks == {(0, 2, 6): (3,), (1, 3, 5): (0, 2)}
    assert len(shared) == 4
    assert SharedErrors(sp.csr_array((7, 0))).blocks == ()
    for rows, columns in shared.blocks:
        block = shared.block(rows, columns)
        dense = block if isinstance(block, np.ndarray) else block.toarray()
        np.testing.assert_array_equal(dense, B[np.ix_(rows, columns)])


def test_sizes_multiply_and_nothing_is_found_again():
    first, second = np.array([2.0, 5.0, 0.5, 3.0]), np.array([1.5, 1.0, 4.0, 0.1])
    plain = SharedErrors(sp.csr_array(B))
    one = plain.sized(first)
    np.testing.assert_allclose(one.columns.toarray(), B * first)
    both = one.sized(second)
    np.testing.assert_allclose(both.columns.toarray(), B * first * second)
    np.testing.assert_array_equal(plain.columns.toarray(), B)
    assert both.parts is plain.parts
    assert both.blocks is plain.blocks
    sigma = np.diag(SD**2) + (B * first * second) @ (B * first * second).T
    np.testing.assert_allclose(
        Covariance(SD, both).solve(TABLE), np.linalg.solve(sigma, TABLE), atol=1e-13
    )
    kept = np.array([True, False, True, True, False, False, True])
    np.testing.assert_allclose(both.only(kept).columns.toarray(), (B * first * second)[kept])


@pytest.mark.parametrize("make", [np.asarray, sp.csr_array], ids=["dense", "sparse"])
def test_products_of_rows(make):
    C, M = B[:, [0, 2, 3]], np.arange(9.0).reshape(3, 3)
    scaled = scaled_rows(SD, make(C))
    assert isinstance(scaled, np.ndarray) == (make is np.asarray)
    np.testing.assert_allclose(scaled if make is np.asarray else scaled.toarray(), np.diag(SD) @ C)
    np.testing.assert_allclose(products(make(C), SD), C.T @ np.diag(SD) @ C)
    np.testing.assert_allclose(row_squares(make(C), M), np.diag(C @ M @ C.T))


@pytest.mark.parametrize("entries", [1, 5, 6, 7, 8, 100])
def test_row_squares_are_the_same_however_many_rows_are_taken_at_a_time(monkeypatch, entries):
    monkeypatch.setattr(errors, "_SMALL", entries)
    seen = []

    class Rows(np.ndarray):
        def __getitem__(self, item):
            seen.append((item.start, item.stop))
            return np.asarray(self)[item]

    C = TABLE.view(Rows)
    M = np.arange(9.0).reshape(3, 3)
    np.testing.assert_allclose(row_squares(C, M), np.diag(TABLE @ M @ TABLE.T))
    step = max(1, entries // 3)
    assert seen == [(k, k + step) for k in range(0, 7, step)]
    assert row_squares(np.zeros((0, 3)), M).shape == (0,)


@pytest.mark.parametrize(
    ("limit", "count", "kind"),
    [(3, 3, "_FewReadings"), (3, 4, "_ManyReadings"), (1, 2, "_FewReadings")],
)
def test_few_readings_have_a_factor_of_their_own_size(monkeypatch, limit, count, kind):
    """Up to FEW of them, or while they are no more than what they share (2)."""
    monkeypatch.setattr(errors, "FEW", limit)
    shared = SharedErrors(sp.csr_array(np.ones((count, 2))))
    found = errors._block(np.arange(count)[None], np.arange(2)[None], shared, np.ones(count))
    assert type(found).__name__ == kind


def test_blocks_are_kept_dense_where_that_is_small(monkeypatch):
    """The whole up to _SMALL entries; else blocks up to that, or a third of which is not zero."""
    columns = sp.csr_array(B)
    rows, k = np.array([1, 3, 5]), np.array([0, 2])  # 6 entries, 4 not zero
    for limit, matrix, dense in ((28, columns, True), (27, columns, True), (6, columns, True)):
        monkeypatch.setattr(errors, "_SMALL", limit)
        shared = SharedErrors(matrix)
        assert (shared._whole is not None) == (limit >= 28)
        assert isinstance(shared.block(rows, k), np.ndarray) == dense
    thin = np.zeros((7, 4))
    thin[1, 0], thin[5, 2] = 0.3, 0.6
    for limit, entries, dense in ((5, 2, True), (5, 1, False), (6, 1, True), (1, 2, True)):
        monkeypatch.setattr(errors, "_SMALL", limit)
        some = thin.copy()
        some[5, 2] *= entries > 1
        given = sp.csr_array(some)
        given.eliminate_zeros()
        assert isinstance(SharedErrors(given).block(rows, k), np.ndarray) == dense


def test_rounding_leaves_a_diagonal_above_zero():
    """1 - c^2 / (2 + c^2) with c = 1e9: the smallest that rounding can tell from zero."""
    columns = SharedErrors(sp.csr_array(np.array([[2e8], [0.1]])))
    found = Covariance(np.array([0.2, 0.1]), columns).inverse_diagonal
    assert 0.0 < found[0] * 0.2**2 <= np.finfo(float).eps
    if errors.FEW == 0:
        assert found[0] * 0.2**2 == pytest.approx(np.finfo(float).eps)
    assert found[1] * 0.1**2 == pytest.approx(1.0)


STRUCTURE = ErrorStructure(
    SD,
    np.array([0, -1, 1, 1, -1, 0, 2]),
    sp.csr_array(B),
    np.array([-1, 2, 1, 0]),
    ("a", "b", "c"),
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


def test_many_readings_are_treated_as_dense_matrices_say(way, many):
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
    expected = columns.T @ inverse @ values
    np.testing.assert_allclose(found.expected_shared(values), expected, atol=1e-9)
    rows = np.random.default_rng(7).normal(size=(5, K)) * (np.arange(K) % 3 == 0)
    left = rows @ (np.eye(K) - columns.T @ inverse @ columns) @ rows.T
    given = sp.csr_array(rows)
    np.testing.assert_allclose(found.conditional_covariance(given), left, atol=1e-9)
    np.testing.assert_allclose(found.conditional_variance(given), np.diag(left), rtol=1e-9)
    for some in ([7], [0, 480, 481, 482], [3, 14, 200]):
        block = inverse[np.ix_(some, some)]
        others = found.without_others(np.array(some), values[some])
        np.testing.assert_allclose(others, np.linalg.solve(block, values[some]), atol=1e-9)


def test_what_few_readings_share_is_kept_apart_from_what_all_do(many):
    """A block for each channel, with set-ups and model error on top."""
    _, columns, _ = many
    blocks, wide = SharedErrors(sp.csr_array(columns)).parts
    assert len(wide) == STAGES + 7
    assert sum(len(rows) for rows, _ in blocks) == CHANNELS
    assert {shared.shape[1] for _, shared in blocks} == {2}
