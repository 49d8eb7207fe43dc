"""What a convergence law says of each gauge: lost before its first reading, and in the end."""

from __future__ import annotations

from geoident.model.results.columns import ROW, Record, column

_LIKE_READING = {"dimension": ROW, "unit": "SI unit of the gauge"}


class ConvergenceState(Record):
    """The convergence of one channel, SI; ends of intervals are infinite where not determined.

    Args:
        gauge: name of the channel.
        zero: stage of its first reading; empty where it counts from the beginning.
        lost: what has happened before its first reading.
        lost_lower95: lower end of the 95 % interval.
        lost_upper95: upper end.
        final: all of it in the end.
        final_lower95: lower end.
        final_upper95: upper end.
        shown: what the gauge shows of it in the end.
        shown_lower95: lower end.
        shown_upper95: upper end.
        unit: in which people see the readings.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    zero: str
    lost: float = column(like=_LIKE_READING)
    lost_lower95: float = column(like=_LIKE_READING)
    lost_upper95: float = column(like=_LIKE_READING)
    final: float = column(like=_LIKE_READING)
    final_lower95: float = column(like=_LIKE_READING)
    final_upper95: float = column(like=_LIKE_READING)
    shown: float = column(like=_LIKE_READING)
    shown_lower95: float = column(like=_LIKE_READING)
    shown_upper95: float = column(like=_LIKE_READING)
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))
