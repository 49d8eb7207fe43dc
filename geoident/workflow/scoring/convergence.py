"""What a fitted convergence law says of each gauge: lost before its first reading, in the end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.external.convergence import LawModel
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.prediction_bands import predict_band
from geoident.model.arrays import Floats
from geoident.model.dual import Dual
from geoident.model.results.convergence import ConvergenceState
from geoident.units import in_unit, shown_unit
from geoident.workflow.estimating.estimate import Estimate


def convergence_states(model: ObservedModel, estimate: Estimate) -> tuple[ConvergenceState, ...]:
    """A row for each gauge of a convergence law, with 95 % intervals; none of other models.

    Args:
        model: of the case.
        estimate: the estimate.
    """
    if not isinstance(model, LawModel):
        return ()
    p = estimate.outcome.values
    lost, final = model.lost(p), model.final(p)
    columns = [_interval(estimate, numbers) for numbers in (lost, final, final - lost)]
    states = []
    for j, (channel, zero) in enumerate(zip(model.case.channels, model.rule.zero, strict=True)):
        (a, a_low, a_high), (b, b_low, b_high), (c, c_low, c_high) = (
            rows[j].tolist() for rows in columns
        )
        states.append(
            ConvergenceState(
                channel.name, channel.zero if zero else "", a, a_low, a_high, b, b_low, b_high,
                c, c_low, c_high, channel.unit, channel.dimension,
            )
        )  # fmt: skip
    return tuple(states)


def _interval(estimate: Estimate, numbers: Dual) -> Floats:
    """A value of each of l channels with the ends of its 95 % interval, SI, (l, 3)."""
    values, slopes = numbers.value, numbers.columns[:, 1:]
    band = predict_band(estimate.assessment, slopes, np.zeros(len(values)), None)
    return np.stack([values, values + band.lower95, values + band.upper95], axis=1)


def convergence_notes(states: Sequence[ConvergenceState]) -> tuple[str, ...]:
    """The same, a sentence for each gauge.

    Args:
        states: of the gauges.
    """
    notes = []
    for one in states:
        final = _words(one, one.final, one.final_lower95, one.final_upper95)
        if not one.zero:
            notes.append(f"convergence of {one.gauge}: in the end {final}")
            continue
        lost = _words(one, one.lost, one.lost_lower95, one.lost_upper95)
        shown = _words(one, one.shown, one.shown_lower95, one.shown_upper95)
        notes.append(
            f"convergence of {one.gauge}: {lost} lost before its first reading at '{one.zero}'; "
            f"in the end {final} in all, of which the gauge shows {shown}"
        )
    return tuple(notes)


def _words(of: ConvergenceState, value: float, lower: float, upper: float) -> str:
    unit = of.unit, of.dimension
    name = f" {shown_unit(*unit)}".rstrip()
    number, low, high = (f"{in_unit(x, *unit):.4g}" for x in (value, lower, upper))
    if not np.isfinite([lower, upper]).all():
        return f"{number}{name} (not determined)"
    return f"{number}{name} (95 %: {low} to {high}{name})"
