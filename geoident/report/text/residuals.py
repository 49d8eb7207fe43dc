"""Residuals in standard deviations, and the readings that stand out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.result import Result

OUTLIER = 3.0
"""Standard deviations beyond which a reading is named."""


@dataclass(frozen=True)
class Outlier:
    """A reading far from what the model says.

    Args:
        channel: its gauge.
        stage: its stage.
        residual: measured minus computed, in standard deviations.
        used: it took part in the identification.
    """

    channel: str
    stage: str
    residual: float
    used: bool


def standardized(result: Result) -> Floats:
    """(n_channels, n_stages) measured minus computed in standard deviations.

    That of the gauge, and for a prediction that of the prediction, which holds both the gauge's and
    the parameters'. NaN where nothing was measured or the prediction is not determined.
    """
    table = result.gauges
    sd = table.sd.copy()
    if result.prediction is not None:
        predicted = np.isfinite(result.prediction.mean) & ~table.used
        sd[predicted] = result.prediction.sd[predicted]
    known = np.isfinite(sd) & (sd > 0)
    residual = table.measured - table.computed
    return np.asarray(np.divide(residual, sd, out=np.full(sd.shape, np.nan), where=known))


def outliers(result: Result) -> tuple[Outlier, ...]:
    """Readings beyond `OUTLIER`, the farthest first, without those known to be wrong."""
    residual, table = standardized(result), result.gauges
    found = [
        Outlier(table.channels[i], table.stages[j], float(residual[i, j]), bool(table.used[i, j]))
        for i, j in np.argwhere((np.abs(np.nan_to_num(residual)) > OUTLIER) & ~table.bad)
    ]
    return tuple(sorted(found, key=lambda each: -abs(each.residual)))


def rms(result: Result) -> float:
    """Root mean square of the standardized residuals that were used; about 1 for a good fit."""
    used = standardized(result)[result.gauges.used]
    used = used[np.isfinite(used)]
    return float(np.sqrt(np.mean(used**2))) if used.size else np.nan


def scored(result: Result) -> tuple[int, int]:
    """Later readings inside their 95 % band, and all of those that have one."""
    prediction = result.prediction
    if prediction is None:
        return 0, 0
    known = np.isfinite(prediction.sd) & np.isfinite(result.gauges.measured)
    known &= ~(result.gauges.used | result.gauges.bad)
    measured = result.gauges.measured
    inside = known & (measured >= prediction.lower95) & (measured <= prediction.upper95)
    return int(inside.sum()), int(known.sum())
