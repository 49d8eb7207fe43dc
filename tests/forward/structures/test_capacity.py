"""The utilisation of a rectangular section, against the lower bound theorem and the Eurocode."""

import numpy as np
import pytest
from scipy.optimize import linprog

from geoident.forward.structures.capacity import utilisation

H = 0.3


def by_fibres(axial, moment, compressive, tensile, n=600):
    """The largest t for which some stresses within the strengths have the resultants t N, t M."""
    z = (np.arange(n) + 0.5) / n * H - 0.5 * H
    unknown = np.append(np.zeros(n), -1.0)  # n stresses and t, which is maximised
    balance = np.array([np.append(np.full(n, H / n), -axial), np.append(z * H / n, -moment)])
    bounds = [(-compressive, tensile)] * n + [(0.0, None)]
    found = linprog(unknown, A_eq=balance, b_eq=np.zeros(2), bounds=bounds)
    return found.x[-1]


@pytest.mark.parametrize("tensile", [0.0, 0.8, 5.0, 10.0])
def test_the_load_that_fibres_bear_is_that_of_the_formula(tensile):
    rng = np.random.default_rng(1)
    axial = -rng.uniform(0.2, 2.8, 12)  # MN/m
    axial[6:] *= -0.1 * (tensile > 1.0)
    moment = rng.uniform(-0.09, 0.09, 12) * (1.0 if tensile else np.abs(axial))
    used = utilisation(axial, moment, thickness=H, compressive=10.0, tensile=tensile)
    for n, m, u in zip(axial, moment, used, strict=True):
        if n or m:
            assert 1.0 / u == pytest.approx(by_fibres(n, m, 10.0, tensile), rel=2e-3)


def test_plain_concrete_is_that_of_the_eurocode():
    axial, e = np.array([-1.0, -0.4, -2.2]), np.array([0.0, 0.09, 0.05])
    resisted = 10.0 * H * (1.0 - 2.0 * e / H)  # EN 1992-1-1, (12.2)
    used = utilisation(axial, -axial * e, thickness=H, compressive=10.0)
    np.testing.assert_allclose(used, -axial / resisted, rtol=1e-12)


def test_what_no_strength_bears_is_infinite_and_nothing_uses_nothing():
    axial, moment = np.array([0.1, 0.0, -1.0, 0.0]), np.array([0.0, 0.1, 0.15, 0.0])
    used = utilisation(axial, moment, thickness=H, compressive=10.0)
    np.testing.assert_array_equal(used, [np.inf, np.inf, np.inf, 0.0])
