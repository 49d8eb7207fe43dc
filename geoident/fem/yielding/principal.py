"""Isotropic yield surfaces in principal stresses: smooth Mohr-Coulomb with edges and apex.

A trial stress and the stress it ends at have the same principal axes, because elasticity and
surface are isotropic; between their principal values stands the complementarity problem of planes.
The consistent tangent has the derivative of that and, for the spin of the axes, the ratios
(sigma_i - sigma_j) / (s_i - s_j): Simo (1998), Numerical analysis and simulation of plasticity,
Handbook of Numerical Analysis VI; de Souza Neto, Peric & Owen (2008), Computational Methods for
Plasticity, appendix A.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Protocol

import numpy as np

from geoident.fem.yielding.domain import EmptyDomain, empty_principal_domain
from geoident.fem.yielding.nonassociated_return import ActiveSetSearch
from geoident.fem.yielding.planes import ActiveSets, ReturnStep, ScaledPlanes, YieldPlanes
from geoident.fem.yielding.polyhedral import Rays, active_sets_of
from geoident.fem.yielding.principal_axes import (
    PAIRS,
    Spectrum,
    principal_values,
    rough_principal_values,
    spectrum,
)
from geoident.fem.yielding.sorted_planes import Images, images_of
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

_Finder = Callable[[Floats, Floats, Floats], Ints]
_ROUGH = 1e-6
"""Of the largest stress: an error that rough principal values never have."""
_REPEATED = 1e-8
"""Of the largest principal value: differences below are those of a repeated one."""


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
        self._normals = np.ascontiguousarray(planes.normals.value)
        self._images = images_of(planes)
        self._system = ScaledPlanes(elasticity[:3, :3], self._images.planes(planes))
        self._faces = ActiveSets(self._system.coupling)
        self._ends = self._finder()
        if not self.hardens and (bad := empty_principal_domain(planes)) is not None:
            raise EmptyDomain(bad)

    def _finder(self) -> _Finder:
        """What finds active sets: projection where there is one."""
        if self.associated:
            rays = Rays(self._faces, self._system.root)
            return lambda excess, tolerance, _limits: active_sets_of(excess, tolerance, rays)
        return ActiveSetSearch(self._system, self._faces, self._images).find

    @property
    def associated(self) -> bool:
        """Whether plastic strains follow the normals."""
        flow, normals = self.planes.flow, self.planes.normals
        return flow is None or np.array_equal(flow.value, normals.value)

    @property
    def hardens(self) -> bool:
        """Whether the multipliers of earlier steps count."""
        return self._system.hardens

    def at(self, points: Ints) -> PrincipalLaw:
        """The same at points (k,): its numbers are those of all."""
        return self

    def project(self, trial: Floats, hardened: Floats | None = None) -> PrincipalProjection:
        """Return trial stresses (s, m) to the surface; `hardened` (y, m) as in `YieldLaw`."""
        some = self._outside(trial, hardened)
        spectral = spectrum(trial[:, some])
        spread = self._images.spread(None if hardened is None else hardened[:, some])
        face = self._faces_of(spectral.values, spread)
        ends = np.flatnonzero(face)
        spectral = spectral.of(ends)
        step = ReturnStep(
            self._system,
            self._faces,
            spectral.values,
            np.arange(ends.size),
            None if spread is None else spread[:, ends],
            face[ends],
        )
        return PrincipalProjection(self._images, trial, some[ends], spectral, step)

    def _outside(self, trial: Floats, hardened: Floats | None) -> Ints:
        """Points that may be outside, judged by rough principal values."""
        values = rough_principal_values(trial)
        excess = self._stated(values, hardened)
        margin = _ROUGH * np.abs(values).max(axis=0, initial=0.0)
        lengths = np.abs(self._normals).sum(axis=1)
        return np.flatnonzero((excess > -lengths[:, None] * margin).any(axis=0))

    def _faces_of(self, values: Floats, hardened: Floats | None) -> Ints:
        """Faces (q,) on which sorted principal values (3, q) end; 0 for those inside."""
        system = self._system
        shape = (len(system.scale), values.shape[1])
        rows = (
            system.excess(values, hardened),
            system.tolerance(values, hardened),
            np.broadcast_to(system.limits(hardened), shape),
        )
        try:
            return self._ends(*(np.ascontiguousarray(row.T) for row in rows))
        except EmptyDomain as error:
            stated = np.unique(self._images.owner[list(error.planes)])
            raise EmptyDomain(tuple(int(p) for p in stated)) from None

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self._stated(principal_values(stress), hardened)

    def _stated(self, values: Floats, hardened: Floats | None) -> Floats:
        """Yield functions (y, m) of sorted principal values (3, m)."""
        excess = self._normals @ values - self.planes.distances.value[:, None]
        if hardened is not None and self.planes.hardening is not None:
            excess -= self.planes.hardening.value @ hardened
        return np.asarray(excess)


class PrincipalStep(Protocol):
    """The step of principal values from a trial stress to the surface, at the yielded points."""

    @property
    def returned(self) -> Floats:
        """(3, q) principal values of the admissible stress, in the order of those of the trial."""

    @property
    def reduction(self) -> Floats:
        """(q, 3, 3) their derivatives by those of the trial stress."""


def spin(trial: Floats, step: PrincipalStep) -> Floats:
    """(q, 3): what is left of a shear of the trial stress between two of its axes.

    Args:
        trial: (3, q) principal values of the trial stress.
        step: to those of the admissible stress.
    """
    stress, slope = step.returned, step.reduction
    limit = _REPEATED * np.abs(trial).max(axis=0, initial=0.0)
    left = np.empty((trial.shape[1], 3))
    for pair, (i, j) in enumerate(PAIRS):
        apart = trial[i] - trial[j]
        repeated = apart <= limit
        ends = slope[:, i, i] - slope[:, i, j] + slope[:, j, j] - slope[:, j, i]
        ratio = (stress[i] - stress[j]) / np.where(repeated, 1.0, apart)
        left[:, pair] = np.where(repeated, 0.5 * ends, ratio)
    return left


class OnAxes:
    """Stress, tangent and derivatives of a step of principal values.

    Args:
        trial: (s, m) trial stresses.
        yielded: (q,) the points with an active plane, ascending.
        spectral: principal values and axes of their trial stress.
        step: of the principal values.
    """

    def __init__(
        self, trial: Floats, yielded: Ints, spectral: Spectrum, step: PrincipalStep
    ) -> None:
        self.trial, self.yielded, self.spectral, self._step = trial, yielded, spectral, step

    @cached_property
    def stress(self) -> Floats:
        """(s, m) admissible stress; the trial stress itself where nothing yields."""
        stress = self.trial.copy()
        along = self.spectral.assemble[:, :, :3]
        stress[:, self.yielded] = np.einsum("qsi,iq->sq", along, self._step.returned)
        return stress

    @cached_property
    def reduction(self) -> Floats:
        """(q, s, s) dsigma/ds*: of the principal values and by the spin of the axes."""
        assemble, resolve = self.spectral.assemble, self.spectral.resolve
        values = assemble[:, :, :3] @ self._step.reduction @ resolve[:, :3]
        turned = (assemble[:, :, 3:] * self._spin[:, None, :]) @ resolve[:, 3:]
        return np.asarray(values + turned)

    @cached_property
    def _spin(self) -> Floats:
        return spin(self.spectral.values, self._step)

    def along(self, trial: Floats) -> Floats:
        """(6, q, n) components along the axes of derivatives (s, q, n) of the trial stress."""
        return np.asarray(np.einsum("qks,sqn->kqn", self.spectral.resolve, trial))

    def assembled(self, values: Floats, along: Floats) -> Floats:
        """(s, q, n) derivatives of the stress.

        Args:
            values: (3, q, n) those of its principal values.
            along: (6, q, n) of the trial stress, along the axes.
        """
        ends = np.concatenate([values, self._spin.T[:, :, None] * along[3:]])
        return np.asarray(np.einsum("qsk,kqn->sqn", self.spectral.assemble, ends))


class PrincipalProjection(OnAxes):
    """What `PrincipalLaw` makes of trial stresses; see `law.Projection`.

    Args:
        images: of the stated planes.
        trial: (s, m).
        yielded: (q,) the points with an active plane, ascending.
        spectral: principal values and axes of their trial stress.
        step: of the principal values, on the images.
    """

    def __init__(
        self, images: Images, trial: Floats, yielded: Ints, spectral: Spectrum, step: ReturnStep
    ) -> None:
        super().__init__(trial, yielded, spectral, step)
        self.images, self.step = images, step

    @cached_property
    def multipliers(self) -> Floats:
        """(q, y) dlam >= 0, summed over the images of each plane."""
        return np.maximum(self.step.signed_multipliers @ self.images.total.T, 0.0)

    @cached_property
    def active(self) -> Bools:
        """(q, y) planes on an image of which the derivatives are taken."""
        return np.asarray(self.step.active @ self.images.total.T > 0.0)

    @cached_property
    def biactive(self) -> Bools:
        """(q, y) planes that are reached with dlam = 0 on all images."""
        total = self.images.total.T
        return np.asarray((self.step.reached @ total > 0.0) & (self.step.working @ total == 0.0))

    @property
    def reserve(self) -> Floats:
        """(q,) J/m3."""
        return self.step.reserve

    def derivatives(
        self, trial: Floats, hardened: Floats | None = None, *, of_law: bool
    ) -> tuple[Floats, Floats]:
        """Derivatives (s, q, n) of stress and (y, q, n) of multipliers, see `law.Projection`."""
        along, spread = self.along(trial), self.images.spread(hardened)
        values, multipliers = self.step.derivatives(along[:3], spread, of_law=of_law)
        return self.assembled(values, along), np.tensordot(self.images.total, multipliers, axes=1)


def check_isotropic(elasticity: Floats) -> None:
    """Refuse an elasticity (s, s) that principal axes do not suit.

    Raises:
        ValueError: it is not isotropic.
    """
    size = len(elasticity)
    if size not in (4, 6):
        raise ValueError("principal stresses need stresses of 4 or 6 components")
    lame, shear = elasticity[0, 1], elasticity[3, 3]
    model = np.diag([2.0 * shear] * 3 + [shear] * (size - 3))
    model[:3, :3] += lame
    if np.abs(model - elasticity).max() > 1e-8 * np.abs(elasticity).max():
        raise ValueError("planes in principal stresses need an isotropic elasticity")
