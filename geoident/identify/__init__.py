"""Identification of parameters from readings: vectors in, vectors out, no soil, no meshes.

The names are loaded when they are asked for: what is computed without a fit needs the parts where
readings and methods are described, and none of those that judge an estimate.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geoident.identify.assessment.prediction_bands import predict_band
    from geoident.identify.assessment.uncertainty import Assessment, assess
    from geoident.identify.problem.methods import (
        METHODS,
        Method,
        descend,
        identify,
        refusal,
        refusals,
    )
    from geoident.identify.problem.outcome import Observer, Outcome
    from geoident.identify.problem.problem import Problem

__all__ = [
    "METHODS",
    "Assessment",
    "Method",
    "Observer",
    "Outcome",
    "Problem",
    "assess",
    "descend",
    "identify",
    "predict_band",
    "refusal",
    "refusals",
]

_ROOMS = {
    "assessment.prediction_bands": ("predict_band",),
    "assessment.uncertainty": ("Assessment", "assess"),
    "problem.methods": ("METHODS", "Method", "descend", "identify", "refusal", "refusals"),
    "problem.outcome": ("Observer", "Outcome"),
    "problem.problem": ("Problem",),
}


def __getattr__(name: str) -> Any:
    """A name of the list above, from its room."""
    for room, names in _ROOMS.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{room}"), name)
    msg = f"module {__name__!r} has no attribute {name!r}"
    raise AttributeError(msg)
