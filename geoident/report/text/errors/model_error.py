"""The model error of a fit, in words."""

from __future__ import annotations

from geoident.model.results.model_error import ModelErrorTable

TITLE = "Model error"


def model_error_text(error: ModelErrorTable | None) -> str:
    """Its size in a sentence; empty where there is none."""
    if error is None:
        return ""
    length = f"The correlation length of the model error is about {error.length:.2g} m."
    return f"{error.sentence} {length}"
