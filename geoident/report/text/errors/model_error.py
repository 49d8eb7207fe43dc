"""The model error of a fit, in words and for other programs."""

from __future__ import annotations

from typing import Any

from geoident.model.results.model_error import ModelErrorTable
from geoident.report.text.rows import attributes

TITLE = "Model error"


def model_error_text(error: ModelErrorTable | None) -> str:
    """Its size in a sentence; empty where there is none."""
    if error is None:
        return ""
    over = f"It is taken to be alike over about {error.length:.2g} m."
    return f"{error.sentence} {over}"


def model_error_object(error: ModelErrorTable) -> dict[str, Any]:
    """Its size, relative to what is computed, and the distance over which it is alike, m."""
    return attributes(error)
