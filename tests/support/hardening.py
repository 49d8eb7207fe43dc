"""A little hardening for all planes: it smooths an identifier's path, and carries every load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.model.arrays import Floats
from support.plastic import Planes


def harden(planes: Planes, elasticity: Floats, ratio: float) -> Planes:
    """Planes with H = ratio diag(n^T E m) on top of the hardening they have.

    Args:
        planes: (y, s), or (y, 3) in principal stresses.
        elasticity: E (s, s); for principal stresses its block of normal stresses is taken.
        ratio: of the stiffness that a plane keeps to that across it, without unit.
    """
    _, flow, block = _parts(planes, elasticity)
    added = np.diag(ratio * np.einsum("yi,ij,yj->y", planes.normals, block, flow))
    own = 0.0 if planes.hardening is None else planes.hardening
    return replace(planes, hardening=added + own)


def _parts(planes: Planes, elasticity: Floats) -> tuple[int, Floats, Floats]:
    """Number of stress components, flow, and the block of E for them."""
    count = planes.normals.shape[1]
    flow = planes.normals if planes.flow is None else planes.flow
    return count, flow, elasticity[:count, :count]
