"""Gauges that a fit leaves out: which they are, and how well it predicts them."""

from __future__ import annotations

import numpy as np

from geoident.identify.assessment.scores import scores
from geoident.model.arrays import Bools
from geoident.model.case import Case
from geoident.model.results.bands import Bands, Prediction
from geoident.model.results.left_out import LeftOutTable
from geoident.model.results.result import GaugeTable


def left_out_rows(case: Case) -> Bools:
    """(n_channels,) the channels that ``fit.predict_gauges`` names, by their gauge or their own."""
    named = case.fit.predict_gauges
    return np.array([c.gauge in named or c.name in named for c in case.channels], dtype=np.bool_)


def left_out_table(case: Case, gauges: GaugeTable, prediction: Prediction) -> LeftOutTable | None:
    """The scores of each gauge that is left out; None where none is.

    Args:
        case: with its settings of the fit.
        gauges: what was read.
        prediction: of all that is predicted.
    """
    names = case.fit.predict_gauges
    if not names:
        return None
    measured = np.where(gauges.bad, np.nan, gauges.measured)
    table = []
    for name in names:
        rows = np.array([name in (c.gauge, c.name) for c in case.channels], dtype=np.bool_)
        columns = (measured, prediction.mean, prediction.lower95, prediction.upper95)
        bands = Bands(*(each[rows] for each in columns))
        kinds = [kind for kind, own in zip(gauges.dimensions, rows, strict=True) if own]
        table.append(scores(bands, gauges.accuracy[rows][:, None], kinds))
    return LeftOutTable.of(names, table)
