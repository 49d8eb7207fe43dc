"""Predictions with bands beside what was read, as scores and pictures see them (theory 13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.results.backtest import Backtest, BacktestStep
from geoident.model.results.result import NORMAL_95, Prediction

_NARROW = 1e-9
"""Least standard deviation of a side, as a part of the other."""

_COLUMNS = ("mean", "sd", "lower95", "upper95")
"""Of a prediction."""


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


def bands_of(found: Backtest, step: BacktestStep) -> Bands:
    """The predictions of a fit of a backtest beside what was read, (n_channels, n_stages)."""
    given = step.prediction
    return Bands(found.measured, given.mean, given.lower95, given.upper95)


def next_read(bands: Bands) -> Bools:
    """(n_channels, n_stages) the readings of the first stage that was predicted and read."""
    known = np.isfinite(bands.mean) & np.isfinite(bands.measured)
    stages = np.flatnonzero(known.any(axis=0))
    first = np.zeros(known.shape, dtype=np.bool_)
    if stages.size:
        first[:, stages[0]] = known[:, stages[0]]
    return first


def predicted_before(found: Backtest) -> Prediction:
    """Each reading of a backtest as the last fit before has predicted it, (n_channels, n_stages).

    ``sd`` is that of the side on which the reading is, so that (measured - mean) / sd is z; NaN
    where no fit came before.
    """
    parts = {name: np.full(found.measured.shape, np.nan) for name in _COLUMNS}
    for step in found.steps:
        bands = bands_of(found, step)
        at, (below, above) = next_read(bands), bands.sides
        sd = np.where(bands.scored, np.where(bands.measured < bands.mean, below, above), np.inf)
        for name, given in zip(
            _COLUMNS, (bands.mean, sd, bands.lower95, bands.upper95), strict=True
        ):
            parts[name][at] = given[at]
    return Prediction(**parts)
