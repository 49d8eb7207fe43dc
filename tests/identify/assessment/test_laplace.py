"""What a minimum holds, and the evidence: against quadrature, scipy and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.integrate import dblquad, quad
from scipy.stats import multivariate_normal

from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.laplace import laplace_mass, log_normalisation, log_prior_volume
from geoident.identify.assessment.truncated_normal import log_probability_within
from geoident.identify.problem.losses import transformed
from geoident.identify.problem.problem import Discrepancy, Linearization
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.methods import HuberOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter, Prior


def _mass(problem, p):
    discrepancy = Discrepancy(problem)
    x = discrepancy.scaling.to_scaled(np.asarray(p))
    return laplace_mass(discrepancy.linearize(np.asarray(p)), x, discrepancy.scaling)[0]


@pytest.mark.parametrize("measured", [[0.9, 0.4], [3.0, 2.2], [-5.0, 0.0]], ids=str)
def test_the_mass_of_a_linear_model_is_the_integral_over_the_bounds(make_problem, measured):
    """Inside, on one bound, and far outside of both."""
    A = np.array([[1.0, 0.3], [0.2, 0.8]])
    q = [Parameter("a", 1.0, -1.0, 2.0), Parameter("b", 1.0, -1.0, 2.0)]
    problem = make_problem(lambda p: A @ p, q, measured, 0.5)
    discrepancy = Discrepancy(problem)

    def density(b, a):
        p = discrepancy.scaling.to_natural(np.array([a, b]))
        return np.exp(-0.5 * discrepancy.objective(p))

    low, high = discrepancy.scaling.lower, discrepancy.scaling.upper
    expected, _ = dblquad(density, low[0], high[0], low[1], high[1], epsabs=0.0, epsrel=1e-6)
    for at in ([1.0, 1.0], [2.0, 0.3]):  # the linearised model is the same from everywhere
        assert _mass(problem, at) == pytest.approx(np.log(expected), abs=3e-3)


def test_the_evidence_of_a_linear_model_is_the_density_of_its_readings(make_problem):
    """y = A p + e with p ~ N(m, S) and errors that share one: y ~ N(A m, A S A' + Sigma)."""
    rng = np.random.default_rng(2)
    A, B = rng.normal(size=(6, 2)), 0.4 * rng.normal(size=(6, 1))
    m, s = np.array([1.0, -0.5]), np.array([0.4, 0.7])
    q = [
        Parameter(n, 0.1, -90.0, 90.0, prior=Prior(a, b))
        for n, a, b in zip("ab", m, s, strict=True)
    ]
    y, sd = rng.normal(size=6), rng.uniform(0.2, 0.5, 6)
    problem = replace(make_problem(lambda p: A @ p, q, y, sd), shared=SharedErrors(sp.csr_array(B)))
    found = _mass(problem, [0.3, 0.2]) - log_prior_volume(tuple(q))
    found -= log_normalisation(problem, A @ m)
    sigma = np.diag(sd**2) + B @ B.T + A @ np.diag(s**2) @ A.T
    assert found == pytest.approx(multivariate_normal(A @ m, sigma).logpdf(y), rel=1e-6)


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("kind", ["normal", "lognormal"])
def test_the_volume_of_a_prior_is_its_integral_between_the_bounds(scale, kind):
    parameter = Parameter("E", 3.0, 1.0, 6.0, scale, Prior(4.0, 1.3, kind))
    scaling = Scaling([parameter])

    def density(x):
        return np.exp(
            -0.5 * float(scaling.prior_residuals(scaling.to_natural(np.array([x])))[0]) ** 2
        )

    expected, _ = quad(density, scaling.lower[0], scaling.upper[0], epsabs=0.0, epsrel=1e-10)
    assert log_prior_volume((parameter,)) == pytest.approx(np.log(expected), abs=1e-8)


@pytest.mark.parametrize("upper", [1.05, 2.0, 50.0])
def test_the_volume_without_priors_is_that_of_the_box(upper):
    """Narrow or wide; what cannot move takes nothing away."""
    logarithmic = Parameter("E", 1.02, 1.0, upper, "log")
    held, K0 = Parameter("nu", 0.3, 0.3, 0.3), Parameter("K0", 1.0, 0.9, 1.1)
    wide = float(np.diff([Scaling([K0]).lower[0], Scaling([K0]).upper[0]])[0])
    expected = np.log(np.log(upper)) + np.log(wide)
    assert log_prior_volume((logarithmic, held, K0)) == pytest.approx(expected, abs=1e-12)


def test_a_parameter_without_bounds_and_prior_has_no_volume():
    assert log_prior_volume((Parameter("a", 1.0, -np.inf, np.inf),)) == np.inf


@pytest.mark.parametrize("loss", [SquaredOptions(), HuberOptions(), StudentOptions()], ids=str)
def test_the_normalisation_is_the_integral_over_the_readings(make_problem, loss):
    problem = replace(
        make_problem(lambda p: p, [Parameter("a", 1.0, 0.0, 2.0)], [0.5], 0.3), loss=loss
    )

    def density(y):
        f, _ = transformed(loss, np.array([y / 0.3]))
        return float(np.exp(-0.5 * f[0] ** 2))

    expected, _ = quad(density, -np.inf, np.inf, epsabs=0.0, epsrel=1e-10, limit=500)
    assert log_normalisation(problem, np.array([0.5])) == pytest.approx(np.log(expected), abs=1e-6)


def test_the_covariance_of_a_minimum_is_that_of_the_readings_and_a_hundred_ranges():
    """Ranges of a parameter between bounds, and ten of one that has none; of one held, nothing."""
    parameters = (
        Parameter("a", 2.0, 1.0, 4.0),
        Parameter("b", 3.0, -np.inf, np.inf),
        Parameter("c", 5.0, 5.0, 5.0),
        Parameter("d", 2.0, 1.0, 8.0, "log"),
    )
    J = np.array([[0.7, 0.0, 0.02, 0.3], [0.2, 1e-4, 0.0, -0.6]])
    r = np.array([0.4, -0.9])
    scaling = Scaling(parameters)
    x = scaling.to_scaled(np.array([2.5, 4.0, 5.0, 3.0]))
    log_mass, covariance_x = laplace_mass(Linearization(r, J, r), x, scaling)
    some = [0, 1, 3]
    width = np.array([3.0 / 2.0, 10.0, np.log(8.0)])
    curvature = J[:, some].T @ J[:, some] + np.diag((100.0 * width) ** -2.0)
    covariance = covariance_x[np.ix_(some, some)]
    np.testing.assert_allclose(covariance, np.linalg.inv(curvature), rtol=1e-6)
    assert not covariance_x[2].any()
    assert not covariance_x[:, 2].any()
    gradient = J[:, some].T @ r
    step = np.linalg.solve(curvature, gradient)
    bounds = scaling.lower[some], scaling.upper[some]
    inside = log_probability_within(x[some] - step, covariance, *bounds)
    lowest = r @ r - gradient @ step
    expected = -0.5 * lowest + 1.5 * np.log(2.0 * np.pi) - 0.5 * np.linalg.slogdet(curvature)[1]
    assert log_mass == pytest.approx(expected + inside, abs=1e-6)


def test_a_parameter_that_is_held_is_the_same_as_none(make_problem):
    """Its mass was zero, and so the evidence of every model with one."""
    A = np.array([[1.0, 0.5], [0.3, 2.0]])
    free, held = Parameter("a", 1.0, 0.0, 5.0), Parameter("b", 2.0, 2.0, 2.0)
    y = A @ [1.1, 2.0]
    both = make_problem(lambda p: A @ p, [free, held], y, 0.3)
    alone = make_problem(lambda p: A @ np.append(p, 2.0), [free], y, 0.3)
    assert _mass(both, [1.0, 2.0]) == pytest.approx(_mass(alone, [1.0]), abs=1e-9)


def test_shared_errors_count_beside_the_own_ones_under_any_loss(make_problem):
    """Half the determinant of all by that of the own; with weights of a robust loss in both."""
    B = np.array([[0.5, 0.0], [0.4, 0.2], [0.0, 0.7], [0.3, 0.3]])
    sd, y = np.array([0.3, 0.2, 0.4, 0.25]), np.array([1.0, 1.1, 3.9, 1.0])
    q = [Parameter("a", 1.0, 0.0, 2.0)]
    base = make_problem(lambda p: np.ones(4) * p[0], q, y, sd)
    base = replace(base, shared=SharedErrors(sp.csr_array(B)))
    v = np.ones(4)
    for loss in (SquaredOptions(), HuberOptions(1.3), StudentOptions(4.0)):
        problem = replace(base, loss=loss)
        alone = replace(problem, shared=None)
        own = effective_sd(problem, v)
        assert (own[2] > 2.0 * sd[2]) == (loss != SquaredOptions())
        more = np.linalg.slogdet(np.diag(own**2) + B @ B.T)[1] - 2.0 * np.log(own).sum()
        expected = log_normalisation(alone, v) + 0.5 * more
        assert log_normalisation(problem, v) == pytest.approx(expected, rel=1e-9)
