"""Yield laws and their return mapping: what the run needs at the strain points of one material.

For a trial stress s* = sigma_old + E C du the holonomic step of theory 5 ends at an admissible
stress sigma, with plastic multipliers dlam >= 0 of the planes of the law. A law has numbers only: E
and the planes, or the constants of a curve, with their derivatives by the parameters.

Isotropic laws return principal stresses: a trial stress and the stress it ends at have the same
principal axes. The consistent tangent then has the derivative of that return and, for the spin of
the axes, the ratios (sigma_i - sigma_j) / (s_i - s_j): Simo (1998), Numerical analysis and
simulation of plasticity, Handbook of Numerical Analysis VI; de Souza Neto, Peric & Owen (2008),
Computational Methods for Plasticity, appendix A.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Protocol

import numpy as np

from geoident.fem.yielding.principal_axes import PAIRS, Spectrum
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

_REPEATED = 1e-8
"""Of the largest principal value: differences below are those of a repeated one."""


def seen_from(constant: Dual, columns: int, *, of_law: bool) -> Dual:
    """A constant of a law among columns of a return: value, derivatives by its parameters, others.

    Args:
        constant: with derivatives by the n parameters of the law.
        columns: how many.
        of_law: whether the first n derivatives are by these parameters; else it depends on none.
    """
    seen = np.zeros(columns)
    used = 1 + constant.n * of_law
    seen[:used] = constant.columns[:used]
    return Dual(seen)


class YieldLimits(Protocol):
    """What outputs show of the strength of a material: the distance k of each of its y planes."""

    @property
    def distances(self) -> Dual:
        """k, (y,), Pa."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the y planes."""

    def __len__(self) -> int: ...


class YieldLaw(ABC):
    """The yield law of one material at one parameter vector.

    Attributes:
        planes: as they were given.
        associated: whether the tangents are symmetric and there is a potential.
        hardens: whether the multipliers of earlier steps count.
    """

    planes: YieldLimits
    associated: bool
    hardens = False

    def at(self, points: Ints) -> YieldLaw:
        """The law at some of its points, (k,) by place: the same, where all points are alike."""
        return self

    def with_associated_flow(self) -> YieldLaw:
        """The law with plastic strains along the normals: itself, where they are."""
        return self

    @abstractmethod
    def project(self, trial: Floats, hardened: Floats | None = None) -> ReturnStep:
        """Return trial stresses (s, m) to the yield surface.

        Args:
            trial: (s, m), Pa.
            hardened: (y, m) multipliers of earlier steps; None for zero.
        """

    @abstractmethod
    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""


class ReturnStep(ABC):
    """The return of trial stresses to the yield surface, with tangent and derivatives.

    It goes from a start (d, q) to an end (d, q) at the q points that yield: from stresses to
    stresses, or, with ``spectral``, from principal stresses to principal stresses on the same axes.

    Args:
        trial: s* (s, m) of all points, Pa.
        yielded: (q,) the points with an active plane, ascending.
        spectral: principal values and axes of their trial stress, for a return along these.
    """

    def __init__(self, trial: Floats, yielded: Ints, spectral: Spectrum | None = None) -> None:
        self.trial, self.yielded, self.spectral = trial, yielded, spectral
        self.start = trial[:, yielded] if spectral is None else spectral.values

    @property
    @abstractmethod
    def end(self) -> Floats:
        """(d, q) admissible stress where the return ends."""

    @property
    @abstractmethod
    def end_by_start(self) -> Floats:
        """(q, d, d) derivatives of the end by the start, on the active planes.

        These are linearly independent, with dlam >= 0.
        """

    @abstractmethod
    def end_derivatives(
        self, start: Floats, hardened: Floats | None, *, of_law: bool
    ) -> tuple[Floats, Floats | None]:
        """Derivatives of the end (d, q, n + k) and of multipliers, see `derivatives`."""

    @property
    @abstractmethod
    def multipliers(self) -> Floats:
        """(q, y) plastic multipliers dlam >= 0 of this step."""

    @property
    @abstractmethod
    def biactive(self) -> Bools:
        """(q, y) planes that are reached with dlam = 0 (to rounding): a kink."""

    @property
    @abstractmethod
    def reserve(self) -> Floats:
        """(q,) 1/2 (s* - sigma)^T E^-1 (s* - sigma) + 1/2 dlam^T H dlam, J/m3.

        What the potential of theory 5 loses against the elastic one.
        """

    @cached_property
    def stress(self) -> Floats:
        """(s, m) admissible stress; the trial stress itself where nothing yields."""
        stress, end = self.trial.copy(), self.end
        if self.spectral is not None:
            end = np.einsum("qsi,iq->sq", self.spectral.assemble[:, :, :3], end)
        stress[:, self.yielded] = end
        return stress

    @cached_property
    def reduction(self) -> Floats:
        """(q, s, s) T = dsigma/ds*; the consistent tangent is T E."""
        if self.spectral is None:
            return self.end_by_start
        assemble, resolve = self.spectral.assemble, self.spectral.resolve
        values = assemble[:, :, :3] @ self.end_by_start @ resolve[:, :3]
        return np.asarray(values + (assemble[:, :, 3:] * self._spin[:, None, :]) @ resolve[:, 3:])

    @cached_property
    def _spin(self) -> Floats:
        """(q, 3): the part that remains of a shear of the trial stress between two of its axes."""
        start, end, slope = self.start, self.end, self.end_by_start
        limit = _REPEATED * np.abs(start).max(axis=0, initial=0.0)
        remains = np.empty((start.shape[1], 3))
        for pair, (i, j) in enumerate(PAIRS):
            apart = start[i] - start[j]
            repeated = apart <= limit
            in_limit = slope[:, i, i] - slope[:, i, j] + slope[:, j, j] - slope[:, j, i]
            ratio = (end[i] - end[j]) / np.where(repeated, 1.0, apart)
            remains[:, pair] = np.where(repeated, 0.5 * in_limit, ratio)
        return remains

    def derivatives(
        self, trial: Floats, hardened: Floats | None = None, *, of_law: bool
    ) -> tuple[Floats, Floats | None]:
        """Derivatives of stress and multipliers at the yielded points, on the active planes.

        Args:
            trial: (s, q, n + k) derivatives of the trial stress, all that is in it by dE included:
                by the n parameters first, then along k other directions.
            hardened: (y, q, n + k) derivatives of the multipliers of earlier steps; None for zero.
            of_law: the first n columns are by the law's own parameters, which also change E and
                the planes themselves; otherwise only the trial stress changes, in any columns.

        Returns:
            (s, q, n + k) of the stress and (y, q, n + k) of the multipliers; for the latter None
            where the law never hardens, so that nobody needs them.
        """
        if self.spectral is None:
            return self.end_derivatives(trial, hardened, of_law=of_law)
        along = np.einsum("qks,sqn->kqn", self.spectral.resolve, trial)
        values, multipliers = self.end_derivatives(along[:3], hardened, of_law=of_law)
        ends = np.concatenate([values, self._spin.T[:, :, None] * along[3:]])
        return np.asarray(np.einsum("qsk,kqn->sqn", self.spectral.assemble, ends)), multipliers
