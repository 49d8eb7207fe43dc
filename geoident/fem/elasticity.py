"""Elastic moduli as matrices (theory 1), for every symmetry, with their derivatives.

A *law* is the elasticity matrix E (6, 6) with its derivatives by the constants that users give. It
is made in the material axes 1, 2, 3 (components 11, 22, 33, 12, 23, 13), turned into the axes of
the model (xx, yy, zz, xy, yz, xz), and cut to the components of the analysis.

Engineering constants give the compliance S, which is a sum of simple terms; then E = S^-1 and
dE = -E dS E. Moduli (Lame's, Love's, the 21 entries) give E itself, linearly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geoident.fem.rotation import Turn, bond, bond_slope
from geoident.model.arrays import Floats
from geoident.model.ground import ENTRIES

VOIGT = {
    2: np.array([[0, 3], [3, 1]]),
    3: np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]]),
}
"""Component of the Voigt vector that holds entry (i, j) of a symmetric tensor."""


def isotropic_matrices(n_strain: int) -> Floats:
    """J_lambda and J_mu, (2, n_strain, n_strain), with E = lambda J_lambda + mu J_mu."""
    normal = np.arange(n_strain) < 3
    lame = np.zeros((2, n_strain, n_strain))
    lame[0] = np.outer(normal, normal)
    lame[1] = np.diag(np.where(normal, 2.0, 1.0))
    return lame


def lame_from_young(E: float, nu: float) -> tuple[Floats, Floats]:
    """(lambda, mu) (2,) and their derivatives by (E, nu), (2, 2).

    >>> lame_from_young(2.5, 0.25)[0]
    array([1., 1.])
    """
    a, b = 1 + nu, 1 - 2 * nu
    lame = np.array([E * nu / (a * b), E / (2 * a)])
    by_nu = np.array([E * (1 + 2 * nu**2) / (a * b) ** 2, -E / (2 * a**2)])
    return lame, np.stack([lame / E, by_nu], axis=1)


def lame_from_bulk(K: float, G: float) -> tuple[Floats, Floats]:
    """(lambda, mu) (2,) and their derivatives by bulk and shear modulus (K, G), (2, 2)."""
    return np.array([K - 2 * G / 3, G]), np.array([[1.0, -2 / 3], [0.0, 1.0]])


@dataclass(frozen=True)
class Law:
    """An elasticity matrix and its derivatives.

    Args:
        matrix: E, (6, 6), Pa.
        slopes: dE by each constant and angle, (6, 6).
    """

    matrix: Floats
    slopes: Mapping[str, Floats]


def isotropic_law(constants: Mapping[str, float]) -> Law:
    """From E and nu, or K and G."""
    convert = lame_from_young if "E" in constants else lame_from_bulk
    lame, by_constant = convert(*constants.values())
    matrices = isotropic_matrices(6)
    slopes = np.tensordot(by_constant, matrices, axes=(0, 0))
    return Law(np.tensordot(lame, matrices, axes=1), dict(zip(constants, slopes, strict=True)))


def orthotropic_law(constants: Mapping[str, float]) -> Law:
    """From E_1..3, nu_12, nu_13, nu_23, G_12, G_13, G_23.

    S_ii = 1 / E_i, S_ij = -nu_ij / E_i, and 1 / G_ij for the shear strains. S. G. Lekhnitskii,
    Theory of Elasticity of an Anisotropic Body, section 5.
    """
    S = np.zeros((6, 6))
    by: dict[str, Floats] = {}
    for i in range(3):
        modulus = constants[f"E_{i + 1}"]
        row = np.zeros((6, 6))
        row[i, i] = 1.0
        for j in range(i + 1, 3):
            name = f"nu_{i + 1}{j + 1}"
            row[i, j] = row[j, i] = -constants[name]
            by[name] = -_unit(i, j) / modulus
        S += row / modulus
        by[f"E_{i + 1}"] = -row / modulus**2
    for name, k in (("G_12", 3), ("G_23", 4), ("G_13", 5)):
        S += _unit(k, k) / constants[name]
        by[name] = -_unit(k, k) / constants[name] ** 2
    return _from_compliance(S, by)


def strata_law(constants: Mapping[str, float]) -> Law:
    """Transverse isotropy about axis 3 from E_p, nu_p, E_n, nu_np, G_np.

    S_11 = S_22 = 1 / E_p, S_12 = -nu_p / E_p, S_33 = 1 / E_n, S_13 = S_23 = -nu_np / E_n. B. Amadei
    (1996), Importance of anisotropy when estimating and measuring in situ stresses in rock, Int. J.
    Rock Mech. Min. Sci. 33, section 2 (there nu_np is nu').
    """
    E_p, nu_p, E_n, nu_np, G_np = (
        constants[name] for name in ("E_p", "nu_p", "E_n", "nu_np", "G_np")
    )
    in_plane = _unit(0, 0) + _unit(1, 1) + 2 * _unit(3, 3)
    poisson = -_unit(0, 1) + 2 * _unit(3, 3)
    normal, coupling = _unit(2, 2), -_unit(0, 2) - _unit(1, 2)
    shear = _unit(4, 4) + _unit(5, 5)
    along_p, along_n = in_plane + nu_p * poisson, normal + nu_np * coupling
    by = {
        "E_p": -along_p / E_p**2,
        "nu_p": poisson / E_p,
        "E_n": -along_n / E_n**2,
        "nu_np": coupling / E_n,
        "G_np": -shear / G_np**2,
    }
    return _from_compliance(along_p / E_p + along_n / E_n + shear / G_np, by)


def love_law(constants: Mapping[str, float]) -> Law:
    """Transverse isotropy about axis 3 from Love's moduli A, C, F, L, N, linear in each."""
    by = {
        "A": _unit(0, 0) + _unit(1, 1) + _unit(0, 1),
        "C": _unit(2, 2),
        "F": _unit(0, 2) + _unit(1, 2),
        "L": _unit(4, 4) + _unit(5, 5),
        "N": _unit(3, 3) - 2 * _unit(0, 1),
    }
    return _linear(constants, by)


def anisotropic_law(constants: Mapping[str, float]) -> Law:
    """From entries of the upper triangle, linear in each; what is missing is zero."""
    by = {name: _unit(int(name[1]) - 1, int(name[2]) - 1) for name in ENTRIES if name in constants}
    return _linear(constants, by)


def turned(law: Law, turn: Turn) -> Law:
    """A law in the axes of the model: E = M E' M^T, with its derivatives by the angles too."""
    M = bond(turn.matrix)
    slopes = {name: M @ slope @ M.T for name, slope in law.slopes.items()}
    for name, by_angle in turn.slopes.items():
        half = bond_slope(turn.matrix, by_angle) @ law.matrix @ M.T
        slopes[name] = half + half.T
    return Law(M @ law.matrix @ M.T, slopes)


def _unit(i: int, j: int) -> Floats:
    """The symmetric matrix (6, 6) with ones at (i, j) and (j, i)."""
    matrix = np.zeros((6, 6))
    matrix[i, j] = matrix[j, i] = 1.0
    return matrix


def _from_compliance(S: Floats, by: Mapping[str, Floats]) -> Law:
    E = np.linalg.inv(S)
    E = (E + E.T) / 2
    return Law(E, {name: -E @ slope @ E for name, slope in by.items()})


def _linear(constants: Mapping[str, float], by: Mapping[str, Floats]) -> Law:
    matrix = sum((constants[name] * J for name, J in by.items()), np.zeros((6, 6)))
    return Law(matrix, dict(by))
