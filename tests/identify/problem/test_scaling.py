import numpy as np
import pytest

from geoident.errors import ModelError
from geoident.identify.problem.problem import Discrepancy
from geoident.identify.problem.scaling import Scaling
from geoident.model.parameter import Parameter, Prior

MODULUS = Parameter("E", 15e9, 2e9, 80e9, "log", prior=Prior(12e9, 3e9, "lognormal"))
STRESS = Parameter("sigma_v", 8e6, 2e6, 20e6, prior=Prior(7e6, 1e6))
ANGLE = Parameter("angle", 0.0, -90.0, 90.0)
ALL = (MODULUS, STRESS, ANGLE)


def test_scaling_goes_there_and_back():
    scaling = Scaling(ALL)
    p = np.array([3e9, 19e6, -12.0])
    np.testing.assert_allclose(scaling.to_natural(scaling.to_scaled(p)), p, rtol=1e-14)


def test_bounds_are_met_exactly_in_spite_of_rounding():
    scaling = Scaling(ALL)
    np.testing.assert_array_equal(scaling.to_natural(scaling.upper), [80e9, 20e6, 90.0])
    np.testing.assert_array_equal(scaling.to_natural(scaling.lower - 1.0), [2e9, 2e6, -90.0])


def test_scaled_parameters_are_of_order_one_where_the_start_is_zero_or_the_bounds_are_tight():
    scaling = Scaling([ANGLE, Parameter("T", 1000.0, 999.0, 1001.0), Parameter("c", 7.0, 7.0, 7.0)])
    np.testing.assert_allclose(scaling.reference, [18.0, 2.0, 7.0])


def test_slope_and_prior_jacobian_are_derivatives():
    scaling = Scaling(ALL)
    x, h = scaling.to_scaled(np.array([5e9, 9e6, 4.0])), 1e-6
    p = scaling.to_natural(x)
    for i, e in enumerate(np.eye(3) * h):
        up, down = scaling.to_natural(x + e), scaling.to_natural(x - e)
        np.testing.assert_allclose((up - down)[i] / (2 * h), scaling.dp_dx(p)[i], rtol=1e-8)
        difference = (scaling.prior_residuals(up) - scaling.prior_residuals(down)) / (2 * h)
        np.testing.assert_allclose(scaling.prior_jacobian(p)[:, i], difference, atol=1e-7)


def test_prior_residuals_count_standard_deviations():
    r = Scaling(ALL).prior_residuals(np.array([12e9 * np.exp(0.25), 9e6, 0.0]))
    np.testing.assert_allclose(r, [1.0, 2.0], rtol=1e-12)


@pytest.mark.parametrize("value", [1e-6, 0.3, 0.5, 1.0, 30.0])
def test_a_lognormal_prior_counts_in_logarithms_whatever_the_unit(value):
    """Angles in rad are below 1: 0.3 at 0.6 with 0.06 rad is ten times ln 2 off."""
    q = Parameter("phi", 0.5, 0.0, 40.0, prior=Prior(0.6, 0.06, "lognormal"))
    expected = 10.0 * np.log(value / 0.6)
    assert Scaling([q]).prior_residuals(np.array([value])) == pytest.approx([expected])


def test_a_lognormal_prior_excludes_negative_values():
    q = Parameter("T", 1.0, -1.0, 2.0, prior=Prior(1.0, 0.1, "lognormal"))
    assert Scaling([q]).prior_residuals(np.array([-0.5]))[0] == -np.inf


def test_discrepancy_is_infinite_outside_the_domain_and_where_there_is_no_solution(make_problem):
    def collapse(p):
        raise ModelError("The bench slides.")

    parameters, p = [MODULUS], np.array([15e9])
    outside = make_problem(lambda p: p, parameters, [1.0], 1.0, refuse=lambda p: "E is too low.")
    assert Discrepancy(outside).objective(p) == np.inf
    assert outside.response.evaluations == 0
    assert Discrepancy(make_problem(collapse, parameters, [1.0], 1.0)).objective(p) == np.inf
    with pytest.raises(ModelError, match="too low"):
        Discrepancy(outside).linearize(p)
