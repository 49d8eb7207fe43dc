"""Which yield planes a march reached, where and how often."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from geoident.fem.yielding.law import Projection
from geoident.forward.yielding.laws import law_slopes, plane_distances, plane_names
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.certificate import Activity


class ActivityRecord:
    """Collects during a march what its yield planes do.

    Args:
        case: the case.
        n_strain: strain components of the analysis.
    """

    def __init__(self, case: Case, n_strain: int) -> None:
        self._n_strain = n_strain
        self._materials = {name: m for name, m in case.materials.items() if m.yields}
        self._stages = case.stage_names[1:]
        self._names = {name: plane_names(m, n_strain) for name, m in self._materials.items()}
        counts = np.cumsum([0, *(len(names) for names in self._names.values())])
        self._rows = {
            name: slice(int(first), int(last))
            for name, first, last in zip(self._names, counts[:-1], counts[1:], strict=True)
        }
        self._n_planes = int(counts[-1])
        self.begin({})

    def begin(self, values: Mapping[str, float]) -> None:
        """A march begins: forget the one before."""
        self._values = values
        shape = (self._n_planes, len(self._stages))
        self._points = np.zeros(shape, dtype=np.int64)
        self._biactive = np.zeros(shape, dtype=np.int64)
        self._margin = np.full(self._n_planes, -np.inf)

    def forget(self, state: int) -> None:
        """A state is tried anew."""
        self._points[:, state - 1] = 0
        self._biactive[:, state - 1] = 0

    def name(self, material: str, plane: int) -> str:
        """Name of a plane within its material."""
        return self._names[material][plane]

    def distance(self, material: str, plane: int) -> float:
        """The distance k of a plane, Pa."""
        return float(self._distances(material)[plane])

    def flow(self, state: int, material: str, projection: Projection) -> None:
        """What yields in a state; of several load steps the one where most does counts."""
        place = self._rows[material], state - 1
        flowing = (projection.multipliers > 0.0).sum(axis=0)
        self._points[place] = np.maximum(self._points[place], flowing)
        self._biactive[place] = projection.biactive.sum(axis=0)

    def reach(self, material: str, excess: Floats) -> None:
        """The yield functions psi (y, m) at the stresses of a state."""
        rows = self._rows[material]
        self._margin[rows] = np.maximum(self._margin[rows], excess.max(axis=1, initial=-np.inf))

    def activity(self, names: Sequence[str]) -> Activity:
        """What was collected; the slopes are by the parameters of these names."""
        distances = np.concatenate([np.empty(0), *map(self._distances, self._names)])
        return Activity(
            planes=tuple(f"{m}: {plane}" for m, planes in self._names.items() for plane in planes),
            stages=self._stages,
            points=self._points,
            biactive=self._biactive,
            distances=distances,
            reached=distances + self._margin,
            slopes=self._slopes(names),
        )

    def _distances(self, material: str) -> Floats:
        return plane_distances(self._materials[material], self._values, self._n_strain)

    def _slopes(self, names: Sequence[str]) -> Floats:
        """(r, n) dk/dp."""
        slopes = np.zeros((self._n_planes, len(names)))
        for material, rows in self._rows.items():
            found = law_slopes(self._materials[material], self._values, names, self._n_strain)
            for column, name in enumerate(names):
                if name in found and found[name].distances is not None:
                    slopes[rows, column] = found[name].distances
        return slopes
