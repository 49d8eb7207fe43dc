"""Identification of parameters from readings: vectors in, vectors out, no soil, no meshes."""

from __future__ import annotations

from geoident.identify.assessment.uncertainty import Assessment, assess, predict_band
from geoident.identify.problem.methods import METHODS, Method, descend, identify, refusal, refusals
from geoident.identify.problem.problem import Observer, Outcome, Problem

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
