"""How well predictions came true: coverage, sharpness, scores, and what chance does (theory 13).

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

from geoident.model.arrays import Bools, Floats
from geoident.model.results.backtest import Backtest, BacktestStep, Scores
from geoident.model.results.result import NORMAL_95, Prediction

DRAWS = 20000
"""Draws by which the chance of a coverage is found: 1 % is known within 0.15 %."""

_SEED = 13
"""Of these draws: the same input gives the same result."""

_NARROW = 1e-9
"""Least standard deviation of a side, as a part of the other."""


@dataclass(frozen=True)
class Bands:
    """Predictions of readings and what was read.

    Args:
        measured: (...) what was read; NaN where nothing was.
        mean: (...) the prediction; NaN where nothing is predicted.
        lower95: (...) lower end of the band; infinite where the prediction is not determined.
        upper95: (...) its upper end.
    """

    measured: Floats
    mean: Floats
    lower95: Floats
    upper95: Floats

    @property
    def scored(self) -> Bools:
        """(...) where there are a reading and a band."""
        ends = np.isfinite(self.lower95) & np.isfinite(self.upper95)
        return np.asarray(ends & np.isfinite(self.mean) & np.isfinite(self.measured))

    @property
    def open(self) -> Bools:
        """(...) read, but the prediction is not determined."""
        known = np.isfinite(self.mean) & np.isfinite(self.measured)
        return np.asarray(known & ~self.scored)

    @property
    def inside(self) -> Bools:
        """(...) the reading lies inside its band."""
        within = (self.measured >= self.lower95) & (self.measured <= self.upper95)
        return np.asarray(within & self.scored)

    @property
    def sides(self) -> tuple[Floats, Floats]:
        """(...), (...) standard deviations below and above the mean."""
        below, above = self.mean - self.lower95, self.upper95 - self.mean
        least = _NARROW * (self.upper95 - self.lower95)
        return np.maximum(below, least) / NORMAL_95, np.maximum(above, least) / NORMAL_95

    @property
    def z(self) -> Floats:
        """(...) standardized errors of the prediction; NaN where it is not scored."""
        error, (below, above) = self.measured - self.mean, self.sides
        with np.errstate(invalid="ignore", divide="ignore"):
            z = error / np.where(error < 0.0, below, above)
        return np.where(self.scored, z, np.nan)

    @property
    def log_density(self) -> Floats:
        """(...) logarithm of the predicted density of the reading, per unit; NaN likewise."""
        below, above = self.sides
        with np.errstate(invalid="ignore", divide="ignore"):
            top = 0.5 * np.log(2.0 / np.pi) - np.log(below + above)
        return np.where(self.scored, top - 0.5 * self.z**2, np.nan)

    @property
    def interval_score(self) -> Floats:
        """(...) width, and 40 times what the reading is beyond it (Gneiting & Raftery 2007)."""
        low, high = self.lower95 - self.measured, self.measured - self.upper95
        with np.errstate(invalid="ignore"):
            beyond = np.maximum(low, 0.0) + np.maximum(high, 0.0)
            score = self.upper95 - self.lower95 + 2.0 / 0.05 * beyond
        return np.where(self.scored, score, np.nan)

    def only(self, part: Bools) -> Bands:
        """The same, nothing predicted but in a part (...)."""
        return Bands(self.measured, np.where(part, self.mean, np.nan), self.lower95, self.upper95)


def bands_of(found: Backtest, step: BacktestStep) -> Bands:
    """The predictions of a fit of a backtest beside what was read, (n_channels, n_stages)."""
    told = step.prediction
    return Bands(found.measured, told.mean, told.lower95, told.upper95)


def next_read(bands: Bands) -> Bools:
    """(n_channels, n_stages) the readings of the first stage that was predicted and read."""
    known = np.isfinite(bands.mean) & np.isfinite(bands.measured)
    stages = np.flatnonzero(known.any(axis=0))
    first = np.zeros(known.shape, dtype=np.bool_)
    if stages.size:
        first[:, stages[0]] = known[:, stages[0]]
    return first


def told_before(found: Backtest) -> Prediction:
    """Each reading of a backtest as the last fit before has predicted it, (n_channels, n_stages).

    ``sd`` is that of the side on which the reading is, so that (measured - mean) / sd is z; NaN
    where no fit came before.
    """
    parts = {name: np.full(found.measured.shape, np.nan) for name in _COLUMNS}
    for step in found.steps:
        bands = bands_of(found, step)
        at, (below, above) = next_read(bands), bands.sides
        sd = np.where(bands.scored, np.where(bands.measured < bands.mean, below, above), np.inf)
        for name, told in zip(
            _COLUMNS, (bands.mean, sd, bands.lower95, bands.upper95), strict=True
        ):
            parts[name][at] = told[at]
    return Prediction(**parts)


_COLUMNS = ("mean", "sd", "lower95", "upper95")


def scores(bands: Bands, accuracy: Floats, kinds: Sequence[str]) -> Scores:
    """What is said of many predictions together; see `Scores`.

    Readings of different kinds (motions, stresses) have no common unit: widths are relative to the
    root mean square of the scored readings of their kind, densities are per accuracy.

    Args:
        bands: of the readings (m, ...), rows of one channel each.
        accuracy: (m,) stated standard deviation of a reading of each channel.
        kinds: m dimensions of the channels.
    """
    scored = bands.scored
    count = int(np.count_nonzero(scored))
    size = _sizes(bands, kinds)
    unit = accuracy.reshape(-1, *(1,) * (bands.mean.ndim - 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        width = ((bands.upper95 - bands.lower95) / size)[scored]
        interval = (bands.interval_score / size)[scored]
        density = (bands.log_density + np.log(unit))[scored]
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
class Chance:
    """How often bands that hold would look as bad by chance.

    Args:
        few: probability that as few readings, or fewer, are inside their bands.
        far: probability that the standardized errors are as large, or larger, altogether.
    """

    few: float
    far: float

    @property
    def least(self) -> float:
        """The smaller of them."""
        return min(self.few, self.far)


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


def chance(groups: Sequence[Innovations]) -> Chance:
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
        return Chance(1.0, 1.0)
    random = np.random.default_rng(_SEED)
    inside, squares = np.zeros(DRAWS), np.zeros(DRAWS)
    for one in groups:
        drawn = random.standard_normal((DRAWS, len(one.z))) @ _root(one.correlation).T
        if np.isfinite(one.freedom):
            wrong = random.chisquare(one.freedom, DRAWS) / one.freedom
            drawn /= np.sqrt(wrong)[:, None]
        inside += np.count_nonzero(np.abs(drawn) <= NORMAL_95, axis=1)
        squares += np.sum(drawn**2, axis=1)
    errors = np.concatenate([one.z for one in groups])
    seen = np.count_nonzero(np.abs(errors) <= NORMAL_95)
    few = (1.0 + np.count_nonzero(inside <= seen)) / (1.0 + DRAWS)
    far = (1.0 + np.count_nonzero(squares >= np.sum(errors**2))) / (1.0 + DRAWS)
    return Chance(float(few), float(far))


def _root(R: Floats) -> Floats:
    """A with A A^T = R (l, l), which may be singular."""
    values, vectors = np.linalg.eigh(R)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


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
