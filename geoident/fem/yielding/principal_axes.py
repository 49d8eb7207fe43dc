"""Principal values and axes of stresses, and the frames in which isotropic laws are diagonal.

Stresses have the components xx, yy, zz, xy of a plane or a section about an axis, where zz is one
of the principal axes, or xx, yy, zz, xy, yz, xz.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoident.model.arrays import Floats, Ints

PAIRS = ((0, 1), (1, 2), (0, 2))
"""Of axes, in the order of shear components."""
ROUGH = 1e-6
"""Of the largest stress: an error that `rough_principal_values`, good to 1e-8, never have."""

_FIRST = np.array([0, 1, 2, 0, 1, 0])
_SECOND = np.array([0, 1, 2, 1, 2, 2])


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Principal values and axes of stresses.

    Args:
        values: (3, q), descending.
        axes: (q, 3, 3), their directions as columns.
        n_stress: number s of components of the stress, 4 or 6.
    """

    values: Floats
    axes: Floats
    n_stress: int

    def of(self, points: Ints) -> Spectrum:
        """Of some of the points, by their numbers (k,)."""
        return Spectrum(self.values[:, points], self.axes[points], self.n_stress)

    @cached_property
    def assemble(self) -> Floats:
        """(q, s, 6): stresses of their components 11, 22, 33, 12, 23, 13 along the axes."""
        both = self._products()
        both[:, :, :3] *= 0.5
        return both

    @cached_property
    def resolve(self) -> Floats:
        """(q, 6, s): those components of stresses."""
        both = self._products()
        both[:, :3, :] *= 0.5
        return np.swapaxes(both, 1, 2)

    def _products(self) -> Floats:
        """v_i[a] v_j[b] + v_i[b] v_j[a] of components ab and pairs of axes ij, (q, s, 6).

        Where the axes are equal (to assemble), or the indices (to resolve), half of it counts.
        """
        a, b = self.axes[:, _FIRST[: self.n_stress]], self.axes[:, _SECOND[: self.n_stress]]
        return a[:, :, _FIRST] * b[:, :, _SECOND] + b[:, :, _FIRST] * a[:, :, _SECOND]


def spectrum(stress: Floats) -> Spectrum:
    """Principal values and axes of stresses (s, q)."""
    if len(stress) == 4:
        return _plane_spectrum(stress)
    values, axes = np.linalg.eigh(tensors(stress))
    return Spectrum(values[:, ::-1].T.copy(), axes[:, :, ::-1].copy(), len(stress))


def _plane_spectrum(stress: Floats) -> Spectrum:
    """In closed form: the axes in the plane turn by half the angle of (xx - yy)/2, xy."""
    angle = 0.5 * np.arctan2(stress[3], 0.5 * (stress[0] - stress[1]))
    axes = np.zeros((stress.shape[1], 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(angle)
    axes[:, 1, 0] = np.sin(angle)
    axes[:, 0, 1] = -axes[:, 1, 0]
    axes[:, 2, 2] = 1.0
    values = _plane_values(stress)
    order = np.argsort(-values, axis=0, kind="stable")
    return Spectrum(
        np.take_along_axis(values, order, axis=0),
        np.take_along_axis(axes, order.T[:, None, :], axis=2),
        4,
    )


def _plane_values(stress: Floats) -> Floats:
    """Larger and smaller principal stress in the plane and the one across it (3, m)."""
    centre = 0.5 * (stress[0] + stress[1])
    radius = np.hypot(0.5 * (stress[0] - stress[1]), stress[3])
    return np.stack([centre + radius, centre - radius, stress[2]])


def principal_values(stress: Floats) -> Floats:
    """Principal values (3, m) of stresses (s, m), descending."""
    if len(stress) == 4:
        return np.sort(_plane_values(stress), axis=0)[::-1]
    return np.asarray(np.linalg.eigvalsh(tensors(stress))[:, ::-1].T, dtype=np.float64)


def rough_principal_values(stress: Floats) -> Floats:
    """Principal values (3, m) of stresses (s, m), descending, to about eight digits.

    Fast for solids too: the roots of the cubic by cosines.
    """
    if len(stress) == 4:
        return principal_values(stress)
    mean = stress[:3].mean(axis=0)
    a, b, c = stress[:3] - mean
    d, e, f = stress[3:]
    half_square = 0.5 * (a * a + b * b + c * c) + d * d + e * e + f * f
    determinant = a * (b * c - e * e) - d * (d * c - e * f) + f * (d * e - b * f)
    radius = np.sqrt(half_square / 3.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.nan_to_num(0.5 * determinant / radius**3)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0
    turns = np.array([0.0, -2.0, 2.0])[:, None] * (np.pi / 3.0)
    return np.asarray(mean + 2.0 * radius * np.cos(angle + turns))


def tensors(stress: Floats) -> Floats:
    """Stresses (6, q) as symmetric matrices (q, 3, 3)."""
    full = np.empty((stress.shape[1], 3, 3))
    full[:, _FIRST, _SECOND] = stress.T
    full[:, _SECOND, _FIRST] = stress.T
    return full


def check_isotropic(elasticity: Floats) -> None:
    """Refuse an elasticity (s, s) that principal axes do not suit.

    Raises:
        ValueError: it is not isotropic.
    """
    size = len(elasticity)
    if size not in (4, 6):
        raise ValueError("principal stresses need stresses of 4 or 6 components")
    lame, shear = elasticity[0, 1], elasticity[3, 3]
    model = np.diag([2.0 * shear] * 3 + [shear] * (size - 3))
    model[:3, :3] += lame
    if np.abs(model - elasticity).max() > 1e-8 * np.abs(elasticity).max():
        raise ValueError("planes in principal stresses need an isotropic elasticity")
