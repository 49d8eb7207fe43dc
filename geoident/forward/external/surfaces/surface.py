"""What a response surface gives, the choice of one, and the correlation of the errors of several.

A surface is of one reading. Its coordinates are those of `RunCoordinates`: every parameter goes
from -1 to 1 over the runs, on its own scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from geoident.forward.external.surfaces.gaussian_process import (
    GaussianProcess,
    Hyperparameters,
    fitted_process,
)
from geoident.forward.external.surfaces.polynomial import fitted_polynomial, orders
from geoident.model.arrays import Bools, Floats
from geoident.model.external import SurfaceKind

GOOD_ENOUGH = 1e-3
"""Leave-one-out error, in the accuracy of a reading, below which no other surface is tried."""

_LEAST_FREEDOM = 3
"""Degrees of freedom from which on Student's distribution has a variance."""

_LEAST_EIGENVALUE = 1e-12
"""Eigenvalue of a correlation, in parts of the largest, below which it is rounding."""


class ResponseSurface(Protocol):
    """A function through the runs of one reading."""

    @property
    def words(self) -> str:
        """The kind of function, in words."""

    @property
    def freedom(self) -> int:
        """Runs less what was found from them: degrees of freedom."""

    @property
    def errors(self) -> Floats:
        """(r,) of each run what the surface through all others says too little, SI."""

    @property
    def expected(self) -> Floats:
        """(r,) standard deviation of these errors, as the surface through the others has it, SI."""

    def value(self, u: Floats) -> tuple[float, Floats]:
        """The reading at coordinates u (n,), SI, and its derivatives (n,) by these."""

    def deviation(self, u: Floats) -> float:
        """Standard deviation of the surface's own error at coordinates u (n,), SI."""


@dataclass(frozen=True)
class RunCoordinates:
    """Where parameters are among the runs: from -1 to 1, of those on a log scale the logarithm.

    Args:
        log: (n,) whether a parameter is on a log scale.
        lower: (n,) least value in the runs, SI.
        upper: (n,) largest, SI.
    """

    log: Bools
    lower: Floats
    upper: Floats

    def of(self, p: Floats) -> Floats:
        """Coordinates of parameters p (..., n)."""
        low, high = self._scaled(self.lower), self._scaled(self.upper)
        return np.asarray((2.0 * self._scaled(p) - low - high) / (high - low))

    def slope(self, p: Floats) -> Floats:
        """(n,) derivatives of the coordinates by the parameters p (n,)."""
        width = self._scaled(self.upper) - self._scaled(self.lower)
        return np.asarray(2.0 / width / np.where(self.log, p, 1.0))

    def _scaled(self, p: Floats) -> Floats:
        return np.where(self.log, np.log(np.where(self.log, p, 1.0)), p)


def rms(values: Floats) -> float:
    """Root mean square of numbers (r,)."""
    return float(np.sqrt(np.mean(values**2)))


def surfaces_of(
    u: Floats, readings: Floats, accuracy: Floats, kind: SurfaceKind
) -> tuple[ResponseSurface, ...]:
    """A surface for each of m readings.

    Args:
        u: (r, n) coordinates of the runs.
        readings: (r, m) what they gave, SI.
        accuracy: (m,) of a reading at the gauge, SI.
        kind: of surface; ``auto`` takes that of the smallest leave-one-out error.
    """
    chosen: list[ResponseSurface] = []
    before: Hyperparameters | None = None
    for y, size in zip(readings.T, accuracy.tolist(), strict=True):
        tried: list[ResponseSurface] = []
        if kind != "polynomial":
            process = best_process(u, y, size, before)
            before = process.hyperparameters
            tried.append(process)
        if kind != "gaussian-process" and not any(good(one, size) for one in tried):
            tried += [fitted_polynomial(u, y, order) for order in orders(len(u), u.shape[1])]
        chosen.append(min(tried, key=lambda one: rms(one.errors)))
    return tuple(chosen)


def good(surface: ResponseSurface, accuracy: float) -> bool:
    """Whether a surface is so good that no other is worth a try."""
    return rms(surface.errors) < GOOD_ENOUGH * accuracy


def best_process(
    u: Floats, y: Floats, accuracy: float, before: Hyperparameters | None
) -> GaussianProcess:
    """The process of the best leave-one-out prediction: squared exponential, or Matern's 5/2.

    Args:
        u: (r, n) coordinates of the runs.
        y: (r,) what they gave.
        accuracy: of a reading at the gauge.
        before: hyperparameters of a similar reading, from which the search begins as well.
    """
    smooth = fitted_process(u, y, smooth=True, near=before)
    if good(smooth, accuracy):
        return smooth
    rough = fitted_process(u, y, smooth=False, near=before)
    return min((smooth, rough), key=_surprise)


def _surprise(process: GaussianProcess) -> float:
    """Negative logarithm of the leave-one-out density of the runs, but for a constant."""
    z = process.errors / process.expected
    return float(np.mean(0.5 * z**2 + np.log(process.expected)))


def calibration(surface: ResponseSurface) -> float:
    """Factor on the standard deviation of a surface, at least 1: rms of its z at left-out runs.

    Its variance is estimated from so many degrees of freedom: that of Student's distribution.
    """
    freedom = max(surface.freedom, _LEAST_FREEDOM)
    student = np.sqrt(freedom / (freedom - 2.0))
    return float(max(1.0, rms(surface.errors / surface.expected)) * student)


def together(surfaces: Sequence[ResponseSurface]) -> Floats:
    """Correlation (m, m) of the errors of several surfaces: that of their leave-one-out errors.

    Shrunk towards independence as far as the runs are too few to tell (Schaefer and Strimmer 2005).
    """
    z = np.column_stack([one.errors / one.expected for one in surfaces])
    size = np.sqrt(np.mean(z**2, axis=0))
    z = z / np.where(size > 0.0, size, 1.0)
    count = len(z)
    correlation = z.T @ z / count
    spread = (z**2).T @ (z**2) / count - correlation**2
    off = ~np.eye(len(correlation), dtype=bool)
    total = float((correlation[off] ** 2).sum())
    part = min(1.0, float(spread[off].sum()) / (count - 1) / total) if total > 0.0 else 0.0
    correlation = (1.0 - part) * correlation
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)


def error_root(surfaces: Sequence[ResponseSurface], u: Floats) -> Floats:
    """A root B (m, k) of the covariance B B^T of the errors of surfaces at coordinates u (n,), SI.

    Their standard deviations are those of the surfaces times their `calibration`, their correlation
    is that of the leave-one-out errors (`together`).
    """
    sd = np.array([calibration(one) * one.deviation(u) for one in surfaces])
    size, vectors = np.linalg.eigh(together(surfaces))
    kept = size > _LEAST_EIGENVALUE * size.max(initial=0.0)
    return np.asarray(sd[:, None] * vectors[:, kept] * np.sqrt(size[kept]))
