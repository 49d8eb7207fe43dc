"""The response surfaces of a table of runs, and how well runs left out are told (theory 4.8)."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.columns import Record, column


class SurfaceTable(Record):
    """The surface of each of m readings of a table of runs.

    Args:
        file: name of the table.
        runs: number of its runs.
        channels: m names of channels.
        stages: m names of stages.
        words: m kinds of surface.
        left_out: (m,) root mean square of the errors of runs left out one by one, SI.
        own: (m,) standard deviation of the surface's own error at the estimate, SI.
        accuracy: (m,) of the readings, SI.
        lower: (m,) the least that a run gave, SI.
        upper: (m,) the largest, SI.
        units: m units in which people want to see them.
        dimensions: m dimensions.
    """

    file: str
    runs: int
    channels: tuple[str, ...] = column("column", name="gauge")
    stages: tuple[str, ...] = column("column", name="stage")
    words: tuple[str, ...] = column("column", name="kind", title="surface")
    left_out: Floats = column("column")
    own: Floats = column("column")
    accuracy: Floats = column("column", hidden=("json",))
    lower: Floats = column("column")
    upper: Floats = column("column")
    units: tuple[str, ...] = column("column", name="display_unit", hidden=("json",))
    dimensions: tuple[str, ...] = column("column", name="dimension", hidden=("json",))

    def __len__(self) -> int:
        return len(self.channels)

    @property
    def part(self) -> float:
        """Root mean square of the own errors at the estimate, in accuracies."""
        return float(np.sqrt(np.mean((self.own / self.accuracy) ** 2)))

    @property
    def worst(self) -> int:
        """Number of the reading of which the surface knows least, in its accuracy."""
        return int(np.argmax(self.left_out / self.accuracy))
