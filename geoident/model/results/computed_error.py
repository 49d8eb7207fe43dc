"""By how much computed readings are off, beside their accuracy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.units import in_unit, shown_unit

NOTICED = 0.1
"""Part of its accuracy from which on the error of a computed reading is worth a word."""

MATTERS = 0.5
"""Part of the accuracy from which on such errors count beside it."""


@dataclass(frozen=True)
class ComputedError:
    """The error of the computed readings, by channel and stage.

    Args:
        channels: n_channels names.
        stages: n_stages names.
        error: (n_channels, n_stages) estimated: exact less computed, SI, signed where it is known;
            NaN where it is not known.
        accuracy: (n_channels, n_stages) standard deviation of a reading, SI.
        units: of the channels, as people want to see them.
        dimensions: of the channels.
    """

    channels: tuple[str, ...]
    stages: tuple[str, ...]
    error: Floats
    accuracy: Floats
    units: tuple[str, ...]
    dimensions: tuple[str, ...]

    @property
    def share(self) -> Floats:
        """(n_channels, n_stages) size of the error in parts of the accuracy."""
        return np.asarray(np.abs(self.error) / self.accuracy)

    def scatter(self, which: Bools) -> float:
        """Root mean square of the parts of some readings (n_channels, n_stages); 0 for none."""
        parts = self.share[which & np.isfinite(self.share)]
        return float(np.sqrt(np.mean(parts**2))) if parts.size else 0.0

    def largest(self, which: Bools) -> str:
        """The largest error in accuracies of some readings (n_channels, n_stages), and its place.

        Empty where there is none.
        """
        share = np.where(which, np.nan_to_num(self.share), 0.0)
        if not share.any():
            return ""
        i, j = np.unravel_index(int(share.argmax()), share.shape)
        unit = self.units[i], self.dimensions[i]
        size = f"{in_unit(abs(float(self.error[i, j])), *unit):.2g} {shown_unit(*unit)}".rstrip()
        return f"{size} at {self.channels[i]} in {self.stages[j]}, {share[i, j]:.2g} accuracies"
