"""Alarm values of gauges: when they were reached, and when they are to be expected."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.columns import ROW, Record, column

LIKELY = 0.5
"""Probability from which on an alarm value is expected to be reached."""

AMBER = "amber"
"""Name of an alarm value that warns: reached, it makes the state of a gauge amber, others red."""

_LIKE_READING = {"dimension": ROW, "unit": "SI unit of the gauge"}


class AlarmState(Record):
    """What is known of one alarm value of one channel; SI, NaN where there is none.

    A positive value is reached by readings that are at least as large, a negative one by those that
    are at most as large, a limit by those whose size, with either sign, is at least as large.

    Args:
        gauge: name of the channel.
        level: what the case calls the value, such as ``red``.
        value: the alarm value.
        largest: the reading that came nearest to it, or went farthest beyond.
        reached: name of the first stage with a reading that has reached it; empty for none.
        reached_on: when that was read, seconds since 1970.
        expected: name of the first predicted stage in which it is more probably reached than not;
            empty for none.
        expected_on: when that stage is complete, seconds since 1970.
        likeliest: name of the predicted stage in which it is most probably reached; empty where
            nothing is predicted.
        probability: of being reached in that stage, 0 to 1.
        unit: in which people see the readings.
        dimension: key of `geoident.units.DIMENSIONS`.
        either_sign: it is a limit.
        probabilities: (n_stages,) of being reached in each stage; NaN where it is not predicted.
    """

    gauge: str
    level: str
    value: float = column(like=_LIKE_READING)
    largest: float = column(like=_LIKE_READING)
    reached: str
    reached_on: float = column(unit="s since 1970-01-01")
    expected: str
    expected_on: float = column(unit="s since 1970-01-01")
    likeliest: str
    probability: float
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))
    either_sign: bool = column(default=False, optional=True)
    probabilities: Floats = column(
        "stage",
        default_factory=lambda: np.zeros(0),
        optional=True,
        sheet="probability at {stage}",
        hidden=("diff",),
    )

    @property
    def state(self) -> str:
        """Of a gauge in service: red or amber where the value is reached, amber where it is near.

        Near is a value, other than one named amber, that is more probably reached than not.
        """
        if self.reached:
            return AMBER if self.level == AMBER else "red"
        return AMBER if self.expected and self.level != AMBER else ""
