"""Return to planes with a flow of its own: the complementarity problem by its few active sets.

Without symmetry there is no projection and no descent of a dual objective, but in principal
stresses there are few planes, so the sets that can be active together are tried in turn, all points
at once: first single planes, then edges, then vertices. The first whose multipliers are
nonnegative and whose stress violates no plane is it. Where the flow has too little dilation, no set
brings a tension back; such points go to the apex on the hydrostatic axis, with the plastic volume
that takes: there the flow is free (de Souza Neto, Peric & Owen 2008, 8.2).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from geoident.fem.yielding.domain import NoReturn
from geoident.fem.yielding.planes import ActiveSets, ScaledPlanes
from geoident.fem.yielding.sorted_planes import Images
from geoident.model.arrays import Floats, Ints

_SINGULAR = 1e-9
"""Smallest singular value of A_WW, scaled, of a set that is tried."""
_BETWEEN = 1e5
"""Times the tolerance: what a point may lack that falls between two sets by rounding."""


class ActiveSetSearch:
    """Finds active sets with any flow.

    Args:
        system: the images of the planes.
        faces: of its coupling.
        images: which of them make the apex.
    """

    def __init__(self, system: ScaledPlanes, faces: ActiveSets, images: Images) -> None:
        self._system = system
        self._faces = faces
        self._images = images
        self._plain = np.flatnonzero(~images.upright)
        # Hardening adds a dimension for each stated plane: so many more may be active at a point.
        self._most = min(3 + images.count * system.hardens, self._plain.size)
        self._known: list[int] = []
        self._rest = self._independent_sets()

    def _independent_sets(self) -> Iterator[int]:
        """Faces whose planes can be active together, small ones first."""
        for size in range(1, self._most + 1):
            for some in combinations(self._plain.tolist(), size):
                matrix = self._system.coupling[np.ix_(some, some)]
                if np.linalg.svd(matrix, compute_uv=False)[-1] > _SINGULAR:
                    yield self._faces.number(some)

    def _candidates(self) -> Iterator[int]:
        """The same, found once and kept: most calls need only the first few."""
        yield from self._known
        for face in self._rest:
            self._known.append(face)
            yield face

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
        for face in self._candidates():
            if not left.size:
                return found
            lacking = self._lacking(face, excess[left], tolerance[left])
            better = lacking < best[left]
            best[left[better]], found[left[better]] = lacking[better], face
            left = left[lacking > 1.0]
        far = left[best[left] > _BETWEEN]
        if far.size:
            found[far] = self._apex(excess[far], limits[far])
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

    def _apex(self, excess: Floats, limits: Floats) -> Ints:
        """The apex (q,): where the hydrostatic axis first leaves the surface.

        Raises:
            NoReturn: no set brings a stress back that does not lie beyond the apex.
        """
        upright = np.flatnonzero(self._images.upright)
        faces = np.zeros(len(excess), dtype=np.int64)
        if upright.size:
            pressure = limits[:, upright] / self._system.normals[upright].sum(axis=1)
            faces = self._owned(self._images.owner[upright][np.argmin(pressure, axis=1)])
        for face in np.unique(faces).tolist():
            planes = list(self._faces.members[face])
            coupling = self._system.coupling[np.ix_(planes, planes)]
            volume = np.linalg.solve(coupling, excess[faces == face][:, planes].T).sum(axis=0)
            if not planes or volume.min() < 0.0:
                raise NoReturn("no set of yield planes with their flow brings a stress back")
        return faces

    def _owned(self, owner: Ints) -> Ints:
        """Faces (q,) of the apices of planes (q,)."""
        mine = self._images.upright & (self._images.owner == owner[:, None])
        return np.array([self._faces.number(np.flatnonzero(row).tolist()) for row in mine])
