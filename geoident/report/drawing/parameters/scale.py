"""The scale on which a parameter is identified, and so is drawn: its value or its logarithm."""

from __future__ import annotations

from collections.abc import Set
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from geoident.model.arrays import Floats
from geoident.model.results.result import Labelled, ParameterTable, Result
from geoident.report.drawing.style import labelled, short
from geoident.report.text.case import case_mapping
from geoident.report.text.layout import number
from geoident.report.text.parameters import Unit
from geoident.units import in_unit, shown_unit

_DECADE = 8.0
"""Ends of an axis by each other from which on powers of ten and 2, 5 name it well enough."""


def logarithmic(result: Result) -> Set[str]:
    """Names of the parameters that are identified on the logarithm."""
    entries = case_mapping(result, "parameters")
    return {
        str(name)
        for name, entry in entries.items()
        if isinstance(entry, dict) and entry.get("scale") == "log"
    }


def logarithmic_in_any(results: Labelled) -> Set[str]:
    """The same of several results (with their labels)."""
    return {name for _, result in results for name in logarithmic(result)}


def scaled(values: Floats, *, log: bool) -> Floats:
    """Values (...) on the scale of their parameter; NaN where the logarithm has none."""
    if not log:
        return values
    return np.log(np.where(values > 0.0, values, np.nan))


def unscaled(values: Floats, *, log: bool) -> Floats:
    """The values (...) again."""
    return np.exp(values) if log else values


def shown_bounds(table: ParameterTable, i: int, unit: Unit, *, log: bool) -> tuple[float, float]:
    """The ends of an axis that spans the bounds of a parameter, in its unit.

    Args:
        table: of the parameters.
        i: row of the parameter.
        unit: of its values.
        log: it is identified on the logarithm.
    """
    low, high, value = (
        in_unit(float(column[i]), *unit) for column in (table.lower, table.upper, table.values)
    )
    if not np.isfinite(low):
        low = min(0.0, 2 * value)
    if not np.isfinite(high):
        high = max(3 * value, low + 1.0)
    if log and low <= 0.0:
        low = 1e-3 * high
    return low, high


def set_scale(axis: Any, *, low: float, high: float, log: bool, most: int = 6) -> None:
    """Scale, limits and ticks of an axis of a parameter.

    Args:
        axis: ``axes.xaxis`` or ``axes.yaxis``.
        low: lower end, in the unit of the parameter.
        high: upper end.
        log: the parameter is identified on the logarithm.
        most: ticks at most.
    """
    axes: Axes = axis.axes
    name = axis.axis_name
    getattr(axes, f"set_{name}scale")("log" if log else "linear")
    getattr(axes, f"set_{name}lim")(low, high)
    if not log:
        axis.set_major_locator(MaxNLocator(most))
        return
    if high > _DECADE * low:
        subs = (1.0,) if high > 10.0**most * low else (1.0, 2.0, 5.0)
        axis.set_major_locator(LogLocator(subs=subs, numticks=20))
    else:
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda x, _: number(x)))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def with_unit(name: str, unit: Unit, most: int = 16) -> str:
    """A parameter and its unit, for an axis.

    Args:
        name: of the parameter.
        unit: in which it is shown.
        most: letters of the name at most.
    """
    return labelled(short(name, most), shown_unit(*unit))
