"""Elastic moduli as matrices (theory 1): E = sum_h c_h J_h, and what they do to the stiffness."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats

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


def stiffness_map(elasticity: Floats, dim: int) -> Floats:
    """How moduli turn gradient products into stiffness: (dim^2, dim^2).

    With G_ab[j, l] = integral dN_a/dx_j dN_b/dx_l, the block of nodes a, b is
    K_ab[i, k] = sum_jl E_(ij)(kl) G_ab[j, l] = (G_ab.ravel() @ T)[i, k] for the T returned here.
    One map per material serves every symmetry of the moduli, so all cost the same.

    Args:
        elasticity: E, (n_strain, n_strain), Pa.
        dim: space dimensions.
    """
    voigt = VOIGT[dim]
    tensor = elasticity[voigt[:, :, None, None], voigt[None, None, :, :]]
    return np.asarray(tensor.transpose(1, 3, 0, 2).reshape(dim * dim, dim * dim))
