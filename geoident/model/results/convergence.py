"""What a convergence law says of each gauge: lost before its first reading, and in the end."""

from __future__ import annotations

from dataclasses import dataclass, field

from geoident.model.results.columns import ROW, column

_LIKE_READING = column(dimension=ROW, unit="SI unit of the gauge")


@dataclass(frozen=True)
class ConvergenceState:
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
    lost: float = field(metadata=_LIKE_READING)
    lost_lower95: float = field(metadata=_LIKE_READING)
    lost_upper95: float = field(metadata=_LIKE_READING)
    final: float = field(metadata=_LIKE_READING)
    final_lower95: float = field(metadata=_LIKE_READING)
    final_upper95: float = field(metadata=_LIKE_READING)
    shown: float = field(metadata=_LIKE_READING)
    shown_lower95: float = field(metadata=_LIKE_READING)
    shown_upper95: float = field(metadata=_LIKE_READING)
    unit: str = field(metadata=column(dimension=ROW, name="display_unit", title="unit"))
    dimension: str = field(metadata=column(hidden=("csv", "json")))
