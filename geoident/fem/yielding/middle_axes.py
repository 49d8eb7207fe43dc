"""Stress at the end of a step from its principal values, in the axes of the trial stress."""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.principal_axes import PAIRS, Spectrum
from geoident.model.arrays import Floats

_ONE, _OTHER = np.array(PAIRS).T

_SMALL = 1e-9
"""Difference of principal stresses, by the largest, below which they are taken as equal."""


def end_stress(axes: Spectrum, trial: Floats, ends: Floats, slopes: Floats) -> Floats:
    """Stresses (s, q, 1 + c) at the end of a step, with their derivatives.

    Stresses across the axes change by (e_i - e_j) / (T_i - T_j) of those of the trial stress.

    Args:
        axes: of the trial stresses.
        trial: (s, q, 1 + c) stresses.
        ends: (q, 3, 1 + c) principal values at the end, in the order of the axes.
        slopes: (q, 3, 3) of the ends by the principal values of the trial stress.
    """
    along = np.einsum("qis,sqc->qic", axes.resolve, trial)
    gap, left = (of[:, _ONE, 0] - of[:, _OTHER, 0] for of in (along, ends))
    near = np.abs(gap) <= _SMALL * np.abs(along[:, :3, 0]).max(axis=1, keepdims=True)
    limit = slopes[:, _ONE, _ONE] - slopes[:, _ONE, _OTHER]
    ratio = np.where(near, limit, left / np.where(near, 1.0, gap))
    along[:, :3], along[:, 3:, 0] = ends, 0.0
    along[:, 3:, 1:] *= ratio[..., None]
    return np.asarray(np.einsum("qsi,qic->sqc", axes.assemble, along))
