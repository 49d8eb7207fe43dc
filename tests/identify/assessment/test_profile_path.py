"""A parameter that its bound truncates, in a model that is not linear there.

Readings of a tunnel see the ratio of stress and modulus, plate tests the modulus to 15 %, and the
stress is at least the weight of the ground: a curved ridge that ends on a bound. The judge is the
posterior by quadrature on a grid.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.assessment.profile_path import PathReadings, path_parameter, with_profile
from geoident.identify.assessment.truncated_normal import Posterior
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter
from geoident.model.results.findings import sentences_of

SHAPE = np.linspace(1.0, 2.0, 10)
E = 10.0
LATER_SD = np.array([0.005, 0.005, 0.05])
Q = (Parameter("E", E, 1.0, 100.0, "log"), Parameter("s", 1.2, 1.0, 5.0))


def tunnel(p):
    return np.concatenate([SHAPE * p[1] / p[0], np.full(3, 10.0 / p[0])])


def later(p):
    return np.array([3.0 * p[1] / p[0], 8.0 / p[0], p[1]])


def slopes(f, p):
    return np.stack([(f(p + h) - f(p - h)) / (2.0 * h.sum()) for h in np.diag(1e-6 * p)], axis=1)


class Site:
    """Readings of one truth, fitted; the model's evaluations after the fit are counted."""

    def __init__(self, make_problem, stress, seed):
        rng = np.random.default_rng(seed)
        self.truth = np.array([E, stress])
        exact = tunnel(self.truth)
        sd = np.concatenate([0.02 * exact[:10], 0.15 * np.sqrt(3.0) * exact[10:]])
        self.problem = make_problem(tunnel, Q, exact + sd * rng.normal(size=13), sd)
        self.read_later = later(self.truth) + LATER_SD * rng.normal(size=3)
        self.p = gauss_newton(self.problem, GaussNewtonOptions(), lambda it: None).values
        self.evaluations = 0
        here = self.answers(self.p)
        self.linear = assess(self.problem, self.p, here.used_jacobian, here.used)
        self.known, self.curved = with_profile(
            self.linear, self.problem, self.p, here, self.counted
        )

    def answers(self, p):
        return PathReadings(tunnel(p), slopes(tunnel, p), later(p), slopes(later, p))

    def counted(self, p):
        self.evaluations += 1
        return self.answers(p)

    def bands(self):
        return predict_band(self.known, slopes(later, self.p), LATER_SD, self.curved)

    def on_a_grid(self):
        """Shortest 95 % intervals of E and of the later readings without their own errors."""
        log_E, s = np.meshgrid(np.linspace(np.log(3.0), np.log(99.0), 700), np.linspace(1, 5, 600))
        y, sd = self.problem.measured, self.problem.sd
        ratio, plates = s / np.exp(log_E), 10.0 / np.exp(log_E)
        phi = sum(((y[i] - SHAPE[i] * ratio) / sd[i]) ** 2 for i in range(10))
        phi += sum(((y[i] - plates) / sd[i]) ** 2 for i in range(10, 13))
        weight = np.exp(-0.5 * (phi - phi.min())).ravel()
        return [shortest(z.ravel(), weight) for z in (log_E, 0.8 * plates, s)]


def shortest(z, weight):
    order = np.argsort(z)
    F = np.cumsum(weight[order]) / weight.sum()
    tails = np.linspace(0.0, 0.05, 101)
    low, high = (np.interp(tails + more, F, z[order]) for more in (0.0, 0.95))
    k = np.argmin(high - low)
    return low[k], high[k]


@pytest.mark.parametrize(("stress", "seed"), [(1.0, 1), (1.05, 4), (1.15, 2), (1.15, 0)])
def test_intervals_and_bands_are_those_of_the_posterior_on_a_grid(make_problem, stress, seed):
    site = Site(make_problem, stress, seed)
    (low, high), plate, s = site.on_a_grid()
    width = high - low
    assert np.log(site.known.lower95[0]) == pytest.approx(low, abs=0.06 * width)
    assert np.log(site.known.upper95[0]) == pytest.approx(high, abs=0.06 * width)
    bands, mean = site.bands(), later(site.p)
    for k, (least, most) in ((1, plate), (2, s)):
        sd = 2.0 * LATER_SD[k]
        assert mean[k] + bands.lower95[k] == pytest.approx(least, abs=sd + 0.06 * (most - least))
        assert mean[k] + bands.upper95[k] == pytest.approx(most, abs=sd + 0.06 * (most - least))
    assert site.evaluations <= 12


@pytest.mark.parametrize(("plateau", "kept"), [(1.5, False), (4.0, True)])
def test_what_seems_determined_on_its_bound_stays_so_only_where_it_is(make_problem, plateau, kept):
    """A reading that rises by some of its standard deviations and then stays: c on its bound.

    As mi does, which readings feel where it is small. The judge is the posterior on a grid.
    """
    unknown = (Parameter("c", 0.5, 0.0, 1.0), Parameter("b", 1.0, 0.0, 2.0))

    def v(p):
        return np.array([plateau * (1.0 - np.exp(-20.0 * p[0])), 100.0 * p[1]])

    def slope(p):
        return np.diag([20.0 * plateau * np.exp(-20.0 * p[0]), 100.0])

    at, sd = np.array([0.0, 1.0]), np.ones(2)
    problem = make_problem(v, unknown, v(at), sd)
    linear = assess(problem, at, slope(at), v(at))
    assert linear.determined.all()
    assert linear.upper95[0] < 0.1
    known, path = with_profile(
        linear, problem, at, PathReadings(v(at), slope(at), v(at), slope(at)),
        lambda p: PathReadings(v(p), slope(p), v(p), slope(p)),
    )  # fmt: skip
    assert path is not None
    c = np.linspace(0.0, 1.0, 2000)
    _, far = shortest(c, np.exp(-0.5 * (plateau * (1.0 - np.exp(-20.0 * c))) ** 2))
    assert (far <= 0.5) == kept
    assert known.determined.tolist() == [kept, True]
    assert known.upper95[1] == pytest.approx(linear.upper95[1], rel=1e-3)
    if kept:
        assert known.upper95[0] == pytest.approx(far, rel=0.2)
        assert known.findings == linear.findings
    else:
        assert np.isnan([known.sd[0], known.lower95[0], known.upper95[0]]).all()
        assert sentences_of(known.findings)[:-1] == sentences_of(linear.findings)
        assert sentences_of(known.findings)[-1].startswith(
            "c is not determined: near the estimate it seems"
        )


def test_far_from_bounds_nothing_is_evaluated(make_problem):
    site = Site(make_problem, 2.6, 1)
    assert site.evaluations == 0
    assert site.curved is None
    assert site.known is site.linear


def test_where_the_model_is_linear_one_evaluation_says_so(make_problem):
    A = np.random.default_rng(0).normal(size=(6, 2))
    q = (Parameter("a", 1.0, 1.0, 9.0), Parameter("b", 1.0, -9.0, 9.0))
    p = np.ones(2)
    problem = make_problem(lambda p: A @ p, q, A @ p, 0.3)
    linear = assess(problem, p, A, A @ p)
    asked = []

    def evaluate(p):
        asked.append(p)
        return PathReadings(A @ p, A, A @ p, A)

    known, path = with_profile(linear, problem, p, PathReadings(A @ p, A, A @ p, A), evaluate)
    assert len(asked) == 1
    assert path is None
    assert known is linear


ALONE = (Parameter("c", 0.5, 0.0, 4.0),)


def saturating(p):
    """A reading that rises by two of its standard deviations and then stays."""
    return np.array([2.0 * (1.0 - np.exp(-3.0 * p[0])), 0.4 * p[0]])


def saturating_slope(p):
    return np.array([[6.0 * np.exp(-3.0 * p[0])], [0.4]])


def alone(make_problem, *, readings=saturating, broken=np.inf):
    """A single parameter on its bound; its assessment with the path, and the path."""
    at = np.zeros(1)
    problem = make_problem(saturating, ALONE, saturating(at) - 0.2, np.ones(2))
    linear = assess(problem, at, saturating_slope(at), saturating(at))

    def evaluate(p):
        if p[0] > broken:
            return None
        return PathReadings(saturating(p), saturating_slope(p), readings(p), saturating_slope(p))

    here = PathReadings(saturating(at), saturating_slope(at), readings(at), saturating_slope(at))
    return problem, *with_profile(linear, problem, at, here, evaluate)


@pytest.mark.parametrize("broken", [np.inf, 2.2])
def test_one_parameter_has_its_posterior_as_far_as_the_model_has_a_solution(make_problem, broken):
    problem, known, path = alone(make_problem, broken=broken)
    far = path.t[-1] * 0.5  # the reference of c is its start
    assert 1.0 < far < broken
    c = np.linspace(0.0, far, 4000)
    phi = np.sum((np.array([saturating([one]) for one in c]) - problem.measured) ** 2, axis=1)
    low, high = shortest(c, np.exp(-0.5 * phi))
    limits = np.zeros(1), np.full(1, 8.0)
    ends = known.posterior.summary(np.eye(1), limits=limits)
    found = 0.5 * np.concatenate([ends.lower95, ends.upper95])
    np.testing.assert_allclose(found, [low, high], atol=0.02 * (high - low))


def test_where_the_others_are_known_ever_better_there_is_less_of_the_posterior(make_problem):
    """A reading b exp(c): given c, b is known to exp(-c). The judge is the posterior on a grid."""
    two = (Parameter("c", 0.5, 0.0, 4.0), Parameter("b", 1.0, -60.0, 60.0))
    at, sd = np.array([0.0, 3.0]), np.array([1.5, 1.0])

    def v(p):
        return np.array([p[0], p[1] * np.exp(p[0])])

    def slope(p):
        return np.array([[1.0, 0.0], [p[1] * np.exp(p[0]), np.exp(p[0])]])

    def readings(p):
        return PathReadings(v(p), slope(p), v(p), slope(p))

    problem = make_problem(v, two, at, sd)
    linear = assess(problem, at, slope(at), v(at))
    known, path = with_profile(linear, problem, at, readings(at), readings)
    assert path is not None
    c = np.linspace(0.0, 4.0, 4000)
    low, high = shortest(c, np.exp(-0.5 * (c / 1.5) ** 2 - c))
    ends = known.posterior.summary(np.eye(2)[:1], limits=(np.zeros(1), np.full(1, 8.0)))
    found = 0.5 * np.concatenate([ends.lower95, ends.upper95])  # the reference of c is its start
    np.testing.assert_allclose(found, [low, high], atol=0.03 * high)


def test_the_path_is_that_of_the_parameter_that_a_bound_truncates_most(make_problem):
    """On a bound before beyond one; else by its standard deviation in its range; no mode."""
    three = tuple(Parameter(n, 3.0, 1.0, 16.0) for n in "abc")
    problem = make_problem(lambda p: p, three, np.ones(3), np.ones(3))
    wide = Posterior(np.zeros((3, 1)), np.ones(1), np.diag([0.2, 0.3, 0.6]), np.zeros(1))
    base = replace(assess(problem, np.full(3, 3.0), np.eye(3)), posterior=wide)

    def chosen(at_bound, beyond, field=""):
        flags = [np.isin(list("abc"), list(one)) for one in (at_bound, beyond)]
        parameters = tuple(replace(q, field="E" if q.name == field else "") for q in three)
        known = replace(base, at_bound=flags[0], beyond_bounds=flags[1])
        return path_parameter(known, replace(problem, parameters=parameters))

    assert chosen("", "") is None
    assert [chosen("", beyond) for beyond in ("a", "abc", "ab")] == [0, 2, 1]
    assert chosen("a", "abc") == 0
    assert chosen("", "bc", field="c") == 1


def covered(make_problem, stress, repetitions):
    """E and the later readings inside, of all runs and of those on the bound."""
    inside, on_bound = [], []
    for seed in range(repetitions):
        site = Site(make_problem, stress, seed)
        band, mean = site.bands(), later(site.p)
        within = (mean + band.lower95 <= site.read_later) & (site.read_later <= mean + band.upper95)
        inside.append([site.known.lower95[0] <= E <= site.known.upper95[0], *within])
        on_bound.append(site.known.at_bound[1])
    return np.array(inside), np.array(on_bound)


def test_fits_that_end_on_a_bound_cover_too(make_problem):
    """With the bound taken for the value, none of them would cover E."""
    inside, on_bound = covered(make_problem, 1.05, 12)
    assert on_bound.sum() > 3
    assert inside[on_bound, 0].mean() > 0.85
    assert inside.mean(axis=0).min() > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("stress", [1.05, 1.15, 1.3])
def test_coverage_in_hundreds_of_repetitions(make_problem, stress):
    inside, _ = covered(make_problem, stress, 400)
    assert inside.mean(axis=0).min() > 0.9
