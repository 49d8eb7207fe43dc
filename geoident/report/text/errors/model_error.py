"""The model error of a fit, in words."""

from __future__ import annotations

import numpy as np

from geoident.model.gauges import DAY
from geoident.model.results.model_error import ModelErrorTable

TITLE = "Model error"

_ONE_PLACE = 1e-6
"""Length where all gauges are in one place, as those of a specimen, m: nothing is to be said."""


def model_error_text(error: ModelErrorTable | None) -> str:
    """Its size in a sentence, and over how far and how long it is alike; empty for none."""
    if error is None:
        return ""
    sentences = [error.sentence]
    if np.isfinite(error.length) and error.length > _ONE_PLACE:
        sentences.append(
            f"The correlation length of the model error is about {error.length:.2g} m."
        )
    if error.time_unit:
        days = error.time_unit == "s"
        time = f"{error.time / DAY:.2g} days" if days else f"{error.time:.2g} stages"
        sentences.append(f"Its correlation time is about {time}.")
    return " ".join(sentences)
