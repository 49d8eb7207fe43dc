"""Figures of gauges over a number of each stage, as the case asks for them (`report.curves`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.result import Result
from geoident.report.text.case import case_mapping
from geoident.units import in_unit, read_quantity


@dataclass(frozen=True)
class Curves:
    """Gauges that read one quantity, over a number of the stages.

    Args:
        read: what they read.
        over: what the number is.
        unit: of the number, as the case has it.
        names: (k,) of the lines.
        rows: (k,) their channels in the table of gauges.
        at: (n_stages,) the number in its unit; NaN at stages without one.
        log: it is shown on a logarithm.
        downwards: what is read is drawn downwards.
    """

    read: str
    over: str
    unit: str
    names: tuple[str, ...]
    rows: tuple[int, ...]
    at: Floats
    log: bool
    downwards: bool


def curves_of(result: Result) -> tuple[Curves, ...]:
    """All that the case asks for and the result has."""
    table, found = result.gauges, []
    for given in case_mapping(result, "report").get("curves") or ():
        numbers = {name: read_quantity(text, "") for name, text in given["stages"].items()}
        shown = next(iter(numbers.values()))
        at = np.full(len(table.stages), np.nan)
        for k, stage in enumerate(table.stages):
            if stage in numbers:
                at[k] = in_unit(numbers[stage].value, shown.unit, shown.dimension)
        lines = [
            (name, row)
            for name, gauge in given["gauges"].items()
            for row, channel in enumerate(table.channels)
            if gauge in (channel, table.gauges[row])
        ]
        if lines and np.isfinite(at).any():
            names, rows = zip(*lines, strict=True)
            log, down = given.get("scale") == "log", str(given.get("downwards")).lower() == "true"
            words = given["read"], given["over"]
            found.append(Curves(*words, shown.unit, names, rows, at, log, down))
    return tuple(found)
