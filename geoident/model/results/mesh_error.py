"""How much of the accuracy of readings is lost to mesh error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.computed_error import ComputedError
from geoident.model.results.costs import NO_COST, Counts

DOUBT: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"refinement": (0.2, 0.1), "order": (0.3, 0.2), "recovery": (0.5, 0.1)}
)
"""By how much the error of a channel is uncertain by itself: parts of it, and of the mean of all.

Measured against finer meshes, once a factor that all readings share is taken out (theory 9.4).
"""


@dataclass(frozen=True)
class MeshError(ComputedError):
    """What the mesh does to the computed readings, by channel and stage.

    Args:
        how: ``refinement``: every edge was halved; ``order``: elements of second order on the same
            edges; ``recovery``: from the jumps of the stress.
        computed: (n_channels, n_stages) on the mesh, SI; NaN where nothing can be read.
        change: (n_channels, n_stages) on the finer mesh, SI; NaN where there was none.
        order: of convergence that the extrapolation takes, for readings of displacements.
        elements: of the mesh, and of the finer one.
        notes: what else is to be known, sentences.
        first_order: the mesh has elements of first order.
        cost: of the finer mesh.
    """

    how: str
    computed: Floats
    change: Floats
    order: float
    elements: tuple[int, int]
    notes: tuple[str, ...] = ()
    first_order: bool = True
    cost: Counts = NO_COST

    @property
    def doubt(self) -> Floats:
        """(n_channels, n_stages) by how much each error is uncertain, SI; 0 where it is unknown.

        Beside a factor that all share. Of a channel whose own error happens to be small that of
        the others tells; of those of its dimension, in the same stage. It has the sign of the
        error: what is too much of a channel in one stage is too much of it in all.
        """
        own, mean = DOUBT[self.how]
        known = np.isfinite(self.error)
        error = np.where(known, self.error, 0.0)
        typical = np.zeros_like(error)
        for kind in dict.fromkeys(self.dimensions):
            rows = np.array([other == kind for other in self.dimensions])
            count = np.maximum(np.count_nonzero(known[rows], axis=0), 1)
            typical[rows] = np.sqrt(np.sum(error[rows] ** 2, axis=0) / count)
        size = np.hypot(own * error, mean * typical)
        return np.asarray(np.where(known, np.copysign(size, error), 0.0))
