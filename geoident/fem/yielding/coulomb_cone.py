"""Return to Coulomb's cone of a traction with a cut-off of tension, and derivatives (theory 5.15).

A traction has a part t_n along the normal of a face (tension positive) and parts t_s along it, two
in a solid. With the stiffness k_n and k_s of an interface the limits are

    |t_s| + t_n tan(phi) <= c ,    t_n <= T ,    T <= c / tan(phi) ,

and slip by dl in the direction of t_s opens by tan(psi) dl, the cut-off by dm. Both keep the
direction of t_s, so that the return is one of t_n and tau = |t_s|:

    tau = tau* - k_s dl ,    t_n = t_n* - k_n (tan(psi) dl + dm) .

It ends on the mantle, where dm = 0; on the cut-off, where dl = 0; or on the edge between the two,
t_n = T and tau = c - T tan(phi), which is the tip of a cone that nothing cuts off. With
tan(psi) >= 0 exactly one of these has an admissible end and no negative multiplier. In the plane,
where t_s is one number, this is the return to two planes and the cut-off.

*Derivatives* follow from the same formulas, the constants being dual numbers: t_s = t_s* tau / tau*
also turns as t_s* does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoident.fem.yielding.law import ReturnStep, YieldLaw, seen_from
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import Dual, stacked

_ON_CONE = 1e-13
"""Of the tractions and strengths: rounding, within which a traction is on the cone."""

_REACHED = 1e2 * _ON_CONE
"""The same of an end: a return adds up some ten roundings."""


@dataclass(frozen=True, eq=False)
class ConeLimits:
    """Numbers of the limits with their derivatives by n parameters; one value each.

    Args:
        cohesion: c, Pa.
        steep: tan(phi).
        opens: tan(psi), at most tan(phi).
        tension: T, Pa, at most c / tan(phi).
    """

    cohesion: Dual
    steep: Dual
    opens: Dual
    tension: Dual

    names = ("slip", "opening")

    @property
    def distances(self) -> Dual:
        """(2,) c and T, Pa."""
        return stacked([self.cohesion, self.tension])

    def __len__(self) -> int:
        return len(self.names)


class CoulombCone(YieldLaw):
    """The limits beside springs, perfectly plastic; tractions (s, m) are t_n, t_s, then zeros.

    Args:
        k_n: traction per opening, Pa/m.
        k_s: traction per slip, Pa/m.
        limits: c, phi, psi and T.
        n_slips: components of t_s: 1 in the plane, 2 in a solid.
    """

    planes: ConeLimits

    def __init__(self, k_n: Dual, k_s: Dual, limits: ConeLimits, n_slips: int) -> None:
        self.k_n, self.k_s, self.planes, self.n_slips = k_n, k_s, limits, n_slips
        self.associated = bool(limits.opens.value == limits.steep.value)

    def with_associated_flow(self) -> CoulombCone:
        """The law with plastic strains along the normals."""
        limits = replace(self.planes, opens=self.planes.steep)
        return CoulombCone(self.k_n, self.k_s, limits, self.n_slips)

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """Return |t_s| + t_n tan(phi) - c and t_n - T (2, m) of tractions (s, m), Pa."""
        shears = np.linalg.norm(stress[1:], axis=0) + float(self.planes.steep.value) * stress[0]
        return np.stack([shears, stress[0]]) - self.planes.distances.value[:, None]

    def project(self, trial: Floats, hardened: Floats | None = None) -> ConeReturn:
        """Return trial tractions (s, m) to the limits; nothing hardens."""
        return ConeReturn(self, trial)

    def scale(self, stress: Floats) -> Floats:
        """The size (2, m) of the terms of `excess` at tractions (s, m), Pa."""
        size = np.abs(stress).max(axis=0, initial=0.0) * (1.0 + float(self.planes.steep.value))
        return np.asarray(size + self.planes.distances.value[:, None])


class ConeReturn(ReturnStep):
    """The return of trial tractions to the limits.

    Args:
        law: of the interface.
        trial: (s, m) of all points.
    """

    def __init__(self, law: CoulombCone, trial: Floats) -> None:
        self._law, limits = law, law.planes
        c, T = limits.distances.value
        shear, near = np.linalg.norm(trial[1:], axis=0), _ON_CONE * law.scale(trial)
        on_edge = c - float(limits.steep.value) * T
        if on_edge <= _ON_CONE * c:
            on_edge = 0.0  # the tip, which bears no shear
        beyond = shear - on_edge
        lifted = float((law.k_n * limits.opens / law.k_s).value) * np.maximum(beyond, 0.0)
        opens = trial[0] - lifted - T > near[1]
        slips = np.where(opens, beyond, law.excess(trial)[0]) > near[0]
        super().__init__(trial, np.flatnonzero(opens | slips))
        self._opens, self._slips = opens[self.yielded], slips[self.yielded]
        self._at_tip = self._opens & (on_edge == 0.0)

    @cached_property
    def end(self) -> Floats:
        """(s, q) tractions within the limits."""
        return self._ends(self.start[..., None], of_law=False)[..., 0]

    def _ends(self, start: Floats, *, of_law: bool) -> Floats:
        """Where tractions with derivatives (s, q, 1 + k) end, with theirs."""
        law, limits, size = self._law, self._law.planes, start.shape[2]

        constants = (limits.cohesion, limits.tension, limits.steep, limits.opens, law.k_n, law.k_s)
        c, T, steep, dilates, k_n, k_s = (
            seen_from(constant, size, of_law=of_law) for constant in constants
        )
        normal, along, rest = Dual(start[0]), start[1 : 1 + law.n_slips], start[1 + law.n_slips :]
        sizes = np.linalg.norm(self.start[1:], axis=0)
        still = sizes == 0.0
        way = along[..., 0] / (sizes + still)
        shear = Dual(np.einsum("sq,sqk->qk", way, along)).plus(still)
        slip = (shear + steep * normal - c) / (k_s + k_n * steep * dilates)
        opens, slips, at_tip = (
            where[:, None] for where in (self._opens, self._slips, self._at_tip)
        )
        slid = (normal - k_n * dilates * slip).columns
        ends = np.where(opens, T.columns, slid)
        left = ((c - steep * Dual(ends)) / shear).columns
        left = np.where(at_tip, 0.0, np.where(slips, left, np.eye(1, size)))
        return np.concatenate([ends[None], (Dual(along) * Dual(left)).columns, rest])

    def end_derivatives(
        self, start: Floats, hardened: Floats | None, *, of_law: bool
    ) -> tuple[Floats, None]:
        """Derivatives (s, q, n + k) of the end; nothing hardens."""
        both = np.concatenate([self.start[..., None], start], axis=2)
        return self._ends(both, of_law=of_law)[..., 1:], None

    @cached_property
    def end_by_start(self) -> Floats:
        """(q, s, s)."""
        s, q = self.start.shape
        every = np.broadcast_to(np.eye(s)[:, None], (s, q, s))
        slopes, _ = self.end_derivatives(every, None, of_law=False)
        return np.ascontiguousarray(slopes.swapaxes(0, 1))

    @cached_property
    def _relieved(self) -> Floats:
        """(2, q) what slip takes off the shear, and the cut-off off the normal traction, Pa."""
        law, limits = self._law, self._law.planes
        ratio = float((law.k_n * limits.opens / law.k_s).value)
        shear = np.linalg.norm(self.start[1:] - self.end[1:], axis=0)
        normal = self.start[0] - self.end[0] - ratio * shear
        return np.stack([shear, np.where(self._opens, normal, 0.0)])

    @property
    def multipliers(self) -> Floats:
        """(q, 2) dl and dm, m."""
        stiff = np.array([[self._law.k_s.value], [self._law.k_n.value]])
        return np.asarray(np.maximum(self._relieved / stiff, 0.0).T)

    @property
    def biactive(self) -> Bools:
        """(q, 2)."""
        near = _REACHED * self._law.scale(self.start)
        return np.asarray(((self._law.excess(self.end) >= -near) & (self._relieved <= near)).T)

    @property
    def reserve(self) -> Floats:
        """(q,) 1/2 (t* - t)^T E^-1 (t* - t), J/m2."""
        squares = (self.start - self.end) ** 2
        parts = squares[0] / self._law.k_n.value + squares[1:].sum(axis=0) / self._law.k_s.value
        return np.asarray(0.5 * parts)
