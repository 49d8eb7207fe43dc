"""Numbers that Hoek and his colleagues printed, and halves of moduli that their forms give."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.model.dual import Dual
from geoident.model.empirical.rock_mass import (
    RockMassModulus,
    rock_mass_modulus,
    strength_constants,
)
from geoident.model.parameter import Scalar


def constants(mi: float, GSI: float, D: float) -> list[float]:
    numbers = (Dual(np.array([x])) for x in (mi, GSI, D))
    return [float(found.value) for found in strength_constants(*numbers)]


@pytest.mark.parametrize(
    ("rating", "disturbed", "undisturbed"),
    [(85.0, (2.40, 0.082), (4.10, 0.189)), (65.0, (0.575, 0.00293), (2.006, 0.0205))],
)
def test_table_of_1988_for_carbonate_rocks(rating, disturbed, undisturbed):
    """E. Hoek, E. T. Brown (1988), table 1: m and s of mi = 7 by the rating, D = 1 and D = 0."""
    for D, printed in ((1.0, disturbed), (0.0, undisturbed)):
        assert constants(7.0, rating, D)[:2] == pytest.approx(printed, rel=4e-3)


@pytest.mark.parametrize(("GSI", "printed"), [(100.0, 0.500), (50.0, 0.506), (10.0, 0.585)])
def test_exponents_of_2002(GSI, printed):
    for D in (0.0, 1.0):
        assert constants(10.0, GSI, D)[2] == pytest.approx(printed, abs=5e-4)
    assert constants(10.0, 100.0, 0.7)[:2] == pytest.approx((10.0, 1.0))


@pytest.mark.parametrize(("D", "middle", "most"), [(0.0, 75.0, 100e9), (1.0, 100.0, 50e9)])
def test_the_simplified_modulus_is_half_of_its_most_in_the_middle(D, middle, most):
    """Hoek and Diederichs 2006: the middle is 75 + 25 D, the most 100 GPa (1 - D/2)."""
    found = rock_mass_modulus(None, *(Dual(np.array([x])) for x in (middle, D)))
    assert float(found.value) == pytest.approx(0.5 * most)


@pytest.mark.parametrize(("D", "middle"), [(0.0, 60.0), (1.0, 75.0)])
def test_of_intact_rock_a_fiftieth_stays_and_half_of_the_rest_in_the_middle(D, middle):
    modulus = RockMassModulus(GSI=Scalar(middle), D=Scalar(D), MR=Scalar(400.0), sigci=Scalar(5e7))
    assert modulus.value({}) == pytest.approx(20e9 * (0.02 + 0.5 * (1.0 - 0.5 * D)))
