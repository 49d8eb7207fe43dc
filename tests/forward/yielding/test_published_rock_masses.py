"""Rock masses of Hoek and Brown against numbers that others have printed.

- E. Hoek, C. Carranza-Torres, B. Corkum (2002), Hoek-Brown failure criterion, 2002 edition, p. 271:
  sigci 50 MPa, mi 10, GSI 45. As a slope of 100 m with D = 1, c = 0.35 MPa and phi = 27.61 degrees;
  as a tunnel 100 m deep with D = 0, c = 0.58 MPa and phi = 47.16 degrees. The unit weight is not
  printed: 27 kN/m3 gives all four.
- E. Hoek, C. Carranza-Torres, M. Diederichs, B. Corkum (2008), Integration of geotechnical and
  structural design in tunnelling, table A1.1, case D1: sigci 50 MPa, mi 7, GSI 48, D = 0.
- FLAC3D 5.01, Verification Problems: Cylindrical Hole in an Infinite Hoek-Brown Medium.

No printed displacement of an opening, and no number of Hoek and Diederichs (2006), was at hand.
"""

from __future__ import annotations

from math import degrees

import numpy as np
import pytest
from support.yielding import hoek

from geoident.forward.openings.closed_forms import Opening, Rock
from geoident.forward.openings.hoek_brown import HoekBrownLimit
from geoident.forward.yielding.hoek_brown import RockMassStrength
from geoident.model.dual import Dual

MPa = 1e6
DEPTH = 100.0 * 27e3


def around_slope(mass: RockMassStrength) -> float:
    """sigma3_max of a slope (Hoek et al. 2002, equation 19)."""
    return 0.72 * mass.whole * (mass.whole / DEPTH) ** -0.91


@pytest.mark.parametrize(
    ("D", "most", "cohesion", "friction"),
    [
        pytest.param(1.0, around_slope, 0.35, 27.61, id="slope"),
        pytest.param(0.0, lambda mass: mass.around_tunnel(DEPTH), 0.58, 47.16, id="tunnel"),
    ],
)
def test_cohesion_and_friction_of_2002(D, most, cohesion, friction):
    mass = RockMassStrength.of(hoek(50 * MPa, mi=10.0, GSI=45.0, D=D), {})
    c, phi = mass.coulomb(most(mass))
    assert c / MPa == pytest.approx(cohesion, abs=0.005)
    assert degrees(phi) == pytest.approx(friction, abs=0.01)


def test_constants_of_a_graphitic_phyllite():
    mass = RockMassStrength.of(hoek(50 * MPa, mi=7.0, GSI=48.0, D=0.0), {})
    assert mass.mb == pytest.approx(1.093, abs=5e-4)
    assert mass.s == pytest.approx(0.0031, abs=5e-5)
    assert mass.a == pytest.approx(0.507, abs=5e-4)


def test_yielded_zone_of_another_programs_manual(verification):
    shear, bulk, far, held, radius = 2.2e9, 3.667e9, 30 * MPa, 5 * MPa, 2.0
    E = 9 * bulk * shear / (3 * bulk + shear)
    rock = Rock(*(Dual(np.array([x])) for x in (E, E / (2 * shear) - 1, far, far)))
    numbers = (30 * MPa, 1.7, 0.0039, 0.5, 1.0)
    case = Opening(radius, rock, HoekBrownLimit(*(Dual(np.array([x])) for x in numbers)))
    edge = case.under(Dual(np.array([held]))).plastic_radius
    begins = case.critical[0]
    assert edge is not None
    found = [float(edge.value), float(begins.value) / MPa]
    printed = [1.62 * radius, 15.8]
    np.testing.assert_allclose(found, printed, rtol=4e-3)
    places = ["edge of the zone (m)", "yielding begins (MPa)"]
    verification("manuals-hoek-brown", "closed form", places, exact=printed, found=found)
