"""Laws of yield planes: polyhedra in the space of stresses, isotropic ones in principal stresses.

Both return a trial stress by the planes that are active where it ends, which `active_sets` finds.
The second is for exact surfaces such as Mohr-Coulomb's, with its edges and its apex: in principal
stresses they are planes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from geoident.fem.yielding.active_sets import CombinationSearch, DualSearch
from geoident.fem.yielding.domain import EmptyDomain, empty_principal_domain
from geoident.fem.yielding.law import ReturnStep, YieldLaw
from geoident.fem.yielding.planes import ScaledPlanes, YieldPlanes
from geoident.fem.yielding.principal_axes import (
    ROUGH,
    Spectrum,
    check_isotropic,
    principal_values,
    rough_principal_values,
    spectrum,
)
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

_REACHED = 100.0
"""Times the tolerance: within it a plane is reached; a return adds up some ten roundings."""

_MOST_FACES = 20_000
"""Of many planes that harden there are as many faces as points, and none comes again."""


class PolyhedralLaw(YieldLaw):
    """Yield planes in the space of stresses, perfect or hardening; those with a flow are perfect.

    Args:
        elasticity: E (s, s), symmetric, positive definite, Pa.
        planes: normals (y, s); any number, also parallel or repeated ones.

    Raises:
        ValueError: E is not positive definite, a plane has no normal or flows inwards, or planes
            with a flow harden.

    Two planes of a stress of two components, sigma_1 <= 1 and sigma_2 <= 1, and their corner:

    >>> planes = YieldPlanes(Dual.constant(np.eye(2), 0), Dual.constant(np.ones(2), 0))
    >>> law = PolyhedralLaw(Dual.constant(np.eye(2), 0), planes)
    >>> step = law.project(np.array([[0.5, 2.0, 3.0], [0.5, 0.5, 4.0]]))
    >>> step.stress.tolist()
    [[0.5, 1.0, 1.0], [0.5, 0.5, 1.0]]
    >>> step.multipliers.tolist()
    [[1.0, 0.0], [2.0, 3.0]]
    """

    planes: YieldPlanes

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        self.planes, self.associated = planes, planes.associated
        self._elasticity = elasticity
        if not self.associated and planes.hardening is not None:
            raise ValueError("planes with a flow of their own do not harden")
        system = ScaledPlanes(elasticity, planes)
        self._search = self._new_search(system)
        self.hardens = self._search.system.hardens

    def _new_search(self, system: ScaledPlanes) -> DualSearch | CombinationSearch:
        return DualSearch(system) if self.associated else CombinationSearch(system)

    def with_associated_flow(self) -> PolyhedralLaw:
        """The law with plastic strains along the normals."""
        return PolyhedralLaw(self._elasticity, replace(self.planes, flow=None))

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self.planes.excess(stress, hardened)

    def project(self, trial: Floats, hardened: Floats | None = None) -> PlaneReturn:
        """Return trial stresses (s, m) to the polyhedron; `hardened` (y, m) as in `YieldLaw`.

        Raises:
            EmptyDomain: no stress satisfies all planes.
        """
        system = self._search.system
        if len(self._search.sets.members) > _MOST_FACES:  # steps before this one keep their sets
            self._search = self._new_search(system)
        excess = system.excess(trial, hardened)
        outside = np.flatnonzero((excess > 0.0).any(axis=0))
        before = None if hardened is None else hardened[:, outside]
        tolerance = system.tolerance(trial[:, outside], before)
        faces = self._search.find(excess[:, outside].T, tolerance.T)
        yields = np.flatnonzero(faces)
        before = None if before is None else before[:, yields]
        return PlaneReturn(self._search, trial, outside[yields], faces[yields], hardened=before)


class PrincipalLaw(YieldLaw):
    """Yield planes in sorted principal stresses, isotropic, associated or not.

    Args:
        elasticity: E (s, s), isotropic, of xx, yy, zz, xy (4) or xx, yy, zz, xy, yz, xz (6), Pa.
        planes: normals (y, 3) for sigma_1 >= sigma_2 >= sigma_3, components descending.

    Raises:
        ValueError: E is not isotropic or not positive definite, normals do not descend, a plane
            flows inwards, or no stress satisfies all planes.
    """

    planes: YieldPlanes

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        check_isotropic(elasticity.value)
        if planes.hardening is not None:
            raise ValueError("planes in principal stresses do not harden")
        self.planes, self.associated = planes, planes.associated
        self._elasticity = elasticity
        system = ScaledPlanes.of_sorted(elasticity[:3, :3], planes)
        self._search = (DualSearch if self.associated else CombinationSearch)(system)
        if (contradicting := empty_principal_domain(planes)) is not None:
            raise EmptyDomain(contradicting)

    def with_associated_flow(self) -> PrincipalLaw:
        """The law with plastic strains along the normals."""
        return PrincipalLaw(self._elasticity, replace(self.planes, flow=None))

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self.planes.excess(principal_values(stress))

    def project(self, trial: Floats, hardened: Floats | None = None) -> PlaneReturn:
        """Return trial stresses (s, m) to the surface; nothing hardens."""
        rough = rough_principal_values(trial)
        margin = ROUGH * np.abs(rough).max(axis=0, initial=0.0)
        lengths = np.abs(self.planes.normals.value).sum(axis=1)[:, None]
        near = np.flatnonzero((self.planes.excess(rough) > -lengths * margin).any(axis=0))
        axes, system = spectrum(trial[:, near]), self._search.system
        faces = self._search.find(system.excess(axes.values).T, system.tolerance(axes.values).T)
        yields = np.flatnonzero(faces)
        return PlaneReturn(self._search, trial, near[yields], faces[yields], axes.of(yields))


class PlaneReturn(ReturnStep):
    """The return of trial stresses to the faces of planes on which they end.

    Args:
        search: the planes, with their images, and their faces.
        trial: s* (s, m) of all points.
        yielded: (q,) those with an active plane, ascending.
        faces: (q,) the numbers of their faces.
        spectral: principal values and axes of their trial stress, for planes in these.
        hardened: (y, q) multipliers of earlier steps; None for zero.
    """

    def __init__(
        self,
        search: DualSearch | CombinationSearch,
        trial: Floats,
        yielded: Ints,
        faces: Ints,
        spectral: Spectrum | None = None,
        hardened: Floats | None = None,
    ) -> None:
        super().__init__(trial, yielded, spectral)
        self._system = system = search.system
        self._hardened = hardened
        used, self._place = np.unique(faces, return_inverse=True)
        self._face_planes, self._face_inverse = search.sets.inverses(used.tolist())
        self._planes = self._face_planes[self._place]
        self._inverse = self._face_inverse[self._place]
        excess = system.excess(self.start, hardened).T
        self._scaled = np.zeros_like(excess)
        """Scaled multipliers (q, i), refined once: what the inverse lacks in digits."""
        for _ in range(2):
            remaining = excess - self._scaled @ system.coupling.T
            active = np.take_along_axis(remaining, self._planes, axis=1)
            full = np.zeros_like(excess)
            correction = np.einsum("qij,qj->qi", self._inverse, active)
            np.put_along_axis(full, self._planes, correction, axis=1)
            self._scaled += full

    @cached_property
    def multipliers(self) -> Floats:
        """(q, y) dlam >= 0, of the stated planes."""
        return np.maximum(self._system.summed((self._scaled / self._system.scale).T).T, 0.0)

    @cached_property
    def end(self) -> Floats:
        """(d, q) admissible stress."""
        return np.asarray(self.start - self._system.moved @ self._scaled.T)

    @cached_property
    def biactive(self) -> Bools:
        """(q, y) planes that are reached with dlam = 0, on all images."""
        system = self._system
        near = _REACHED * system.tolerance(self.start, self._hardened)
        limits = system.limits(self._hardened) + system.hardening @ self._scaled.T
        reached = system.normals @ self.end - limits + near >= 0.0
        working = np.abs(self._scaled.T) > near
        on, flows = (system.summed(which.astype(np.float64)) for which in (reached, working))
        return np.asarray((on > 0.0) & (flows == 0.0)).T

    @cached_property
    def end_by_start(self) -> Floats:
        """(q, d, d)."""
        planes = self._face_planes
        moved, normals = self._system.moved.T[planes], self._system.normals[planes]
        change = np.einsum("fis,fij,fjt->fst", moved, self._face_inverse, normals, optimize=True)
        return np.asarray((np.eye(len(self.start)) - change)[self._place])

    @property
    def reserve(self) -> Floats:
        """(q,): 1/2 lam^T (M E M^T + H) lam."""
        work = self._system.flow @ self._system.moved + self._system.hardening
        return np.asarray(0.5 * np.einsum("qi,ij,qj->q", self._scaled, work, self._scaled))

    def end_derivatives(
        self, start: Floats, hardened: Floats | None, *, of_law: bool
    ) -> tuple[Floats, Floats]:
        """Derivatives (d, q, n + k) of the end and (y, q, n + k) of multipliers.

        With the yield functions at fixed multipliers, dpsi = d(N s* - k - H Lam), the multipliers
        change by A_WW^-1 dpsi_W on the active planes W.
        """
        system, lam = self._system, self._scaled
        end = start.copy()
        limits = np.zeros((len(system.scale), *start.shape[1:]))
        if of_law:  # what the parameters change at fixed multipliers
            parts = system.by_parameter
            moving = [
                k
                for k in range(parts[0].n)
                if any(part.columns[..., 1 + k].any() for part in parts)
            ]
            stiffness, normals, flow, distances, hardening = (
                part.columns[..., 1:][..., moving] for part in parts
            )
            plastic, total = lam @ system.flow, lam.T
            if self._hardened is not None:
                total = total + system.scale[:, None] * self._hardened
            end[..., moving] -= np.einsum("stn,qt->sqn", stiffness, plastic, optimize=True)
            turned = np.einsum("qi,itn->tqn", lam, flow, optimize=True)
            end[..., moving] -= np.tensordot(system.elasticity, turned, axes=1)
            limits[..., moving] += distances[:, None]
            limits[..., moving] += np.einsum("ijn,jq->iqn", hardening, total, optimize=True)
            limits[..., moving] -= np.einsum("isn,sq->iqn", normals, self.end, optimize=True)
        if hardened is not None and system.hardens:
            limits += np.tensordot(system.hardening * system.scale, hardened, axes=1)
        excess = np.tensordot(system.normals, end, axes=1) - limits
        points = np.arange(start.shape[1])[:, None]
        multipliers = np.zeros_like(excess)
        multipliers[self._planes, points] = np.einsum(
            "qij,qjn->qin", self._inverse, excess[self._planes, points]
        )
        end -= np.tensordot(system.moved, multipliers, axes=1)
        return end, system.summed(multipliers / system.scale[:, None, None])
