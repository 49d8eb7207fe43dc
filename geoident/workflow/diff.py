"""``geoident diff``: which numbers of two results are not the same.

Both results become a list of named numbers; numbers of one name are compared. A number that only
one of them has (a gauge that is new, a parameter that is not determined) is a difference.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, replace

import numpy as np

from geoident.io.result.file import read_result
from geoident.model.arrays import Floats
from geoident.model.results.backtest import Backtest
from geoident.model.results.bands import Prediction
from geoident.model.results.comparison import Amount, Comparison, Difference, Place, Tolerance
from geoident.model.results.result import GaugeTable, ParameterTable, Result
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
    found = [Difference(place, pairs[0].get(place), pairs[1].get(place)) for place in places]
    return Comparison(
        first,
        second,
        (one.status, other.status),
        len(places),
        tuple(d for d in found if not same(d.first, d.second, tolerance)),
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
    yield from _parameters(result.parameters)
    yield from _readings(result.gauges)
    if result.prediction is not None:
        yield from _predictions(result.gauges, result.prediction)
    if result.grid is not None:
        yield from _grid(result)
    if result.kind == "backtest" and result.backtest is not None:
        yield from _backtest(result, result.backtest)


def _parameters(table: ParameterTable) -> NamedAmounts:
    value = np.where(table.determined, table.values, np.nan)
    columns = {"value": value, "sd": table.sd, "lower95": table.lower95, "upper95": table.upper95}
    for i, name in enumerate(table.names):
        for quantity, column in columns.items():
            if math.isfinite(column[i]):
                amount = Amount(float(column[i]), table.dimensions[i], table.units[i])
                yield Place("parameters", name, quantity), amount


def _readings(table: GaugeTable) -> NamedAmounts:
    columns = {"measured": table.measured, "sd": table.sd, "computed": table.computed}
    for quantity, column in columns.items():
        yield from _of_channels("readings", quantity, table, column)


def _predictions(gauges: GaugeTable, table: Prediction) -> NamedAmounts:
    mean = np.where(np.isfinite(table.sd), table.mean, np.nan)  # else it is not determined
    columns = {"mean": mean, "lower95": table.lower95, "upper95": table.upper95}
    for quantity, column in columns.items():
        yield from _of_channels("predictions", quantity, gauges, column)


def _of_channels(table: str, quantity: str, gauges: GaugeTable, column: Floats) -> NamedAmounts:
    """What a column (n_channels, n_stages), SI, holds, stage by stage."""
    for j, i in np.argwhere(np.isfinite(column).T):
        item = f"{gauges.channels[i]}, {gauges.stages[j]}"
        amount = Amount(float(column[i, j]), gauges.dimensions[i], gauges.units[i])
        yield Place(table, item, quantity), amount


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


def _backtest(result: Result, found: Backtest) -> NamedAmounts:
    """Parameters and predictions of every fit, and the scores."""
    gauges, table = result.gauges, result.parameters
    for step in found.steps:
        stage = gauges.stages[step.last]
        at_step = replace(
            table,
            values=step.values,
            sd=step.sd,
            lower95=step.lower95,
            upper95=step.upper95,
            determined=step.determined,
        )
        for place, amount in _parameters(at_step):
            yield Place(f"fit up to {stage}", place.item, place.quantity), amount
        for place, amount in _predictions(gauges, step.prediction):
            yield (
                Place(f"predicted from readings up to {stage}", place.item, place.quantity),
                amount,
            )
    for horizon, scores in (("next stage", found.next), ("further ahead", found.further)):
        for quantity, value in asdict(scores).items():
            if math.isfinite(value):
                yield Place("scores", horizon, quantity), _pure(float(value))


def _pure(value: float) -> Amount:
    return Amount(value, DIMENSIONLESS, "")
