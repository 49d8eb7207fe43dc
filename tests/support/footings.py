"""Identifications of two yield limits under a strip load, small enough for a proof."""

from __future__ import annotations

import numpy as np

from geoident.forward.equation_arrays import Affine, PointLaw
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter

from .array_model import ArrayModel
from .plates import footing, tresca

NAMES = ("k1", "k2")
TRUTH = np.array([1.0, 1.1])
LOW, HIGH = 0.5, 4.0


def layers() -> tuple[PointLaw, PointLaw]:
    """Two layers, each with its own limit in all directions."""
    return tuple(tresca(Affine(np.zeros(1), row[None]), 2) for row in np.eye(2))  # type: ignore[return-value]


def two_layers(
    cells: tuple[int, int],
    pressures: tuple[float, ...],
    *,
    start: tuple[float, float],
    seed: int | None = 0,
) -> Problem:
    """Readings of the truth, with noise of a hundredth of the largest; none without a seed."""
    model = ArrayModel(footing(cells, layers(), NAMES, pressures))
    exact = model.readings(TRUTH)
    sd = np.full(len(exact), 1e-2 * np.abs(exact).max())
    noise = 0.0 if seed is None else np.random.default_rng(seed).standard_normal(len(exact))
    parameters = tuple(
        Parameter(name, value, LOW, HIGH) for name, value in zip(NAMES, start, strict=True)
    )
    return Problem(model, exact + sd * noise, sd, parameters)
