"""What competes for the same readings, as tables and for other programs.

Other minima of a model that are nearly as low as the answer; and several models, side by side.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from geoident.model.results.bands import NORMAL_95
from geoident.model.results.result import Result
from geoident.model.results.rivals import ModelComparison, ModelScore
from geoident.report.text.layout import (
    TextTable,
    bullets,
    decimals,
    number,
    sections,
    sentence,
    with_interval,
)
from geoident.units import in_unit, shown_unit

TITLE = "Minima of the misfit that are nearly as low"
MODELS_TITLE = "Models compared"


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
    sd = np.sqrt(np.diagonal(rivals.covariance[k]))
    values = [
        with_interval(*(in_unit(float(x), *unit) for x in (value, value - gap, value + gap)))[0]
        for value, gap, unit in zip(rivals.values[k], NORMAL_95 * sd, units, strict=True)
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


def models_table(comparison: ModelComparison | None) -> TextTable:
    """One row a model, from the simplest on; the chosen one has a star."""
    header = (
        "model", "parameters", "status", "misfit", "log evidence", "probability", "backtest",
    )  # fmt: skip
    if comparison is None:
        return TextTable(header, [])
    best = max(model.log_evidence for model in comparison.models)
    rows = [
        [
            f"{model.name}{' *' if k == comparison.chosen else ''}",
            _unknowns(model),
            model.status,
            number(model.objective),
            decimals(model.log_evidence - best, 1),
            _percent(part),
            decimals(model.backtest, 2),
        ]
        for k, (model, part) in enumerate(
            zip(comparison.models, comparison.probabilities, strict=True)
        )
    ]
    return TextTable(header, rows, right="lrlrrrr")


def _unknowns(model: ModelScore) -> str:
    """How many parameters people see, and the modes of fields apart."""
    modes = f" + {model.modes} modes" if model.modes else ""
    return f"{model.parameters}{modes}"


def _percent(part: float) -> str:
    """A probability in words.

    >>> _percent(0.9999), _percent(0.234), _percent(1e-9)
    ('> 99.9 %', '23 %', '< 0.1 %')
    """
    if part > 0.999:
        return "> 99.9 %"
    return f"{100 * part:.2g} %" if part >= 0.001 else "< 0.1 %"


MODELS_LEGEND = (
    "log evidence: less that of the best. probability: for equal prior odds, "
    "if one of them is right. backtest: log score, a reading, of the last fitted stage. *: taken."
)


def models_parts(comparison: ModelComparison | None) -> tuple[str, ...]:
    """The table, what it says in words, and what its columns are; nothing where there is none."""
    if comparison is None:
        return ()
    return models_table(comparison).text, bullets(comparison.sentences), sentence(MODELS_LEGEND)


def models_text(comparison: ModelComparison) -> str:
    """The comparison for a terminal."""
    return sections(
        f"{len(comparison.models)} models of {comparison.readings} readings",
        *models_parts(comparison),
    )


def models_object(comparison: ModelComparison) -> dict[str, Any]:
    """The comparison for other programs."""
    return {
        "readings": comparison.readings,
        "chosen": comparison.models[comparison.chosen].name,
        "decided": comparison.decided,
        "sentences": comparison.sentences,
        "models": [
            {**asdict(model), "probability": part}
            for model, part in zip(comparison.models, comparison.probabilities, strict=True)
        ],
    }
