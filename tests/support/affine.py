"""Toy models whose equations are affine in their parameters: dense, small, no meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.response import Condensed
from geoident.model.results.costs import Counts


@dataclass
class AffineToy:
    """K(p) u = F(p), affine in p, dense.

    Args:
        K: (n+1, d, d) K_0 and the K_h.
        F: (n+1, d) F_0 and the F_h.
        G: (g, d) readings v = G u.
    """

    K: Floats
    F: Floats
    G: Floats
    calls: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"p{h}" for h in range(1, len(self.K)))

    @property
    def counts(self) -> Counts:
        return Counts(evaluations=self.calls)

    def obstacle(self) -> str | None:
        return None

    def admissible(self, p: Floats) -> str | None:
        return None

    def at(self, p: Floats) -> tuple[Floats, Floats]:
        self.calls += 1
        factors = np.append(1.0, p)
        return np.tensordot(factors, self.K, 1), factors @ self.F

    def readings(self, p: Floats) -> Floats:
        return np.asarray(self.G @ np.linalg.solve(*self.at(p)))

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        K, F = self.at(p)
        u = np.linalg.solve(K, F)
        return self.G @ u, self.G @ np.linalg.solve(K, (self.F[1:] - self.K[1:] @ u).T)

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        K, F = self.at(p)
        u, X = np.linalg.solve(K, F), np.linalg.solve(K, self.G.T)
        v, S = self.G @ u, self.G @ X
        white = sd if sd.ndim == 2 else np.diag(1.0 / sd)
        forces = np.linalg.lstsq(white @ S, white @ (measured - v), rcond=1e-10)[0]
        errors = self.K @ (u + X @ forces) - self.F
        carried = self.G @ np.linalg.solve(K, errors.T)
        return Condensed(v, S, carried[:, 1:], -carried[:, 0])


def chain(groups: Sequence[int], gauges: Sequence[tuple[int, int]]) -> AffineToy:
    """A row of blocks between two walls, a force on each; p = the moduli of groups of springs.

    Spring i is between blocks i-1 and i (block 0 and the last are the walls) and belongs to
    ``groups[i]``. A gauge reads the relative displacement of two blocks.
    """
    blocks = len(groups) - 1
    strain = np.eye(blocks + 1, blocks) - np.eye(blocks + 1, blocks, -1)
    K = np.zeros((max(groups) + 2, blocks, blocks))
    for row, group in zip(strain, groups, strict=True):
        K[group + 1] += np.outer(row, row)
    F = np.zeros((len(K), blocks))
    F[0] = 1.0 + 0.5 * np.arange(blocks) ** 2
    places = np.vstack([np.zeros(blocks), np.eye(blocks), np.zeros(blocks)])
    return AffineToy(K, F, np.array([places[j] - places[i] for i, j in gauges]))


def truss(seed: int) -> AffineToy:
    """A statically indeterminate pin-jointed tangle of random bars in three groups."""
    rng = np.random.default_rng(seed)
    strain = rng.standard_normal((3, 7, 8))
    K = np.concatenate([np.zeros((1, 8, 8)), strain.transpose(0, 2, 1) @ strain])
    F = np.zeros((4, 8))
    F[0] = rng.standard_normal(8)
    return AffineToy(K, F, rng.standard_normal((4, 8)))


def two_stages() -> AffineToy:
    """Two stages stacked: the second starts from the stress of the first, with less ground.

    K_2 du = f_2 - (stress of what is left, from u_1), and the in-situ stress is a parameter.
    """
    first = chain([0, 0, 1, 1, 1, 2, 2], [(0, 1)]).K
    second = first.copy()
    gone = np.zeros(6)
    gone[2], gone[3] = -1.0, 1.0
    second[2] -= np.outer(gone, gone)
    K = np.zeros((5, 12, 12))
    K[:4, :6, :6], K[:4, 6:, 6:], K[:4, 6:, :6] = first, second, second
    F = np.zeros((5, 12))
    F[0, :6] = F[0, 6:] = 1.0 + np.arange(6.0)
    F[4, :6] = [1.0, 0, 0, 0, 0, -1.0]
    F[4, 6:] = [1.0, 0, 1.0, -1.0, 0, -1.0]
    u1, du = np.split(np.eye(12), 2)
    return AffineToy(K, F, np.vstack([u1[[1, 3]], u1[1] + du[1], du[4], du[2] - du[1]]))
