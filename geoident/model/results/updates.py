"""A fit that was brought up to date as readings came: what each update judged, and what it found.

One row each; `update` counts from 0, the fit that was there before the first update.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.results.columns import ROW, Record, column

LEAST_CHANCE = 0.005
"""P-value of all new readings, or of a gauge by their number, below which they do not belong.

Chance does so in one of a hundred updates."""

_LIKE_READING = {"dimension": ROW, "unit": "SI unit of the gauge"}
_LIKE_PARAMETER = {"dimension": ROW, "unit": "SI unit of the parameter"}
_UNIT = {"dimension": ROW, "name": "display_unit", "title": "unit"}
_DIMENSION = {"hidden": ("csv", "json")}


@dataclass(frozen=True)
class UpdateStep:
    """One update.

    Args:
        made: date and time of the fit, ISO 8601.
        readings: that it used.
        new: of these, readings that the fit before had not used.
        changed: readings whose value has changed since.
        removed: readings that the fit before had used and this one did not.
        judged: new readings of which the fit before had a prediction with a finite band.
        p_value: probability that readings which belong to the fit before are as far from its
            predictions, all together; NaN where none was judged.
        least: the smallest p-value of a gauge.
        belong: no p-value is below what chance does once in a hundred updates.
        alarm: the new readings do not belong, or they reach an alarm value.
        status: how the fit ended.
        objective: its misfit.
        case_changed: the case, its mesh or the files of its model had changed beside the readings.
        finding: what it said of the new readings where they do not belong; else empty.
    """

    made: str
    readings: int
    new: int
    changed: int
    removed: int
    judged: int
    p_value: float
    least: float
    belong: bool
    alarm: bool
    status: str
    objective: float
    case_changed: bool
    finding: str = ""


@dataclass(frozen=True)
class JudgedGauge:
    """The new readings of one gauge in one update.

    Args:
        update: its number.
        gauge: name of the gauge with all its channels; of a seasonal model of the channel.
        readings: how many were judged.
        p_value: as of `UpdateStep`, of these alone.
    """

    update: int
    gauge: str
    readings: int
    p_value: float


class JudgedReading(Record):
    """A new reading and what the fit before had predicted of it.

    Args:
        update: number of the update.
        channel: name of the channel.
        stage: name of the stage.
        time: when it was read, s since 1970; NaN where only the stage is known.
        value: what was read, SI.
        predicted: what was expected, SI.
        sd: standard deviation of that with the errors of a reading; infinite if not determined.
        lower95: lower end of the 95 % band.
        upper95: its upper end.
        unit: in which people see the readings.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    update: int
    channel: str
    stage: str
    time: float = column(unit="s since 1970-01-01")
    value: float = column(like=_LIKE_READING)
    predicted: float = column(like=_LIKE_READING)
    sd: float = column(like=_LIKE_READING)
    lower95: float = column(like=_LIKE_READING)
    upper95: float = column(like=_LIKE_READING)
    unit: str = column(like=_UNIT)
    dimension: str = column(like=_DIMENSION)

    @property
    def outside(self) -> bool:
        """It lies outside of its band."""
        return not self.lower95 <= self.value <= self.upper95


class PastParameter(Record):
    """A parameter as one update left it; of a seasonal model the size of an effect on a gauge.

    Args:
        update: number of the update.
        parameter: its name; ``GAUGE: EFFECT`` of a seasonal model.
        value: SI.
        sd: standard deviation; NaN where it is not determined.
        lower95: lower end of the 95 % interval.
        upper95: its upper end.
        at_bound: the value lies on a bound.
        determined: readings (and prior) determine it.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    update: int
    parameter: str
    value: float = column(like=_LIKE_PARAMETER)
    sd: float = column(like=_LIKE_PARAMETER)
    lower95: float = column(like=_LIKE_PARAMETER)
    upper95: float = column(like=_LIKE_PARAMETER)
    at_bound: bool
    determined: bool
    unit: str = column(like=_UNIT)
    dimension: str = column(like=_DIMENSION)


class PastPrediction(Record):
    """What one update predicted of a channel at a stage.

    Args:
        update: number of the update.
        channel: name of the channel.
        stage: name of the stage.
        mean: SI.
        sd: standard deviation; infinite where the prediction is not determined.
        lower95: lower end of the 95 % band.
        upper95: its upper end.
        unit: in which people see the readings.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    update: int
    channel: str
    stage: str
    mean: float = column(like=_LIKE_READING)
    sd: float = column(like=_LIKE_READING)
    lower95: float = column(like=_LIKE_READING)
    upper95: float = column(like=_LIKE_READING)
    unit: str = column(like=_UNIT)
    dimension: str = column(like=_DIMENSION)


class UpdateHistory(Record):
    """All updates of a fit.

    Args:
        steps: one for each, the first fit among them.
        gauges: p-values of their gauges.
        readings: those that were judged.
        parameters: after each.
        predictions: after each.
    """

    steps: tuple[UpdateStep, ...] = column("update", group="updates")
    gauges: tuple[JudgedGauge, ...] = column(
        "row", default=(), group="update_gauges", optional=True
    )
    readings: tuple[JudgedReading, ...] = column(
        "row", default=(), group="update_readings", optional=True
    )
    parameters: tuple[PastParameter, ...] = column(
        "row", default=(), group="update_parameters", optional=True
    )
    predictions: tuple[PastPrediction, ...] = column(
        "row", default=(), group="update_predictions", optional=True
    )

    @property
    def last(self) -> int:
        """Number of the last update."""
        return len(self.steps) - 1

    def values_of(self, parameter: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        """(4, n_updates) value, lower and upper end, and 1 where determined; NaN where absent.

        Args:
            parameter: its name.
        """
        table = np.full((4, len(self.steps)), np.nan)
        for row in self.parameters:
            if row.parameter == parameter:
                table[:, row.update] = row.value, row.lower95, row.upper95, row.determined
        return table
