"""Other minima that are nearly as low as the answer, as a table and for other programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from geoident.model.result import Result
from geoident.report.text.layout import TextTable, number
from geoident.units import in_unit, shown_unit

TITLE = "Minima of the misfit that are nearly as low"


def rivals_table(result: Result) -> TextTable:
    """One row a minimum, the lowest first: its values, misfit and part of the posterior."""
    rivals, table = result.rivals, result.parameters
    names = [
        f"{name} ({unit})" if (unit := shown_unit(*pair)) else name
        for name, pair in zip(
            table.names, zip(table.units, table.dimensions, strict=True), strict=True
        )
    ]
    rows = [] if rivals is None else [_row(result, k) for k in range(len(rivals))]
    return TextTable(("", *names, "misfit", "odds"), rows, right="l" + "r" * (len(names) + 2))


def _row(result: Result, k: int) -> list[str]:
    rivals, table = result.rivals, result.parameters
    assert rivals is not None
    units = zip(table.units, table.dimensions, strict=True)
    values = [
        number(in_unit(float(value), *unit), 3)
        for value, unit in zip(rivals.values[k], units, strict=True)
    ]
    part = f"{100 * rivals.odds[k]:.2g} %"
    return ["lowest" if k == 0 else f"rival {k}", *values, number(rivals.objectives[k]), part]


def rivals_list(result: Result) -> list[dict[str, Any]]:
    """One object for every minimum, the lowest first; SI."""
    rivals, names = result.rivals, result.parameters.names
    if rivals is None:
        return []
    sd = np.sqrt(np.diagonal(rivals.covariance, axis1=1, axis2=2))
    return [
        {
            "objective": rivals.objectives[k],
            "odds": rivals.odds[k],
            "parameters": {
                name: {"value": rivals.values[k, i], "sd": sd[k, i]} for i, name in enumerate(names)
            },
        }
        for k in range(len(rivals))
    ]
