"""Steps to the minimum of a reduced model: fewer evaluations, the same answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from geoident.identify import identify
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts

PARAMETERS = (
    Parameter("a", 4.0, 0.1, 40.0, "log"),
    Parameter("b", 1.0, 0.1, 10.0, "log"),
)
X = np.linspace(0.1, 2.0, 12)


class Curve:
    """v = b exp(-a x): strongly bent in a."""

    names = ("a", "b")

    def __init__(self, shift: float = 0.0) -> None:
        self.shift, self.evaluated = shift, 0

    @property
    def counts(self) -> Counts:
        return Counts(self.evaluated, 0, 0, 0)

    def admissible(self, p):
        return None

    def readings(self, p):
        return self.evaluate(p)[0]

    def evaluate(self, p):
        self.evaluated += 1
        a, b = p
        v = b * np.exp(-a * X) + self.shift * (a - 4.0) ** 2
        slopes = [-b * X * np.exp(-a * X) + 2.0 * self.shift * (a - 4.0), np.exp(-a * X)]
        return v, np.stack(slopes, axis=1)


@dataclass
class Reduced(Curve):
    """The same, or nearly, at no cost."""

    bound: float = 0.0
    shift: float = 0.0
    evaluated: int = 0

    def error(self, p):
        return self.bound


@dataclass
class Whole(Curve):
    reduced: Reduced | None = None
    shift: float = 0.0
    evaluated: int = 0

    def surrogate_obstacle(self):
        return None

    def visited(self):
        return ()

    def surrogate(self, visited):
        return self.reduced


def solved(response):
    truth = np.array([1.2, 2.5])
    measured = Curve().readings(truth) + 1e-3 * np.sin(7.0 * X)
    problem = Problem(response, measured, np.full(len(X), 1e-3), PARAMETERS)
    return identify(problem, [GaussNewtonOptions()], lambda _: None)


def test_an_exact_reduced_model_leaves_two_evaluations():
    plain, led = Whole(), Whole(Reduced())
    first, second = solved(plain), solved(led)
    assert plain.evaluated > 4
    assert led.evaluated == 2
    assert second.status == "converged"
    np.testing.assert_allclose(second.values, first.values, rtol=1e-6)


@pytest.mark.parametrize("shift", [1e-3, 0.05, -0.05])
def test_a_wrong_reduced_model_changes_nothing_but_the_way(shift):
    first, second = solved(Whole()), solved(Whole(Reduced(shift=shift)))
    assert second.status == "converged"
    np.testing.assert_allclose(second.values, first.values, rtol=1e-6)


def test_where_its_bound_is_large_it_is_not_followed():
    plain, led = Whole(), Whole(Reduced(bound=0.5))
    np.testing.assert_array_equal(solved(led).values, solved(plain).values)
    assert led.evaluated == plain.evaluated
