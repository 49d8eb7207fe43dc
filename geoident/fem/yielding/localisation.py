"""Where ground may shear in bands: the sign of the acoustic tensor of its tangent.

A band with the normal n can form where the acoustic tensor Q = n . D . n of the tangent D has no
positive determinant (Rudnicki, Rice 1975, J. Mech. Phys. Solids 23; Rice 1976). Ground that does
not harden and dilates less than its friction comes there as soon as it flows.
"""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Bools, Floats

_ANGLES = 90
"""Normals that are tried over half a turn."""

_PLACES = {4: ((0, 3), (3, 1)), 6: ((0, 3, 5), (3, 1, 4), (5, 4, 2))}
"""Number of the component of stress at (i, j) of the tensor, by the number of components."""


def may_localise(tangents: Floats) -> Bools:
    """(q,) whether the acoustic tensor has a determinant of zero or less for some normal.

    Args:
        tangents: (q, s, s) with s = 4 (xx, yy, zz, xy; normals in the plane) or s = 6
            (xx, yy, zz, xy, yz, xz), engineering shear strains.
    """
    places = np.array(_PLACES[tangents.shape[1]])
    D = tangents[:, places[:, :, None, None], places[None, None]]  # (q, i, j, k, l)
    may = np.zeros(len(tangents), dtype=np.bool_)
    for n in _normals(len(places)):
        may |= np.linalg.det(np.einsum("i,qijkl,l->qjk", n, D, n)) <= 0.0
    return may


def _normals(dim: int) -> Floats:
    """Unit vectors (k, dim) over half a circle, or half a sphere, evenly."""
    if dim == 2:
        angle = np.pi * np.arange(_ANGLES) / _ANGLES
        return np.column_stack([np.cos(angle), np.sin(angle)])
    count = 4 * _ANGLES  # Fibonacci's spiral
    z = (np.arange(count) + 0.5) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    r = np.sqrt(1.0 - z**2)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
