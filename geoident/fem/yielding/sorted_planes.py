"""Planes for sorted principal stresses and their mirror images for all orders of them.

A yield surface that is isotropic is the same in all six orders of the principal stresses. Stated is
the sector sigma_1 >= sigma_2 >= sigma_3; the other planes follow by permutation and make its edges
and its apex.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from geoident.fem.yielding.planes import YieldPlanes
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import Dual

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

    def turned(self, directions: Dual) -> Dual:
        """Directions (y, 3) of the planes as those of the images (i, 3)."""
        columns = directions.columns[self.owner]
        return Dual(np.take_along_axis(columns, self.order[..., None], axis=1))

    def planes(self, planes: YieldPlanes) -> YieldPlanes:
        """The images as planes of their own; those that make the apex flow along their normals."""
        normals, flow = self.turned(planes.normals), None
        if planes.flow is not None:
            upright = self.upright[:, None, None]
            own = self.turned(planes.flow)
            flow = Dual(np.where(upright, normals.columns, own.columns))
        hardening = planes.hardening
        return YieldPlanes(
            normals,
            planes.distances[self.owner],
            flow,
            None if hardening is None else hardening[self.owner][:, self.owner],
        )

    def spread(self, values: Floats | None) -> Floats | None:
        """Sums (y, ...) over images as values of the images (i, ...): all on the first."""
        if values is None:
            return None
        images = np.zeros((len(self.owner), *values.shape[1:]))
        images[self.first] = values
        return images


def images_of(planes: YieldPlanes) -> Images:
    """Different images of planes for sorted principal stresses, (y, 3), and those of the apex.

    Raises:
        ValueError: a normal does not descend, so the surface would not be convex.
    """
    normals = planes.normals.value
    flow = normals if planes.flow is None else planes.flow.value
    if np.any(np.diff(normals, axis=1) > 0.0):
        raise ValueError("normals for sorted principal stresses must descend")
    rows = [
        (p, order, False) for p in range(len(normals)) for order in _orders(normals[p], flow[p])
    ]
    if planes.flow is not None:
        tilted = np.any(flow != normals, axis=1) & (np.ptp(normals, axis=1) > 0)
        tilted &= normals.sum(axis=1) > 0.0
        rows += [(int(p), order, True) for p in np.flatnonzero(tilted) for order in _CYCLES]
    return Images(
        owner=np.array([row[0] for row in rows], dtype=np.int64),
        order=np.array([row[1] for row in rows], dtype=np.int64).reshape(-1, 3),
        upright=np.array([row[2] for row in rows], dtype=np.bool_),
        count=len(normals),
    )


def _orders(normal: Floats, flow: Floats) -> list[tuple[int, ...]]:
    """Permutations that give different images of a plane, of its normal (3,) and its flow (3,)."""
    both = np.stack([normal, flow])
    seen: dict[bytes, tuple[int, ...]] = {}
    for order in permutations(range(3)):
        seen.setdefault((both[:, list(order)] + 0.0).tobytes(), order)
    return list(seen.values())
