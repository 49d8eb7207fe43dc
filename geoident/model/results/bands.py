"""Predictions with bands beside what was read, as scores and pictures see them (theory 13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.results.columns import Record, column

NORMAL_95 = 1.959963984540054
"""Half width of a normal 95 % interval, in standard deviations."""

_NARROW = 1e-9
"""Least standard deviation of a side, as a part of the other."""


class Prediction(Record):
    """What the channels will show, all (n_channels, n_stages), m; NaN where not predicted.

    ``sd`` holds the uncertainty of the parameters and the accuracy of the gauge (theory 6). Where
    later readings share errors with those of the fit, such as that of a zero, both ``mean`` and
    ``sd`` know what these tell of them (theory 7).
    """

    mean: Floats = column(
        "gauge", "stage", dimension="gauge", known="known", sheet="predicted", array="predicted"
    )
    sd: Floats = column("gauge", "stage", dimension="gauge", array="predicted_sd", hidden=("diff",))
    lower95: Floats = column("gauge", "stage", dimension="gauge", array="predicted_lower95")
    upper95: Floats = column("gauge", "stage", dimension="gauge", array="predicted_upper95")

    @property
    def known(self) -> Bools:
        """(n_channels, n_stages) where the prediction is determined."""
        return np.asarray(np.isfinite(self.sd))


@dataclass(frozen=True)
class Bands:
    """Predictions of readings and what was read.

    Args:
        measured: (...) what was read; NaN where nothing was.
        mean: (...) the prediction; NaN where nothing is predicted.
        lower95: (...) lower end of the band; infinite where the prediction is not determined.
        upper95: (...) its upper end.
    """

    measured: Floats
    mean: Floats
    lower95: Floats
    upper95: Floats

    @property
    def scored(self) -> Bools:
        """(...) where there are a reading and a band."""
        ends = np.isfinite(self.lower95) & np.isfinite(self.upper95)
        return np.asarray(ends & np.isfinite(self.mean) & np.isfinite(self.measured))

    @property
    def open(self) -> Bools:
        """(...) read, but the prediction is not determined."""
        known = np.isfinite(self.mean) & np.isfinite(self.measured)
        return np.asarray(known & ~self.scored)

    @property
    def inside(self) -> Bools:
        """(...) the reading lies inside its band."""
        within = (self.measured >= self.lower95) & (self.measured <= self.upper95)
        return np.asarray(within & self.scored)

    @property
    def sides(self) -> tuple[Floats, Floats]:
        """(...), (...) standard deviations below and above the mean."""
        below, above = self.mean - self.lower95, self.upper95 - self.mean
        least = _NARROW * (self.upper95 - self.lower95)
        return np.maximum(below, least) / NORMAL_95, np.maximum(above, least) / NORMAL_95

    @property
    def z(self) -> Floats:
        """(...) standardized errors of the prediction; NaN where it is not scored."""
        error, (below, above) = self.measured - self.mean, self.sides
        with np.errstate(invalid="ignore", divide="ignore"):
            z = error / np.where(error < 0.0, below, above)
        return np.where(self.scored, z, np.nan)

    @property
    def log_density(self) -> Floats:
        """(...) logarithm of the predicted density of the reading, per unit; NaN likewise."""
        below, above = self.sides
        with np.errstate(invalid="ignore", divide="ignore"):
            top = 0.5 * np.log(2.0 / np.pi) - np.log(below + above)
        return np.where(self.scored, top - 0.5 * self.z**2, np.nan)

    @property
    def interval_score(self) -> Floats:
        """(...) width, and 40 times what the reading is beyond it (Gneiting & Raftery 2007)."""
        low, high = self.lower95 - self.measured, self.measured - self.upper95
        with np.errstate(invalid="ignore"):
            beyond = np.maximum(low, 0.0) + np.maximum(high, 0.0)
            score = self.upper95 - self.lower95 + 2.0 / 0.05 * beyond
        return np.where(self.scored, score, np.nan)

    def only(self, part: Bools) -> Bands:
        """The same, nothing predicted but in a part (...)."""
        return Bands(self.measured, np.where(part, self.mean, np.nan), self.lower95, self.upper95)


def next_read(bands: Bands) -> Bools:
    """(n_channels, n_stages) the readings of the first stage that was predicted and read."""
    known = np.isfinite(bands.mean) & np.isfinite(bands.measured)
    stages = np.flatnonzero(known.any(axis=0))
    first = np.zeros(known.shape, dtype=np.bool_)
    if stages.size:
        first[:, stages[0]] = known[:, stages[0]]
    return first
