"""What a backtest found: fits of the first stages, and what each of them said of the later ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.results.bands import Bands, Prediction, next_read
from geoident.model.results.columns import Record, column
from geoident.model.results.costs import Counts

_COLUMNS = ("mean", "sd", "lower95", "upper95")
"""Of a prediction."""


class Scores(Record):
    """How well predictions came true, all together (theory 13).

    Args:
        readings: how many were predicted with a band.
        open: how many more were read, but their prediction is not determined.
        inside: how many lie inside their 95 % bands.
        rms: root mean square of the standardized errors; 1 where the bands are right.
        sharpness: mean width of the bands, by the root mean square of the readings.
        interval_score: mean of the width and 40 times what a reading is beyond it, likewise: the
            smaller the better.
        log_score: mean of the logarithm of the predicted density of a reading, per stated accuracy:
            the larger the better.
    """

    readings: int = column(name="predicted", title="readings")
    open: int
    inside: int
    rms: float
    sharpness: float
    interval_score: float
    log_score: float

    @property
    def coverage(self) -> float:
        """The part of the readings that is inside; NaN without any."""
        return self.inside / self.readings if self.readings else float("nan")


class Horizon(Record):
    """How predictions of a series came true by how far they looked ahead.

    Args:
        first: how many read stages ahead, at least.
        last: at most.
        time: how long ahead the last of them was, s; NaN where the stages have no dates.
        readings: how many were predicted with a band.
        inside: how many lie inside their 95 % bands.
        rms: root mean square of the standardized errors.
    """

    first: int = column(name="stages_ahead")
    last: int = column(name="stages_ahead_at_most")
    time: float = column()
    readings: int = column()
    inside: int = column()
    rms: float = column()


@dataclass(frozen=True)
class Reach:
    """One fit whose predictions of a series look as far ahead as the prediction does.

    Args:
        step: number of the last stage that it fits.
        stages: how many read stages it looks ahead.
        far: how far the last of them is, in s, or in stages where these have no dates.
        asked: how far ahead the prediction looks, likewise.
        dated: both are in s.
        readings: how many were predicted with a band.
        inside: how many lie inside their 95 % bands.
        rms: root mean square of the standardized errors.
        few: probability that bands that hold leave so few inside.
        large: probability that standardized errors are then as large.
        independent: how many independent readings say as much.
    """

    step: int
    stages: int
    far: float
    asked: float
    dated: bool
    readings: int
    inside: int
    rms: float
    few: float
    large: float
    independent: float


class BacktestStep(Record):
    """A fit of the readings up to a stage, and what it says of later stages.

    Args:
        last: number of the last stage with fitted readings, in the stages of the result.
        readings: how many it was fitted to.
        status: how the search ended, as of a fit.
        reason: why.
        values: (n,) parameters, SI; kept also where they are not determined.
        sd: (n,) their standard deviations; NaN where not determined.
        lower95, upper95: (n,) ends of their 95 % intervals.
        determined: (n,) readings or priors determine it.
        prediction: of the later stages, (n_channels, n_stages); NaN where nothing is predicted.
        log_density: (n_channels, n_stages) logarithm of the predicted density of what was read, per
            SI unit; NaN where there is none.
        excess: (n_stages,) by how much, relative, computed stresses of a later stage exceed those
            of the fitted ones; NaN where that is not known.
        counts: what this fit and its predictions have cost.
    """

    last: int
    readings: int
    status: str
    reason: str
    values: Floats = column(
        "parameter",
        name="parameter_value",
        title="value",
        dimension="parameter",
        known="determined",
    )
    sd: Floats = column("parameter", name="parameter_sd", title="sd", dimension="parameter")
    lower95: Floats = column(
        "parameter", name="parameter_lower95", title="lower95", dimension="parameter"
    )
    upper95: Floats = column(
        "parameter", name="parameter_upper95", title="upper95", dimension="parameter"
    )
    determined: Bools = column("parameter")
    prediction: Prediction = column()
    log_density: Floats = column("gauge", "stage")
    excess: Floats = column("stage", name="stress_excess")
    counts: Counts = column()


class Skipped(Record):
    """A stage up to which no fit was made.

    Args:
        stage: its name.
        why: a clause.
    """

    stage: str = column(name="skipped", title="stage")
    why: str = column(name="why_skipped", title="why")


class Backtest(Record):
    """Fits of the first stages and their predictions.

    Args:
        steps: one for each fit, in the order of their last stages.
        skipped: the fits that could not be made.
        next: scores of the next stage that was read.
        further: scores of all stages after that.
        few: probability that bands that hold leave so few readings of next stages inside.
        far: probability that standardized errors are then as large.
        measured: (n_channels, n_stages) readings that predictions are compared with, SI.
        horizons: of a series, how predictions came true by how far they looked ahead.
        reach: of a series, the test that looks as far ahead as the prediction; None where the next
            stage is what counts, or no fit can look ahead so.
    """

    steps: tuple[BacktestStep, ...] = column("fit")
    skipped: tuple[Skipped, ...] = column("skipped")
    next: Scores = column(part=("horizon", "next"))
    further: Scores = column(part=("horizon", "further"))
    few: float
    far: float
    measured: Floats = column("gauge", "stage", dimension="gauge")
    horizons: tuple[Horizon, ...] = column("ahead", default=(), group="horizons", optional=True)
    reach: Reach | None = column(default=None, group="reach", optional=True)


def bands_of(backtest: Backtest, step: BacktestStep) -> Bands:
    """The predictions of a fit of a backtest beside what was read, (n_channels, n_stages)."""
    prediction = step.prediction
    return Bands(backtest.measured, prediction.mean, prediction.lower95, prediction.upper95)


def predicted_before(backtest: Backtest) -> Prediction:
    """Each reading of a backtest as the last fit before has predicted it, (n_channels, n_stages).

    ``sd`` is that of the side on which the reading is, so that (measured - mean) / sd is z; NaN
    where no fit came before.
    """
    parts = {name: np.full(backtest.measured.shape, np.nan) for name in _COLUMNS}
    for step in backtest.steps:
        bands = bands_of(backtest, step)
        at, (below, above) = next_read(bands), bands.sides
        sd = np.where(bands.scored, np.where(bands.measured < bands.mean, below, above), np.inf)
        for name, values in zip(
            _COLUMNS, (bands.mean, sd, bands.lower95, bands.upper95), strict=True
        ):
            parts[name][at] = values[at]
    return Prediction(**parts)
