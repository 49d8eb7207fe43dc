"""Elastic moduli as matrices (theory 1), for every symmetry, with their derivatives.

The elasticity matrix E (6, 6) is made in the material axes 1, 2, 3 (components 11, 22, 33, 12, 23,
13) from the constants that users give, turned into the axes of the model (xx, yy, zz, xy, yz, xz),
and cut to the components of the analysis. All is written with dual numbers, so every constant and
every angle may be a parameter.

Engineering constants give the compliance S, which is a sum of simple terms; then E = S^-1 and
dE = -E dS E. Moduli (Lame's, Love's, the 21 entries) give E itself, linearly.

The strain points of a material take such a matrix as `Moduli`: the same at all of them, or of each
its own. Where a modulus is a field, most often the whole matrix varies by one factor (Young's
modulus at fixed Poisson's ratio): E_q = f_q E. Otherwise every point has its own matrix.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.dual import Dual
from geoident.model.ground import ENTRIES

Constants = Mapping[str, Dual]
"""Elastic constants (Pa, or without unit) by the names that users write."""

VOIGT = {
    2: np.array([[0, 3], [3, 1]]),
    3: np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]]),
}
"""Component of the Voigt vector that holds entry (i, j) of a symmetric tensor."""

_FIRST, _SECOND = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]).T


def lame_constants(constants: Constants) -> tuple[Dual, Dual]:
    """Lambda and mu from E and nu, or K and G."""
    if "E" in constants:
        E, nu = constants["E"], constants["nu"]
        return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
    K, mu = constants["K"], constants["G"]
    return K - mu * (2.0 / 3.0), mu


def isotropic(constants: Constants) -> Dual:
    """E (6, 6) from E and nu, or K and G: lambda J_lambda + mu J_mu."""
    lame, mu = lame_constants(constants)
    normal = np.arange(6) < 3
    return lame * np.outer(normal, normal).astype(np.float64) + mu * np.diag(
        np.where(normal, 2.0, 1.0)
    )


def orthotropic(constants: Constants) -> Dual:
    """E (6, 6) from E_1..3, nu_12, nu_13, nu_23, G_12, G_13, G_23.

    S_ii = 1 / E_i, S_ij = -nu_ij / E_i, and 1 / G_ij for the shear strains. S. G. Lekhnitskii,
    Theory of Elasticity of an Anisotropic Body, section 5.
    """
    terms = []
    for i in range(3):
        row = _unit(i, i) + constants["E_1"] * 0.0
        for j in range(i + 1, 3):
            row = row - constants[f"nu_{i + 1}{j + 1}"] * _unit(i, j)
        terms.append(row / constants[f"E_{i + 1}"])
    terms += [_unit(k, k) / constants[name] for name, k in (("G_12", 3), ("G_23", 4), ("G_13", 5))]
    return _inverse(_sum(terms))


def transversely_isotropic(constants: Constants) -> Dual:
    """E (6, 6), isotropic about axis 3, from E_p, nu_p, E_n, nu_np, G_np.

    S_11 = S_22 = 1 / E_p, S_12 = -nu_p / E_p, S_33 = 1 / E_n, S_13 = S_23 = -nu_np / E_n. B. Amadei
    (1996), Importance of anisotropy when estimating and measuring in situ stresses in rock, Int. J.
    Rock Mech. Min. Sci. 33, section 2 (there nu_np is nu').
    """
    in_plane = _unit(0, 0) + _unit(1, 1) + 2 * _unit(3, 3)
    poisson = -_unit(0, 1) + 2 * _unit(3, 3)
    normal, coupling = _unit(2, 2), -_unit(0, 2) - _unit(1, 2)
    shear = _unit(4, 4) + _unit(5, 5)
    along_p = constants["nu_p"] * poisson + in_plane
    along_n = constants["nu_np"] * coupling + normal
    return _inverse(
        along_p / constants["E_p"] + along_n / constants["E_n"] + shear / constants["G_np"]
    )


def love(constants: Constants) -> Dual:
    """E (6, 6), isotropic about axis 3, from Love's moduli A, C, F, L, N, linear in each."""
    return _linear(
        constants,
        {
            "A": _unit(0, 0) + _unit(1, 1) + _unit(0, 1),
            "C": _unit(2, 2),
            "F": _unit(0, 2) + _unit(1, 2),
            "L": _unit(4, 4) + _unit(5, 5),
            "N": _unit(3, 3) - 2 * _unit(0, 1),
        },
    )


def anisotropic(constants: Constants) -> Dual:
    """E (6, 6) from entries of the upper triangle, linear in each; what is missing is zero."""
    entries = [name for name in ENTRIES if name in constants]
    return _linear(constants, {c: _unit(int(c[1]) - 1, int(c[2]) - 1) for c in entries})


def turned(elasticity: Dual, axes: Dual) -> Dual:
    """E (..., 6, 6) in the axes of the model: M E' M^T with Bond's matrix M of the material axes.

    Args:
        elasticity: E' (..., 6, 6) in the material axes.
        axes: R (3, 3); its columns are the material axes 1, 2, 3 in the axes of the model.
    """
    one = bond(axes).columns
    M = Dual(one.reshape((1,) * (elasticity.columns.ndim - 3) + one.shape))
    return M @ elasticity @ M.T


def bond(R: Dual) -> Dual:
    """Bond's matrix M (6, 6): stress in the model's axes = M (stress in the material axes).

    W. L. Bond (1943), The mathematics of the physical properties of crystals, Bell System Technical
    Journal 22; here with the components in the order xx, yy, zz, xy, yz, xz:
    sigma_ij = R_ik R_jl sigma'_kl.
    """
    rows = R[_FIRST], R[_SECOND]
    straight = rows[0][:, _FIRST] * rows[1][:, _SECOND]
    crossed = rows[0][:, _SECOND] * rows[1][:, _FIRST]
    return straight + crossed * np.where(_FIRST == _SECOND, 0.0, 1.0)


def axes_of_attitude(
    dip: Dual, dip_direction: Dual, rotation: Dual, *, section: bool = False
) -> Dual:
    """Material axes of strata (3, 3): 1 down the dip, 2 along the strike, 3 normal, upwards.

    R = R_z(-dip_direction) R_x(-dip) R_z(90 deg + rotation) in axes east, north, up.

    Args:
        dip: rad, from the horizontal downwards.
        dip_direction: rad, clockwise from north.
        rotation: rad, of axes 1 and 2 about the normal.
        section: in the axes of a plane section that is seen looking north: x east, y up, z south.
    """
    axes = about(2, -dip_direction) @ about(0, -dip) @ about(2, rotation + np.pi / 2)
    if not section:
        return axes
    upright = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    return Dual.constant(upright, axes.n) @ axes


def axes_of_vectors(first: Floats, second: Floats) -> Floats:
    """Material axes (3, 3) by the orthonormal vectors of axis 1 and axis 2, each (3,)."""
    return np.column_stack([first, second, np.cross(first, second)])


def about(axis: int, angle: Dual) -> Dual:
    """Right-handed rotation (3, 3) about a coordinate axis by an angle, rad."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    flat, half = np.zeros((3, 3)), np.zeros((3, 3))
    flat[[j, k], [j, k]] = 1.0
    half[j, k], half[k, j] = -1.0, 1.0
    return angle.cosine() * flat + angle.sine() * half + (np.eye(3) - flat)


def _unit(i: int, j: int) -> Floats:
    """The symmetric matrix (6, 6) with ones at (i, j) and (j, i)."""
    matrix = np.zeros((6, 6))
    matrix[i, j] = matrix[j, i] = 1.0
    return matrix


def _sum(terms: list[Dual]) -> Dual:
    return sum(terms[1:], start=terms[0])


def _inverse(S: Dual) -> Dual:
    """S^-1 and -S^-1 dS S^-1 of a compliance (6, 6)."""
    E = np.linalg.inv(S.value)
    E = (E + E.swapaxes(-2, -1)) / 2
    slopes = -E @ np.moveaxis(S.columns[..., 1:], -1, 0) @ E
    return Dual(np.concatenate([E[..., None], np.moveaxis(slopes, 0, -1)], axis=-1))


def _linear(constants: Constants, matrices: Mapping[str, Floats]) -> Dual:
    return _sum([constants[name] * J for name, J in matrices.items()])


class Moduli(Protocol):
    """E at the strain points (q) of a material that are looked at, or a derivative of it."""

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some of them, (k,) by place."""

    def at(self, points: Ints) -> Moduli:
        """Those of some of them, (k,) by place."""


@dataclass(frozen=True, eq=False)
class UniformModuli:
    """The same E (s, s) at all points."""

    matrix: Floats

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""
        return np.asarray(np.tensordot(self.matrix, strain, axes=1))

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some points (k,)."""
        return np.broadcast_to(self.matrix, (len(points), *self.matrix.shape))

    def at(self, points: Ints) -> UniformModuli:
        """The same."""
        return self


@dataclass(frozen=True, eq=False)
class ScaledModuli:
    """One matrix (s, s) times a factor (q,) of every point."""

    matrix: Floats
    factor: Floats

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""
        stress = np.tensordot(self.matrix, strain, axes=1)
        stress *= self.factor.reshape((1, -1) + (1,) * (strain.ndim - 2))
        return np.asarray(stress)

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some points (k,)."""
        return np.asarray(self.factor[points, None, None] * self.matrix)

    def at(self, points: Ints) -> ScaledModuli:
        """Those of some points (k,)."""
        return ScaledModuli(self.matrix, self.factor[points])


@dataclass(frozen=True, eq=False)
class PointwiseModuli:
    """E of every point, (s, s, q)."""

    entries: Floats

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""
        shape = (-1,) + (1,) * (strain.ndim - 2)
        stress = np.zeros((len(self.entries), *strain.shape[1:]))
        for a, row in enumerate(self.entries):
            for entry, component in zip(row, strain, strict=True):
                if entry.any():
                    stress[a] += entry.reshape(shape) * component
        return stress

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some points (k,)."""
        return np.ascontiguousarray(np.moveaxis(self.entries[..., points], -1, 0))

    def at(self, points: Ints) -> PointwiseModuli:
        """Those of some points (k,)."""
        return PointwiseModuli(self.entries[..., points])
