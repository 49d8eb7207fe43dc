"""Errors that readings share: least squares with the full covariance, by hand and another way."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.assessment.diagnostics import diagnose, effective_sd
from geoident.identify.assessment.later_readings import given_used
from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.direct.simplex import simplex
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Discrepancy, own_residuals
from geoident.identify.problem.shared_errors import Covariance, ErrorStructure, SharedErrors
from geoident.model.methods import (
    GaussNewtonOptions,
    HuberOptions,
    SimplexOptions,
    SquaredOptions,
    StudentOptions,
)
from geoident.model.parameter import Parameter, Prior

X = np.array([0.0, 0.4, 1.1, 1.5, 2.2, 2.9, 3.1, 8.0])
SD = np.array([0.1, 0.1, 0.2, 0.1, 0.1, 0.3, 0.1, 0.2])
B = np.zeros((8, 3))
B[:3, 0] = [0.3, 0.3, 0.2]  # a head
B[2:5, 1] = 0.25  # a survey, which hangs together with the head through reading 2
B[6:, 2] = -0.4  # a zero
SIGMA = np.diag(SD**2) + B @ B.T
SHARED = SharedErrors(sp.csr_array(B))
ROBUST = [HuberOptions(), StudentOptions()]


def line(p):
    return p[0] + p[1] * X


def parameters(prior=None):
    return [Parameter("a", 0.5, -50.0, 50.0), Parameter("b", 1.0, -50.0, 50.0, prior=prior)]


@pytest.fixture
def measured():
    generator = np.random.default_rng(4)
    return 2.0 + 0.7 * X + np.linalg.cholesky(SIGMA) @ generator.normal(size=8)


@pytest.fixture
def problem(make_problem, measured):
    return replace(make_problem(line, parameters(), measured, SD), shared=SHARED)


def fitted(problem):
    return gauss_newton(problem, GaussNewtonOptions(tolerance=1e-13), lambda i: None).values


def by_hand(y, prior=None):
    """Generalised least squares with the whole covariance, and the covariance of the answer."""
    J = np.stack([np.ones(8), X], axis=1)
    W = np.linalg.inv(SIGMA)
    M, b = J.T @ W @ J, J.T @ W @ y
    if prior:
        M, b = M + np.diag([0, prior.sd**-2]), b + np.array([0, prior.mean / prior.sd**2])
    return np.linalg.solve(M, b), np.linalg.inv(M)


@pytest.mark.parametrize("prior", [None, Prior(0.5, 0.05)])
def test_the_answer_and_its_covariance_are_those_of_generalised_least_squares(
    make_problem, measured, prior
):
    problem = replace(make_problem(line, parameters(prior), measured, SD), shared=SHARED)
    expected, covariance = by_hand(measured, prior)
    p = fitted(problem)
    np.testing.assert_allclose(p, expected, rtol=1e-9)
    known = assess(problem, p, problem.response.evaluate(p)[1])
    np.testing.assert_allclose(known.covariance, covariance, rtol=1e-9)
    alone = assess(replace(problem, shared=None), p, problem.response.evaluate(p)[1])
    assert np.all(alone.sd < known.sd)


def test_phi_is_the_same_whatever_finds_it(problem, measured):
    discrepancy = Discrepancy(problem)
    p = np.array([1.7, 0.9])
    gap = line(p) - measured
    assert discrepancy.objective(p) == pytest.approx(gap @ np.linalg.solve(SIGMA, gap))
    assert discrepancy.squares(p, line(p)) == pytest.approx(discrepancy.objective(p))
    own, z = own_residuals(problem, line(p))  # shared errors as unknowns: another way to it
    assert own @ own + z @ z == pytest.approx(discrepancy.objective(p))
    found = simplex(problem, SimplexOptions(), lambda i: None).values
    np.testing.assert_allclose(found, by_hand(measured)[0], rtol=1e-3)


@pytest.mark.parametrize("loss", ROBUST)
def test_the_gradient_of_a_robust_phi_is_exact(problem, measured, loss):
    measured = measured + np.where(np.arange(8) == 1, 3.0, 0.0)
    discrepancy = Discrepancy(replace(problem, measured=measured, loss=loss))
    p = np.array([1.6, 0.8])
    at = discrepancy.linearize(p)
    gradient = 2.0 * at.jacobian.T @ at.residual / discrepancy.scaling.dp_dx(p)
    for h in range(2):
        step = 1e-5 * np.eye(2)[h]
        ends = (discrepancy.objective(p + step), discrepancy.objective(p - step))
        assert gradient[h] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-7)


@pytest.mark.parametrize(("loss", "least"), [(HuberOptions(), 0.3), (StudentOptions(), 0.6)])
def test_one_wrong_reading_loses_its_weight_and_its_neighbours_keep_theirs(
    problem, measured, loss, least
):
    wrong = replace(problem, measured=measured + np.where(np.arange(8) == 1, 5.0, 0.0), loss=loss)
    p = fitted(wrong)
    w = (SD / effective_sd(wrong, line(p))) ** 2
    assert w[1] < 0.15
    assert np.delete(w, 1).min() > least
    # whitened residuals are spoilt in all that stand behind it
    spoilt = Covariance(SD, SHARED).whiten(wrong.measured - line(by_hand(measured)[0]))
    assert np.count_nonzero(np.abs(spoilt[:5]) > 3.0) > 2
    # and the answer is near that without it
    expected = fitted(without(problem, np.arange(8) != 1))
    sd = np.sqrt(np.diag(by_hand(measured)[1]))
    assert np.all(np.abs(p - expected) < sd)
    pulled = fitted(replace(wrong, loss=SquaredOptions()))
    assert np.abs((pulled - expected) / sd).max() > 3.0


def without(problem, keep):
    """The same problem without some of its readings."""
    response = type(problem.response)(
        lambda p: problem.response.function(p)[keep], problem.response.names
    )
    return replace(
        problem,
        response=response,
        measured=problem.measured[keep],
        sd=problem.sd[keep],
        shared=problem.shared.only(keep),
    )


def test_influence_is_that_of_fits_without_the_readings(problem):
    p = fitted(problem)
    v, J = problem.response.evaluate(p)
    known = assess(problem, p, J)
    sets = np.array([0, 1, 1, 2, 3, 4, 5, 6])
    found = diagnose(problem, known, v, J, sets)
    for k in range(7):
        keep = sets != k
        moved = (p - fitted(without(problem, keep))) / known.sd
        np.testing.assert_allclose(found.influence[~keep][0], moved, rtol=1e-6, atol=1e-9)


def test_studentized_residuals_are_deletion_residuals(problem, measured):
    """t_i: the reading against its best prediction from all the others, in its own deviation."""
    p = fitted(problem)
    v, J = problem.response.evaluate(p)
    found = diagnose(problem, assess(problem, p, J), v, J, np.arange(8))
    for i in range(8):
        keep = np.arange(8) != i
        others = without(problem, keep)
        q = fitted(others)
        u, K = others.response.evaluate(q)
        structure = ErrorStructure(
            SD[[i]], np.array([-1]), sp.csr_array(B[[i]]), np.full(3, -1), ()
        )
        later = given_used(others, u, K, later=structure, later_jacobian=J[[i]])
        sd = predict_band(assess(others, q, K), later.jacobian, later.sd).sd
        t = (measured[i] - line(q)[i] - later.shift[0]) / sd[0]
        assert found.studentized[i] == pytest.approx(t, rel=1e-6)
    assert np.all((found.leverage > 0.0) & (found.leverage < 1.0))


def test_later_readings_know_the_error_of_the_zero(measured, make_problem):
    """Against the same with shared errors as parameters with a prior of one."""
    with_z = [*parameters(), *(Parameter(f"z{k}", 0.0, -9, 9, prior=Prior(0, 1)) for k in range(3))]
    wide = make_problem(lambda p: line(p[:2]) + B @ p[2:], with_z, measured, SD)
    q = fitted(wide)
    known = assess(wide, q, wide.response.evaluate(q)[1])
    later = np.array([[1.0, 9.0, 0.0, 0.0, -0.4], [1.0, 3.0, 0.3, 0.0, 0.0]])
    sd = np.array([0.2, 0.1])
    bands = predict_band(known, later, sd).sd

    problem = replace(make_problem(line, parameters(), measured, SD), shared=SHARED)
    p = fitted(problem)
    v, J = problem.response.evaluate(p)
    structure = ErrorStructure(
        sd, np.array([-1, -1]), sp.csr_array(later[:, 2:]), np.full(3, -1), ()
    )
    found = given_used(problem, v, J, later=structure, later_jacobian=later[:, :2])
    np.testing.assert_allclose(later[:, :2] @ p + found.shift, later @ q, rtol=1e-7)
    np.testing.assert_allclose(
        predict_band(assess(problem, p, J), found.jacobian, found.sd).sd, bands, rtol=1e-7
    )
    alone = np.sqrt(np.sum(later[:, 2:] ** 2, axis=1) + sd**2)  # as if nothing were known of them
    assert np.all(found.sd < alone)


def test_rows_of_a_robust_loss_leave_out_what_shared_errors_can_do(problem):
    """Where the loss is that of squares everywhere, curvature is that of whitened rows."""
    wide = Discrepancy(replace(problem, loss=HuberOptions(1e6)))
    p = np.array([1.6, 0.8])
    curvature = [each.jacobian.T @ each.jacobian for each in (
        wide.linearize(p), Discrepancy(problem).linearize(p)
    )]  # fmt: skip
    np.testing.assert_allclose(*curvature, rtol=1e-9)


# Many readings that differ only by their own noise


def test_twenty_thousand_readings_cost_what_they_share():
    """A zero and a year of survey days: against the closed form of means, in little memory."""
    g, days = 20_000, 365
    generator = np.random.default_rng(8)
    sd = generator.uniform(0.5, 2.0, g)
    day = generator.integers(days, size=g)
    columns = sp.csr_array(
        (
            np.concatenate([np.full(g, 3.0), np.full(g, 0.7)]),
            (np.tile(np.arange(g), 2), np.concatenate([np.zeros(g, int), 1 + day])),
        ),
        shape=(g, 1 + days),
    )
    e = generator.normal(size=(g, 2))
    tracemalloc.start()
    covariance = Covariance(sd, SharedErrors(columns))
    solved, white = covariance.solve(e), covariance.whiten(e)
    log_det = covariance.log_determinant()
    diagonal = covariance.inverse_diagonal
    some = np.flatnonzero(day < 40)
    within = covariance.without_others(some, solved[some])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5e7
    # means of a day have the precision w of its readings; the zero is what the days share
    w = np.bincount(day, sd**-2.0, days)
    alpha = 1.0 / (1.0 / w + 0.7**2)  # precision of a day's mean, its own error in it
    mean = np.stack([np.bincount(day, x / sd**2, days) / w for x in e.T], axis=1)
    zero = (alpha @ mean) / (1.0 / 9.0 + alpha.sum())
    of_day = (mean - zero) * (0.49 / (0.49 + 1.0 / w))[:, None]
    np.testing.assert_allclose(solved, (e - zero - of_day[day]) / sd[:, None] ** 2, atol=1e-12)
    np.testing.assert_allclose(white.T @ white, e.T @ solved, rtol=1e-11)
    expected = 2.0 * np.log(sd).sum() + np.log1p(0.49 * w).sum() + np.log1p(9.0 * alpha.sum())
    assert log_det == pytest.approx(expected, rel=1e-12)
    left = 1.0 / (1.0 / 9.0 + alpha.sum())
    variance = 0.49 / (1.0 + 0.49 * w) + left * (1.0 / (1.0 + 0.49 * w)) ** 2
    np.testing.assert_allclose(diagonal, sd**-2.0 - variance[day] * sd**-4.0, rtol=1e-10)
    # and what the others leave of a set: Sigma_II - Sigma_IR Sigma_RR^-1 Sigma_RI
    zero_left = 1.0 / (1.0 / 9.0 + alpha[40:].sum())
    force = solved[some]
    sums = np.stack([np.bincount(day[some], x, days) for x in force.T], axis=1)
    moved = sd[some, None] ** 2 * force + zero_left * force.sum(axis=0) + 0.49 * sums[day[some]]
    np.testing.assert_allclose(within, moved, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("ratio", [1e-3, 1e4])
def test_shared_errors_far_smaller_or_larger_than_own_ones(ratio):
    shared = SharedErrors(sp.csr_array(ratio * B))
    covariance = Covariance(SD, shared)
    sigma = np.diag(SD**2) + ratio**2 * B @ B.T
    white = covariance.whiten(np.eye(8))
    np.testing.assert_allclose(white @ sigma @ white.T, np.eye(8), atol=1e-16 * max(1, ratio) ** 3)
    assert covariance.log_determinant() == pytest.approx(np.linalg.slogdet(sigma)[1], rel=1e-7)


@pytest.mark.parametrize("loss", [SquaredOptions(), HuberOptions(), StudentOptions()])
def test_many_readings_of_one_channel_count_as_their_mean(make_problem, loss):
    """4000 readings that share a zero and a head: phi, its minimum, and their influence."""
    g = 4000
    generator = np.random.default_rng(2)
    noise = generator.normal(size=g)
    columns = np.zeros((g + 2, 2))
    columns[:, 0], columns[:g, 1] = 0.5, 0.3
    measured = np.concatenate([2.0 + noise, [2.0, 1.9]])
    x = np.concatenate([np.ones(g), [0.0, 3.0]])
    sd = np.concatenate([np.ones(g), [0.1, 0.1]])
    problem = replace(
        make_problem(lambda p: p[0] + p[1] * x, parameters(), measured, sd),
        shared=SharedErrors(sp.csr_array(columns)),
        loss=loss,
    )
    p = fitted(problem)
    v, J = problem.response.evaluate(p)
    known = assess(replace(problem, sd=effective_sd(problem, v)), p, J)
    sets = np.concatenate([np.zeros(g, int), [1, 2]])
    found = diagnose(problem, known, v, J, sets)
    if loss == SquaredOptions():
        few = replace(
            make_problem(
                lambda p: p[0] + p[1] * np.array([1.0, 0.0, 3.0]),
                parameters(),
                np.concatenate([[measured[:g].mean()], measured[g:]]),
                np.concatenate([[g**-0.5], sd[g:]]),
            ),
            shared=SharedErrors(sp.csr_array(columns[[0, -2, -1]])),
        )
        q = fitted(few)
        u, K = few.response.evaluate(q)
        one = assess(few, q, K)
        np.testing.assert_allclose(p, q, rtol=1e-6)
        np.testing.assert_allclose(known.covariance, one.covariance, rtol=1e-8)
        other = diagnose(few, one, u, K, np.arange(3))
        np.testing.assert_allclose(found.influence[[0, -2, -1]], other.influence, rtol=1e-5)
        np.testing.assert_allclose(found.distance[[0, -2, -1]], other.distance, rtol=1e-5)
    assert np.all(np.isfinite(found.standardized))


def test_without_used_readings_all_of_the_errors_of_later_ones_is_left(make_problem):
    none = make_problem(lambda p: p[:0], parameters(), [], [])
    sd, shares = np.array([0.2, 0.1]), sp.csr_array(np.array([[0.3, -0.4], [0.3, 0.0]]))
    later = ErrorStructure(sd, np.full(2, -1), shares, np.full(2, -1), ())
    J = np.ones((2, 2))
    found = given_used(none, np.zeros(0), np.zeros((0, 2)), later=later, later_jacobian=J)
    np.testing.assert_allclose(found.sd, np.sqrt([0.04 + 0.25, 0.01 + 0.09]))
    np.testing.assert_allclose(found.shift, 0.0)
    np.testing.assert_allclose(found.jacobian, J)
