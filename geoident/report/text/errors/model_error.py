"""The model error of a fit, in words and for other programs."""

from __future__ import annotations

from typing import Any

from geoident.model.results.model_error import ModelErrorTable

TITLE = "Model error"


def model_error_text(found: ModelErrorTable | None) -> str:
    """Its size in a sentence; empty where there is none."""
    if found is None:
        return ""
    over = f"It is taken to be alike over about {found.length:.2g} m."
    return f"{found.sentence} {over}"


def model_error_object(found: ModelErrorTable) -> dict[str, Any]:
    """Its size, relative to what is computed, and the distance over which it is alike, m."""
    return {
        "kind": found.kind,
        "size": found.size,
        "lower95": found.lower95,
        "upper95": found.upper95,
        "length": found.length,
        "scatter": found.factor,
        "scatter_lower95": found.factor_lower95,
        "scatter_upper95": found.factor_upper95,
        "zero": found.zero,
        "zero_lower95": found.zero_lower95,
        "zero_upper95": found.zero_upper95,
        "sentence": found.sentence,
        "findings": found.findings,
    }
