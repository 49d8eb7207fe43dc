"""What hardening soil obeys: formulas of stress and state, with dual numbers (theory 19).

Schanz, Vermeer & Bonnier (1999), with the initial modulus E_i = 2 E50 / (2 - Rf), by which E50 is
the secant modulus at half of the strength. Compression is positive here: s_1 >= s_2 >= s_3 are the
principal values of minus the stress, a = c cot(phi). Moduli follow the least principal stress,

    L = ((a + s_3) / (a + p_ref))^m ,    E_ur L and E_i L ,    s_3 not below p_ref / 100 .

For each pair of principal stresses i < j the shear stress is limited by that which the plastic
shear strain gamma_p (one for all pairs) allows, and by Mohr-Coulomb:

    s_i - s_j <= min(q(gamma_p), q_f) ,    q_f = 2 sin(phi) / (1 - sin(phi)) (s_j + a) ,
    gamma_p = (2 / E_i) q / (1 - Rf q / q_f) - (2 / E_ur) q     for q(gamma_p) .

It flows by Rowe's dilatancy of the pair, sin(psi_m) = max(0, (sin phi_m - sin phi_cv) / (1 -
sin phi_m sin phi_cv)). The cap

    q^2 / alpha^2 + (p + a)^2 <= (p_c + a)^2 ,    q^2 = 3 J_2 ,

flows along its normal, and p_c grows by H ((p_c + a) / (p_ref + a))^m with the volume that the cap
takes; alpha and H follow from Eoed and K0nc (`cap_constants`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from geoident.fem.elasticity import lame_constants
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, Number

LEAST_STRESS = 0.01
"""Part of p_ref below which s_3 and p_c do not lower the stiffness."""

_TINY = 1e-6
"""Part of p_ref that keeps what is divided by above zero at the apex."""


Numbers: TypeAlias = "Mapping[str, Dual] | Mapping[str, float]"
"""Constants of the law by name: numbers where they are not differentiated by."""


def stress_level(s_3: Dual, k: Numbers) -> Dual:
    """L (q,) at the least principal stress (q,)."""
    a, p_ref = k["a"], k["p_ref"]
    floor = p_ref * LEAST_STRESS
    held = (s_3 - floor).positive_part() + floor
    return power((held + a) / (p_ref + a), k["m"])


def cap_constants(constants: Mapping[str, Dual]) -> tuple[Dual, Dual]:
    """Alpha and H (Pa) of the cap by which a first loading without strain to the sides has K0nc.

    And the tangent modulus Eoed where its stress is p_ref. The elastic strain is that of E at K0nc
    p_ref, the strain of shear that by which gamma_p follows the stress; what is left is the cap's.

    Args:
        constants: as of `HardeningSoil`.
    """
    k = derived(constants)
    a, p_ref, K0, nu, Eoed = (
        k["a"],
        k["p_ref"],
        constants["K0nc"],
        constants["nu"],
        constants["Eoed"],
    )
    side = K0 * p_ref
    scale = a + p_ref
    level = ((a + side) / scale).power(k["m"])
    initial, unloading = compliances(k, level)
    q, largest = p_ref - side, strength(side, k)
    ratio = q / largest
    rate, rate_side = Eoed, K0 * Eoed
    elastic = (rate - nu * rate_side * 2.0) / (k["E"] * level)
    elastic_side = (rate_side * (1.0 - nu) - nu * rate) / (k["E"] * level)
    # gamma_p = q (A / (1 - Rf r) - B), A and B ~ L^-1, r = q / q_f
    left = 1.0 - k["Rf"] * ratio
    gamma = q * (initial / left - unloading)
    rate_ratio = (rate - rate_side) / largest - ratio * rate_side / (a + side)
    rate_gamma = (rate - rate_side) * (initial / left - unloading)
    rate_gamma = rate_gamma + q * initial * k["Rf"] * rate_ratio / (left * left)
    rate_gamma = rate_gamma - gamma * k["m"] * rate_side / (a + side)
    dilates = dilation(p_ref, side, k)
    shear = rate_gamma * (1.0 - dilates) * 0.5
    shear_side = rate_gamma * (1.0 + dilates) * -0.25
    cap, cap_side = 1.0 - elastic - shear, -(elastic_side + shear_side)
    volume, distortion = cap + cap_side * 2.0, (cap - cap_side) * (2.0 / 3.0)
    p = (p_ref + side * 2.0) / 3.0
    alpha = (q / (p + a) * volume / distortion).root()
    squared = alpha * alpha
    radius = (q * q / squared + (p + a) * (p + a)).root()
    rate_p = (rate + rate_side * 2.0) / 3.0
    rate_cap = (q * (rate - rate_side) / squared + (p + a) * rate_p) / radius
    hardening = rate_cap / volume / (radius / scale).power(k["m"])
    return alpha, hardening


def derived(constants: Mapping[str, Dual]) -> dict[str, Dual]:
    """What the equations are written with: a, E_i, sines, and the constants as they stand."""
    k, phi = constants, constants["friction"]
    lame, mu = lame_constants({name: k[name] for name in ("E", "nu")})
    sine, dilation = phi.sine(), k["dilation"].sine()
    initial = {"E_i": k["E50"] * 2.0 / (2.0 - k["Rf"])} if "E50" in k else {}
    return {
        **{name: k[name] for name in ("E", "m", "p_ref", "Rf", "tension")},
        **initial,
        "lame": lame,
        "mu": mu,
        "a": k["cohesion"] * phi.cosine() / sine,
        "sine": sine,
        "sine_cv": (sine - dilation) / (1.0 - sine * dilation),
    }


def compliances(k: Numbers, level: Number) -> tuple[Number, Number]:
    """2 / E_i and 2 / E_ur at L, 1/Pa."""
    return 2.0 / (k["E_i"] * level), 2.0 / (k["E"] * level)


def strength(s_j: Dual, k: Numbers) -> Dual:
    """q_f at the lower stress of a pair, Pa; a little more than zero at the apex and beyond."""
    sine, tiny = k["sine"], k["p_ref"] * _TINY
    return ((s_j + (k["a"] - tiny)).positive_part() + tiny) * (2.0 * sine / (1.0 - sine))


def hardened(gamma: Dual, strength: Dual, initial: Number, unloading: Number, k: Numbers) -> Dual:
    """min(q(gamma_p), q_f): the root of the quadratic that the hyperbola is.

    Its slopes are those of gamma_p = initial q / (1 - q / asymptote) - unloading q.
    """
    asymptote = strength / k["Rf"]
    g, A, i, u = (_value(one) for one in (gamma, asymptote, initial, unloading))
    b, twice = (i - u) * A + g, 2.0 * g * A
    q = twice / (b + np.sqrt(b * b + 2.0 * u * twice))
    ratio = q / A
    left = 1.0 - ratio
    inverse = 1.0 / (i - u * left * left)
    terms = ((gamma, left * left * inverse), (asymptote, i * ratio * ratio * inverse))
    constants = ((initial, -left * q * inverse), (unloading, left * left * q * inverse))
    return least(_chained(q, *terms, *constants), strength)


def dilation(s_i: Dual, s_j: Dual, k: Numbers) -> Dual:
    """sin(psi_m) of a pair."""
    tiny, constant = k["p_ref"] * _TINY, k["sine_cv"]
    sum_ = (s_i + s_j + (2.0 * k["a"] - tiny)).positive_part() + tiny
    ratio, inverse = (s_i.value - s_j.value) / sum_.value, 1.0 / sum_.value
    mobilised = least(
        _chained(ratio, (s_i, inverse), (s_j, -inverse), (sum_, -ratio * inverse)), k["sine"]
    )
    m, c = mobilised.value, _value(constant)
    below = 1.0 / (1.0 - m * c)
    slopes = (1.0 - c * c) * below**2, (m * m - 1.0) * below**2
    sine = _chained((m - c) * below, (mobilised, slopes[0]), (constant, slopes[1]))
    return sine.positive_part()


def mean_stress(s: Dual) -> Dual:
    """Mean p (q,) of principal stresses (3, q)."""
    return Dual(s.columns.sum(axis=0) / 3.0)


def cap_radius(s: Dual, k: Numbers) -> Dual:
    """p_c + a (q,) of the cap through principal stresses (3, q), Pa."""
    p = mean_stress(s)
    parts = s - p
    squared = Dual((parts * parts).columns.sum(axis=0) * 1.5)
    tiny, p = k["p_ref"] * _TINY, p + k["a"]
    return (squared / k["squared"] + p * p + tiny * tiny).root()


def _value(number: Number) -> Floats:
    return number.value if isinstance(number, Dual) else np.asarray(number)


def _chained(value: Floats, *terms: tuple[Number, Floats]) -> Dual:
    """A function of numbers: its value (...), and each number with the slope (...) by it."""
    parts = [slope[..., None] * one.columns for one, slope in terms if isinstance(one, Dual)]
    columns = parts[0]
    for part in parts[1:]:
        columns += part
    columns[..., 0] = value
    return Dual(columns)


def least(one: Dual, other: Dual | float) -> Dual:
    """The smaller of two numbers."""
    if not isinstance(other, Dual):
        other = Dual.constant(np.full(one.value.shape, other), one.n)
    return Dual(np.where(one.columns[..., :1] < other.columns[..., :1], one.columns, other.columns))


def power(base: Dual, exponent: Dual | float) -> Dual:
    """Base ** exponent, of a positive base."""
    if isinstance(exponent, Dual):
        return base.power(exponent)
    return base.through(lambda x: x**exponent, lambda x: exponent * x ** (exponent - 1.0))
