"""Temperatures of ground that conducts heat."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats
from geoident.report.drawing.fields.panels import ColouredField, contours
from geoident.report.drawing.scene import SheetView
from geoident.report.drawing.style import STRESSES, Picture


def temperature_pictures(view: SheetView) -> tuple[Picture, ...]:
    """Temperatures stage by stage; none in a case that conducts no heat."""
    if view.scene.fields.temperature is None:
        return ()
    quantity = ColouredField("temperature (degC)", _temperature, STRESSES, "degC")
    words = "Temperature of the ground at the end of the stage; a cross marks the largest."
    return (contours(view, "temperature", "Temperature", words, quantity),)


def _temperature(view: SheetView, state: int) -> Floats:
    temperature = view.scene.fields.temperature
    assert temperature is not None  # as there is a picture
    return np.asarray(view.sheet.of_nodes(temperature[state][:, None])[:, 0])
