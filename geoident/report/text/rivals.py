"""What competes for the same readings, as tables and for other programs.

Other minima of a model that are nearly as low as the answer; and several models, side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from geoident.model.results.bands import NORMAL_95
from geoident.model.results.result import Result
from geoident.model.results.rivals import ModelComparison, Rivals
from geoident.report.text.layout import (
    TextTable,
    bullets,
    decimals,
    number,
    sections,
    sentence,
    shown_interval,
    with_unit,
)

TITLE = "Minima of the misfit that are nearly as low"
MODELS_TITLE = "Models compared"


def rivals_table(result: Result) -> TextTable:
    """One row a minimum, the lowest first: its values, misfit and part of the posterior."""
    rivals, table = result.rivals, result.parameters
    units = list(zip(table.units, table.dimensions, strict=True))
    names = [with_unit(name, *unit) for name, unit in zip(table.names, units, strict=True)]
    rows = []
    for k in range(0 if rivals is None else len(rivals)):
        assert rivals is not None
        gaps = NORMAL_95 * np.sqrt(np.diagonal(rivals.covariance[k]))
        values = [
            shown_interval(value, value - gap, value + gap, *unit)[0]
            for value, gap, unit in zip(rivals.values[k], gaps, units, strict=True)
        ]
        part = f"{100 * rivals.odds[k]:.2g} %"
        name = f"rival {k}" if k else "lowest"
        rows.append([name, *values, number(rivals.objectives[k]), part])
    return TextTable(("", *names, "misfit", "odds"), rows, right="l" + "r" * (len(names) + 2))


def rivals_list(rivals: Rivals, names: Sequence[str]) -> list[dict[str, Any]]:
    """One object for every minimum, the lowest first; SI.

    Args:
        rivals: the minima.
        names: of the parameters.
    """
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
            f"{model.parameters} + {model.modes} modes" if model.modes else str(model.parameters),
            model.status,
            number(model.objective),
            decimals(model.log_evidence - best, 1),
            _percent(comparison.probabilities[k]),
            decimals(model.backtest, 2),
        ]
        for k, model in enumerate(comparison.models)
    ]
    return TextTable(header, rows, right="lrlrrrr")


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
