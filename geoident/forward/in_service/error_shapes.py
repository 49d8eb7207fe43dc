"""Shapes in time of the error of a finite element model in service (theory 16.9).

A gauge may move more or less than the model says, later, or along another curve of the level. The
shapes are columns whose coefficients each gauge has of its own; how large these may be is up to the
fit. None of them depends on where the series end, so that they stay what they are as readings come.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from geoident.forward.in_service.seasonal import Scales
from geoident.forward.in_service.structure import Motions, ServiceModel
from geoident.model.arrays import Floats
from geoident.model.in_service import DAY, YEAR

_LAGS = (1.0, 3.0, 10.0, 30.0, 90.0, 365.0)
"""Response times, d, between which the air may act otherwise than in the model."""

FAST = "air"
"""First word of the names of shapes that are as large as the motion beside the yearly wave."""

OF_HEAT = "temperature, "
"""First words of the names of derivatives of the motion by temperature by parameters of heat."""

OWN_SIGN = ("level", "temperature")
"""Shapes that, like these derivatives, are those of a gauge and have the sign of its motion."""


def error_shapes(
    model: ServiceModel, motions: Motions, scales: Scales, times: Floats
) -> Iterator[tuple[str, str, Floats]]:
    """The shapes: names, effects and columns (k,); first of each effect its motion itself.

    Args:
        model: of the structure.
        motions: of the k readings.
        scales: what the level counts from.
        times: (k,) s.
    """
    service = model.service
    if service.level is not None:
        yield "level", "level", motions.parts["level"][:, 0]
        x = (service.level.at(times) - scales.level_low) / (scales.level_high - scales.level_low)
        for degree in (2, 3):
            curve = np.polynomial.legendre.Legendre.basis(degree)(2.0 * x - 1.0)
            yield f"level^{degree}", "level", curve
    if service.air is None:
        return
    yield "temperature", "temperature", motions.parts["temperature"][:, 0]
    for number, name in enumerate(model.names):
        if name in model.of_heat:
            yield f"{OF_HEAT}{name}", "temperature", motions.parts["temperature"][:, 1 + number]
    for part in (1, 2):
        angle = 2.0 * np.pi * part * times / YEAR
        yield f"cos {part}", "temperature", np.cos(angle)
        yield f"sin {part}", "temperature", np.sin(angle)
    # a long time after a gap of the air nothing is known of what a slow body has made of it
    bodies = [np.nan_to_num(service.air.lagged(times, lag * DAY)) for lag in _LAGS]
    for lag, (fast, slow) in zip(_LAGS, pairwise(bodies), strict=False):
        yield f"{FAST} {lag:g} d", "temperature", fast - slow
    yield f"{FAST} {_LAGS[-1]:g} d", "temperature", bodies[-1]
