"""Problems, their residuals and histories, number by number."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import minimize

from geoident.errors import ModelError
from geoident.identify.problem import problem as module
from geoident.identify.problem.errors import SharedErrors
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import (
    Discrepancy,
    full_weights,
    own_residuals,
    transformed,
    weights,
)
from geoident.identify.problem.scaling import Scaling
from geoident.model.methods import HuberOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter, Prior

P = (
    Parameter("a", 2.0, 0.5, 9.0, "log"),
    Parameter("b", 1.0, -4.0, 3.0, prior=Prior(0.5, 0.2)),
)
MEASURED = np.array([1.0, 3.0, -2.0, 6.0])
SD = np.array([0.1, 0.4, 0.3, 0.2])
B = np.array([[0.3, 0.0], [0.2, 0.5], [0.0, 0.7], [0.0, 0.0]])
LOSSES = [HuberOptions(1.7), StudentOptions(3.5)]


def function(p):
    return np.array([p[0], p[0] * p[1], p[1] ** 2 - p[0], 3.0 * p[1]])


@pytest.fixture
def problem(make_problem):
    return make_problem(function, P, MEASURED, SD)


def shared(problem):
    return replace(problem, shared=SharedErrors(sp.csr_array(B)))


# Losses


@pytest.mark.parametrize("loss", LOSSES)
def test_weights_and_curvature_are_derivatives_of_the_loss(loss):
    """rho' / (2 r) and rho'' / 2, by differences; cut at 1 where a weight is asked for."""
    r = np.array([-8.0, -1.9, -1.5, -0.4, 0.3, 1.6, 1.8, 5.0])

    def rho(r):
        return transformed(loss, r)[0] ** 2

    h = 1e-5
    slope = (rho(r + h) - rho(r - h)) / (2.0 * h)
    bend = (rho(r + 10 * h) - 2.0 * rho(r) + rho(r - 10 * h)) / (10 * h) ** 2
    np.testing.assert_allclose(full_weights(loss, r), slope / (2.0 * r), rtol=1e-6)
    np.testing.assert_allclose(module._curvature(loss, r), 0.5 * bend, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(weights(loss, r), np.minimum(1.0, slope / (2.0 * r)), rtol=1e-6)


def test_weights_in_numbers():
    """nu = 3.5: 4.5 / (3.5 + r^2); delta = 1.7."""
    r = np.array([0.0, 0.9, -2.0, 3.4])
    np.testing.assert_allclose(full_weights(StudentOptions(3.5), r), 4.5 / (3.5 + r**2))
    np.testing.assert_allclose(weights(StudentOptions(3.5), r), [1.0, 1.0, 0.6, 4.5 / 15.06])
    np.testing.assert_allclose(weights(HuberOptions(1.7), r), [1.0, 1.0, 0.85, 0.5])
    np.testing.assert_allclose(full_weights(HuberOptions(1.7), r), [1.0, 1.0, 0.85, 0.5])
    for given in (weights, full_weights, module._curvature):
        assert given(SquaredOptions(), r).tolist() == [1.0] * 4
    assert module._curvature(HuberOptions(1.7), np.array([1.7, -1.7, 1.71])).tolist() == [1, 1, 0]
    f, slope = transformed(HuberOptions(1.7), np.array([1.7, -3.4, 0.0]))
    np.testing.assert_allclose(f, [1.7, -np.sqrt(3.0) * 1.7, 0.0])
    np.testing.assert_allclose(slope, [1.0, 1.0 / np.sqrt(3.0), 1.0])
    f, slope = transformed(StudentOptions(3.5), np.array([0.0, 1e-170]))
    np.testing.assert_allclose(slope, np.sqrt(4.5 / 3.5))
    np.testing.assert_allclose(f, [0.0, 1e-170 * np.sqrt(4.5 / 3.5)])


# Residuals


def test_a_problem_in_numbers(problem):
    assert problem.start.tolist() == [2.0, 1.0]
    assert [ends.tolist() for ends in problem.bounds] == [[0.5, -4.0], [9.0, 3.0]]
    moved = problem.begun_at(np.array([20.0, -1.5]))
    assert moved.start.tolist() == [9.0, -1.5]
    assert problem.begun_at(np.array([0.1, 5.0])).start.tolist() == [0.5, 3.0]
    assert replace(moved, parameters=P) == problem
    table = np.arange(8.0).reshape(4, 2)
    np.testing.assert_allclose(problem.whiten(table), table / SD[:, None])
    np.testing.assert_allclose(problem.whiten(table[:, 1]), table[:, 1] / SD)
    none = replace(problem, parameters=())
    assert [ends.shape for ends in none.bounds] == [(0,), (0,)]


def test_residuals_are_those_of_readings_then_of_priors(problem):
    p = np.array([1.5, 0.8])
    r = (function(p) - MEASURED) / SD
    prior = (0.8 - 0.5) / 0.2
    found = Discrepancy(problem)
    np.testing.assert_allclose(found.residuals(p, function(p)), [*r, prior])
    np.testing.assert_allclose(found.whitened_residuals(function(p)), r)
    assert found.squares(p, function(p)) == pytest.approx(r @ r + prior**2)
    assert found.objective(p) == pytest.approx(r @ r + prior**2)
    for loss in LOSSES:
        f, _ = transformed(loss, r)
        robust = Discrepancy(replace(problem, loss=loss))
        np.testing.assert_allclose(robust.residuals(p, function(p)), [*f, prior])
        np.testing.assert_allclose(robust.whitened_residuals(function(p)), r)
        assert robust.squares(p, function(p)) == pytest.approx(r @ r + prior**2)


@pytest.mark.parametrize("loss", [SquaredOptions(), *LOSSES])
@pytest.mark.parametrize("common", [False, True])
def test_the_slope_of_phi_is_that_of_differences(problem, loss, common):
    given = replace(shared(problem) if common else problem, loss=loss)
    found = Discrepancy(given)
    x = found.scaling.to_scaled(np.array([1.5, 0.8]))
    at = found.linearize(found.scaling.to_natural(x))
    for h, step in enumerate(1e-5 * np.eye(2)):
        up, down = (found.objective(found.scaling.to_natural(x + s)) for s in (step, -step))
        gradient = 2.0 * at.jacobian[:, h] @ at.residual
        assert gradient == pytest.approx((up - down) / 2e-5, rel=1e-6)
    p = np.array([1.5, 0.8])
    v, J = given.response.evaluate(p)
    again = found.linearization_of(p, v, J)
    np.testing.assert_array_equal(again.residual, at.residual)
    np.testing.assert_allclose(again.jacobian, at.jacobian, rtol=1e-12)


@pytest.mark.parametrize("loss", [SquaredOptions(), *LOSSES])
def test_shared_errors_are_those_that_lower_phi_most(problem, loss):
    """Against a general minimiser over z; none without shared errors."""
    given = replace(shared(problem), loss=loss)
    readings = function(np.array([1.5, 0.8]))
    own, z = own_residuals(given, readings)
    np.testing.assert_allclose(own, (readings - MEASURED - B @ z) / SD)

    def phi(z):
        f, _ = transformed(loss, (readings - MEASURED - B @ z) / SD)
        return f @ f + z @ z

    lowest = minimize(phi, np.zeros(2), tol=1e-12)
    assert phi(z) <= lowest.fun * (1.0 + 1e-9)
    np.testing.assert_allclose(z, lowest.x, atol=1e-4)
    robust = not isinstance(loss, SquaredOptions)
    found = Discrepancy(given)
    assert found.latent == robust
    p = np.array([1.5, 0.8])
    assert found.objective(p) == pytest.approx(lowest.fun + 1.5**2, rel=1e-8)
    if robust:
        f, _ = transformed(loss, own)
        np.testing.assert_allclose(found.residuals(p, readings), [*f, *z, 1.5])
    alone, nothing = own_residuals(replace(problem, loss=loss), readings)
    np.testing.assert_allclose(alone, (readings - MEASURED) / SD)
    assert nothing.shape == (0,)


def test_without_finite_readings_shared_errors_are_zero(problem):
    own, z = own_residuals(shared(problem), np.array([np.inf, 1.0, 2.0, 3.0]))
    assert np.isinf(own[0])
    assert z.tolist() == [0.0, 0.0]


def test_rows_of_a_robust_problem_leave_out_what_shared_errors_do(problem):
    """[W (J - B X); X] with X = (1 + B^T W^2 B)^-1 B^T W^2 J, the whole at once."""
    loss = HuberOptions(1.7)
    given = replace(shared(problem), loss=loss)
    p = np.array([1.5, 0.8])
    v, J = given.response.evaluate(p)
    own, _ = own_residuals(given, v)
    W = transformed(loss, own)[1] / SD
    dx = J * [1.5, 3.5]  # p, and the reference of b: its width of 7, times a tenth, is less than 1
    dx[:, 1] = J[:, 1] * Scaling(P).reference[1]
    C, rows = W[:, None] * B, W[:, None] * dx
    X = np.linalg.solve(np.eye(2) + C.T @ C, C.T @ rows)
    expected = np.vstack([rows - C @ X, X, [0.0, Scaling(P).reference[1] / 0.2]])
    np.testing.assert_allclose(Discrepancy(given).linearize(p).jacobian, expected, atol=1e-12)


def test_numbers_that_overflow_are_no_solution(make_problem):
    for size, slope, fine in (
        (1e153, 1.0, True),
        (1e100, 1e100, True),
        (1e155, 1.0, False),
        (1.0, 1e155, False),
    ):
        given = make_problem(lambda p: p, P[:1], [0.0], 1.0)
        given.response.evaluate = lambda p, size=size, slope=slope: (
            np.array([size]),
            np.array([[slope]]),
        )
        if fine:
            assert Discrepancy(given).linearize(np.ones(1)).objective == pytest.approx(size**2)
            continue
        with pytest.raises(ModelError, match="exceed the range of floating-point") as caught:
            Discrepancy(given).linearize(np.ones(1))
        assert "Check the units" in caught.value.hint
    large = make_problem(lambda p: 1e200 * p, P[:1], [0.0], 1.0)
    assert Discrepancy(large).objective(np.ones(1)) == np.inf
    none = make_problem(lambda p: np.nan * p, P[:1], [0.0], 1.0)
    assert Discrepancy(none).objective(np.ones(1)) == np.inf


def test_noise_is_in_standard_deviations(problem):
    assert Discrepancy(problem).noise().tolist() == [0.0] * 4
    problem.response.noise = np.array([0.1, 0.2, 0.0, 0.5])
    np.testing.assert_allclose(Discrepancy(problem).noise(), problem.response.noise / SD)


# Scaling


def test_references_are_sizes_within_widths():
    """The start, a tenth of the width, or the width where that is less; 1 or the start without."""
    ends = {
        (5.0, 0.0, 9.0): 5.0,
        (-5.0, -9.0, 0.0): 5.0,
        (0.4, 0.0, 9.0): 0.9,
        (5.0, 4.0, 6.0): 2.0,
        (5.0, 5.0, 5.0): 5.0,
        (0.0, 0.0, 0.0): 1.0,
        (-0.3, -np.inf, 4.0): 0.3,
        (0.0, -np.inf, np.inf): 1.0,
    }
    found = Scaling([Parameter("p", *given) for given in ends]).reference
    np.testing.assert_allclose(found, list(ends.values()))


def test_steps_away_stay_within_the_bounds():
    scaling = Scaling([*P, replace(P[0], name="c")])
    p = np.array([2.0, 1.0, 3.0])
    away = scaling.away(p, np.array([0.3, -0.25, -9.0]))
    np.testing.assert_allclose(away, [2.0 * np.exp(0.3), 1.0 - 0.25, 0.5])
    np.testing.assert_allclose(scaling.away(p, np.array([1e4, 9.0, 0.0])), [9.0, 3.0, 3.0])
    assert len(scaling) == 3


def test_priors_count_rows_in_their_order():
    parameters = [
        Parameter("a", 2.0, 0.5, 9.0, "log", Prior(3.0, 0.6, "lognormal")),
        Parameter("b", 2.0, 0.5, 9.0),
        Parameter("c", 2.0, 0.5, 9.0, "log", Prior(3.0, 0.6)),
        Parameter("d", 4.0, 0.5, 9.0, prior=Prior(3.0, 0.6, "lognormal")),
    ]
    scaling, p = Scaling(parameters), np.array([2.5, 1.0, 4.0, 5.0])
    expected = [np.log(2.5 / 3.0) * 5.0, 1.0 / 0.6, np.log(5.0 / 3.0) * 5.0]
    np.testing.assert_allclose(scaling.prior_residuals(p), expected)
    rows = np.zeros((3, 4))
    rows[0, 0], rows[1, 2], rows[2, 3] = 5.0, 4.0 / 0.6, 5.0 / 5.0 * 4.0
    np.testing.assert_allclose(scaling.prior_jacobian(p), rows)
    nowhere = Scaling([Parameter("d", 0.5, -1.0, 9.0, prior=Prior(3.0, 0.6, "lognormal"))])
    assert nowhere.prior_residuals(np.zeros(1)).tolist() == [-np.inf]


# Histories


def test_a_history_counts_and_listens(problem):
    seen = []

    def observe(entry):
        seen.append(entry)
        return {1: "First.", 3: "Last."}.get(entry.number)

    history = History("some-method", problem.response, observe)
    values = np.array([1.0, 2.0])
    for k, stop in enumerate((None, "First.", "First.", "Last.")):
        history.record(values, 10.0 - k, step=0.1 * k, note=f"note {k}")
        problem.response.readings(values)
        assert history.stop == stop
    values[0] = 99.0
    assert history.iterations == tuple(seen)
    assert [(e.method, e.number, e.objective, e.note) for e in seen] == [
        ("some-method", k, 10.0 - k, f"note {k}") for k in range(4)
    ]
    assert [e.step for e in seen] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert [e.values[0] for e in seen] == [1.0] * 4
    assert [e.counts.evaluations for e in seen] == [0, 1, 2, 3]
    outcome = history.outcome(values, 7.0, "converged", "Done.")
    assert (outcome.status, outcome.reason) == ("out-of-budget", "Last.")
    quiet = History("some-method", problem.response, lambda entry: None)
    outcome = quiet.outcome(values, 7.0, "converged", "Done.")
    assert (outcome.status, outcome.reason, outcome.iterations) == ("converged", "Done.", ())
