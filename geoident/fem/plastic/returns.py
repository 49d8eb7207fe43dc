"""Return to planes with a flow of its own: the complementarity problem by its few active sets.

Without symmetry there is no projection and no descent of a dual objective, but in principal
stresses there are few planes, so the sets of at most three active ones are tried in turn, all
points at once: first single planes, then edges, then vertices. The first whose multipliers are
nonnegative and whose stress violates no plane is it. Where the flow has too little dilation, no set
brings a tension back; such points go to the apex on the hydrostatic axis, with the plastic volume
that takes: there the flow is free (de Souza Neto, Peric & Owen 2008, 8.2).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from geoident.fem.plastic.faces import Faces
from geoident.fem.plastic.images import Images
from geoident.fem.plastic.system import System
from geoident.model.arrays import Floats, Ints

_SINGULAR = 1e-9
"""Smallest singular value of A_WW, scaled, of a set that is tried."""
_BETWEEN = 1e5
"""Times the tolerance: what a point may lack that falls between two sets by rounding."""


class Returns:
    """Finds active sets with any flow.

    Args:
        system: the images of the planes.
        faces: of its coupling.
        images: which of them make the apex.
    """

    def __init__(self, system: System, faces: Faces, images: Images) -> None:
        self._system = system
        self._faces = faces
        self._images = images
        plain = np.flatnonzero(~images.upright)
        sets = [c for size in (1, 2, 3) for c in combinations(plain.tolist(), size)]
        self._plain = plain
        self._candidates = [faces.number(c) for c in sets if self._independent(c)]

    def _independent(self, planes: tuple[int, ...]) -> bool:
        matrix = self._system.coupling[np.ix_(planes, planes)]
        return bool(np.linalg.svd(matrix, compute_uv=False)[-1] > _SINGULAR)

    def find(self, excess: Floats, tolerance: Floats, limits: Floats) -> Ints:
        """Faces (q,) of points with the scaled yield functions (q, i) of their trial stress.

        Args:
            excess: (q, i).
            tolerance: (q, i) what counts as zero in them.
            limits: (q, i) scaled distances with hardening.
        """
        found = np.zeros(len(excess), dtype=np.int64)
        left = np.flatnonzero(((excess > tolerance)[:, self._plain]).any(axis=1))
        best = np.full(len(excess), np.inf)
        for face in self._candidates:
            if not left.size:
                return found
            lacking = self._lacking(face, excess[left], tolerance[left])
            better = lacking < best[left]
            best[left[better]], found[left[better]] = lacking[better], face
            left = left[lacking > 1.0]
        far = left[best[left] > _BETWEEN]
        if far.size:
            found[far] = self._apex(limits[far])
        return found

    def _lacking(self, face: int, excess: Floats, tolerance: Floats) -> Floats:
        """By how many tolerances the worst condition (q,) fails on a face; a solution has < 1."""
        active = list(self._faces.members[face])
        inverse = np.linalg.inv(self._system.coupling[np.ix_(active, active)])
        multipliers = excess[:, active] @ inverse.T
        rest = excess - multipliers @ self._system.coupling[:, active].T
        rest[:, active] = 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            outside = (rest / tolerance)[:, self._plain].max(axis=1)
            against = (-multipliers / tolerance[:, active]).max(axis=1)
        return np.asarray(np.nan_to_num(np.maximum(outside, against), nan=0.0))

    def _apex(self, limits: Floats) -> Ints:
        """The apex (q,): where the hydrostatic axis first leaves the surface."""
        sums = self._system.normals.sum(axis=1)
        upright = np.flatnonzero(self._images.upright)
        if not upright.size:
            raise ArithmeticError("no set of yield planes brings a stress back")
        pressure = limits[:, upright] / sums[upright]
        owner = self._images.owner[upright][np.argmin(pressure, axis=1)]
        apices = {
            int(p): self._faces.number(upright[self._images.owner[upright] == p].tolist())
            for p in np.unique(owner)
        }
        return np.array([apices[int(p)] for p in owner], dtype=np.int64)
