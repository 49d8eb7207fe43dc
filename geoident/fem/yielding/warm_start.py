"""Where points ended the last time: most of them end there again.

Newton's method and its line search project almost the same stresses many times over. A point is
tried on the face of its last projection first; where multipliers and yield functions confirm it
(the Kuhn-Tucker conditions, which are sufficient), no search is needed.
"""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.projection import ActiveSets
from geoident.model.arrays import Bools, Floats, Ints


class LastActiveSets:
    """The faces on which the points of a law ended in its last projection.

    Args:
        faces: their numbers.
    """

    def __init__(self, faces: ActiveSets) -> None:
        self._faces = faces
        self._last = np.empty(0, dtype=np.int64)

    def keep(self, count: int, points: Ints, face: Ints) -> None:
        """Remember where points ended.

        Args:
            count: of all points.
            points: (q,) those that were projected.
            face: (q,) their faces.
        """
        self._last = np.zeros(count, dtype=np.int64)
        self._last[points] = face

    def confirmed(self, count: int, points: Ints, excess: Floats, tolerance: Floats) -> Ints:
        """ActiveSets (q,) of points that end where they did; 0 for those that have to be searched.

        Args:
            count: number of points of the law.
            points: (q,) those outside the polyhedron.
            excess: (q, y) scaled yield functions of their trial stresses.
            tolerance: (q, y) what counts as zero in them.
        """
        found = np.zeros(len(points), dtype=np.int64)
        if len(self._last) != count:
            return found
        guess = self._last[points]
        tried = np.flatnonzero(guess > 0)
        if len(tried):
            holds = self._holds(guess[tried], excess[tried], tolerance[tried])
            found[tried[holds]] = guess[tried[holds]]
        return found

    def _holds(self, face: Ints, excess: Floats, tolerance: Floats) -> Bools:
        """Whether multipliers are not negative and no plane is violated on faces (q,)."""
        used, place = np.unique(face, return_inverse=True)
        planes, inverses = self._faces.compact(used.tolist())
        mine = planes[place]
        active = np.take_along_axis(excess, mine, axis=1)
        multipliers = np.einsum("qij,qj->qi", inverses[place], active)
        full = np.zeros_like(excess)
        np.put_along_axis(full, mine, multipliers, axis=1)
        after = excess - full @ self._faces.coupling
        return np.asarray((multipliers >= 0.0).all(axis=1) & (after <= tolerance).all(axis=1))
