"""What is known of the gauges of a structure in service, each by itself."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.columns import ROW, Record, column, derived
from geoident.units import in_unit, shown_unit

_DATE = {"unit": "s since 1970-01-01", "dated": True}


class SeasonalFit(Record):
    """Coefficients and errors of all gauges, one entry of every column each.

    NaN where a gauge has too few readings, or where its readings cannot tell a term from others.

    Args:
        terms: names of the q terms, ``constant`` first.
        effects: to which effect each belongs: ``level``, ``season``, ``air``, ``temperature``,
            ``creep`` or ``irreversible``; empty for a constant, and for parameters that all gauges
            share.
        coefficients: (n_gauges, q) in the unit of the gauge, by K for the air, by year for
            ``linear``.
        covariance: (n_gauges, q + 2, q + 2) of the coefficients and, last, of the lasting error and
            the drift at the last reading.
        lasting_now: (n_gauges,) that lasting error.
        drift_now: (n_gauges,) that drift.
        number: (n_gauges,) readings that were used.
        last: (n_gauges,) when the last of them was taken, s since 1970.
        white: (n_gauges,) error that each reading has by itself.
        lasting: (n_gauges,) standard deviation of the error that lasts.
        fades: (n_gauges,) time in which that fades to 1/e, s.
        drift: (n_gauges,) standard deviation of what the drift, a random walk, adds in a year.
        likely_noises: (n_gauges, k, 4) white, lasting, fades and drift of noises that the readings
            leave possible, as often as they are likely.
        level_low: level from which it counts, m; NaN where there is no effect of it.
        level_high: level at which it counts as 1, m.
        air_mean: air temperature from which it counts, K.
        level: (n_gauges,) range of the readings that the level causes.
        level_sd: (n_gauges,) its standard deviation.
        season, season_sd: likewise the season.
        air, air_sd: likewise the air temperature.
        irreversible: (n_gauges,) motion between the first reading and the last that does not come
            back.
        irreversible_sd: (n_gauges,) its standard deviation.
        explained: (n_gauges,) part of the variance of the readings that the effects explain.
        temperature, temperature_sd: like ``air``, of the temperature of a structure on its mesh;
            None where there is no mesh.
        creep, creep_sd: like ``irreversible``, of materials that creep, age or soften on a mesh;
            None where none does.
    """

    terms: tuple[str, ...] = column("term", name="term")
    effects: tuple[str, ...] = column("term", name="effect")
    coefficients: Floats = column("gauge", "term", dimension="gauge", sheet="coefficient {term}")
    covariance: Floats = column("gauge", "state", "other_state", hidden=("csv",))
    lasting_now: Floats = column("gauge", dimension="gauge")
    drift_now: Floats = column("gauge", dimension="gauge")
    number: Ints = column("gauge")
    last: Floats = column("gauge", unit="s since 1970-01-01", hidden=("csv", "json", "diff"))
    white: Floats = column("gauge", dimension="gauge")
    lasting: Floats = column("gauge", dimension="gauge")
    fades: Floats = column("gauge", dimension="time", shown="d")
    drift: Floats = column("gauge", dimension="gauge")
    likely_noises: Floats = column(
        "gauge", "draw", "part of the noise", hidden=("csv", "json", "diff")
    )
    level_low: float
    level_high: float
    air_mean: float
    level: Floats = column("gauge", dimension="gauge")
    level_sd: Floats = column("gauge", dimension="gauge")
    season: Floats = column("gauge", dimension="gauge")
    season_sd: Floats = column("gauge", dimension="gauge")
    air: Floats = column("gauge", dimension="gauge")
    air_sd: Floats = column("gauge", dimension="gauge")
    irreversible: Floats = column("gauge", dimension="gauge")
    irreversible_sd: Floats = column("gauge", dimension="gauge")
    explained: Floats = column("gauge")
    temperature: Floats | None = column("gauge", default=None, dimension="gauge", optional=True)
    temperature_sd: Floats | None = column("gauge", default=None, dimension="gauge", optional=True)
    creep: Floats | None = column("gauge", default=None, dimension="gauge", optional=True)
    creep_sd: Floats | None = column("gauge", default=None, dimension="gauge", optional=True)

    @property
    def shared(self) -> Ints:
        """Numbers of the terms that are parameters of all gauges, as far as they are known."""
        parameters = np.flatnonzero(np.array(self.effects) == "")[1:]
        known = np.isfinite(self.coefficients[:, parameters]).any(axis=0)
        return np.asarray(parameters[known])

    @property
    @derived("gauge", dimension="gauge")
    def scatter(self) -> Floats:
        """(n_gauges,) standard deviation of a reading about what the effects explain."""
        return np.hypot(self.white, self.lasting)


class Judged(Record):
    """Readings that took no part in a fit, each held against what was expected before it was taken.

    NaN for all other readings.

    Args:
        predicted: (k,) what each was expected to be, SI.
        predicted_sd: (k,) standard deviation of that with a reading's errors, SI.
        innovation: (k,) reading less prediction in these: of variance one, and independent, as long
            as the structure and its gauges are what they were.
    """

    predicted: Floats = column("reading", dimension="gauge")
    predicted_sd: Floats = column("reading", dimension="gauge")
    innovation: Floats = column("reading")


class ChangeRow(Record):
    """A change that new readings show: of one gauge, or of several at once.

    Args:
        change: number of the change, from 1: of several gauges there is a row for each.
        kind: ``step``, ``drift``, or ``reading`` for a single one that is far off.
        gauge: name of the gauge of this row.
        since: when it most likely began, s since 1970.
        earliest: beginning of the 95 % interval of that.
        latest: end of it.
        shown: from when on it was seen.
        size: of the step, SI; of a drift by year.
        sd: its standard deviation.
        odds: probability that it is a step and no drift, or a drift and no step.
        surprise: -log10 of the probability that chance does as much.
        lasts: the last reading still shows it.
        unit: in which people see the readings.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    change: int
    kind: str
    gauge: str
    since: float = column(like=_DATE)
    earliest: float = column(like=_DATE)
    latest: float = column(like=_DATE)
    shown: float = column(like=_DATE)
    size: float = column(dimension=ROW, unit="SI unit of the gauge")
    sd: float = column(dimension=ROW, unit="SI unit of the gauge")
    odds: float
    surprise: float
    lasts: bool
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))

    @property
    def text(self) -> str:
        """Its size with the 95 % interval and the unit; of a single reading without interval."""
        size, half = (
            in_unit(x, self.unit, self.dimension) for x in (self.size, NORMAL_95 * self.sd)
        )
        places = max(0, 1 - int(np.floor(np.log10(half)))) if half > 0.0 else 3
        interval = "" if self.kind == "reading" else f" ± {half:.{places}f}"
        rate = " a year" if self.kind == "drift" else ""
        return (
            f"{size:+.{places}f}{interval} {shown_unit(self.unit, self.dimension)}".rstrip() + rate
        )


class ParameterChangeRow(Record):
    """A parameter of a structure on its mesh that has changed, or that may have as well.

    Args:
        change: number of the change, from 1: of several parameters that cannot be told apart there
            is a row for each, the most probable one first.
        parameter: its name.
        gauges: names of those that show it.
        since: when it most likely began, s since 1970.
        earliest: beginning of the 95 % interval of that.
        latest: end of it.
        shown: from when on it was seen.
        before: value of the fit, SI.
        after: value since then, SI.
        lower95: lower end of the 95 % interval of that, before being given.
        upper95: upper end.
        odds: probability that it is this parameter, and no other one and no change of gauges.
        surprise: -log10 of the probability that chance does as much.
        lasts: the last reading still shows it.
        unit: in which people see the parameter.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    change: int
    parameter: str
    gauges: str
    since: float = column(like=_DATE)
    earliest: float = column(like=_DATE)
    latest: float = column(like=_DATE)
    shown: float = column(like=_DATE)
    before: float = column(dimension=ROW, unit="SI unit of the parameter")
    after: float = column(dimension=ROW, unit="SI unit of the parameter")
    lower95: float = column(dimension=ROW, unit="SI unit of the parameter")
    upper95: float = column(dimension=ROW, unit="SI unit of the parameter")
    odds: float
    surprise: float
    lasts: bool
    unit: str = column(dimension=ROW, name="display_unit", title="unit")
    dimension: str = column(hidden=("csv", "json"))

    @property
    def text(self) -> str:
        """By how much it fell or rose, with the 95 % interval: ``fell by 22 % (15 to 30 %)``."""
        way = "fell" if self.after < self.before else "rose"
        sign = np.sign(self.after - self.before) or 1.0
        of = in_unit(1.0, self.unit, self.dimension) if not self.before else 100 / abs(self.before)
        unit = "%" if self.before else shown_unit(self.unit, self.dimension)
        size, *ends = (
            float(sign * of * (x - self.before)) for x in (self.after, self.lower95, self.upper95)
        )
        low, high = sorted(ends)
        places = max(0, 1 - int(np.floor(np.log10(max(high - low, 1e-12)))))
        places = min(places, 1 if self.before else 3)
        return f"{way} by {size:.{places}f} {unit} ({low:.{places}f} to {high:.{places}f} {unit})"


class PowerRow(Record):
    """Whether a change would be seen, and how late.

    Args:
        change: in words.
        gauges: that it concerns.
        probability: that it is seen within the horizon, 0 to 1.
        median: time after which half of such changes are seen, s; NaN if fewer are within it.
        late: time after which 90 % of them are.
        horizon: time that is looked ahead, s.
    """

    change: str
    gauges: str
    probability: float
    median: float = column(dimension="time", shown="d")
    late: float = column(dimension="time", shown="d")
    horizon: float = column(dimension="time", shown="d")
