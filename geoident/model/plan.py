"""What planned gauges could tell, before any reading exists."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.arrays import Floats
from geoident.model.result import ParameterTable


@dataclass(frozen=True)
class Identifiability:
    """What the planned readings could determine.

    Args:
        parameters: the parameters at their start values, with the intervals to expect.
        findings: sentences on what would stay undetermined.
        singular_values: (min(g, n),) of the scaled sensitivities of the readings.
        readings: number g of planned readings: all channels at all stages of the fit.
    """

    parameters: ParameterTable
    findings: tuple[str, ...]
    singular_values: Floats
    readings: int
