"""Problems, their residuals and histories, number by number."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import minimize

from geoident.errors import ModelError
from geoident.identify.problem.losses import transformed
from geoident.identify.problem.problem import Discrepancy, own_residuals
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.methods import HuberOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter, Prior

P = (Parameter("a", 2.0, 0.5, 9.0, "log"), Parameter("b", 1.0, -4.0, 3.0, prior=Prior(0.5, 0.2)))
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


# Residuals


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


@pytest.mark.parametrize("loss", [SquaredOptions(), *LOSSES])
@pytest.mark.parametrize("common", [False, True])
def test_noise_of_readings_scatters_phi_by_its_slope_along_them(problem, loss, common):
    """Slope and curvature of phi along each reading from differences."""
    discrepancy = Discrepancy(replace(shared(problem) if common else problem, loss=loss))
    p = np.array([1.5, 0.8])
    v, h = function(p), 1e-4
    assert discrepancy.noise_of_phi(v) == (0.0, 0.0)
    problem.response.noise = noise = np.array([0.1, 0.2, 0.0, 0.5])
    discrepancy = Discrepancy(discrepancy.problem)
    steps = h * np.eye(4)
    up, down = (np.array([discrepancy.objective_of(p, v + s * e) for e in steps]) for s in (1, -1))
    scatter, rise = discrepancy.noise_of_phi(v)
    assert scatter == pytest.approx(np.linalg.norm(noise * (up - down) / (2.0 * h)), rel=1e-4)
    if isinstance(loss, SquaredOptions):  # of robust losses Gauss-Newton's part of the curvature
        bend = (up - 2.0 * discrepancy.objective_of(p, v) + down) / h**2
        assert rise == pytest.approx(0.5 * noise**2 @ bend, rel=1e-4)


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
