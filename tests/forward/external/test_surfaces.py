"""Response surfaces: derivatives, errors of runs left out, own errors, which one is taken."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc

from geoident.forward.external.surfaces.gaussian_process import (
    ProcessLikelihood,
    fitted_process,
    process_with,
)
from geoident.forward.external.surfaces.polynomial import fitted_polynomial, orders, terms
from geoident.forward.external.surfaces.surface import (
    RunCoordinates,
    calibration,
    error_root,
    rms,
    surfaces_of,
    together,
)

AT = np.array([0.3, -0.4])


def smooth(u):
    """A function without a bend."""
    return np.exp(-0.8 * u[..., 0]) * (1.0 + 0.5 * u[..., 1]) + 0.1 * np.sin(2.0 * u[..., 1])


def bent(u):
    """One with a bend, as of ground that begins to yield."""
    return smooth(u) + 0.3 * np.maximum(u[..., 0] + 0.3 * u[..., 1], 0.0) ** 1.5


def spread(count, seed=1, n=2):
    """Coordinates (count, n) over the whole range."""
    return 2.0 * qmc.LatinHypercube(n, seed=seed).random(count) - 1.0


def slopes(value, u, h=1e-2):
    """Derivatives by differences of eighth order: their error is far below that of the digits."""
    weights = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
    return np.array(
        [sum(w * (value(u + k * h * e) - value(u - k * h * e)) for k, w in weights) / h
         for e in np.eye(len(u))]
    )  # fmt: skip


def surfaces(function, u):
    y = function(u)
    yield fitted_process(u, y, smooth=True)
    yield fitted_process(u, y, smooth=False)
    yield fitted_polynomial(u, y, 4)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_derivatives_are_those_of_the_surface(which):
    surface = list(surfaces(bent, spread(60)))[which]
    value, gradient = surface.value(AT)
    assert value == pytest.approx(bent(AT), abs=0.02)
    np.testing.assert_allclose(gradient, slopes(lambda u: surface.value(u)[0], AT), rtol=1e-6)


@pytest.mark.parametrize("which", [0, 1])
def test_errors_of_a_process_are_those_of_fits_without_each_run(which):
    u = spread(30)
    process = list(surfaces(bent, u))[which]
    given = replace(process.hyperparameters, nugget=1e-4)
    process = process_with(u, process.y, given)
    for k in range(len(u)):
        rest = np.arange(len(u)) != k
        other = process_with(u[rest], process.y[rest], given)
        error = process.y[k] - other.value(u[k])[0]
        assert process.errors[k] == pytest.approx(error, rel=1e-6, abs=1e-10)
        # the variance of the process is that of all runs, in closed form
        sd = other.deviation(u[k]) * np.sqrt(process.variance / other.variance)
        assert process.expected[k] == pytest.approx(sd, rel=1e-6)


def test_errors_of_a_polynomial_are_those_of_fits_without_each_run():
    u = spread(30)
    polynomial = fitted_polynomial(u, bent(u), 3)
    for k in range(len(u)):
        rest = np.arange(len(u)) != k
        other = fitted_polynomial(u[rest], bent(u[rest]), 3)
        assert polynomial.errors[k] == pytest.approx(bent(u[k]) - other.value(u[k])[0], rel=1e-9)
        sd = other.deviation(u[k]) * np.sqrt(polynomial.variance / other.variance)
        assert polynomial.expected[k] == pytest.approx(sd, rel=1e-9)


@pytest.mark.parametrize("kind", [True, False])
def test_the_likelihood_has_its_derivatives_and_a_maximum(kind):
    u = spread(40)
    likelihood = ProcessLikelihood(u, bent(u), smooth=kind)
    theta = np.array([0.2, 0.5, -7.0])
    np.testing.assert_allclose(
        likelihood(theta)[1], slopes(lambda t: likelihood(t)[0], theta), rtol=1e-6
    )
    found = fitted_process(u, bent(u), smooth=kind).hyperparameters
    best = np.log([*found.lengths, found.nugget])
    for step in 0.3 * np.vstack([np.eye(3), -np.eye(3)]):
        other = best + step
        if np.exp(other[-1]) > 1e-8:  # less of a nugget is not looked for
            assert likelihood(best)[0] <= likelihood(other)[0] + 1e-3


@pytest.mark.parametrize("n", [1, 2])
def test_the_likelihood_is_that_of_contrasts_of_the_runs(n):
    """The restricted likelihood is that of what the trend leaves: A y with A F = 0."""
    u = spread(12)
    y, u = bent(u), u[:, :n]
    F = np.column_stack([np.ones(12), u])
    A = np.linalg.svd(F)[0][:, 1 + n :].T

    def by_contrasts(theta):
        given = fitted_process(u, y, smooth=True).hyperparameters
        given = replace(given, lengths=np.exp(theta[:-1]), nugget=np.exp(theta[-1]))
        K = given.correlation(u, u) + given.nugget * np.eye(12)
        whole = A @ K @ A.T
        size = A @ y @ np.linalg.solve(whole, A @ y) / len(A)
        return 0.5 * (len(A) * np.log(size) + np.linalg.slogdet(whole)[1])

    likelihood = ProcessLikelihood(u, y, smooth=True)
    one, two = np.array([0.1, 0.4, -4.0])[-1 - n :], np.array([0.6, -0.2, -2.0])[-1 - n :]
    found = likelihood(one)[0] - likelihood(two)[0]
    assert found == pytest.approx(by_contrasts(one) - by_contrasts(two), rel=1e-9)


def test_own_errors_are_as_large_as_the_surface_says():
    """Over many tables of a function, its error in standard deviations has the size one."""
    z = []
    for seed in range(15):
        u = spread(25, seed)
        (surface,) = surfaces_of(u, bent(u)[:, None], np.array([1e-9]), "gaussian-process")
        for at in 0.8 * spread(5, 100 + seed):
            error = bent(at) - surface.value(at)[0]
            z.append(error / surface.deviation(at) / calibration(surface))
    assert 0.6 < rms(np.array(z)) < 1.4
    assert np.mean(np.abs(z) < 1.96) > 0.92


def test_errors_of_surfaces_go_together_as_their_runs_left_out_do():
    u = spread(50)
    readings = np.column_stack([bent(u), 3.0 * bent(u), np.cos(4.0 * u[:, 1] + u[:, 0])])
    found = surfaces_of(u, readings, np.full(3, 1e-9), "polynomial")
    R = together(found)
    assert R[0, 1] > 0.9
    assert abs(R[0, 2]) < 0.5
    root = error_root(found, AT)
    sd = np.sqrt(np.diag(root @ root.T))
    np.testing.assert_allclose(sd, [calibration(f) * f.deviation(AT) for f in found], rtol=1e-9)
    np.testing.assert_allclose((root @ root.T) / np.outer(sd, sd), R, atol=1e-9)
    assert sd[1] == pytest.approx(3.0 * sd[0], rel=1e-9)


def test_the_surface_with_the_smaller_error_is_taken():
    u = spread(60)
    cubic = u[:, 0] ** 3 - 2.0 * u[:, 0] * u[:, 1] + 1.0
    (found,) = surfaces_of(u, cubic[:, None], np.array([1e-12]), "auto")
    assert found.words == "polynomial of order 3"
    (found,) = surfaces_of(u, bent(u)[:, None], np.array([1e-9]), "auto")
    assert found.words.startswith("Gaussian process")
    (found,) = surfaces_of(u, smooth(u)[:, None], np.array([1.0]), "gaussian-process")
    assert found.words == "Gaussian process"


def test_noise_of_the_runs_is_no_detail_of_the_surface():
    u = spread(200)
    noise = 0.02 * np.random.default_rng(0).standard_normal(200)
    surface = fitted_process(u, smooth(u) + noise, smooth=True)
    assert surface.value(AT)[0] == pytest.approx(smooth(AT), abs=0.012)
    noise_found = np.sqrt(surface.variance * surface.hyperparameters.nugget)
    assert noise_found == pytest.approx(0.02, rel=0.15)
    assert surface.deviation(AT) >= noise_found


def test_a_reading_that_never_changes_is_a_surface_too():
    u = spread(20)
    for kind in ("auto", "gaussian-process", "polynomial"):
        (found,) = surfaces_of(u, np.zeros((20, 1)), np.array([1e-4]), kind)
        value, gradient = found.value(AT)
        assert (value, found.deviation(AT)) == pytest.approx((0.0, 0.0), abs=1e-12)
        np.testing.assert_allclose(gradient, 0.0, atol=1e-12)


def test_polynomials_have_enough_runs():
    assert len(terms(3, 2)) == 10
    assert orders(2, 3) == orders(9, 3) == [1]
    assert orders(20, 3) == [1, 2]
    assert orders(1000, 2)[-1] == 6


def test_coordinates_follow_the_scale_of_a_parameter():
    there = RunCoordinates(np.array([True, False]), np.array([1e9, 0.5]), np.array([1e11, 1.5]))
    p = np.array([1e10, 1.25])
    np.testing.assert_allclose(there.of(p), [0.0, 0.5], atol=1e-12)
    h = np.array([1e-6 * 1e10, 1e-6])
    found = [(there.of(p + d) - there.of(p - d)) / 2 for d in np.diag(h)]
    np.testing.assert_allclose(np.diag(found) / h, there.slope(p), rtol=1e-8)
