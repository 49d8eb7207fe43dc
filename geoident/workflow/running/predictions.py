"""What the gauges will show at stages that took no part in the fit, and how well that came true."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.protocols import Survey
from geoident.identify.assessment.uncertainty import Assessment, predict_band
from geoident.model.arrays import Bools, Floats
from geoident.model.result import NORMAL_95, GaugeTable, Prediction


def predicted_stages(gauges: GaugeTable) -> Bools:
    """(n_stages,) the stages of which no reading was used."""
    return np.asarray(~np.any(gauges.used, axis=0), dtype=np.bool_)


def chosen_stages(gauges: GaugeTable, names: Sequence[str]) -> Bools:
    """(n_stages,) the stages of these names."""
    return np.array([stage in names for stage in gauges.stages], dtype=np.bool_)


def predict_stages(
    survey: Survey, assessment: Assessment, accuracy: Floats, stages: Bools
) -> Prediction:
    """Bands of the computed readings at the given stages.

    Args:
        survey: the model at the estimate; its readings are NaN where a channel cannot be read.
        assessment: how well the parameters are known.
        accuracy: (n_channels, n_stages) standard deviation of a reading, SI; NaN for no prediction.
        stages: (n_stages,) the stages to predict.
    """
    computed = survey.computed
    wanted = np.isfinite(computed) & np.isfinite(accuracy) & stages[None, :]
    mean = np.where(wanted, computed, np.nan)
    sd = np.full(computed.shape, np.nan)
    sd[wanted] = predict_band(assessment, survey.sensitivity[wanted], accuracy[wanted])
    return Prediction(mean, sd, mean - NORMAL_95 * sd, mean + NORMAL_95 * sd)


def score(gauges: GaugeTable, prediction: Prediction) -> tuple[str, ...]:
    """One sentence for every predicted stage that was read: how well the prediction came true."""
    sentences = []
    measured = np.where(gauges.bad, np.nan, gauges.measured)  # without those known to be wrong
    within = (measured >= prediction.lower95) & (measured <= prediction.upper95)
    for column, stage in enumerate(gauges.stages):
        error = measured[:, column] - prediction.mean[:, column]
        sd = prediction.sd[:, column]
        read = np.isfinite(error) & np.isfinite(sd)
        if np.any(read):
            inside = within[read, column]
            rms = float(np.sqrt(np.mean((error[read] / sd[read]) ** 2)))
            sentences.append(
                f"Predicted stage {stage!r}: {np.count_nonzero(inside)} of {inside.size} readings"
                f" inside the 95 % band ({100 * np.mean(inside):.0f} %),"
                f" RMS of the standardized residuals {rms:.2f}."
            )
    return tuple(sentences)


def collapse_findings(survey: Survey) -> tuple[str, ...]:
    """One sentence for every stage that the ground does not survive at the estimate."""
    return tuple(
        f"With these parameters, {sentence}. Nothing is predicted from there on."
        for sentence in survey.collapses
    )
