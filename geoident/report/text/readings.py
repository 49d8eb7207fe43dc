"""Readings as the CSV that a case can read back."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from geoident.model.gauges import Reading


def readings_csv(readings: Sequence[Reading]) -> str:
    """Lines ``gauge,stage,value,unit``, in mm; the value is empty where none was read.

    >>> print(readings_csv([Reading("EX1", "bench 1", 0.0123)]), end="")
    gauge,stage,value,unit
    EX1,bench 1,12.3,mm
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["gauge", "stage", "value", "unit"])
    for reading in readings:
        value = "" if reading.value is None else f"{1e3 * reading.value:.12g}"
        writer.writerow([reading.channel, reading.stage, value, "mm"])
    return text.getvalue()
