"""What is known and what bears on it, against dense matrices: nothing is one, zero or alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.stats import norm

from geoident.identify.assessment.diagnostics import diagnose, effective_sd
from geoident.identify.assessment.later_readings import given_used, later_covariance
from geoident.identify.assessment.misfit import misfit
from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.assessment.profile_path import Nonlinearity
from geoident.identify.assessment.truncated_normal import Posterior
from geoident.identify.assessment.uncertainty import assess, with_posterior
from geoident.identify.problem.losses import weights
from geoident.identify.problem.problem import Problem, own_residuals
from geoident.identify.problem.shared_errors import ErrorStructure, SharedErrors
from geoident.model.methods import HuberOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.findings import sentences_of

RNG = np.random.default_rng(8)
A = RNG.normal(size=(7, 2))
B = np.array([[0.5, 0.0], [0.4, 0.2], [0.0, 0.7], [0.3, 0.3], [0.6, -0.1], [0.0, 0.2], [0.0, 0.0]])
SD = np.array([0.3, 0.2, 0.4, 0.25, 0.35, 0.15, 0.22])
Q = (
    Parameter("E", 3.0, 0.3, 300.0, "log"),
    Parameter("K", 1.3, -80.0, 90.0, prior=Prior(1.1, 0.4)),
)
AT = np.array([2.5, 1.2])
SLOPE = np.array([2.5, 17.0])
"""dp/dx: the value itself, and a tenth of the range."""

Y = A @ AT + np.array([0.3, -0.5, 0.2, 0.1, -0.2, 2.5, -0.4])


def problem_of(*, shared=True, loss=None):
    held = SharedErrors(sp.csr_array(B)) if shared else None
    return Problem(None, Y, SD, Q, loss or SquaredOptions(), held)


@pytest.mark.parametrize("loss", [SquaredOptions(), HuberOptions(1.3), StudentOptions(4.0)])
@pytest.mark.parametrize("shared", [True, False])
def test_readings_bear_on_the_answer_as_dense_matrices_say(loss, shared):
    """Leverage, influence and distance by the inverse of the covariance under the loss."""
    problem = problem_of(shared=shared, loss=loss)
    v, sets = A @ AT, np.array([0, 1, 1, 2, 0, 3, 4])
    sd = effective_sd(problem, v)
    known = assess(replace(problem, sd=sd, loss=SquaredOptions()), AT, A)
    found = diagnose(problem, known, v, A, sets)
    w = weights(loss, own_residuals(problem, v)[0])
    np.testing.assert_allclose(found.weight, w)
    np.testing.assert_allclose(sd, SD / np.sqrt(w))
    S = np.diag(SD**2 / w) + (B @ B.T if shared else 0.0)
    inverse = np.linalg.inv(S)
    J = A * SLOPE
    C = np.linalg.inv(J.T @ inverse @ J + np.diag([0.0, (17.0 / 0.4) ** 2]))
    np.testing.assert_allclose(known.held_covariance_x, C, rtol=1e-9)
    P = inverse - inverse @ J @ C @ J.T @ inverse
    own = np.diag(inverse)
    np.testing.assert_allclose(found.leverage, 1.0 - np.diag(P) / own, rtol=1e-9)
    gap = Y - v
    d = inverse @ gap / own
    e = d / np.sqrt(SD**2 + 1.0 / own - SD**2 / w)
    np.testing.assert_allclose(found.standardized, e, rtol=1e-9)
    np.testing.assert_allclose(found.studentized, e / np.sqrt(np.diag(P) / own), rtol=1e-9)
    assert found.scale == pytest.approx(1.482602218505602 * np.median(np.abs(e)))
    sizes = np.sqrt(np.diag(C))
    for k in range(5):
        rows = np.flatnonzero(sets == k)
        force = (inverse @ gap)[rows]
        change = C @ (inverse @ J)[rows].T @ np.linalg.solve(P[np.ix_(rows, rows)], force)
        for i in rows:
            np.testing.assert_allclose(found.influence[i], change / sizes, rtol=1e-8)
            cook = change @ np.linalg.solve(C, change) / 2.0
            assert found.distance[i] == pytest.approx(cook, rel=1e-8)


LATER_B = np.array([[0.9, 0.1], [0.0, -0.4], [0.3, 0.5]])
LATER_SD = np.array([0.12, 0.3, 0.2])
LATER = ErrorStructure(
    LATER_SD, np.full(3, -1), sp.csr_array(LATER_B), np.array([-1, -1]), ()
)  # fmt: skip


def test_later_readings_given_the_used_ones_are_those_of_conditioning():
    J_later = np.array([[0.4, -0.3], [1.1, 0.2], [0.0, 0.8]])
    v = A @ AT
    found = given_used(problem_of(), v, A, later=LATER, later_jacobian=J_later)
    sigma, cross = np.diag(SD**2) + B @ B.T, LATER_B @ B.T
    pull = cross @ np.linalg.inv(sigma)
    np.testing.assert_allclose(found.shift, pull @ (Y - v))
    np.testing.assert_allclose(found.jacobian, J_later - pull @ A)
    left = np.diag(LATER_SD**2) + LATER_B @ LATER_B.T - pull @ cross.T
    np.testing.assert_allclose(found.sd, np.sqrt(np.diag(left)))
    np.testing.assert_allclose(later_covariance(problem_of(), LATER), left, atol=1e-12)
    alone = given_used(problem_of(shared=False), v, A, later=LATER, later_jacobian=J_later)
    np.testing.assert_array_equal(alone.shift, np.zeros(3))
    np.testing.assert_array_equal(alone.jacobian, J_later)
    whole = np.diag(LATER_SD**2) + LATER_B @ LATER_B.T
    np.testing.assert_allclose(alone.sd, np.sqrt(np.diag(whole)))
    np.testing.assert_allclose(later_covariance(problem_of(shared=False), LATER), whole)


# Residuals


@pytest.mark.parametrize("shared", [True, False])
def test_squares_of_residuals_have_the_moments_of_dense_matrices(shared):
    v = A @ AT
    found = misfit(problem_of(shared=shared), AT, v, A)
    S = np.diag(SD**2) + (B @ B.T if shared else 0.0)
    inverse, J = np.linalg.inv(S), A * SLOPE
    C = np.linalg.inv(J.T @ inverse @ J + np.diag([0.0, (17.0 / 0.4) ** 2]))
    keep = np.eye(7) - inverse @ J @ C @ J.T
    mean, spread = np.trace(keep), np.trace(keep @ keep)
    assert found.squares == pytest.approx((Y - v) @ inverse @ (Y - v))
    assert found.mean == pytest.approx(mean)
    assert found.freedom == pytest.approx(mean**2 / spread)
    assert found.scale == pytest.approx(np.sqrt(found.squares / mean))
    assert found.above + found.below == pytest.approx(1.0)


# Parameters


def fields():
    return (
        Q[0],
        Parameter("m1", 0.0, -np.inf, np.inf, prior=Prior(0.0, 1.0), field="E"),
        Q[1],
        Parameter("m2", 0.0, -np.inf, np.inf, prior=Prior(0.0, 0.7), field="E"),
    )


def test_modes_of_fields_are_free_where_named_parameters_are_judged():
    """Singular values of readings with the covariance 1 + B_m P^-1 B_m^T, in ranges."""
    J = np.random.default_rng(3).normal(size=(7, 4))
    problem = Problem(None, Y, SD, fields())
    values = np.array([2.5, 0.3, 1.2, -0.2])
    found = assess(problem, values, J)
    white = J / SD[:, None]
    modes = white[:, [1, 3]] * [1.0, 0.7]
    root = np.linalg.cholesky(np.eye(7) + modes @ modes.T)
    width = np.array([np.log(1000.0), 10.0])
    named = np.linalg.solve(root, white[:, [0, 2]] * SLOPE * width)
    expected = np.linalg.svd(named, compute_uv=False)
    np.testing.assert_allclose(found.singular_values, expected, rtol=1e-9)
    precision = np.diag([0.0, 1.0, 0.4**-2, 0.7**-2]) + white.T @ white
    C = np.linalg.inv(precision)
    np.testing.assert_allclose(found.covariance, C, rtol=1e-6)
    assert not any("m1" in said or "m2" in said for said in sentences_of(found.findings))


@pytest.mark.parametrize("undetermined", [True, False])
@pytest.mark.parametrize("wide", [0.9, 1.1])
def test_a_band_follows_what_deviates_from_linear(wide, undetermined):
    """A parameter of which a reading depends by t - t^2 / 2 only, t even between 0 and 1.

    It is not determined where that moves it more than its own error, if t is not.
    """
    known = assess(problem_of(shared=False), AT, A)
    t = (np.arange(4000) + 0.5) / 4000
    normal = norm.ppf((np.arange(4000) * np.sqrt(2.0)) % 1.0)
    even = Posterior(np.stack([t, 0.0 * t]), np.full(4000, 1 / 4000), np.zeros((2, 1)), normal)
    known = replace(known, posterior=even)
    path = np.linspace(0.0, 1.0, 40)
    bent = Nonlinearity(
        path,
        -0.5 * path[:, None] ** 2,
        t,
        undetermined=undetermined,
        used_deviation=np.empty((len(path), 0)),
    )
    sd = np.array([np.std(t - 0.5 * t**2) / wide])
    band = predict_band(known, np.array([[1.0, 0.0]]) / SLOPE, sd, bent)
    assert np.isinf([band.sd[0], band.lower95[0], band.upper95[0]]).all() == (
        undetermined and wide > 1.0
    )
    if undetermined:
        return
    y = t - 0.5 * t**2
    assert band.sd[0] == pytest.approx(np.sqrt(np.mean(y**2) + sd[0] ** 2), rel=1e-3)
    below = norm.cdf(np.array([band.lower95, band.upper95]) - y, scale=sd[0]).mean(axis=1)
    assert below[1] - below[0] == pytest.approx(0.95, abs=4e-3)


def test_what_another_posterior_finds_too_wide_is_not_determined():
    """More than half of the range to one side; two of three, named together."""
    three = (*(replace(q, prior=None) for q in Q), Parameter("c", 4.0, 1.0, 9.0))
    J = np.hstack([A, RNG.normal(size=(7, 1))]) * 20.0
    problem = Problem(None, Y, SD, three)
    at = np.array([*AT, 4.0])
    known = assess(problem, at, J)
    assert known.determined.all()
    width = np.array([np.log(1000.0), 10.0, 2.0])
    for sizes, lost in (
        ((0.49, 0.49, 0.4), ""),
        ((0.51, 0.3, 0.3), "E"),
        ((0.51, 0.51, 0.3), "EK"),
    ):
        factor = np.diag(np.array(sizes) * width / norm.ppf(0.975))
        other = Posterior(np.zeros((3, 1)), np.ones(1), factor, np.zeros(1))
        found = with_posterior(known, problem, at, other)
        gone = np.array([q.name in lost for q in three])
        np.testing.assert_array_equal(found.determined, ~gone)
        sd = np.array([*SLOPE, 4.0]) * np.diag(factor)
        np.testing.assert_allclose(found.sd, np.where(gone, np.nan, sd))
        said = {"E": "E is not determined: near the estimate it seems",
                "EK": "E and K are not determined: near the estimate they seem"}  # fmt: skip
        more = "to be known, but values far from it fit the readings nearly as well."
        expected = (f"{said[lost]} {more}",) if lost else ()
        assert sentences_of(found.findings[len(known.findings) :]) == expected


def test_the_normal_that_is_cut_has_the_gradient_that_a_bound_holds():
    """E on its lower bound, pressed; K on its upper one, not pressed: it would leave by itself."""
    at = np.array([0.3, 90.0])
    scaled = A * [0.3, 17.0]
    y = A @ at + 0.05 * A @ np.array([-1.0, -1.0])
    problem = Problem(None, y, SD, (Q[0], replace(Q[1], prior=None)))
    found = assess(problem, at, A, A @ at)
    H = (scaled / SD[:, None]).T @ (scaled / SD[:, None])
    gradient = scaled.T @ ((A @ at - y) / SD**2)
    assert gradient.tolist() == pytest.approx((H @ (0.05 / np.array([0.3, 17.0]))).tolist())
    pressed = np.where(gradient * [1.0, -1.0] > 0.0, gradient, 0.0)
    assert (pressed != 0.0).tolist() == [True, False]
    C = found.uncut_factor @ found.uncut_factor.T
    np.testing.assert_allclose(C, np.linalg.inv(H), rtol=1e-6)
    np.testing.assert_allclose(found.uncut_mean, -C @ pressed, rtol=1e-6)
