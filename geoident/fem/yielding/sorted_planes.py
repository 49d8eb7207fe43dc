"""Planes for sorted principal stresses and their mirror images for all orders of them.

A yield surface that is isotropic is the same in all six orders of the principal stresses. Stated is
the sector sigma_1 >= sigma_2 >= sigma_3; the other planes follow by permutation and make its edges
and its apex.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from geoident.fem.yielding.law import LawSlopes, Planes
from geoident.model.arrays import Floats, Ints

_CYCLES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


@dataclass(frozen=True, eq=False)
class Images:
    """Which plane and which order of its components each image has.

    Args:
        owner: (i,) the stated plane.
        order: (i, 3) places of the stated components.
        upright: (i,) whether the image flows along its normal whatever the flow of its plane is:
            three of these make the apex.
        count: number y of stated planes.
    """

    owner: Ints
    order: Ints
    upright: np.typing.NDArray[np.bool_]
    count: int

    @property
    def total(self) -> Floats:
        """(y, i): sums over the images of each plane."""
        return np.asarray(self.owner == np.arange(self.count)[:, None], dtype=np.float64)

    @property
    def first(self) -> Ints:
        """(y,) one image of each plane."""
        return np.asarray(np.argmax(self.total, axis=1), dtype=np.int64)

    def turned(self, directions: Floats) -> Floats:
        """Directions (y, 3) of the planes as those of the images (i, 3)."""
        return np.take_along_axis(directions[self.owner], self.order, axis=1)

    def flow(self, normals: Floats, flow: Floats | None) -> Floats | None:
        """Flow (i, 3) of the images."""
        if flow is None:
            return None
        return np.where(self.upright[:, None], self.turned(normals), self.turned(flow))

    def planes(self, planes: Planes) -> Planes:
        """The images as planes of their own."""
        hardening = planes.hardening
        return Planes(
            normals=self.turned(planes.normals),
            distances=planes.distances[self.owner],
            flow=self.flow(planes.normals, planes.flow),
            hardening=None if hardening is None else hardening[np.ix_(self.owner, self.owner)],
        )

    def slopes(self, slopes: LawSlopes) -> LawSlopes:
        """Slopes of the stated planes as those of the images; E of normal stresses only."""
        normals, hardening = slopes.normals, slopes.hardening
        return LawSlopes(
            elasticity=None if slopes.elasticity is None else slopes.elasticity[:3, :3],
            normals=None if normals is None else self.turned(normals),
            distances=None if slopes.distances is None else slopes.distances[self.owner],
            flow=self._flow_slopes(slopes),
            hardening=None if hardening is None else hardening[np.ix_(self.owner, self.owner)],
        )

    def _flow_slopes(self, slopes: LawSlopes) -> Floats | None:
        """Slopes of flow of the images: those of the apex follow the normals."""
        if slopes.flow is None and (slopes.normals is None or not self.upright.any()):
            return None
        zero = np.zeros((self.count, 3))
        normals, flow = (zero if v is None else v for v in (slopes.normals, slopes.flow))
        return self.flow(normals, flow)

    def spread(self, values: Floats | None) -> Floats | None:
        """Sums (y, ...) over images as values of the images (i, ...): all on the first."""
        if values is None:
            return None
        images = np.zeros((len(self.owner), *values.shape[1:]))
        images[self.first] = values
        return images


def images_of(planes: Planes) -> Images:
    """Different images of planes for sorted principal stresses, (y, 3), and those of the apex.

    Raises:
        ValueError: a normal does not descend, so the surface would not be convex.
    """
    if np.any(np.diff(planes.normals, axis=1) > 0.0):
        raise ValueError("normals for sorted principal stresses must descend")
    rows = [(p, order, False) for p in range(len(planes.normals)) for order in _orders(planes, p)]
    if planes.flow is not None:
        tilted = np.any(planes.flow != planes.normals, axis=1) & (
            np.ptp(planes.normals, axis=1) > 0
        )
        tilted &= planes.normals.sum(axis=1) > 0.0
        rows += [(int(p), order, True) for p in np.flatnonzero(tilted) for order in _CYCLES]
    return Images(
        owner=np.array([row[0] for row in rows], dtype=np.int64),
        order=np.array([row[1] for row in rows], dtype=np.int64).reshape(-1, 3),
        upright=np.array([row[2] for row in rows], dtype=np.bool_),
        count=len(planes.normals),
    )


def _orders(planes: Planes, plane: int) -> list[tuple[int, ...]]:
    """Permutations that give different images of a plane."""
    flow = planes.normals if planes.flow is None else planes.flow
    both = np.stack([planes.normals[plane], flow[plane]])
    seen: dict[bytes, tuple[int, ...]] = {}
    for order in permutations(range(3)):
        seen.setdefault((both[:, list(order)] + 0.0).tobytes(), order)
    return list(seen.values())
