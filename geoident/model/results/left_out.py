"""How well a fit predicts the gauges that it left out (`fit: {predict_gauges: [..]}`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.backtest import Scores
from geoident.model.results.columns import Record, column


class LeftOutTable(Record):
    """Scores of k gauges that were left out; see `Scores`.

    Args:
        names: k names of gauges, or of single channels.
        readings: (k,) how many of their readings have a band.
        open: (k,) how many more were read, but their prediction is not determined.
        inside: (k,) how many lie inside their 95 % bands.
        rms: (k,) root mean square of the standardized errors; 1 where the bands are right.
        sharpness: (k,) mean width of the bands, by the root mean square of the readings.
        interval_score: (k,) mean of the width and 40 times what a reading is beyond it, likewise.
        log_score: (k,) mean logarithm of the predicted density of a reading, per stated accuracy.
    """

    names: tuple[str, ...] = column("left_out", name="gauge")
    readings: Ints = column("left_out", name="predicted", title="readings")
    open: Ints = column("left_out")
    inside: Ints = column("left_out")
    rms: Floats = column("left_out")
    sharpness: Floats = column("left_out")
    interval_score: Floats = column("left_out")
    log_score: Floats = column("left_out")

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, names: Sequence[str], scores: Sequence[Scores]) -> LeftOutTable:
        """The table of the scores of gauges.

        Args:
            names: k names.
            scores: of each.
        """
        return cls(
            names=tuple(names),
            readings=np.array([one.readings for one in scores], dtype=np.int64),
            open=np.array([one.open for one in scores], dtype=np.int64),
            inside=np.array([one.inside for one in scores], dtype=np.int64),
            rms=np.array([one.rms for one in scores]),
            sharpness=np.array([one.sharpness for one in scores]),
            interval_score=np.array([one.interval_score for one in scores]),
            log_score=np.array([one.log_score for one in scores]),
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """One for each gauge."""
        return tuple(self._sentence(k) for k in range(len(self)))

    def _sentence(self, k: int) -> str:
        name, count = self.names[k], int(self.readings[k])
        if not count:
            why = (
                "its predictions are not determined" if self.open[k] else "nothing to compare with"
            )
            return f"{name}, left out of the fit, is predicted: {why}."
        return (
            f"{name}, left out of the fit, is predicted: {self.inside[k]} of {count} readings "
            f"inside the 95 % band, errors {self.rms[k]:.2f} times what the band says."
        )
