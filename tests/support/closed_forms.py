"""Closed forms of the literature."""

from __future__ import annotations

import numpy as np


def kirsch(
    x: np.ndarray, *, radius: float, E: float, nu: float, horizontal: float, vertical: float
) -> np.ndarray:
    """Displacements (n, 2) that excavating a round hole adds in a stressed plane, plane strain.

    Kirsch (1898), as in Brady & Brown, Rock Mechanics for Underground Mining, section 7.2.
    Pressures are positive in compression.
    """
    r, t = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    G, p, K = E / (2 * (1 + nu)), vertical, horizontal / vertical
    s = (radius / r) ** 2
    u_r = -p * radius**2 / (4 * G * r) * ((1 + K) - (1 - K) * (4 * (1 - nu) - s) * np.cos(2 * t))
    u_t = -p * radius**2 / (4 * G * r) * (1 - K) * (2 * (1 - 2 * nu) + s) * np.sin(2 * t)
    return np.stack([u_r * np.cos(t) - u_t * np.sin(t), u_r * np.sin(t) + u_t * np.cos(t)], 1)


def spherical_cavity(
    x: np.ndarray, *, radius: float, E: float, nu: float, stress: tuple[float, float, float]
) -> np.ndarray:
    """Displacements (n, 3) that a spherical cavity adds under principal stresses along x, y, z.

    Goodier (1933), Concentration of stress around spherical and cylindrical inclusions and flaws,
    J. Appl. Mech. 1: the solution for a pull along one axis, superposed. Tension positive.
    """
    mu = E / (2 * (1 + nu))
    r = np.linalg.norm(x, axis=1)
    total = np.zeros_like(x)
    for axis, S in enumerate(stress):
        k = S / (8 * mu * (7 - 5 * nu))
        A = -k * (13 - 10 * nu) * radius**3
        B = k * radius**5
        C = k * 5 * (1 - 2 * nu) * radius**3
        cos_t = x[:, axis] / r
        sin_t = np.sqrt(np.maximum(1 - cos_t**2, 0))
        cos_2t, sin_2t = 2 * cos_t**2 - 1, 2 * sin_t * cos_t
        u_r = -A / r**2 - 3 * B / r**4
        u_r = u_r + ((5 - 4 * nu) / (1 - 2 * nu) * C / r**2 - 9 * B / r**4) * cos_2t
        u_t = -(2 * C / r**2 + 6 * B / r**4) * sin_2t
        radial = x / r[:, None]
        away = radial * cos_t[:, None]
        away[:, axis] -= 1
        tangent = away / np.maximum(sin_t, 1e-30)[:, None]
        total += u_r[:, None] * radial + u_t[:, None] * tangent
    return total


def lift_settlement(n: int, height: float, weight: float, modulus: float) -> np.ndarray:
    """Settlements (n,) of the tops of n lifts that were placed one after the other, m.

    Each lift is free of stress when placed; a top counts its settlement from its own placing. A
    lift of height h compresses by gamma h^2 / (2 M) under its own weight and by gamma h^2 / M under
    each lift above. So the top of lift k has settled by
    gamma h^2 / M (k (n - k) + (k - 1) + 1/2): a parabola over the height.
    """
    k = np.arange(1, n + 1)
    return weight * height**2 / modulus * (k * (n - k) + (k - 1) + 0.5)


def lame_cylinder(
    r: np.ndarray, *, inner: float, outer: float, pressure: float, E: float, nu: float
) -> np.ndarray:
    """Radial displacement (n,) of a thick cylinder under inner pressure, plane strain, m.

    Lame (1852), as in Timoshenko & Goodier, Theory of Elasticity, section 28.
    """
    a, b = inner**2, outer**2
    return (1 + nu) / E * pressure * a / (b - a) * ((1 - 2 * nu) * r + b / r)


def circular_load(*, radius: float, pressure: float, E: float, nu: float) -> tuple[float, float]:
    """Settlements of the centre and of the rim of a flexible round plate on a half-space, m.

    Boussinesq (1885), as in Timoshenko & Goodier, Theory of Elasticity, section 139.
    """
    centre = 2 * pressure * radius * (1 - nu**2) / E
    return centre, centre * 2 / np.pi


def lekhnitskii(
    x: np.ndarray, *, radius: float, compliance: np.ndarray, stress: tuple[float, float, float]
) -> np.ndarray:
    """Displacements (n, 2) that cutting a round hole adds at its wall, anisotropic plane strain.

    S. G. Lekhnitskii, Anisotropic Plates (1968), section 38, or Theory of Elasticity of an
    Anisotropic Body (1963), section 26: complex potentials Phi_k = A_k / zeta_k, where zeta_k is
    exp(i theta) on the wall; mu_k are the roots of the characteristic equation with the compliances
    of plane strain b_ij = a_ij - a_i3 a_j3 / a_33.

    Args:
        x: points of the wall.
        radius: of the hole.
        compliance: (6, 6) a_ij in the order xx, yy, zz, xy, ... of the section; distinct roots.
        stress: xx, yy, xy far away, tension positive.
    """
    keep = np.ix_([0, 1, 3], [0, 1, 3])
    a3 = compliance[[0, 1, 3], 2]
    b = compliance[keep] - np.outer(a3, a3) / compliance[2, 2]
    roots = np.roots([b[0, 0], -2 * b[0, 2], 2 * b[0, 1] + b[2, 2], -2 * b[1, 2], b[1, 1]])
    mu = roots[roots.imag > 0]
    xx, yy, xy = stress
    # On the wall the added stress functions take away what the far stress does:
    # 2 Re sum Phi_k = -(yy x - xy y), 2 Re sum mu_k Phi_k = -(xx y - xy x).
    sides = radius / 2 * np.array([-yy + 1j * xy, xy - 1j * xx])
    A = np.linalg.solve(np.array([[1, 1], mu]), sides)
    p = b[0, 0] * mu**2 + b[0, 1] - b[0, 2] * mu
    q = b[0, 1] * mu + b[1, 1] / mu - b[1, 2]
    inverse = np.exp(-1j * np.arctan2(x[:, 1], x[:, 0]))
    return np.stack([2 * np.real(inverse * (c @ A)) for c in (p, q)], axis=1)


def rigid_plate(*, radius: float, force: float, E: float, nu: float) -> float:
    """Settlement of a rigid round plate that sticks to a half-space, m.

    Mossakovskii (1954); D. A. Spence (1968), Self similar solutions to adhesive contact problems
    with incremental loading, Proc. R. Soc. A 305: P = 4 G a w ln(3 - 4 nu) / (1 - 2 nu).
    """
    G = E / (2 * (1 + nu))
    return force * (1 - 2 * nu) / (4 * G * radius * np.log(3 - 4 * nu))


def salencon_wall(
    *, pressure: float, inner: float, c: float, phi: float, psi: float, E: float, nu: float
) -> tuple[float, float]:
    """Plastic radius and inward wall displacement, both over the radius, of a circular opening.

    J. Salencon (1969), Annales des Ponts et Chaussees 4, in the form in which manuals of programs
    quote it. The stress out of the plane is taken as the middle one everywhere, which makes the
    displacement a little too small where it is not. Compression positive, angles in rad.
    """
    G, K_p = E / (2 * (1 + nu)), (1 + np.sin(phi)) / (1 - np.sin(phi))
    K_ps = (1 + np.sin(psi)) / (1 - np.sin(psi))
    tip = 2 * c * np.sqrt(K_p) / (K_p - 1)
    R = (2 / (K_p + 1) * (pressure + tip) / (inner + tip)) ** (1 / (K_p - 1))
    chi = (2 * nu - 1) * (pressure + tip)
    chi += (1 - nu) * (K_p**2 - 1) / (K_p + K_ps) * (inner + tip) * R ** (K_p + K_ps)
    chi += ((1 - nu) * (K_p * K_ps + 1) / (K_p + K_ps) - nu) * (inner + tip)
    return R, chi / (2 * G)


def tresca_cylinder(
    *, inner: float, outer: float, edge: float, c: float, E: float, nu: float
) -> tuple[float, float]:
    """Inner pressure and motion of the outer face of a thick cylinder that yields to a radius.

    R. Hill, The Mathematical Theory of Plasticity (1950), chapter V: Tresca with the axial stress
    in the middle, plane strain. With the yield stress Y = 2 c and rho the edge of the plastic zone,
    p / Y = ln(rho / a) + (1 - rho^2 / b^2) / 2; the outer face moves as in an elastic ring.
    Fully plastic (edge = outer) the pressure is the limit 2 c ln(b / a).
    """
    Y = 2 * c
    p = Y * (np.log(edge / inner) + (1 - edge**2 / outer**2) / 2)
    return p, (1 - nu**2) / E * Y * edge**2 / outer


def plastic_sphere(
    r: np.ndarray,
    *,
    radius: float,
    pressure: float,
    inner: float,
    c: float,
    phi: float,
    psi: float,
    E: float,
    nu: float,
) -> tuple[float, np.ndarray]:
    """Plastic radius and radial displacements (n,) of a spherical cavity under an all-round stress.

    J. Salencon (1969), the spherical case; Tresca (phi = 0, taken as a limit by a small angle) is
    Hill's. Compression positive, displacement positive outwards, angles in rad. At the yield edge
    sigma_t = sigma_p both hoop directions flow: eps_r + 2 K eps_t plastic is zero.

    d sigma_r / d ln r = 2 ((N - 1) sigma_r + Y);  u' + 2 K u / r = -(e_r + 2 K e_t), integrated
    with the elastic strains e of the changes of stress.
    """
    N, K = ((1 + np.sin(x)) / (1 - np.sin(x)) for x in (phi, psi))
    Y, G, m = 2 * c * np.sqrt(N), E / (2 * (1 + nu)), 2 * (N - 1)
    tip = Y / (N - 1)
    critical = (3 * pressure - 2 * Y) / (1 + 2 * N)
    R = radius * ((critical + tip) / (inner + tip)) ** (1 / m)
    outside = (critical - pressure) * R**3 / (4 * G * r**2)
    # e_r + 2 K e_t = A r^m + B, as sigma_r = (inner + tip) (r / a)^m - tip
    on_r, on_t = (1 - 2 * K * nu) / E, 2 * (K * (1 - nu) - nu) / E
    A = (on_r + on_t * N) * (inner + tip) / radius**m
    B = -(on_r + on_t) * (tip + pressure)
    k = 2 * K + 1
    edge = (critical - pressure) * R / (4 * G)
    source = A * (R ** (m + k) - r ** (m + k)) / (m + k) + B * (R**k - r**k) / k
    within = (edge * R ** (2 * K) + source) / r ** (2 * K)
    return R, np.where(r < R, within, outside)
