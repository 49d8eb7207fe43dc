"""Yield surfaces of planes with associated flow: exact projection in the norm of E^-1."""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.active_sets import ActiveSets
from geoident.fem.yielding.law import YieldPlanes
from geoident.fem.yielding.projection import Rays, active_sets_of
from geoident.fem.yielding.return_step import ReturnStep
from geoident.fem.yielding.scaled_planes import ScaledPlanes
from geoident.fem.yielding.warm_start import LastActiveSets
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import Dual

_MOST_FACES = 20_000
"""Of many planes that harden there are as many faces as points, and none comes again."""


class PolyhedralLaw:
    """Yield planes in the space of stresses, associated, perfect or hardening.

    Args:
        elasticity: E (s, s), symmetric, positive definite, Pa.
        planes: normals (y, s); any number, also parallel or repeated ones.

    Raises:
        ValueError: E is not positive definite, a plane has no normal, or a flow is given.
    """

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        if planes.flow is not None:
            raise ValueError("planes in the space of stresses flow along their normals")
        self.planes = planes
        self._system = ScaledPlanes(elasticity, planes)
        self._forget()

    def _forget(self) -> None:
        """Begin with no face known."""
        self._rays = Rays(ActiveSets(self._system.coupling), self._system.root)
        self._memory = LastActiveSets(self._rays.faces)

    @property
    def associated(self) -> bool:
        """Always."""
        return True

    @property
    def hardens(self) -> bool:
        """Whether the multipliers of earlier steps count."""
        return self._system.hardens

    def project(self, trial: Floats, hardened: Floats | None = None) -> ReturnStep:
        """Bring trial stresses (s, m) to the polyhedron; `hardened` (y, m) as in `YieldLaw`.

        Raises:
            EmptyDomain: no stress satisfies all planes.
        """
        # Projections keep the faces they know; only a law between two of them may forget.
        if len(self._rays.faces.members) > _MOST_FACES:
            self._forget()
        yielded, face = self._faces_of(trial, hardened)
        some = None if hardened is None else hardened[:, yielded]
        return ReturnStep(self._system, self._rays.faces, trial, yielded, some, face)

    def _faces_of(self, trial: Floats, hardened: Floats | None) -> tuple[Ints, Ints]:
        """The points (q,) outside the polyhedron and the faces (q,) on which they end."""
        excess = self._system.excess(trial, hardened)
        outside = np.flatnonzero((excess > 0.0).any(axis=0))
        some = None if hardened is None else hardened[:, outside]
        beyond = np.ascontiguousarray(excess[:, outside].T)
        tolerance = np.ascontiguousarray(self._system.tolerance(trial[:, outside], some).T)
        count = trial.shape[1]
        face = self._memory.confirmed(count, outside, beyond, tolerance)
        rest = np.flatnonzero(face == 0)
        face[rest] = active_sets_of(beyond[rest], tolerance[rest], self._rays)
        self._memory.keep(count, outside, face)
        return outside[face > 0], face[face > 0]

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self._system.excess(stress, hardened) * self._system.scale[:, None]
