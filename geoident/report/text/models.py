"""Several models of the same readings, side by side: as text, as a table and for other programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from geoident.model.rivals import ModelComparison
from geoident.report.text.layout import TextTable, bullets, decimals, number, sections, sentence

TITLE = "Models compared"


def models_table(found: ModelComparison | None) -> TextTable:
    """One row a model, from the simplest on; the chosen one has a star."""
    header = (
        "model", "parameters", "status", "misfit", "log evidence", "probability", "backtest",
    )  # fmt: skip
    if found is None:
        return TextTable(header, [])
    best = max(model.log_evidence for model in found.models)
    rows = [
        [
            f"{model.name}{' *' if k == found.chosen else ''}",
            str(model.parameters),
            model.status,
            number(model.objective),
            decimals(model.log_evidence - best, 1),
            _percent(part),
            decimals(model.backtest, 2),
        ]
        for k, (model, part) in enumerate(zip(found.models, found.probabilities, strict=True))
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


LEGEND = (
    "log evidence: less that of the best. probability: if all are as likely before the readings "
    "and one of them is right. backtest: log score, a reading, of the last fitted stage. *: taken."
)


def models_parts(found: ModelComparison | None) -> tuple[str, ...]:
    """The table, what it says in words, and what its columns are; nothing where there is none."""
    if found is None:
        return ()
    return models_table(found).text, bullets(found.sentences), sentence(LEGEND)


def models_text(found: ModelComparison) -> str:
    """The comparison for a terminal."""
    return sections(
        f"{len(found.models)} models of {found.readings} readings", *models_parts(found)
    )


def models_object(found: ModelComparison) -> dict[str, Any]:
    """The comparison for other programs."""
    return {
        "readings": found.readings,
        "chosen": found.models[found.chosen].name,
        "decided": found.decided,
        "sentences": found.sentences,
        "models": [
            {**asdict(model), "probability": part}
            for model, part in zip(found.models, found.probabilities, strict=True)
        ],
    }
