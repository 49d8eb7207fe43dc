"""How well predictions came true: coverage, sharpness, scores and their p-values (theory 13).

A prediction is a mean with a 95 % band. The band may be asymmetric: it is read as a normal density
in two pieces that meet at the mean, with the standard deviations

    s_- = (mean - lower95) / 1.96        s_+ = (upper95 - mean) / 1.96

so that 95 % of it lie inside the band, whatever its sides. A reading y has the standardized error
z = (y - mean) / s, with the s of its side.

All of it is arrays in, arrays out; NaN stands for what was not predicted or not read, and an
infinite band for a prediction that is not determined. Neither takes part in a score.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, fdtrc

from geoident.model.arrays import Floats
from geoident.model.results.backtest import Scores
from geoident.model.results.bands import NORMAL_95, Bands

DRAWS = 20000
"""Draws by which the chance of a coverage is found: 1 % is known within 0.15 %."""

_SEED = 13
"""Of these draws: the same input gives the same result."""


def scores(bands: Bands, accuracy: Floats, kinds: Sequence[str]) -> Scores:
    """Coverage, sharpness and scores of many predictions together; see `Scores`.

    Readings of different kinds (motions, stresses) have no common unit: widths are relative to the
    root mean square of the scored readings of their kind, densities are per accuracy.

    Args:
        bands: of the readings (m, ...), rows of one channel each.
        accuracy: (m, ...) stated standard deviation of each reading, or one that fits its shape.
        kinds: m dimensions of the channels.
    """
    scored = bands.scored
    count = int(np.count_nonzero(scored))
    size = _sizes(bands, kinds)
    with np.errstate(invalid="ignore", divide="ignore"):
        width = ((bands.upper95 - bands.lower95) / size)[scored]
        interval = (bands.interval_score / size)[scored]
        density = (bands.log_density + np.log(accuracy))[scored]
    return Scores(
        readings=count,
        open=int(np.count_nonzero(bands.open)),
        inside=int(np.count_nonzero(bands.inside)),
        rms=_mean(bands.z[scored] ** 2) ** 0.5,
        sharpness=_mean(width),
        interval_score=_mean(interval),
        log_score=_mean(density),
    )


def _mean(values: Floats) -> float:
    return float(np.mean(values)) if values.size else float("nan")


def _sizes(bands: Bands, kinds: Sequence[str]) -> Floats:
    """Root mean square of the scored readings of the kind of each (m, ...)."""
    size = np.full(bands.mean.shape, np.nan)
    for kind in dict.fromkeys(kinds):
        rows = np.array([other == kind for other in kinds], dtype=np.bool_)
        own = bands.measured[rows][bands.scored[rows]]
        size[rows] = np.sqrt(np.mean(own**2)) if own.size else np.nan
    return size


@dataclass(frozen=True)
class PValue:
    """How often bands that hold would look as bad by chance.

    Args:
        few: probability that as few readings, or fewer, are inside their bands.
        far: probability that the standardized errors are as large, or larger, altogether.
    """

    few: float
    far: float


@dataclass(frozen=True)
class Innovations:
    """Errors of what one fit has predicted of the next stage.

    Args:
        z: (l,) standardized errors.
        correlation: (l, l) of them.
        freedom: degrees of freedom from which accuracies were estimated; infinite for given ones.
    """

    z: Floats
    correlation: Floats
    freedom: float = float("inf")


def p_value(groups: Sequence[Innovations]) -> PValue:
    """How often bands that hold would look as bad as these.

    Errors of predictions made from one fit are correlated, since they share the errors of its
    parameters: so the number inside is not binomial. It is drawn. Predictions of the next stage
    made from fits that grow are independent from fit to fit: they are innovations. Where accuracies
    were estimated all errors of a fit are larger or smaller by what that estimate is wrong.

    Args:
        groups: what each fit has predicted.
    """
    groups = [one for one in groups if one.z.size]
    if not groups:
        return PValue(1.0, 1.0)
    random = np.random.default_rng(_SEED)
    inside, squares = np.zeros(DRAWS), np.zeros(DRAWS)
    for one in groups:
        values, vectors = np.linalg.eigh(one.correlation)  # which may be singular
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        drawn = random.standard_normal((DRAWS, len(one.z))) @ root.T
        if np.isfinite(one.freedom):
            wrong = random.chisquare(one.freedom, DRAWS) / one.freedom
            drawn /= np.sqrt(wrong)[:, None]
        inside += np.count_nonzero(np.abs(drawn) <= NORMAL_95, axis=1)
        squares += np.sum(drawn**2, axis=1)
    errors = np.concatenate([one.z for one in groups])
    seen = np.count_nonzero(np.abs(errors) <= NORMAL_95)
    few = (1.0 + np.count_nonzero(inside <= seen)) / (1.0 + DRAWS)
    far = (1.0 + np.count_nonzero(squares >= np.sum(errors**2))) / (1.0 + DRAWS)
    return PValue(float(few), float(far))


def joint_p_value(errors: Innovations) -> float:
    """How often errors of predictions that hold are as large altogether, each in its direction.

    With R their correlation, d^2 = z^T R^-1 z is chi-squared with l degrees of freedom; where
    accuracies were estimated from nu degrees of freedom, d^2 / l has the distribution F(l, nu).
    Unlike `p_value` it sees readings that contradict each other, each within its band.

    Args:
        errors: of l predictions made from one fit.
    """
    number = len(errors.z)
    if not number:
        return float("nan")
    values, vectors = np.linalg.eigh(errors.correlation)
    along = (vectors.T @ errors.z) ** 2 / np.maximum(values, _SINGULAR * values[-1])
    if np.isfinite(errors.freedom):
        return float(fdtrc(number, errors.freedom, along.sum() / number))
    return float(chdtrc(number, along.sum()))


_SINGULAR = 1e-9
"""Part of the largest eigenvalue of a correlation below which one is rounding."""

STEADY = 0.2
"""Least standard deviation of a change, as a part of that of the value before."""


def changes(x: Floats, variance: Floats) -> Floats:
    """Standardized changes (k - 1,) of an estimate as readings are added.

    With a right model, the change from a fit to one with more readings has the variance by which
    that of the estimate falls (Hausman 1978), and changes are independent. So these numbers are
    standard normal; if they are far larger, the estimate does not settle.

    Args:
        x: (k,) estimates, in the scale in which their errors are normal.
        variance: (k,) of them.
    """
    gained = np.maximum(variance[:-1] - variance[1:], STEADY**2 * variance[:-1])
    return np.asarray(np.diff(x) / np.sqrt(gained))
