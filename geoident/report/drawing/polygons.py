"""Many flat polygons at once: cut by planes, and cut into bands of a value.

A polygon is a row of points, each with any number of columns: coordinates, displacements, a value.
All polygons have room for as many points as the largest one needs; how many each has is counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Polygons:
    """Convex polygons.

    Args:
        points: (n, k, d) points with their columns; what lies behind the last one says nothing.
        count: (n,) points of each.
    """

    points: Floats
    count: Ints

    def __len__(self) -> int:
        return len(self.count)

    @classmethod
    def of(cls, parts: list[Floats]) -> Polygons:
        """Polygons (n, k, d) of several sizes in one."""
        most = max((part.shape[1] for part in parts), default=3)
        wide = [
            np.concatenate([part, np.repeat(part[:, -1:], most - part.shape[1], axis=1)], axis=1)
            for part in parts
        ]
        count = [np.full(len(part), part.shape[1]) for part in parts]
        return cls(np.concatenate(wide), np.concatenate(count))

    @property
    def filled(self) -> Bools:
        """(n, k) which places hold a point."""
        return np.asarray(np.arange(self.points.shape[1])[None] < self.count[:, None])

    def some(self, chosen: Bools | Ints) -> Polygons:
        """Some of them, by number or by (n,) whether."""
        return Polygons(self.points[chosen], self.count[chosen])

    def extent(self, column: int) -> tuple[Floats, Floats]:
        """Least and largest value (n,) of a column in each polygon."""
        values = self.points[:, :, column]
        low = np.where(self.filled, values, np.inf).min(axis=1)
        return low, np.where(self.filled, values, -np.inf).max(axis=1)

    def clipped(self, column: int, bound: float, *, above: bool) -> Polygons:
        """What lies on one side of a bound of a column (Sutherland and Hodgman, 1974).

        Args:
            column: which.
            bound: its value there.
            above: whether the part with larger values is kept.
        """
        low, high = self.extent(column)
        inside = low >= bound if above else high <= bound
        crossed = ~inside & (high > bound if above else low < bound)
        cut = self.some(crossed)._cut(column, bound, above=above)
        return Polygons.joined([self.some(inside), cut])

    def _cut(self, column: int, bound: float, *, above: bool) -> Polygons:
        n, k, d = self.points.shape
        if not n:
            return self
        following = np.where(
            np.arange(1, k + 1)[None] < self.count[:, None], np.arange(1, k + 1)[None], 0
        )
        following = np.minimum(following, k - 1)
        after = np.take_along_axis(self.points, following[:, :, None], axis=1)
        here = (self.points[:, :, column] - bound) * (1.0 if above else -1.0)
        next_distance = (after[:, :, column] - bound) * (1.0 if above else -1.0)
        crossing = ((here >= 0) != (next_distance >= 0)) & self.filled
        part = np.where(crossing, here / np.where(crossing, here - next_distance, 1.0), 0.0)
        meeting = self.points + part[:, :, None] * (after - self.points)
        points = np.stack([self.points, meeting], axis=2).reshape(n, 2 * k, d)
        kept = np.stack([(here >= 0) & self.filled, crossing], axis=2).reshape(n, 2 * k)
        order = np.argsort(~kept, axis=1, kind="stable")[:, : int(kept.sum(axis=1).max())]
        count = kept.sum(axis=1)
        polygons = Polygons(np.take_along_axis(points, order[:, :, None], axis=1), count)
        return polygons.some(count >= 3)

    @classmethod
    def joined(cls, parts: list[Polygons]) -> Polygons:
        """Several in one."""
        most = max(part.points.shape[1] for part in parts)
        wide = [np.pad(p.points, ((0, 0), (0, most - p.points.shape[1]), (0, 0))) for p in parts]
        return cls(np.concatenate(wide), np.concatenate([part.count for part in parts]))

    def in_bands(self, column: int, levels: Floats) -> Iterator[tuple[int, Polygons]]:
        """The parts between levels (n,) of a column: -1 for those below the first, and so on."""
        low, high = self.extent(column)
        for k in range(-1, len(levels)):
            first = -np.inf if k < 0 else levels[k]
            last = np.inf if k + 1 >= len(levels) else levels[k + 1]
            part = self.some((low < last) & (high >= first))
            if k >= 0:
                part = part.clipped(column, float(first), above=True)
            if k + 1 < len(levels):
                part = part.clipped(column, float(last), above=False)
            if len(part):
                yield k, part

    @property
    def triangles(self) -> Floats:
        """(m, 3, d) polygons as triangles from their first points."""
        each = range(1, self.points.shape[1] - 1)
        parts = [self.points[self.filled[:, k + 1]][:, [0, k, k + 1]] for k in each]
        return np.concatenate(parts)

    @property
    def normals(self) -> Floats:
        """(n, k - 2, 3) normals of these triangles, twice as long as these are large; else 0."""
        p = self.points[:, :, :3]
        normals = np.cross(p[:, 1:-1] - p[:, :1], p[:, 2:] - p[:, :1])
        return np.asarray(normals * self.filled[:, 2:, None])

    def brightness(self, shadow: float) -> Floats:
        """(n,) 1 of level polygons, so much less of those that face along x, half along y."""
        normal = self.normals.sum(axis=1)
        length = np.linalg.norm(normal, axis=1)
        share = np.abs(normal) / np.where(length > 0, length, 1.0)[:, None]
        return np.asarray(1.0 - (share**2) @ (shadow * np.array([1.0, 0.5, 0.0])))

    def corners(self, columns: slice = slice(0, 3)) -> list[Floats]:
        """Points (count, ...) of each polygon."""
        return [
            points[:count, columns]
            for points, count in zip(self.points, self.count.tolist(), strict=True)
        ]
