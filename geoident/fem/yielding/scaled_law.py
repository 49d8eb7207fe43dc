"""A yield law whose surface is that of another, scaled and moved from point to point.

At a point the surface is f times the other one, moved by the hydrostatic tension t, and the
elasticity g times the other one. Stresses less t e, e = (1, 1, 1, 0, ...), and divided by f are
those of the other law: the projection in the norm of (g E)^-1 is that in the norm of E^-1, so

    P(s*) = f P_1((s* - t e) / f) + t e ,  lam = f / g lam_1 ,  psi = f psi_1((sigma - t e) / f) .

There is no hardening: its modulus would have to vary along.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.fem.yielding.law import ReturnStep, YieldLaw
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual


@dataclass(eq=False)
class ScaledLaw(YieldLaw):
    """A law at points (m) with factors.

    Args:
        law: of one surface and elasticity E; it does not harden.
        strength: f (m,), with derivatives by the n parameters of the law.
        shift: t (m,), with derivatives, Pa.
        stiffness: g (m,).
    """

    law: YieldLaw
    strength: Dual
    shift: Dual
    stiffness: Floats

    def __post_init__(self) -> None:
        self.planes, self.associated = self.law.planes, self.law.associated

    def at(self, points: Ints) -> ScaledLaw:
        """The law at some of its points, (k,) by place."""
        factors = self.strength[points], self.shift[points], self.stiffness[points]
        return ScaledLaw(self.law.at(points), *factors)

    def with_associated_flow(self) -> ScaledLaw:
        """The law with plastic strains along the normals."""
        return replace(self, law=self.law.with_associated_flow())

    def project(self, trial: Floats, hardened: Floats | None = None) -> ScaledReturn:
        """Return trial stresses (s, m) to the yield surface."""
        return ScaledReturn(self, trial, self.law.project(self._of_the_other(trial)))

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self.law.excess(self._of_the_other(stress)) * self.strength.value

    def _of_the_other(self, stress: Floats) -> Floats:
        """Stresses (s, m) as the other law has them."""
        moved = stress.copy()
        moved[:3] -= self.shift.value
        return moved / self.strength.value


class ScaledReturn(ReturnStep):
    """The return of trial stresses to a scaled surface.

    Args:
        law: with the factors of the points.
        trial: (s, m) of all points.
        unit: the return of the stresses as the other law has them.
    """

    def __init__(self, law: ScaledLaw, trial: Floats, unit: ReturnStep) -> None:
        super().__init__(trial, unit.yielded)
        self._unit = unit
        self._factor, self._shift = law.strength[unit.yielded], law.shift[unit.yielded]
        self._strength, self._stiffness = self._factor.value, law.stiffness[unit.yielded]

    @property
    def end(self) -> Floats:
        """(s, q) admissible stress."""
        end = self._unit.stress[:, self.yielded] * self._strength
        end[:3] += self._shift.value
        return np.asarray(end)

    @property
    def end_by_start(self) -> Floats:
        """(q, s, s): that of the other law."""
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
        """Derivatives (s, q, n + k) of the end; nothing hardens.

        With x = (s* - t e) / f and the end f u(x) + t e: f du + u df + dt e, and in du
        dx = (ds* - dt e - x df) / f.
        """
        n, strength = self._factor.n if of_law else 0, self._strength[:, None]
        by_factor, by_shift = (part.columns[:, 1 : 1 + n] for part in (self._factor, self._shift))
        other, moved = self._unit, start.copy()
        moved[..., :n] -= other.trial[:, self.yielded, None] * by_factor
        moved[:3, :, :n] -= by_shift
        end = other.derivatives(moved / strength, of_law=of_law)[0] * strength
        end[..., :n] += other.stress[:, self.yielded, None] * by_factor
        end[:3, :, :n] += by_shift
        return end, None
