"""A yield law whose strength, and whose elasticity, are those of another times factors of a point.

With strengths f k and elasticity g E at a point, stresses divided by f are those of a material of
strengths k: the projection in the norm of (g E)^-1 is that in the norm of E^-1, so

    P(s*) = f P_1(s* / f) ,    lam = f / g lam_1 ,    psi = f psi_1(sigma / f) .

There is no hardening: its modulus would have to vary along.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.fem.yielding.law import ReturnStep, YieldLaw
from geoident.model.arrays import Bools, Floats, Ints


@dataclass(eq=False)
class ScaledLaw(YieldLaw):
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

    def __post_init__(self) -> None:
        self.planes, self.associated = self.law.planes, self.law.associated

    def at(self, points: Ints) -> ScaledLaw:
        """The law at some of its points, (k,) by place."""
        factors = self.strength[points], self.stiffness[points], self.slopes[points]
        return ScaledLaw(self.law.at(points), *factors)

    def with_associated_flow(self) -> ScaledLaw:
        """The law with plastic strains along the normals."""
        return replace(self, law=self.law.with_associated_flow())

    def project(self, trial: Floats, hardened: Floats | None = None) -> ScaledReturn:
        """Return trial stresses (s, m) to the yield surface."""
        return ScaledReturn(self, trial, self.law.project(trial / self.strength))

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self.law.excess(stress / self.strength) * self.strength


class ScaledReturn(ReturnStep):
    """The return of trial stresses to a scaled surface.

    Args:
        law: with the factors of the points.
        trial: (s, m) of all points.
        unit: the return of the stresses divided by the strengths.
    """

    def __init__(self, law: ScaledLaw, trial: Floats, unit: ReturnStep) -> None:
        super().__init__(trial, unit.yielded)
        self._unit = unit
        self._strength, self._stiffness, self._slopes = (
            factor[unit.yielded] for factor in (law.strength, law.stiffness, law.slopes)
        )

    @property
    def end(self) -> Floats:
        """(s, q) admissible stress."""
        return np.asarray(self._unit.stress[:, self.yielded] * self._strength)

    @property
    def end_by_start(self) -> Floats:
        """(q, s, s): that of the divided stresses."""
        return self._unit.reduction

    @property
    def multipliers(self) -> Floats:
        """(q, y)."""
        return self._unit.multipliers * (self._strength / self._stiffness)[:, None]

    @property
    def biactive(self) -> Bools:
        """(q, y)."""
        return self._unit.biactive

    @property
    def reserve(self) -> Floats:
        """(q,) J/m3."""
        return self._unit.reserve * self._strength**2 / self._stiffness

    def end_derivatives(
        self, start: Floats, hardened: Floats | None, *, of_law: bool
    ) -> tuple[Floats, None]:
        """Derivatives (s, q, n + k) of the end; nothing hardens."""
        n = self._slopes.shape[1] if of_law else 0
        relative = self._slopes / self._strength[:, None]
        divided = start / self._strength[:, None]
        divided[..., :n] -= (self.start / self._strength)[..., None] * relative[:, :n]
        end = self._unit.derivatives(divided, of_law=of_law)[0] * self._strength[:, None]
        end[..., :n] += self.end[..., None] * relative[:, :n]
        return end, None
