"""Laws of yield planes: polyhedra in the space of stresses, isotropic ones in principal stresses.

Both return a trial stress by the planes that are active where it ends, which `active_sets` finds.
The second is for smooth surfaces such as Mohr-Coulomb's, with its edges and its apex: in principal
stresses they are planes.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from geoident.fem.yielding.active_sets import ActiveSets, CombinationSearch, DualSearch
from geoident.fem.yielding.domain import EmptyDomain, empty_principal_domain
from geoident.fem.yielding.law import ReturnStep
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


class PolyhedralLaw:
    """Yield planes in the space of stresses, associated, perfect or hardening.

    Args:
        elasticity: E (s, s), symmetric, positive definite, Pa.
        planes: normals (y, s); any number, also parallel or repeated ones.

    Raises:
        ValueError: E is not positive definite, a plane has no normal, or a flow is given.

    Two planes of a stress of two components, sigma_1 <= 1 and sigma_2 <= 1, and their corner:

    >>> planes = YieldPlanes(Dual.constant(np.eye(2), 0), Dual.constant(np.ones(2), 0))
    >>> law = PolyhedralLaw(Dual.constant(np.eye(2), 0), planes)
    >>> step = law.project(np.array([[0.5, 2.0, 3.0], [0.5, 0.5, 4.0]]))
    >>> step.stress.tolist()
    [[0.5, 1.0, 1.0], [0.5, 0.5, 1.0]]
    >>> step.multipliers.tolist()
    [[1.0, 0.0], [2.0, 3.0]]
    """

    associated = True

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        if planes.flow is not None:
            raise ValueError("planes in the space of stresses flow along their normals")
        self.planes = planes
        self._system = ScaledPlanes(elasticity, planes)
        self._search = DualSearch(self._system)
        self._last = np.empty(0, dtype=np.int64)

    @property
    def hardens(self) -> bool:
        """Whether the multipliers of earlier steps count."""
        return self._system.hardens

    def at(self, points: Ints) -> PolyhedralLaw:
        """The same at points (k,): its numbers are those of all."""
        return self

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self.planes.excess(stress, hardened)

    def project(self, trial: Floats, hardened: Floats | None = None) -> PlaneReturn:
        """Return trial stresses (s, m) to the polyhedron; `hardened` (y, m) as in `YieldLaw`.

        Newton's method and its line search project almost the same stresses many times over, so
        points are tried on the face of their last projection before a search.

        Raises:
            EmptyDomain: no stress satisfies all planes.
        """
        if len(self._search.sets.members) > _MOST_FACES:  # steps before this one keep their sets
            self._search = DualSearch(self._system)
            self._last = np.empty(0, dtype=np.int64)
        excess = self._system.excess(trial, hardened)
        outside = np.flatnonzero((excess > 0.0).any(axis=0))
        some = None if hardened is None else hardened[:, outside]
        beyond = np.ascontiguousarray(excess[:, outside].T)
        tolerance = np.ascontiguousarray(self._system.tolerance(trial[:, outside], some).T)

        faces = np.zeros(len(outside), dtype=np.int64)
        if len(self._last) == trial.shape[1]:
            before = self._last[outside]
            tried = np.flatnonzero(before)
            if tried.size:
                holds = self._search.sets.holds(before[tried], beyond[tried], tolerance[tried])
                faces[tried[holds]] = before[tried[holds]]
        rest = np.flatnonzero(faces == 0)
        faces[rest] = self._search.find(beyond[rest], tolerance[rest])
        self._last = np.zeros(trial.shape[1], dtype=np.int64)
        self._last[outside] = faces

        yields = np.flatnonzero(faces)
        some = None if some is None else some[:, yields]
        sets = self._search.sets
        return PlaneReturn(self._system, sets, trial, outside[yields], None, some, faces[yields])


class PrincipalLaw:
    """Yield planes in sorted principal stresses, isotropic, associated or not.

    Args:
        elasticity: E (s, s), isotropic, of xx, yy, zz, xy (4) or xx, yy, zz, xy, yz, xz (6), Pa.
        planes: normals (y, 3) for sigma_1 >= sigma_2 >= sigma_3, components descending.

    Raises:
        ValueError: E is not isotropic or not positive definite, normals do not descend, a plane
            flows inwards, or no stress satisfies all planes.
    """

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        check_isotropic(elasticity.value)
        self.planes = planes
        self._system = ScaledPlanes.of_sorted(elasticity[:3, :3], planes)
        self.associated = planes.associated
        self._search = (DualSearch if self.associated else CombinationSearch)(self._system)
        if not self.hardens and (bad := empty_principal_domain(planes)) is not None:
            raise EmptyDomain(bad)

    @property
    def hardens(self) -> bool:
        """Whether the multipliers of earlier steps count."""
        return self._system.hardens

    def at(self, points: Ints) -> PrincipalLaw:
        """The same at points (k,): its numbers are those of all."""
        return self

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self.planes.excess(principal_values(stress), hardened)

    def project(self, trial: Floats, hardened: Floats | None = None) -> PlaneReturn:
        """Return trial stresses (s, m) to the surface; `hardened` (y, m) as in `YieldLaw`."""
        rough = rough_principal_values(trial)
        margin = ROUGH * np.abs(rough).max(axis=0, initial=0.0)
        lengths = np.abs(self.planes.normals.value).sum(axis=1)[:, None]
        excess = self.planes.excess(rough, hardened)
        near = np.flatnonzero((excess > -lengths * margin).any(axis=0))

        axes, system = spectrum(trial[:, near]), self._system
        on_images = system.on_images(None if hardened is None else hardened[:, near])
        shape = (len(system.scale), near.size)
        rows = (
            system.excess(axes.values, on_images),
            system.tolerance(axes.values, on_images),
            np.broadcast_to(system.limits(on_images), shape),
        )
        try:
            faces = self._search.find(*(np.ascontiguousarray(row.T) for row in rows))
        except EmptyDomain as error:
            stated = np.unique(system.owner[list(error.planes)])
            raise EmptyDomain(tuple(int(p) for p in stated)) from None

        yields = np.flatnonzero(faces)
        axes = axes.of(yields)
        some = None if on_images is None else on_images[:, yields]
        return PlaneReturn(
            system, self._search.sets, trial, near[yields], axes, some, faces[yields]
        )


class PlaneReturn(ReturnStep):
    """The return of trial stresses to the faces of planes on which they end.

    Args:
        system: the planes, with their images.
        sets: the faces.
        trial: s* (s, m) of all points.
        yielded: (q,) those with an active plane, ascending.
        spectral: principal values and axes of their trial stress, for planes in these.
        hardened: (i, q) multipliers of earlier steps; None for zero.
        faces: (q,) their numbers.
    """

    def __init__(
        self,
        system: ScaledPlanes,
        sets: ActiveSets,
        trial: Floats,
        yielded: Ints,
        spectral: Spectrum | None,
        hardened: Floats | None,
        faces: Ints,
    ) -> None:
        super().__init__(trial, yielded, spectral)
        self._system, self._hardened = system, hardened
        used, self._place = np.unique(faces, return_inverse=True)
        self._face_planes, self._face_inverse = sets.compact(used.tolist())
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

    def _stated(self, values: Floats) -> Floats:
        """Sums (q, y) over the images of each stated plane of values (q, i)."""
        return self._system.summed(values.T).T

    @cached_property
    def multipliers(self) -> Floats:
        """(q, y) dlam >= 0, of the stated planes."""
        return np.maximum(self._stated(self._scaled / self._system.scale), 0.0)

    @cached_property
    def end(self) -> Floats:
        """(d, q) admissible stress."""
        return np.asarray(self.start - self._system.moved @ self._scaled.T)

    @cached_property
    def biactive(self) -> Bools:
        """(q, y) planes that are reached with dlam = 0, on all images."""
        system = self._system
        near = _REACHED * system.tolerance(self.start, self._hardened).T
        limits = system.limits(self._hardened) + system.hardening @ self._scaled.T
        reached = (system.normals @ self.end - limits).T + near >= 0.0
        working = np.abs(self._scaled) > near
        on, flows = (self._stated(which.astype(np.float64)) for which in (reached, working))
        return np.asarray((on > 0.0) & (flows == 0.0))

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
        system = self._system
        end = start.copy()
        limits = np.zeros((len(system.scale), *start.shape[1:]))
        for column in range(system.by_parameter[0].n if of_law else 0):
            self._add_direct(column, end[:, :, column], limits[:, :, column])
        if hardened is not None and system.hardens:
            on_images = system.on_images(hardened)
            assert on_images is not None
            limits += np.tensordot(system.hardening * system.scale, on_images, axes=1)
        excess = np.tensordot(system.normals, end, axes=1) - limits
        points = np.arange(start.shape[1])[:, None]
        multipliers = np.zeros_like(excess)
        multipliers[self._planes, points] = np.einsum(
            "qij,qjn->qin", self._inverse, excess[self._planes, points]
        )
        end -= np.tensordot(system.moved, multipliers, axes=1)
        return end, system.summed(multipliers / system.scale[:, None, None])

    def _add_direct(self, column: int, stress: Floats, limits: Floats) -> None:
        """Add what a parameter changes at fixed multipliers: stress (d, q) and limits (i, q)."""
        system, lam = self._system, self._scaled
        elasticity, planes = system.by_parameter
        stiffer = elasticity.slope(column)
        normals, distances = planes.normals.slope(column), planes.distances.slope(column)
        flow = normals if planes.flow is None else planes.flow.slope(column)
        hardening = None if planes.hardening is None else planes.hardening.slope(column)
        if stiffer is not None:
            stress -= stiffer @ (lam @ system.flow).T
        if flow is not None:
            stress -= system.elasticity @ (lam @ flow).T
        if distances is not None:
            limits += distances[:, None]
        if normals is not None:
            limits -= normals @ self.end
        if hardening is not None:
            earlier = 0.0 if self._hardened is None else system.scale[:, None] * self._hardened
            limits += hardening @ (lam.T + earlier)
