"""Several models of the same readings, side by side: as text, as a table and for other programs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from geoident.model.rivals import ModelComparison
from geoident.report.text.layout import TextTable, bullets, decimals, number, sections

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
            f"{100 * part:.2g} %",
            decimals(model.backtest, 2),
        ]
        for k, (model, part) in enumerate(zip(found.models, found.probabilities, strict=True))
    ]
    return TextTable(header, rows, right="lrlrrrr")


def models_text(found: ModelComparison) -> str:
    """The comparison for a terminal."""
    return sections(
        f"{len(found.models)} models of {found.readings} readings",
        models_table(found).text,
        bullets(found.sentences),
        "log evidence: less that of the best; probability: if all are as likely before the readings"
        "\nand one is right; backtest: log score of the last fitted stage, a reading; *: preferred",
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
