"""What a fitted convergence law says of each gauge: lost before its first reading, in the end."""

from __future__ import annotations

import numpy as np

from geoident.forward.external.convergence import LawModel
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.prediction_bands import predict_band
from geoident.model.dual import Dual
from geoident.model.gauges import Channel
from geoident.units import in_unit, shown_unit
from geoident.workflow.estimating.estimate import Estimate


def convergence_notes(model: ObservedModel, estimate: Estimate) -> tuple[str, ...]:
    """A sentence for each gauge of a convergence law, with 95 % intervals; none of other models.

    Args:
        model: of the case.
        estimate: the estimate.
    """
    if not isinstance(model, LawModel):
        return ()
    p = estimate.outcome.values
    lost, final = model.lost(p), model.final(p)
    rest = final - lost
    lost_words, final_words, rest_words = (
        _interval(model, estimate, numbers) for numbers in (lost, final, rest)
    )
    notes = []
    for j, channel in enumerate(model.case.channels):
        if not model.rule.zero[j]:
            notes.append(f"convergence of {channel.name}: in the end {final_words[j]}")
            continue
        notes.append(
            f"convergence of {channel.name}: {lost_words[j]} lost before its first reading at "
            f"'{channel.zero}'; in the end {final_words[j]} in all, of which the gauge shows "
            f"{rest_words[j]}"
        )
    return tuple(notes)


def _interval(model: LawModel, estimate: Estimate, numbers: Dual) -> list[str]:
    """A value of each channel with its 95 % interval, in the unit of the gauge."""
    values, slopes = numbers.value, numbers.columns[:, 1:]
    band = predict_band(estimate.assessment, slopes, np.zeros(len(values)), None)
    ends = np.stack([values, values + band.lower95, values + band.upper95], axis=1)
    pairs = zip(model.case.channels, ends.tolist(), strict=True)
    return [_words(channel, *row) for channel, row in pairs]


def _words(channel: Channel, value: float, lower: float, upper: float) -> str:
    unit = channel.unit, channel.dimension
    name = f" {shown_unit(*unit)}".rstrip()
    number, low, high = (f"{in_unit(x, *unit):.4g}" for x in (value, lower, upper))
    if not np.isfinite([lower, upper]).all():
        return f"{number}{name} (not determined)"
    return f"{number}{name} (95 %: {low} to {high}{name})"
