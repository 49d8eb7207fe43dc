"""Intervals and bands of small models with parameters on or near their bounds.

A modulus, and pressures that are at least zero. The judge is the posterior by quadrature on a grid,
with numpy alone: what `sample` would draw from.
"""

from __future__ import annotations

import numpy as np
import pytest

from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.assessment.profile_path import PathReadings, with_profile
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior

LOADS = np.array([1.0, 1.3, 1.7, 2.0, 2.2, 2.5])
PER_PRESSURE = np.array([[0.2, 0.5, 1.0, 1.6, 1.1, 0.7], [0.5, 0.1, 0.3, 0.9, 0.2, 0.8]])
LATER_LOADS, LATER_PER_PRESSURE = np.array([3.0, 1.0]), np.array([[2.5, 0.0], [1.0, 0.0]])
LATER_SD = np.array([0.05, 0.05])
E = Parameter("E", 1.0, 0.05, 20.0, "log")
PRESSURES = tuple(Parameter(name, 0.5, 0.0, 3.0) for name in "ab")


def motion(p, loads, per_pressure, power):
    """Motions (g,) under loads less what pressures p[1:] carry, of a ground of modulus p[0].

    Or of many p (n, K) at once.
    """
    carried = sum(
        np.multiply.outer(part, x**power) for part, x in zip(per_pressure, p[1:], strict=False)
    )
    return (np.multiply.outer(loads, np.ones_like(p[0])) - carried) / p[0]


class Ground:
    """A model of one or two pressures, fitted to readings, and its posterior on a grid."""

    def __init__(self, make_problem, pressures, power, off, sd):
        self.power, self.sd = power, sd
        self.parameters = (E, *PRESSURES[:pressures])
        self.measured = LOADS + sd * np.array(off)
        problem = make_problem(self.readings, self.parameters, self.measured, sd)
        self.p = gauss_newton(problem, GaussNewtonOptions(), lambda it: None).values
        at = self.answers(self.p)
        linear = assess(problem, self.p, at.used_jacobian, at.used)
        self.known, curved = with_profile(linear, problem, self.p, at, self.answers)
        self.band = predict_band(self.known, at.all_jacobian, LATER_SD, curved)

    def readings(self, p):
        return motion(p, LOADS, PER_PRESSURE, self.power)

    def later(self, p):
        return motion(p, LATER_LOADS, LATER_PER_PRESSURE, self.power)

    def answers(self, p):
        steps = 1e-30j * np.eye(len(p))
        both = [
            (f(p), np.stack([np.imag(f(p + h)) / 1e-30 for h in steps], axis=1))
            for f in (self.readings, self.later)
        ]
        return PathReadings(*both[0], *both[1])

    def on_a_grid(self):
        """Shortest 95 % intervals: E by its logarithm, the pressures, the later readings."""
        low = np.array([np.log(E.lower), *(q.lower for q in self.parameters[1:])])
        high = np.array([np.log(E.upper), *(q.upper for q in self.parameters[1:])])
        count = 600 if len(low) == 2 else 120
        for _ in range(4):  # each over what has weight in the one before
            step = (high - low) / count
            axes = [a + s * (np.arange(count) + 0.5) for a, s in zip(low, step, strict=True)]
            x = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
            p = np.stack([np.exp(x[0]), *x[1:]])
            phi = np.sum(((self.readings(p) - self.measured[:, None]) / self.sd) ** 2, axis=0)
            weight = np.exp(-0.5 * (phi - phi.min()))
            some = x[:, weight > 1e-8]
            low = np.maximum(low, some.min(axis=1) - step)
            high = np.minimum(high, some.max(axis=1) + step)
        rng = np.random.default_rng(1)
        drawn = rng.choice(len(weight), 200_000, p=weight / weight.sum())
        later = self.later(p[:, drawn]) + LATER_SD[:, None] * rng.standard_normal((2, len(drawn)))
        equal = np.ones(len(drawn))
        return [shortest(row, weight) for row in x] + [shortest(row, equal) for row in later]

    def intervals(self):
        """The same of the assessment."""
        low, high = self.known.lower95, self.known.upper95
        at = self.later(self.p)
        return [
            (np.log(low[0]), np.log(high[0])),
            *zip(low[1:], high[1:], strict=True),
            *zip(at + self.band.lower95, at + self.band.upper95, strict=True),
        ]


def shortest(values, weight):
    """Shortest 95 % interval of weighted values (k,)."""
    order = np.argsort(values)
    below = np.cumsum(weight[order]) / weight.sum()
    tails = np.linspace(0.0, 0.05, 201)
    low, high = (np.interp(tails + more, below, values[order]) for more in (0.0, 0.95))
    k = np.argmin(high - low)
    return low[k], high[k]


NEAR_ZERO = (0.0, 0.5, -0.3, 0.8, 0.2, -0.4)
PRESSED = (0.0, 0.3, 1.5, 2.0, 0.6, -0.5)
"""Deviations of the readings, in accuracies, from those without pressures: around zero; and those
that a pressure below zero would explain, so that its bound holds it."""


@pytest.mark.parametrize("sd", [pytest.param(0.01, marks=pytest.mark.slow), 0.03, 0.1, 0.3])
@pytest.mark.parametrize("off", [NEAR_ZERO, PRESSED], ids=["near-zero", "pressed"])
@pytest.mark.parametrize("power", [1, 2], ids=["linear", "square"])
def test_a_pressure_at_zero_has_the_interval_of_the_posterior(make_problem, power, off, sd):
    """By its square the readings do not depend on it at zero, but soon after."""
    ground = Ground(make_problem, 1, power, off, sd)
    assert ground.known.determined.all()
    assert not [f for f in ground.known.findings if f.kind in ("not-determined", "not-separated")]
    for found, expected in zip(ground.intervals(), ground.on_a_grid(), strict=True):
        width = expected[1] - expected[0]
        np.testing.assert_allclose(found, expected, atol=0.05 * width)


@pytest.mark.parametrize(
    "sd", [0.03, *(pytest.param(sd, marks=pytest.mark.slow) for sd in (0.01, 0.1, 0.3))]
)
@pytest.mark.parametrize("off", [NEAR_ZERO, PRESSED], ids=["near-zero", "pressed"])
@pytest.mark.parametrize("power", [1, 2], ids=["linear", "square"])
def test_two_pressures_at_zero_truncate_each_other_once(make_problem, power, off, sd):
    """Each has the interval of its own path, which does not count the bound of the other."""
    ground = Ground(make_problem, 2, power, off, sd)
    found, expected = ground.intervals(), ground.on_a_grid()
    of_E = 0.15 if power == 1 else 0.3
    for k, part in enumerate([of_E, 0.15, 0.15]):
        width = expected[k][1] - expected[k][0]
        np.testing.assert_allclose(found[k], expected[k], atol=part * width, err_msg=str(k))
    for k in (3, 4) if power == 1 and sd < 0.3 else ():
        width = expected[k][1] - expected[k][0]
        np.testing.assert_allclose(found[k], expected[k], atol=0.05 * width, err_msg=str(k))


def test_what_only_the_bounds_of_another_limit_says_so_with_the_interval_of_draws(make_problem):
    """One reading of a modulus, a ratio known from its prior, and a pressure nobody knows."""
    parameters = (
        Parameter("E", 5.0, 1.2, 19.0, "log"),
        Parameter("K", 1.0, 0.4, 2.9, prior=Prior(1.0, 0.1)),
        Parameter("q", 0.5, 0.1, 1.9),
    )
    problem = make_problem(lambda p: np.array([10.0 * (1.0 + p[1] - 0.5 * p[2]) / p[0]]),
                           parameters, [3.0], 0.1)  # fmt: skip
    p = np.array([10.0 * 1.75 / 3.0, 1.0, 0.5])
    known = assess(problem, p, np.array([[-3.0 / p[0], 10.0 / p[0], -5.0 / p[0]]]), np.array([3.0]))
    assert known.determined.tolist() == [False, False, False]
    (sentence,) = [f.sentence for f in known.findings if f.subject == "E"]
    assert "parameters of which only their bounds are known" in sentence
    found = [float(word) for word in sentence.split("within ")[1].rstrip(".").split(" to ")]
    axes = np.linspace(np.log(1.2), np.log(19.0), 300), np.linspace(0.6, 1.4, 60)
    log_E, K, q = np.meshgrid(*axes, np.linspace(0.1, 1.9, 60), indexing="ij")
    phi = ((10.0 * (1.0 + K - 0.5 * q) / np.exp(log_E) - 3.0) / 0.1) ** 2 + ((K - 1.0) / 0.1) ** 2
    expected = shortest(log_E.ravel(), np.exp(-0.5 * phi).ravel())
    width = expected[1] - expected[0]
    np.testing.assert_allclose(np.log(found), expected, atol=0.2 * width)
