"""Which yield planes a march reached, where and how often."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.fem.yielding.law import Projection, YieldLimits
from geoident.model.arrays import Floats
from geoident.model.yielding import Activity


class ActivityRecord:
    """Collects during a march what its yield planes do.

    Args:
        planes: of every material that yields, at the parameters of the march.
        stages: names of the stages.
    """

    def __init__(self, planes: Mapping[str, YieldLimits], stages: tuple[str, ...]) -> None:
        self._planes = planes
        self._stages = stages
        ends = np.cumsum([0, *map(len, planes.values())])
        self._rows = {
            name: slice(int(first), int(last))
            for name, first, last in zip(planes, ends[:-1], ends[1:], strict=True)
        }
        shape = (int(ends[-1]), len(stages))
        self._points = np.zeros(shape, dtype=np.int64)
        self._biactive = np.zeros(shape, dtype=np.int64)
        self._margin = np.full(shape[0], -np.inf)

    def flow(self, state: int, material: str, projection: Projection) -> None:
        """What yields in a state.

        Args:
            state: index of the state.
            material: whose points are projected.
            projection: of its trial stresses.
        """
        place = self._rows[material], state - 1
        flowing = (projection.multipliers > 0.0).sum(axis=0)
        self._points[place] = np.maximum(self._points[place], flowing)
        self._biactive[place] = projection.biactive.sum(axis=0)

    def reach(self, material: str, excess: Floats) -> None:
        """The yield functions psi (y, m) at the stresses of a state."""
        rows = self._rows[material]
        self._margin[rows] = np.maximum(self._margin[rows], excess.max(axis=1, initial=-np.inf))

    def activity(self) -> Activity | None:
        """What was collected, with slopes by all parameters; None where nothing can yield."""
        if not self._planes:
            return None
        distances = np.concatenate([p.distances.columns for p in self._planes.values()])
        return Activity(
            planes=tuple(f"{m}: {name}" for m, p in self._planes.items() for name in p.names),
            stages=self._stages,
            points=self._points,
            biactive=self._biactive,
            distances=distances[:, 0].copy(),
            reached=distances[:, 0] + self._margin,
            slopes=distances[:, 1:].copy(),
        )
