"""Stress at the end of a step whose flow has the principal axes of its middle (theory 19).

A return in principal values knows one set of axes, those of the trial stress T. Flow along these is
that of the end of a step, an error of the first order where axes turn. In the middle, the mean of
the stresses b before and e after, the axes differ from these by the angle whose tangent of twice is
b_ij / (m_i - m_j), m the mean of principal values. So there is stress across the axes of T,

    e_ij = -b_ij / 2 ((T_i - T_j) - (e_i - e_j)) / (m_i - m_j) ,

bounded where m_i and m_j come together. Principal values change by its square only.
"""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.principal_axes import PAIRS, Spectrum
from geoident.model.arrays import Floats
from geoident.model.dual import Dual

_ONE, _OTHER = np.array(PAIRS).T
_PLACES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
"""Of the components 11, 22, 33, 12, 23, 13 in a matrix."""

_SMALL = 1e-9
"""Difference of principal stresses, by the largest, below which they are taken as equal."""


def end_stress(
    axes: Spectrum, trial: Floats, before: Floats, ends: Floats, begin: Floats, slopes: Floats
) -> Floats:
    """Stresses (s, q, 1 + c) at the end of a step, with their derivatives.

    Args:
        axes: of the trial stresses.
        trial: (s, q, 1 + c) stresses.
        before: (s, q, 1 + c) those at the beginning.
        ends: (q, 3, 1 + c) principal values at the end, in the order of the axes.
        begin: (q, 3, 1 + c) at the beginning.
        slopes: (q, 3, 3) of the ends by the principal values of the trial stress.
    """
    along, first = (np.einsum("qis,sqc->qic", axes.resolve, of) for of in (trial, before))
    gap, left, twice = (
        Dual(of[:, _ONE] - of[:, _OTHER]) for of in (along[:, :3], ends, ends + begin)
    )
    largest = np.abs(along[:, :3, 0]).max(axis=1, keepdims=True)
    near = np.abs(gap.value) <= _SMALL * largest
    inverse = np.where(near, 0.0, 1.0 / np.where(near, 1.0, gap.value))
    turn = along[:, 3:, 1:] * inverse[..., None]
    first[..., 1:] -= _turned(first[..., 0], turn)
    across, middle = Dual(first[:, 3:]), twice * 0.5
    size = Dual((across * across).columns.sum(axis=1, keepdims=True)) + middle * middle
    across = across * (left - gap) * middle / (size + (_SMALL * largest) ** 2) * 0.5
    # of equal trial stresses the limit
    ratio = np.where(near, slopes[:, _ONE, _ONE] - slopes[:, _ONE, _OTHER], left.value * inverse)
    result = np.concatenate([ends, across.columns], axis=1)
    result[:, 3:, 1:] += ratio[..., None] * along[:, 3:, 1:]
    result[..., 1:] += _turned(np.pad(across.value, ((0, 0), (3, 0))), turn)
    return np.asarray(np.einsum("qsi,qic->sqc", axes.assemble, result))


def _turned(stress: Floats, turn: Floats) -> Floats:
    """(q, 6, c) what stresses (q, 6) change as they turn by small angles (q, 3, c) about pairs."""
    full = np.zeros((len(stress), 3, 3, turn.shape[2]))
    full[:, _ONE, _OTHER], full[:, _OTHER, _ONE] = turn, -turn
    change = np.einsum("qij,qjkc->qikc", stress[:, _PLACES], full)
    change += change.swapaxes(1, 2)
    return np.concatenate([change[:, [0, 1, 2], [0, 1, 2]], change[:, _ONE, _OTHER]], axis=1)
