"""Stiffness at small strains, and stiffness by stress without hardening, on one element.

Drained triaxial and oedometer tests in closed form: Hardin & Drnevich as Santos & Correia have it,
Masing's loops and their damping, moduli that grow with stress.
"""

import numpy as np
import pytest
from support.in_stages import read
from support.specimen import element, pressed

G0, G_UR, NU, GAMMA = 120e6, 25e6, 0.2, 2e-4
STIFF = "m: 0, cohesion: 1 MPa, friction: 34 deg, G0: 120 MPa, gamma_07: 2e-4"


def backbone(gamma):
    """Shear stress tau of a first loading to a shear strain, Pa."""
    return G0 * gamma / (1.0 + 0.385 * gamma / GAMMA)


def sheared(folder, gammas):
    """tau = q / 2 of a drained triaxial test at shear strains eps_1 - eps_3, Pa."""
    strains = np.asarray(gammas) / (1.0 + NU)
    path = element(folder, STIFF, pressed(*strains), side=100e3, nu=f"{NU}")
    yy, xx, _ = read(path)
    return 0.5 * (xx - yy)


def test_first_loading_is_the_curve_of_hardin_and_drnevich_down_to_unloading(
    tmp_path, verification
):
    cut = GAMMA / 0.385 * (np.sqrt(G0 / G_UR) - 1.0)
    gammas = np.array([0.01, 0.1, 0.4, 1.0, 2.0]) * GAMMA
    assert gammas[-1] < cut
    found = sheared(tmp_path, [*gammas, 2.0 * cut, 3.0 * cut])
    modulus = found[:5] / gammas
    exact = backbone(gammas) / gammas
    verification("small-strains", "", gammas / GAMMA, exact=exact / G0, found=modulus / G0)
    np.testing.assert_allclose(modulus, exact, rtol=0.01)
    assert modulus[0] == pytest.approx(G0, rel=0.005)
    assert (found[6] - found[5]) / cut == pytest.approx(G_UR, rel=1e-6)


def test_a_cycle_follows_the_curve_of_twice_the_size_and_closes(tmp_path):
    largest = 1.5 * GAMMA
    way = np.array([1.0, 0.4, -1.0, 0.2, 1.0]) * largest
    found = sheared(tmp_path, way)
    top = backbone(largest)
    down = top - 2.0 * backbone(0.5 * (largest - way[1:3]))
    up = 2.0 * backbone(0.5 * (way[3:] + largest)) - top
    np.testing.assert_allclose(found[1:], [*down, *up], atol=0.01 * top)
    assert found[-1] == pytest.approx(found[0], rel=1e-9)
    assert found[2] == pytest.approx(-found[0], rel=1e-9)


@pytest.mark.slow
def test_the_damping_of_a_cycle_is_that_of_masing(tmp_path):
    largest = 1.5 * GAMMA
    half = np.cos(np.linspace(0.0, np.pi, 13))
    way = largest * np.array([1.0, *half[1:], *-half[1:]])
    found = sheared(tmp_path, way)
    lost = np.sum(0.5 * (found[1:] + found[:-1]) * np.diff(way))
    damping = lost / (2.0 * np.pi * largest * found[0])
    x = 0.385 * largest / GAMMA
    exact = 4.0 / np.pi * (1.0 + 1.0 / x) * (1.0 - np.log1p(x) / x) - 2.0 / np.pi
    assert damping == pytest.approx(exact, rel=0.02)


@pytest.mark.slow
def test_a_small_cycle_in_a_loading_leaves_no_trace(tmp_path):
    """What a rule that forgets all at a reversal gets wrong (overshooting)."""
    straight = sheared(tmp_path, [1.0 * GAMMA, 1.5 * GAMMA])
    cycled = sheared(tmp_path, [1.0 * GAMMA, 0.98 * GAMMA, 1.5 * GAMMA])
    assert cycled[2] == pytest.approx(straight[1], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("m", [0.5, 1.0])
def test_stiffness_by_stress_alone_in_the_oedometer(tmp_path, m):
    """Without E50: horizontal stress is nu / (1 - nu) of the vertical, moduli follow it."""
    nu, E, c = 0.3, 60e6, 5e3
    a, side = c / np.tan(np.radians(34.0)), nu / (1.0 - nu)
    M = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) / (a + 1e5) ** m
    stress = 20e3 * 10.0 ** (np.arange(7) / 6.0)
    base = a + side * stress
    if m == 1.0:
        strains = np.log(base / base[0]) / (M * side)
    else:
        strains = (base ** (1.0 - m) - base[0] ** (1.0 - m)) / (M * side * (1.0 - m))
    path = element(
        tmp_path, f"m: {m}, cohesion: 5 kPa, friction: 34 deg", pressed(*strains[1:]),
        side=side * stress[0], upright=stress[0], held=", x1: x", nu=f"{nu}",
    )  # fmt: skip
    yy, xx, _ = read(path)
    np.testing.assert_allclose(-yy, stress[1:], rtol=0.015)
    np.testing.assert_allclose(xx / yy, side, rtol=1e-6)


def test_without_hardening_the_strength_is_that_of_mohr_and_coulomb(tmp_path):
    path = element(
        tmp_path, "m: 0.5, cohesion: 2 kPa, friction: 34 deg, dilation: 10 deg",
        pressed(0.001, 0.02, 0.03), side=100e3,
    )  # fmt: skip
    yy, xx, u = read(path)
    sine = np.sin(np.radians(34.0))
    a = 2e3 / np.tan(np.radians(34.0))
    np.testing.assert_allclose((xx - yy)[1:], 2.0 * sine / (1.0 - sine) * (100e3 + a), rtol=1e-6)
    assert (xx - yy)[0] == pytest.approx(60e6 * 0.001, rel=1e-6)
    # of further strain eps_1 the volume grows by 2 sin(psi) / (1 - sin(psi))
    volume = 2.0 * (u[2] - u[1]) - 0.01
    sine = np.sin(np.radians(10.0))
    assert volume / 0.01 == pytest.approx(2.0 * sine / (1.0 - sine), rel=1e-6)
