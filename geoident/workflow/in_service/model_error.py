"""The error of a finite element model in service, of each gauge and of all together (theory 16.9).

A gauge may err by a part eta of what level and temperature do to it, in each of the shapes that
`error_shapes` gives. As everywhere (theory 9.1) errors are alike where gauges are near each other,
and a gauge that hardly moves errs by a part of what the others do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from geoident.forward.in_service.error_shapes import FAST, OF_HEAT, OWN_SIGN
from geoident.forward.in_service.seasonal import Effects
from geoident.forward.in_service.structure import ServiceModel
from geoident.identify.assessment.model_error import SIZES, SizeWeights, weigh_all
from geoident.identify.assessment.variance_components import likelihood_at
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Floats
from geoident.model.in_service import YEAR
from geoident.model.results.model_error import ModelErrorTable
from geoident.workflow.estimating.model_error import percent
from geoident.workflow.estimating.model_error_covariance import columns_of_motions

_SHOWN = 0.01
"""Lower end of the interval of the size below which no model error shows."""

_MORE_OF_HEAT = 2.0
"""By how much more a gauge may err in the shape of a parameter of heat: sun, wet concrete, and
elements too thick for the weather of a week act so on all gauges."""

_NOTHING = 1e-9
"""Standard deviation of a coefficient of a gauge that does not move, in those of the others."""


@dataclass(frozen=True)
class GaugeErrors:
    """What the errors of n gauges with s shapes are made of at eta = 1.

    Args:
        columns: (m, s) of each gauge, at its readings.
        root: (n s, r) root of the covariance of all coefficients, gauge by gauge.
    """

    columns: Sequence[Floats]
    root: Floats

    @property
    def sd(self) -> Floats:
        """(n, s) standard deviations of the coefficients."""
        sd = np.sqrt((self.root**2).sum(axis=1)).reshape(len(self.columns), -1)
        return np.asarray(np.maximum(sd, _NOTHING * sd.max(axis=0)))


def gauge_errors(
    model: ServiceModel,
    effects: Effects,
    numbers: Sequence[int],
    times: Sequence[Floats],
    length: float,
) -> GaugeErrors | None:
    """The errors of n gauges, from what moves them at their readings; None if nothing does.

    Args:
        model: of the structure.
        effects: on the readings of all, gauge by gauge, with the shapes.
        numbers: of their channels.
        times: (m,) of the readings of each, s.
        length: over which errors are alike, m.
    """
    shapes = [*effects.of("level"), *effects.of("temperature")]
    names = [effects.names[j] for j in shapes]
    ends = np.cumsum([0, *map(len, times)]).tolist()
    of_each = [effects.columns[a:b, shapes] for a, b in pairwise(ends)]
    sizes: dict[str, Floats] = {}
    if model.service.level is not None:
        motions = [own[:, names.index("level")] for own in of_each]
        slopes = [
            np.cov(model.service.level.at(t), own)[0, 1]
            for t, own in zip(times, motions, strict=True)
        ]
        sizes["level"] = np.sign(slopes) * [own.std() for own in motions]
    if model.service.air is not None:
        motions = [own[:, names.index("temperature")] for own in of_each]
        waves = [_wave(t, own) for t, own in zip(times, motions, strict=True)]
        amplitudes = np.array([amplitude for amplitude, _ in waves])
        largest = amplitudes[np.argmax(np.linalg.norm(amplitudes, axis=1))]
        sign = np.where(amplitudes @ largest < 0.0, -1.0, 1.0)
        sizes["temperature"] = sign * [own.std() for own in motions]
        sizes[FAST] = sign * [left.std() for _, left in waves]
    if not any(np.any(own) for own in sizes.values()):
        return None
    n, s = len(numbers), len(shapes)
    channels = [model.case.channels[number] for number in numbers]
    spread = np.array([own.std(axis=0) for own in of_each])
    spread[spread == 0.0] = 1.0
    parts = []
    for j, name in enumerate(names):
        effect = effects.effects[shapes[j]]
        size = sizes[FAST if name.startswith(FAST) else effect]
        columns = columns_of_motions(channels, size, length) / spread[:, [j]]
        if name.startswith(OF_HEAT):
            columns *= _MORE_OF_HEAT
        if name in OWN_SIGN or name.startswith(OF_HEAT):
            columns *= np.where(size < 0.0, -1.0, 1.0)[:, None]
        placed = np.zeros((n, s, columns.shape[1]))
        placed[:, j] = columns
        parts.append(placed.reshape(n * s, -1))
    return GaugeErrors(of_each, np.hstack(parts))


def _wave(times: Floats, motion: Floats) -> tuple[Floats, Floats]:
    """Cosine and sine of the yearly wave of a motion (m,), and what is left beside it (m,)."""
    angle = 2.0 * np.pi / YEAR * times
    wave = np.column_stack([np.ones(len(times)), np.cos(angle), np.sin(angle)])
    b = np.linalg.lstsq(wave, motion, rcond=None)[0]
    return b[1:], motion - wave @ b


def weights_of_size(
    problem: Problem,
    values: Floats,
    columns: Sequence[tuple[Floats, Floats, Floats]],
    root: Floats,
) -> SizeWeights:
    """What the residuals say of the size eta of the model's errors.

    Args:
        problem: of the fit, for its parameters.
        values: (n,) the estimate.
        columns: of each gauge, projected and whitened: shapes (m, s), derivatives by the
            parameters (m, n), and readings less the model (m,).
        root: of `GaugeErrors`.
    """
    # sums over the readings of a gauge are those over as few rows
    few: list[Floats] = [np.linalg.qr(np.column_stack(own))[1] for own in columns]
    n = len(values)
    s = columns[0][0].shape[1]
    starts = np.arange(len(few)) * s
    felt = [own[:, :s] @ root[k : k + s] for k, own in zip(starts, few, strict=True)]
    rows = np.concatenate(few)
    g = len(rows)
    structure = ErrorStructure(
        np.ones(g), np.full(g, -1), sp.csr_array((g, 0)), np.zeros(0, dtype=np.int64), ()
    )
    gap = replace(problem, measured=rows[:, -1], sd=np.ones(g))
    likelihood = likelihood_at(gap, structure, values, np.zeros(g), rows[:, s : s + n])
    return weigh_all(likelihood, sp.csr_array(np.concatenate(felt)), None, free=False)


def model_error_table(
    size: float, weights: SizeWeights | None, length: float, readings: int
) -> ModelErrorTable:
    """For a result of a number of readings.

    Args:
        size: eta.
        weights: what the residuals say of it; None where it is given.
        length: over which errors are alike, m.
        readings: how many there are.
    """
    low, high = (size if weights is None else weights.quantile(part) for part in (0.025, 0.975))
    whole = "of what level and temperature do to the gauges"
    if weights is None:
        sentence = f"The model is assumed accurate to {percent(size)} {whole}, as the case says."
    elif low > _SHOWN:
        sentence = (
            f"The model errs by {percent(size)} {whole} (95 %: {percent(low)} to {percent(high)}). "
            "Intervals and bands hold that."
        )
    else:
        sentence = (
            f"The model errs by at most {percent(high)} {whole} (95 %): the residuals hardly show "
            "a model error."
        )
    nothing = np.zeros((readings, 0))
    return ModelErrorTable(
        kind="given" if weights is None else "estimated",
        size=size,
        lower95=low,
        upper95=high,
        length=length,
        sizes=np.array([size]) if weights is None else SIZES,
        weights=np.ones(1) if weights is None else weights.weights,
        states=(),
        steps=nothing,
        floors=nothing,
        sentence=sentence,
    )
