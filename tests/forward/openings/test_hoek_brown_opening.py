"""A circular opening in ground of Hoek and Brown: against a radial calculation of another kind."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from support.derivatives import richardson

from geoident.forward.openings.closed_forms import BeyondClosedForm, Opening, Rock, mohr_coulomb
from geoident.forward.openings.hoek_brown import EXPANDED, HoekBrownLimit
from geoident.model.dual import Dual

MADE = Path(__file__).parents[3] / "cases" / "squeezing-tunnel" / "make_readings.py"
RADII = np.array([3.0, 3.5, 5.0, 8.0])


@pytest.fixture(scope="module")
def made():
    """The calculation by Runge and Kutta that made the readings of `cases/squeezing-tunnel`."""
    spec = importlib.util.spec_from_file_location("make_squeezing_readings", MADE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def opening(E, nu, far, sigci, m, s, a, K, *, n=0, axial=None) -> Opening:
    numbers = [x if isinstance(x, Dual) else Dual.constant(x, n) for x in (E, nu, far)]
    z0 = numbers[2] if axial is None else Dual.constant(axial, n)
    limit = [x if isinstance(x, Dual) else Dual.constant(x, n) for x in (sigci, m, s, a, K)]
    return Opening(3.0, Rock(*numbers, z0), HoekBrownLimit(*limit))


def under(case: Opening, inside: float):
    state = case.under(Dual.constant(inside, case.rock.E.n))
    return -state.displacement(RADII).value, float(state.plastic_radius.value)


@pytest.mark.parametrize("gsi", [20.0, 35.0, 60.0])
@pytest.mark.parametrize("K", [1.0, 1.4])
@pytest.mark.parametrize("inside", [0.0, 0.3])
def test_walls_and_plastic_radii_are_those_of_runge_and_kutta(made, gsi, K, inside):
    rock = made.rock_of(gsi)
    far = 10.0 if gsi < 50.0 else 30.0
    case = opening(rock.E, rock.nu, far, rock.sigci, rock.m, rock.s, rock.a, K)
    moved, reach = made.radial(rock, far, inside, RADII, dilation=K)
    found, plastic = under(case, inside)
    np.testing.assert_allclose(found, moved, rtol=1e-8)
    assert plastic == pytest.approx(reach, rel=1e-8)
    assert plastic > 3.0


def test_carranza_torres_and_fairhurst(made):
    """Their scaled pressures for a = 0.5, written out: p_cr and R_p are algebra then."""
    far, sigci, m, s = 10.0, 40.0, 1.2, 0.001
    S0, inner = far / (m * sigci) + s / m**2, 0.4 / (m * sigci) + s / m**2
    critical = (1.0 - np.sqrt(1.0 + 16.0 * S0)) ** 2 / 16.0
    reach = 3.0 * np.exp(2.0 * (np.sqrt(critical) - np.sqrt(inner)))
    case = opening(2000.0, 0.25, far, sigci, m, s, 0.5, 1.0)
    below = case.critical[0]
    assert below.value == pytest.approx((critical - s / m**2) * m * sigci, rel=1e-12)
    assert under(case, 0.4)[1] == pytest.approx(reach, rel=1e-12)


def test_with_an_exponent_near_one_it_is_mohr_coulomb():
    """sigma_t = (1 + m) sigma_r + s sigci."""
    rock = [Dual.constant(x, 0) for x in (5000.0, 0.25, 10.0, 10.0)]
    sine = 2.0 / (2.0 + 2.0)
    N = (1.0 + sine) / (1.0 - sine)
    cohesion = 2.0 * (1.0 - sine) / (2.0 * np.sqrt(1.0 - sine**2))
    angles = [Dual.constant(x, 0) for x in (cohesion, np.arcsin(sine), 0.1)]
    other = Opening(3.0, Rock(*rock), mohr_coulomb(*angles))
    K = (1.0 + np.sin(0.1)) / (1.0 - np.sin(0.1))
    case = opening(5000.0, 0.25, 10.0, 1.0, N - 1.0, 2.0, 1.0 - 1e-7, K)
    np.testing.assert_allclose(under(case, 0.2)[0], under(other, 0.2)[0], rtol=1e-5)


@pytest.mark.parametrize("axial", [10.0, 6.0])
def test_derivatives_are_exact(axial):
    """By all numbers, where sigma_z meets sigma_t and where it does not."""
    p = np.array([2000.0, 0.28, 10.0, 40.0, 1.1, 0.002, 0.52, 1.2])

    def wall(values):
        n = len(values)
        given = [Dual(np.append(x, np.eye(n)[k])) for k, x in enumerate(values)]
        case = opening(*given, n=n, axial=axial)
        state = case.under(Dual.constant(0.3, n))
        radius = state.edge_radius
        assert (radius is not None) == (axial > 9.0)
        return state.displacement(RADII).columns, state.plastic_radius.columns

    moved, reach = wall(p)
    for h in range(len(p)):
        step = 1e-3 * p[h]
        numeric = richardson(lambda q: wall(q)[0][:, 0], p, h, step)
        np.testing.assert_allclose(moved[:, 1 + h], numeric, rtol=1e-7, atol=1e-14)
        numeric = richardson(lambda q: wall(q)[1][:1], p, h, step)
        np.testing.assert_allclose(reach[1 + h], numeric[0], rtol=1e-7, atol=1e-10)


def test_stresses_are_in_equilibrium_and_at_the_limit():
    case = opening(2000.0, 0.25, 10.0, 40.0, 1.1, 0.002, 0.52, 1.0)
    state = case.under(Dual.constant(0.3, 0))
    r = np.linspace(3.001, float(state.plastic_radius.value) - 0.002, 9)
    h = 1e-4
    slope = (state.stresses(r + h)[0].value - state.stresses(r - h)[0].value) / (2.0 * h)
    radial, hoop, _ = (stress.value for stress in state.stresses(r))
    np.testing.assert_allclose(slope, (hoop - radial) / r, rtol=1e-6)
    np.testing.assert_allclose(hoop, radial + 40.0 * (1.1 * radial / 40.0 + 0.002) ** 0.52)


def test_what_it_does_not_cover_is_said():
    case = opening(2000.0, 0.25, 10.0, 40.0, 1.1, 0.0, 0.52, 1.0)
    with pytest.raises(BeyondClosedForm, match="cannot carry"):
        case.under(Dual.constant(0.0, 0))
    with pytest.raises(BeyondClosedForm, match=EXPANDED):
        case.under(Dual.constant(40.0, 0))


def test_both_pressures_at_which_the_wall_begins_to_yield():
    """Contraction at sigma_r + sigma_t = 2 p0, expansion at the other of these two stresses."""
    case = opening(2000.0, 0.25, 10.0, 40.0, 1.1, 0.002, 0.52, 1.0)
    below, above = (float(pressure.value) for pressure in case.critical)
    assert below + above == pytest.approx(20.0, rel=1e-12)
    assert above - below == pytest.approx(40.0 * (1.1 * below / 40.0 + 0.002) ** 0.52, rel=1e-12)
    assert case.under(Dual.constant(above - 1e-6, 0)).plastic_radius is None
    with pytest.raises(BeyondClosedForm, match=EXPANDED):
        case.under(Dual.constant(above + 1e-6, 0))
