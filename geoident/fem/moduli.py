"""Elastic moduli of the strain points of a material: the same at all of them, or of each its own.

Where a modulus is a field, most often the whole matrix varies by one factor (Young's modulus at
fixed Poisson's ratio): E_q = f_q E. Otherwise every point has its own matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from geoident.model.arrays import Floats, Ints


class Moduli(Protocol):
    """E at the strain points (q) of a material that are looked at, or a derivative of it."""

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some of them, (k,) by place."""

    def at(self, points: Ints) -> Moduli:
        """Those of some of them, (k,) by place."""


@dataclass(frozen=True, eq=False)
class UniformModuli:
    """The same E (s, s) at all points."""

    matrix: Floats

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""
        return np.asarray(np.tensordot(self.matrix, strain, axes=1))

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some points (k,)."""
        return np.broadcast_to(self.matrix, (len(points), *self.matrix.shape))

    def at(self, points: Ints) -> UniformModuli:
        """The same."""
        return self


@dataclass(frozen=True, eq=False)
class ScaledModuli:
    """One matrix (s, s) times a factor (q,) of every point."""

    matrix: Floats
    factor: Floats

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""
        stress = np.tensordot(self.matrix, strain, axes=1)
        stress *= self.factor.reshape((1, -1) + (1,) * (strain.ndim - 2))
        return np.asarray(stress)

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some points (k,)."""
        return np.asarray(self.factor[points, None, None] * self.matrix)

    def at(self, points: Ints) -> ScaledModuli:
        """Those of some points (k,)."""
        return ScaledModuli(self.matrix, self.factor[points])


@dataclass(frozen=True, eq=False)
class PointwiseModuli:
    """E of every point, (s, s, q)."""

    entries: Floats

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""
        shape = (-1,) + (1,) * (strain.ndim - 2)
        stress = np.zeros((len(self.entries), *strain.shape[1:]))
        for a, row in enumerate(self.entries):
            for entry, component in zip(row, strain, strict=True):
                if entry.any():
                    stress[a] += entry.reshape(shape) * component
        return stress

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some points (k,)."""
        return np.ascontiguousarray(np.moveaxis(self.entries[..., points], -1, 0))

    def at(self, points: Ints) -> PointwiseModuli:
        """Those of some points (k,)."""
        return PointwiseModuli(self.entries[..., points])


@dataclass(frozen=True, eq=False)
class SummedModuli:
    """A sum of several."""

    parts: tuple[Moduli, ...]

    def stress(self, strain: Floats) -> Floats:
        """E eps (s, q, ...) of strains (s, q, ...)."""
        stress = self.parts[0].stress(strain)
        for part in self.parts[1:]:
            stress = stress + part.stress(strain)
        return stress

    def matrices(self, points: Ints) -> Floats:
        """E (k, s, s) of some points (k,)."""
        return np.asarray(sum(part.matrices(points) for part in self.parts))

    def at(self, points: Ints) -> SummedModuli:
        """Those of some points (k,)."""
        return SummedModuli(tuple(part.at(points) for part in self.parts))
