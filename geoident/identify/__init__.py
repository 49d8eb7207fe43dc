"""Identification of parameters from readings: vectors in, vectors out, no soil, no meshes."""

from __future__ import annotations

from geoident.identify.methods import METHODS, Method, identify, refusal, refusals
from geoident.identify.problem import Observer, Outcome, Problem
from geoident.identify.uncertainty import Assessment, assess, predict_band

__all__ = [
    "METHODS",
    "Assessment",
    "Method",
    "Observer",
    "Outcome",
    "Problem",
    "assess",
    "identify",
    "predict_band",
    "refusal",
    "refusals",
]
