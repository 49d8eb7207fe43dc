"""Variations that fill a space: Latin hypercube and Sobol points, on the scale of each value."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtri

from geoident.model.arrays import Floats
from geoident.model.campaign import SampledRange, Sampling
from geoident.model.run import Run

_BITS = 30
"""Of a Sobol point. A random digital shift keeps what makes the points even (Owen 1998)."""

_DIGITS = 9
"""Of a value: its text is what counts, so that a run can be repeated by hand."""


def sampled(sampling: Sampling, case: str) -> tuple[Run, ...]:
    """The runs of a sampling, numbered.

    Args:
        sampling: the same one gives the same runs.
        case: path of the case that they are of.
    """
    width = max(4, len(str(sampling.count)))
    points = unit_points(sampling.method, len(sampling.spans), sampling.count, sampling.seed)
    columns = [_values(span, points[:, k]) for k, span in enumerate(sampling.spans)]
    places = tuple(span.place for span in sampling.spans)
    return tuple(
        Run(
            f"{number + 1:0{width}d}",
            case,
            tuple(
                (span.path, f"{column[number]:.{_DIGITS}g} {span.unit}".rstrip())
                for span, column in zip(sampling.spans, columns, strict=True)
            ),
            places,
            places[0],
        )
        for number in range(sampling.count)
    )


def unit_points(method: str, dim: int, count: int, seed: int) -> Floats:
    """Points (count, dim) of the open unit cube.

    Args:
        method: ``latin-hypercube`` or ``sobol``.
        dim: number of values.
        count: number of points.
        seed: of the random numbers.
    """
    generator = np.random.default_rng(seed)
    if method == "sobol":
        from scipy.stats import qmc  # noqa: PLC0415 - a second, and most campaigns have none

        power = max(0, math.ceil(math.log2(count)))
        plain = qmc.Sobol(dim, scramble=False, bits=_BITS).random_base2(power)[:count]
        shift = generator.integers(0, 1 << _BITS, size=dim)
        cells = (plain * (1 << _BITS)).astype(np.int64) ^ shift
        return np.asarray((cells + 0.5) / (1 << _BITS), dtype=np.float64)
    cells = np.column_stack([generator.permutation(count) for _ in range(dim)])
    within = np.clip(generator.random((count, dim)), 1e-12, 1.0 - 1e-12)
    return np.asarray((cells + within) / count, dtype=np.float64)


def _values(span: SampledRange, points: Floats) -> Floats:
    """Values (k,) of a span, in its unit, at points (k,) between 0 and 1."""
    if span.kind == "linear":
        return span.first + (span.second - span.first) * points
    if span.kind == "log":
        return np.asarray(span.first * (span.second / span.first) ** points)
    normal = np.asarray(ndtri(points), dtype=np.float64)
    if span.kind == "normal":
        return span.first + span.second * normal
    return np.asarray(span.first * np.exp(span.second / span.first * normal))
