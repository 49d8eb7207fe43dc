"""Decisions that depend on a reading: how probable they are, and what earlier readings tell."""

from __future__ import annotations

from geoident.model.results.columns import ROW, Record, column

_LIKE_READING = {"dimension": ROW, "unit": "SI unit of the gauge"}


class DecisionState(Record):
    """What is known today of one decision; SI, NaN where there is nothing.

    Args:
        condition: as the case has it.
        then: what is to be done.
        gauge: name of the channel.
        stage: name of the stage at whose end it is read.
        value: beyond which the reading must be.
        state: ``open``; ``due`` or ``not due`` where it was read; ``not read`` where its stage is
            past; ``unknown`` where it is not predicted.
        probability: that the reading will be beyond the value, 0 to 1.
        measured: what was read.
        unit: in which people see the readings.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    condition: str
    then: str
    gauge: str
    stage: str
    value: float = column(like=_LIKE_READING)
    state: str
    probability: float
    measured: float = column(like=_LIKE_READING)
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))


class TellingReading(Record):
    """An earlier reading that would tell how probable a decision is; SI.

    Args:
        condition: of the decision.
        gauge: name of the channel that would be read.
        stage: name of the stage.
        predicted: what it is expected to read.
        lower95: lower end of the 95 % band.
        upper95: its upper end.
        correlation: with the reading on which the decision depends.
        at_5: reading that would make the decision 5 % likely; NaN where that is more than four
            standard deviations from what is expected.
        at_50: likewise, 50 % likely.
        unit: in which people see the readings.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    condition: str
    gauge: str
    stage: str
    predicted: float = column(like=_LIKE_READING)
    lower95: float = column(like=_LIKE_READING)
    upper95: float = column(like=_LIKE_READING)
    correlation: float
    at_5: float = column(like=_LIKE_READING)
    at_50: float = column(like=_LIKE_READING)
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))
