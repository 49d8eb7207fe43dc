"""A yield law whose strength, and whose elasticity, are those of another times factors of a point.

With strengths f k and elasticity g E at a point, stresses divided by f are those of a material of
strengths k: the projection in the norm of (g E)^-1 is that in the norm of E^-1, so

    P(s*) = f P_1(s* / f) ,    lam = f / g lam_1 ,    psi = f psi_1(sigma / f) .

There is no hardening: its modulus would have to vary along.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoident.fem.yielding.law import Projection, YieldLaw, YieldLimits
from geoident.model.arrays import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class ScaledLaw:
    """A law at points (m) with factors.

    Args:
        law: of strengths k and elasticity E; it does not harden.
        strength: (m,) f.
        stiffness: (m,) g.
        slopes: (m, n) derivatives of f by the n parameters of the law.
    """

    law: YieldLaw
    strength: Floats
    stiffness: Floats
    slopes: Floats

    @property
    def associated(self) -> bool:
        """Whether the tangents are symmetric and there is a potential."""
        return self.law.associated

    @property
    def planes(self) -> YieldLimits:
        """Those of the factor one."""
        return self.law.planes

    @property
    def hardens(self) -> bool:
        """Never."""
        return False

    def at(self, points: Ints) -> ScaledLaw:
        """The law at some of its points, (k,) by place."""
        factors = self.strength[points], self.stiffness[points], self.slopes[points]
        return ScaledLaw(self.law.at(points), *factors)

    def project(self, trial: Floats, hardened: Floats | None = None) -> ScaledProjection:
        """Bring trial stresses (s, m) to the yield surface."""
        found = self.law.project(trial / self.strength, None)
        at = found.yielded
        slopes = self.slopes[at]
        return ScaledProjection(trial, found, self.strength[at], self.stiffness[at], slopes)

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self.law.excess(stress / self.strength, None) * self.strength


@dataclass(frozen=True, eq=False)
class ScaledProjection:
    """What a `ScaledLaw` makes of trial stresses; see `law.Projection`.

    Args:
        trial: (s, m) of all points.
        found: of the stresses divided by the strengths.
        strength: (q,) f at the yielded points.
        stiffness: (q,) g.
        slopes: (q, n) of f.
    """

    trial: Floats
    found: Projection
    strength: Floats
    stiffness: Floats
    slopes: Floats

    @property
    def yielded(self) -> Ints:
        """(q,) the points with an active plane, ascending."""
        return self.found.yielded

    @cached_property
    def stress(self) -> Floats:
        """(s, m) admissible stress; the trial stress itself where nothing yields."""
        stress = self.trial.copy()
        stress[:, self.yielded] = self._one * self.strength
        return stress

    @cached_property
    def _one(self) -> Floats:
        """(s, q) admissible stress divided by the strength."""
        return np.asarray(self.found.stress[:, self.yielded])

    @property
    def multipliers(self) -> Floats:
        """(q, y) dlam >= 0 of this step at those points."""
        return self.found.multipliers * (self.strength / self.stiffness)[:, None]

    @property
    def active(self) -> Bools:
        """(q, y) planes on which the derivatives are taken."""
        return self.found.active

    @property
    def biactive(self) -> Bools:
        """(q, y) planes that are reached with dlam = 0."""
        return self.found.biactive

    @property
    def reduction(self) -> Floats:
        """(q, s, s) T: that of the divided stresses."""
        return self.found.reduction

    @property
    def reserve(self) -> Floats:
        """(q,) J/m3."""
        return self.found.reserve * self.strength**2 / self.stiffness

    def derivatives(
        self, trial: Floats, hardened: Floats | None = None, *, of_law: bool
    ) -> tuple[Floats, Floats]:
        """Derivatives of stress (s, q, n + k) and multipliers (y, q, n + k), see `Projection`.

        Those of the multipliers count only where a material hardens; they are those of the law
        without factors.
        """
        n = self.slopes.shape[1] if of_law else 0
        given = trial / self.strength[:, None]
        if n:
            relative = self.slopes / self.strength[:, None]
            given[..., :n] -= self.trial[:, self.yielded, None] * (
                relative / self.strength[:, None]
            )
        stress, multipliers = self.found.derivatives(given, None, of_law=of_law)
        stress = stress * self.strength[:, None]
        if n:
            stress[..., :n] += self._one[..., None] * self.slopes
        return stress, multipliers
