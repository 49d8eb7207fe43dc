"""Bands in which later readings are expected (theory 6.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.assessment.profile_path import Nonlinearity
from geoident.identify.assessment.uncertainty import Assessment
from geoident.model.arrays import Floats


@dataclass(frozen=True)
class Band:
    """Where l later readings are expected, from their predicted values, SI.

    Args:
        lower95: (l,) lower end of the 95 % band; -inf where not determined.
        upper95: (l,) upper end; inf where not determined.
        sd: (l,) root of the mean square deviation from the prediction; inf where not determined.
    """

    lower95: Floats
    upper95: Floats
    sd: Floats


def predict_band(
    assessment: Assessment,
    jacobian: Floats,
    sd: Floats,
    nonlinearity: Nonlinearity | None = None,
    wider: tuple[Floats, Floats] | None = None,
) -> Band:
    """Where later readings are expected.

    Args:
        assessment: how well the parameters are known.
        jacobian: (l, n) derivative of the later readings at the estimate, SI.
        sd: (l,) accuracy of the later readings, SI.
        nonlinearity: how they deviate from linear; None for not at all.
        wider: factors (l,), (l,) by which the ends are farther out, as accuracies were estimated;
            None where they are given.

    Returns:
        Infinite where the reading depends mainly on what is not determined.
    """
    rows = jacobian * assessment.dp_dx
    deviation = None if nonlinearity is None else nonlinearity.at_draws
    summary = assessment.posterior.summary(rows, sd, deviation=deviation)
    # not determined where the part of undetermined directions is larger than all the rest
    determined = np.sum((rows @ assessment.determined_x) ** 2, axis=1) + sd**2
    undetermined = np.sum((rows @ assessment.gaps_x) ** 2, axis=1) > determined
    if nonlinearity is not None and nonlinearity.undetermined:
        undetermined |= summary.shift_variance > summary.own_sd**2
    lower95, upper95 = summary.lower95, summary.upper95
    if wider is not None:
        lower95, upper95 = lower95 * wider[0], upper95 * wider[1]
    return Band(
        np.where(undetermined, -np.inf, np.minimum(lower95, 0.0)),
        np.where(undetermined, np.inf, np.maximum(upper95, 0.0)),
        np.where(undetermined, np.inf, summary.rms),
    )
