"""``geoident diff``: which numbers of two results are not the same.

Both results become a list of named numbers; numbers of one name are compared. A number that only
one of them has (a gauge that is new, a parameter that is not determined) is a difference.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from geoident.io.result.file import read_result
from geoident.io.text.dates import date_text
from geoident.model.results.backtest import Backtest
from geoident.model.results.columns import columns
from geoident.model.results.comparison import Amount, Comparison, Difference, Place, Tolerance
from geoident.model.results.result import Result
from geoident.units import DIMENSIONLESS

NamedAmounts = Iterator[tuple[Place, Amount]]


def diff(first: str, second: str, tolerance: Tolerance) -> Comparison:
    """Compare two result files.

    Args:
        first: path of a result.
        second: path of another.
        tolerance: up to which numbers are the same.

    Raises:
        InputError: one of them is no result.
    """
    one, other = read_result(first), read_result(second)
    pairs = dict(numbers(one)), dict(numbers(other))
    places = list(dict.fromkeys([*pairs[0], *pairs[1]]))
    differences = [Difference(place, pairs[0].get(place), pairs[1].get(place)) for place in places]
    return Comparison(
        first,
        second,
        (one.status, other.status),
        len(places),
        tuple(d for d in differences if not same(d.first, d.second, tolerance)),
        (one.kind, other.kind),
    )


def same(first: Amount | None, second: Amount | None, tolerance: Tolerance) -> bool:
    """Whether two numbers are the same within a tolerance.

    Args:
        first: a number, or None where there is none.
        second: the other.
        tolerance: up to which they are the same.

    >>> E = [Amount(value, "pressure", "GPa") for value in (2.0e9, 2.1e9)]
    >>> same(*E, Tolerance()), same(*E, Tolerance(absolute={"pressure": 1e8}))
    (False, True)
    """
    if first is None or second is None or first.dimension != second.dimension:
        return False
    if first.value == second.value:  # also two infinities
        return True
    size = max(abs(first.value), abs(second.value))
    allowed = max(tolerance.relative * size, tolerance.absolute.get(first.dimension, 0.0))
    return math.isfinite(size) and abs(first.value - second.value) <= allowed


def numbers(result: Result) -> NamedAmounts:
    """All numbers of a result that people act on, those that are not known left out."""
    result = result.for_people
    if math.isfinite(result.objective):
        yield Place("objective", "", "objective"), _pure(result.objective)
    yield from _of_parameters("parameters", result.parameters, result)
    if result.in_service:
        yield from _in_service(result)
    else:
        read = ("measured", "sd", "computed")
        yield from _amounts("readings", result.gauges, ("stage", "gauge"), result, read)
    if result.prediction is not None:
        yield from _amounts("predictions", result.prediction, ("stage", "gauge"), result)
    if result.grid is not None:
        yield from _grid(result)
    if result.kind == "backtest" and result.backtest is not None:
        yield from _backtest(result, result.backtest)


def _amounts(
    table: str, record: Any, axes: tuple[str, ...], result: Result, only: Sequence[str] = ()
) -> NamedAmounts:
    """The numbers of the columns of a record along axes, row by row, each column after the other.

    Args:
        table: name of it.
        record: with the columns, such as `geoident.model.results.result.ParameterTable`.
        axes: that it has; the item of a number is named along them, the last one first.
        result: that it belongs to.
        only: fields that are compared; in this order; all if empty.
    """
    compared = [
        one
        for one in columns(type(record))
        if {*one.axes} == {*axes}
        and one.kind == "float"
        and "diff" not in one.hidden
        and getattr(record, one.field) is not None
    ]
    if only:
        compared = [one for name in only for one in compared if one.field == name]
    labels, quantities = result.labels, result.quantities
    for one in compared:
        values = getattr(record, one.field)
        if one.known:
            values = np.where(getattr(record, one.known), values, np.nan)
        order = [one.axes.index(axis) for axis in axes]
        for place in np.argwhere(np.isfinite(np.transpose(values, order))).tolist():
            at = dict(zip(axes, place, strict=True))
            item = ", ".join(labels[axis][at[axis]] for axis in reversed(axes))
            unit, dimension = one.shown, one.dimension or DIMENSIONLESS
            if one.dimension in quantities:
                unit, dimension = quantities[one.dimension][at[one.dimension]]
            value = float(values[tuple(at[axis] for axis in one.axes)])
            yield Place(table, item, one.title), Amount(value, dimension, unit)


def _of_parameters(table: str, record: Any, result: Result) -> NamedAmounts:
    """The numbers of the columns of each parameter, one parameter after the other."""
    names = {name: k for k, name in enumerate(result.parameters.names)}
    amounts = _amounts(table, record, ("parameter",), result)
    yield from sorted(amounts, key=lambda one: names[one[0].item])


def _in_service(result: Result) -> NamedAmounts:
    """Effects and noise of the gauges, what later readings were expected to be, and changes."""
    if result.seasonal is not None:
        yield from _amounts("effects", result.seasonal, ("gauge",), result)
    readings, of = (
        result.gauges.readings,
        dict(zip(result.gauges.channels, result.quantities["gauge"], strict=True)),
    )
    for k in () if result.judged is None else np.flatnonzero(np.isfinite(result.judged.innovation)):
        assert result.judged is not None
        unit, dimension = of[readings.channel[k]]
        item = f"{readings.channel[k]}, {date_text(float(readings.time[k]))}"
        for quantity, value in (
            ("measured", readings.value[k]),
            ("predicted", result.judged.predicted[k]),
            ("sd", result.judged.predicted_sd[k]),
        ):
            yield Place("judged", item, quantity), Amount(float(value), dimension, unit)
    for row in result.changes:
        item = f"{row.kind} of {row.gauge}, {date_text(row.since)}"
        yield Place("changes", item, "size"), Amount(row.size, row.dimension, row.unit)
    for changed in result.parameter_changes:
        item = f"{changed.parameter}, {date_text(changed.since)}"
        yield (
            Place("changes", item, "after"),
            Amount(changed.after, changed.dimension, changed.unit),
        )


def _grid(result: Result) -> NamedAmounts:
    grid = result.grid
    if grid is None:
        return
    for point in np.ndindex(grid.objective.shape):
        at = (
            f"{name} {axis[k]:.9g}"
            for name, axis, k in zip(grid.names, grid.axes, point, strict=True)
        )
        yield Place("grid", ", ".join(at), "objective"), _pure(float(grid.objective[point]))


def _backtest(result: Result, backtest: Backtest) -> NamedAmounts:
    """Parameters and predictions of every fit, and the scores."""
    for step in backtest.steps:
        stage = result.gauges.stages[step.last]
        yield from _of_parameters(f"fit up to {stage}", step, result)
        ahead = f"predicted from readings up to {stage}"
        yield from _amounts(ahead, step.prediction, ("stage", "gauge"), result)
    for horizon, scores in (("next stage", backtest.next), ("further ahead", backtest.further)):
        for quantity, value in asdict(scores).items():
            if math.isfinite(value):
                yield Place("scores", horizon, quantity), _pure(float(value))


def _pure(value: float) -> Amount:
    return Amount(value, DIMENSIONLESS, "")
