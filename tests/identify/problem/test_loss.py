"""Robust losses: their formulas, an independent solver, and what they are for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import least_squares
from scipy.stats import norm
from scipy.stats import t as student
from support.affine import chain

from geoident.errors import InputError
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.losses import robust_scale, transformed, weights
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.methods import (
    CondensationOptions,
    GaussNewtonOptions,
    HuberOptions,
    ScanOptions,
    SimplexOptions,
    SquaredOptions,
    StudentOptions,
)
from geoident.model.parameter import Parameter, Prior

LOSSES = [SquaredOptions(), HuberOptions(), HuberOptions(0.3), StudentOptions(), StudentOptions(1)]
R = np.array([-300.0, -2.0, -1.345, -0.3, -1e-9, 0.0, 1e-6, 0.2, 1.2, 7.0, 1e4])
T = np.linspace(0.0, 3.0, 40)


def decay(p):
    return p[0] * np.exp(-p[1] * T)


def unknowns():
    return [Parameter("a", 1.0, 0.01, 100.0, "log"), Parameter("k", 1.0, 0.01, 100.0, "log")]


def spoiled(seed, share=0.1, size=40):
    """Readings of a = 2, k = 0.8 with their noise, and gross errors of one sign among them."""
    rng = np.random.default_rng(seed)
    measured = decay([2.0, 0.8]) + 0.05 * rng.normal(size=size)
    wrong = rng.choice(size, int(share * size), replace=False)
    measured[wrong] += rng.uniform(0.5, 2.0, len(wrong))
    return measured


def run(problem, **options):
    return gauss_newton(problem, GaussNewtonOptions(**options), lambda i: None)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_transformed_residual_has_its_derivative(loss):
    f, slope = transformed(loss, R)
    h = 1e-6 * np.maximum(np.abs(R), 1.0)
    numeric = (transformed(loss, R + h)[0] - transformed(loss, R - h)[0]) / (2 * h)
    np.testing.assert_allclose(slope, numeric, rtol=2e-5)
    assert np.all(np.sign(f) == np.sign(R))


@pytest.mark.parametrize("loss", LOSSES[:4])
def test_the_weight_is_half_the_slope_of_the_loss_by_the_residual(loss):
    r = R[np.abs(R) > 1e-3]
    f, slope = transformed(loss, r)
    np.testing.assert_allclose(weights(loss, r), np.minimum(1.0, f * slope / r), rtol=1e-12)


def test_huber_is_twice_the_loss_of_scipy():
    rho = transformed(HuberOptions(1.5), R)[0] ** 2
    z = (R / 1.5) ** 2
    np.testing.assert_allclose(rho, 1.5**2 * np.where(z <= 1, z, 2 * np.sqrt(z) - 1), rtol=1e-12)


def test_student_is_the_likelihood_of_the_t_distribution():
    rho = transformed(StudentOptions(3), R)[0] ** 2
    np.testing.assert_allclose(
        rho, -2 * (student.logpdf(R, 3) - student.logpdf(0.0, 3)), rtol=1e-9, atol=1e-14
    )


def test_huber_at_its_default_loses_five_percent():
    """Efficiency (E psi')^2 / E psi^2 for normal errors, as Huber 1964 has it."""
    f, slope = (lambda r, k=k: transformed(HuberOptions(), np.array([r]))[k][0] for k in (0, 1))
    variance = 2 * quad(lambda r: (f(r) * slope(r)) ** 2 * norm.pdf(r), 0, 9, points=[1.345])[0]
    assert (norm.cdf(1.345) - norm.cdf(-1.345)) ** 2 / variance == pytest.approx(0.95, abs=2e-3)


@pytest.mark.parametrize("seed", range(4))
def test_huber_agrees_with_an_independent_solver(make_problem, seed):
    measured = spoiled(seed)
    problem = replace(make_problem(decay, unknowns(), measured, 0.05), loss=HuberOptions())
    outcome = run(problem, tolerance=1e-12)
    reference = least_squares(
        lambda p: (decay(p) - measured) / 0.05,
        [1.0, 1.0],
        loss="huber",
        f_scale=1.345,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-13,
    )
    assert outcome.status == "converged"
    assert outcome.objective == pytest.approx(2.0 * reference.cost, rel=1e-9)
    np.testing.assert_allclose(outcome.values, reference.x, rtol=1e-5)
    assert len(outcome.iterations) <= 25


@pytest.mark.parametrize("loss", [HuberOptions(), StudentOptions()])
def test_simplex_and_scan_minimise_the_same_loss(make_problem, loss):
    problem = replace(make_problem(decay, unknowns(), spoiled(1), 0.05), loss=loss)
    best = run(problem, tolerance=1e-12)
    found = identify(problem, [SimplexOptions()], lambda i: None)
    np.testing.assert_allclose(found.values, best.values, rtol=1e-4)
    assert found.objective == pytest.approx(best.objective, rel=1e-8)
    grid = identify(problem, [ScanOptions(points=7)], lambda i: None)
    at = Discrepancy(problem).objective(grid.values)
    assert grid.objective == at >= best.objective


def test_condensation_refuses_a_robust_loss_in_a_sentence():
    toy = chain([0, 0, 1, 1], [(0, 2), (1, 3)])
    moduli = tuple(Parameter(name, 1.0, 0.1, 10.0) for name in toy.names)
    plain = Problem(toy, toy.readings(np.array([2.0, 3.0])), np.full(2, 0.01), moduli)
    assert identify(plain, [CondensationOptions()], lambda i: None).status == "converged"
    with pytest.raises(InputError) as caught:
        identify(replace(plain, loss=HuberOptions()), [CondensationOptions()], lambda i: None)
    assert "the loss is huber" in str(caught.value)
    assert "Possible are gauss-newton, simplex, scan" in str(caught.value)


def test_priors_keep_their_squares(make_problem):
    a, k = unknowns()
    prior = replace(k, prior=Prior(0.1, 0.001), start=0.8)
    problem = make_problem(decay, [a, prior], spoiled(1), 0.05)
    plain, robust = Discrepancy(problem), Discrepancy(replace(problem, loss=StudentOptions()))
    p = np.array([2.0, 0.8])
    v = problem.response.readings(p)
    assert robust.objective(p) > 700.0**2 * 0.99
    assert robust.squares(p, v) == pytest.approx(plain.objective(p))
    assert robust.objective(p) < plain.objective(p)


def _estimate(problem):
    p = run(problem).values
    v, J = problem.response.evaluate(p)
    return assess(replace(problem, sd=effective_sd(problem, v)), p, J), p


def _inside(problem, truth):
    known, _ = _estimate(problem)
    return (known.lower95 <= truth) & (truth <= known.upper95)


@pytest.mark.parametrize("loss", [HuberOptions(), StudentOptions()])
def test_one_wrong_reading_in_ten_does_not_move_a_robust_fit(make_problem, loss):
    truth = np.array([2.0, 0.8])
    problem = make_problem(decay, unknowns(), spoiled(3), 0.05)
    assert not _inside(problem, truth).any()
    assert _inside(replace(problem, loss=loss), truth).all()


def _off(make_problem, loss, share, repetitions):
    """(repetitions, 2) how far ln of the estimates is off, in half widths of 95 % intervals."""
    found = []
    for k in range(repetitions):
        problem = make_problem(decay, unknowns(), spoiled(100 + k, share), 0.05)
        known, p = _estimate(replace(problem, loss=loss))
        half = 0.5 * np.log(known.upper95 / known.lower95)
        found.append(np.log(p / [2.0, 0.8]) / half)
    return np.array(found)


@pytest.mark.parametrize(
    "loss", [HuberOptions(), pytest.param(StudentOptions(), marks=pytest.mark.slow)]
)
def test_intervals_are_as_wide_as_estimates_scatter(make_problem, loss):
    """Half a 95 % interval is 1.96 times the scatter; what is a fifth wider or less is seen."""
    off = _off(make_problem, loss, 0.0, 50)
    assert 1.96 * np.sqrt(np.mean(off**2)) == pytest.approx(1.0, abs=0.17)
    assert np.mean(np.abs(_off(make_problem, loss, 0.1, 25)) <= 1.0) >= 0.8


@pytest.mark.slow
@pytest.mark.parametrize("loss", [HuberOptions(), StudentOptions()])
def test_intervals_cover_without_wrong_readings_and_nearly_with_them(make_problem, loss):
    """95 % intervals of 200 repetitions, none wrong or one in ten (see the next test)."""
    cover = [np.mean(np.abs(_off(make_problem, loss, share, 200)) <= 1.0) for share in (0.0, 0.1)]
    assert 0.91 <= cover[0] <= 0.985, cover
    assert cover[1] >= 0.85, cover


def test_the_scatter_is_the_median_size_of_a_normal_distribution():
    r = np.array([-3.0, 0.1, 0.2, 90.0, -1.2])
    assert robust_scale(r) == pytest.approx(1.2 / norm.ppf(0.75))
    assert np.isnan(robust_scale(np.zeros(0)))
