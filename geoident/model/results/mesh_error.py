"""How much of the accuracy of readings the mesh eats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats

NOTICED = 0.1
"""Part of its accuracy from which on the error of a reading by the mesh is counted."""

MATTERS = 0.5
"""Root mean square of these parts from which on the mesh is called too coarse."""


@dataclass(frozen=True)
class MeshError:
    """What the mesh does to the computed readings, by channel and stage.

    Args:
        how: ``refinement``: every edge was halved; ``recovery``: from the jumps of the stress.
        channels: n_channels names.
        stages: n_stages names.
        computed: (n_channels, n_stages) on the mesh, SI; NaN where nothing can be read.
        change: (n_channels, n_stages) by the refinement, SI; NaN where there was none.
        error: (n_channels, n_stages) estimated: exact less computed, SI, signed where it is known.
        accuracy: (n_channels,) standard deviation of a reading, SI.
        units: of the channels, as people want to see them.
        dimensions: of the channels.
        order: of convergence that the extrapolation takes, for readings of displacements.
        elements: of the mesh, and of the refined one.
        notes: what else is to be known, sentences.
    """

    how: str
    channels: tuple[str, ...]
    stages: tuple[str, ...]
    computed: Floats
    change: Floats
    error: Floats
    accuracy: Floats
    units: tuple[str, ...]
    dimensions: tuple[str, ...]
    order: float
    elements: tuple[int, int]
    notes: tuple[str, ...] = ()

    @property
    def share(self) -> Floats:
        """(n_channels, n_stages) size of the error in parts of the accuracy."""
        return np.asarray(np.abs(self.error) / self.accuracy[:, None])

    def scatter(self, which: Bools) -> float:
        """Root mean square of the parts of some readings (n_channels, n_stages); 0 for none."""
        parts = self.share[which & np.isfinite(self.share)]
        return float(np.sqrt(np.mean(parts**2))) if parts.size else 0.0
