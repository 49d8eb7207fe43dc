"""What a settlement law says of each gauge: its end, and how far from it the gauge is."""

from __future__ import annotations

from geoident.model.results.columns import ROW, Record, column

_LIKE_ROW = {"dimension": ROW, "unit": "SI unit of the dimension"}


class SettlementState(Record):
    """One quantity of one channel, SI; ends of intervals are infinite where not determined.

    Args:
        gauge: name of the channel.
        quantity: ``final``: what it shows in the end; ``degree``: the part of that which it has
            shown; ``remaining``: what comes after a date; ``reached``: when it shows a part of the
            final settlement, as the time since the law began.
        at: the date of a degree or of what remains, or the part that is reached; the date when
            settlement counts as final, empty for the end of all.
        value: of the quantity.
        lower95: lower end of the 95 % interval.
        upper95: upper end.
        date: that of ``reached``; empty for other quantities.
        date_lower95: lower end of its interval.
        date_upper95: upper end; empty where it may never be reached.
        unit: in which people see the value.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    quantity: str
    at: str
    value: float = column(like=_LIKE_ROW)
    lower95: float = column(like=_LIKE_ROW)
    upper95: float = column(like=_LIKE_ROW)
    date: str
    date_lower95: str
    date_upper95: str
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))
