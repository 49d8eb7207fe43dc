"""The lowest minimum of Student's loss with many wrong readings, against a search of the whole box.

The curve is a (1 - exp(-x / b)); the objective is written out here, and its lowest minimum is found
by a dense grid and Nelder and Mead's method from its best points.
"""

import numpy as np
import pytest
from scipy.optimize import minimize

from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions, StudentOptions
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts

X = np.linspace(0.2, 4.0, 14)
SD, NU = 0.1, 4.0
LOWER, UPPER, START = np.array([0.2, 0.2]), np.array([10.0, 10.0]), np.array([1.0, 1.0])


def curve(a, b):
    return a * -np.expm1(-X / b)


class Settling:
    names = ("a", "b")
    counts = Counts()

    def admissible(self, p):
        return None

    def readings(self, p):
        return curve(*p)

    def evaluate(self, p):
        a, b = p
        slopes = [-np.expm1(-X / b), -a * X / b**2 * np.exp(-X / b)]
        return curve(a, b), np.column_stack(slopes)


def contaminated(seed):
    """Readings of which a third is off, most to one side, as by a second event."""
    rng = np.random.default_rng(seed)
    y = curve(3.0, 1.5) + SD * rng.standard_normal(len(X))
    wrong = rng.permutation(len(X))[:6]
    y[wrong] += rng.choice([1.0, 1.0, -1.0], 6) * rng.uniform(0.5, 2.0, 6)
    return y


def objective(p, y):
    r = (curve(*p) - y) / SD
    return float(np.sum((NU + 1.0) * np.log1p(r**2 / NU)))


def lowest(y):
    """The least objective within the bounds."""
    a, b = (np.geomspace(*ends, 90) for ends in zip(LOWER, UPPER, strict=True))
    grid = a[:, None, None] * -np.expm1(-X / b[None, :, None])
    phi = np.sum((NU + 1.0) * np.log1p(((grid - y) / SD) ** 2 / NU), axis=2)
    inner = np.pad(phi, 1, constant_values=np.inf)
    around = [inner[1 + i : 91 + i, 1 + j : 91 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    places = np.argwhere(phi <= np.min(around, axis=0))
    places = sorted(places.tolist(), key=lambda ij: phi[tuple(ij)])[:6]
    bounds = list(zip(LOWER, UPPER, strict=True))
    found = [
        minimize(objective, [a[i], b[j]], args=(y,), method="Nelder-Mead", bounds=bounds,
                 options={"xatol": 1e-8, "fatol": 1e-10})
        for i, j in places
    ]  # fmt: skip
    return min(one.fun for one in found)


def fitted(y):
    unknown = tuple(
        Parameter(name, start, low, high, scale="log")
        for name, start, low, high in zip("ab", START, LOWER, UPPER, strict=True)
    )
    problem = Problem(Settling(), y, np.full(len(y), SD), unknown, StudentOptions(NU))
    return gauss_newton(problem, GaussNewtonOptions(), lambda iteration: None)


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 48), marks=pytest.mark.slow)])
def test_the_lowest_minimum_is_found_in_spite_of_wrong_readings(seeds):
    for seed in seeds:
        y = contaminated(seed)
        found, best = fitted(y), lowest(y)
        assert found.objective <= best + 1e-3, seed
        assert found.objective == pytest.approx(objective(found.values, y), rel=1e-9)
