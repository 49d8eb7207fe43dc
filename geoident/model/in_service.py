"""A structure in service: what acts on it day by day, and what its gauges make of that."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geoident.model.actions import HeadLine
from geoident.model.arrays import Floats
from geoident.model.parameter import Scalar

DAY = 86400.0  # s
YEAR = 365.25 * DAY


@dataclass(frozen=True)
class Series:
    """A quantity that acts on the structure over time, such as the level of the reservoir.

    Args:
        name: of the load.
        path: of the file that it is from.
        times: (m,) s since 1970, increasing.
        values: (m,) SI.
        bridge: longest gap between two values, s, over which it is known in between, linearly.
    """

    name: str
    path: str
    times: Floats = field(compare=False)
    values: Floats = field(compare=False)
    bridge: float

    def at(self, times: Floats) -> Floats:
        """Its values (k,) at some times, s; NaN before, after and within gaps."""
        values = np.interp(times, self.times, self.values, left=np.nan, right=np.nan)
        values[self._is_unknown(times)] = np.nan
        return np.asarray(values)

    def _is_unknown(self, times: Floats) -> Floats:
        """(k,) whether times are inside a gap that is too long."""
        right = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        long = self.times[right] - self.times[right - 1] > self.bridge
        inside = (times > self.times[right - 1]) & (times < self.times[right])
        return np.asarray(long & inside)

    def lagged(self, times: Floats, lag: float) -> Floats:
        """What a body of a response time ``lag``, s, makes of it: w' = (value - w) / lag.

        Exact for values that are linear in between. The body begins at the mean of the first year.
        NaN where the series is, and where a gap that is too long lies within five lags before.

        Args:
            times: (k,) s.
            lag: response time, s.
        """
        t, v = self.times, self.values
        step = np.diff(t) / lag
        left = np.exp(-step)
        # of a ramp from v0 to v1: w1 = left w0 + (1 - left) v0 + (1 - (1 - left) / step) (v1 - v0)
        rise = 1.0 - np.divide(1.0 - left, step)
        w = np.empty(len(t))
        w[0] = v[t <= t[0] + YEAR].mean()
        for k in range(1, len(t)):
            e = left[k - 1]
            w[k] = e * w[k - 1] + (1.0 - e) * v[k - 1] + rise[k - 1] * (v[k] - v[k - 1])
        known = self.at(times)
        after = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 1)
        since = np.maximum((times - t[after]) / lag, 0.0)
        left = np.exp(-since)
        part = np.where(since > 0.0, 1.0 - (1.0 - left) / np.where(since > 0.0, since, 1.0), 0.0)
        value = left * w[after] + (1.0 - left) * v[after] + part * (known - v[after])
        for start, end in self.gaps:
            value[(times > start) & (times < end + 5.0 * lag)] = np.nan
        return np.asarray(value)

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Beginning and end, s, of the gaps that are too long to be bridged."""
        far = np.flatnonzero(np.diff(self.times) > self.bridge)
        return [(float(self.times[k]), float(self.times[k + 1])) for k in far]


@dataclass(frozen=True)
class TimeCurve:
    """What grows with the time t under load.

    It is share (1 - exp(-t / time)), or share log(1 + t / time).

    Args:
        share: of the elastic strain, or of the modulus.
        time: s.
        law: whether it ends, or goes on with the logarithm.
    """

    share: Scalar
    time: Scalar
    law: Literal["exponential", "logarithmic"] = "exponential"

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        return self.share, self.time


@dataclass(frozen=True)
class SeasonalModel:
    """Readings as a sum of effects of level, season, air temperature and time (theory 16.1).

    Args:
        since: when the effects of time begin, s since 1970.
        level: series of the level; None for no effect of it.
        powers: highest power of the level.
        harmonics: of the year; 0 for none.
        air: series of the air temperature; None for no effect of it.
        lags: response times, s, one effect of the air for each.
        linear: whether there is a motion that goes on.
        settling: times, s, in which motions fade.
    """

    since: float
    level: Series | None = None
    powers: int = 0
    harmonics: int = 0
    air: Series | None = None
    lags: tuple[float, ...] = ()
    linear: bool = False
    settling: tuple[float, ...] = ()

    @property
    def inputs(self) -> tuple[str, ...]:
        """Paths of all files that the model consists of."""
        series = (self.level, self.air)
        return tuple(dict.fromkeys(one.path for one in series if one is not None))

    @property
    def words(self) -> tuple[str, ...]:
        """The effects in words."""
        given = {
            "level": self.powers,
            "season": self.harmonics,
            "air temperature": self.lags,
            "time": self.linear or self.settling,
        }
        return tuple(word for word, is_given in given.items() if is_given)

    @property
    def series(self) -> tuple[Series, ...]:
        """All that acts."""
        return tuple(one for one in (self.level, self.air) if one is not None)


@dataclass(frozen=True)
class ReservoirFormula:
    """Temperature of a reservoir by depth and season (theory 16.7).

    Zhu Bofang, Prediction of water temperature in deep reservoirs, Dam Engineering 8 (1997).

    Args:
        depth: of the reservoir, m.
        surface: mean of a year at its surface, degC.
        bottom: mean of a year at its bottom, degC.
        amplitude: of the year at the surface, K.
        warmest: when the air is warmest, s after the beginning of a year.
    """

    depth: float
    surface: float
    bottom: float
    amplitude: float
    warmest: float

    def at(self, times: Floats, depths: Floats) -> Floats:
        """Temperatures (k, m), degC, at times (k,), s since 1970, and depths (m,) or (k, m), m."""
        fall = np.exp(-_MEAN_FALLS * self.depth)
        limit = (self.bottom - self.surface * fall) / (1.0 - fall)
        mean = limit + (self.surface - limit) * np.exp(-_MEAN_FALLS * depths)
        late = _MONTH * (_LATEST - _SOONER * np.exp(-_LAG_FALLS * depths))
        since = times[:, None] - self.warmest - late
        swing = self.amplitude * np.exp(-_SWING_FALLS * depths)
        return np.asarray(mean + swing * np.cos(2.0 * np.pi / YEAR * since))


_MONTH = YEAR / 12.0
_MEAN_FALLS, _SWING_FALLS, _LAG_FALLS = 0.040, 0.018, 0.085
"""Of Zhu's formula, 1/m: of the mean, the amplitude and the lag."""

_LATEST, _SOONER = 2.15, 1.30
"""Of Zhu's formula, months: lag behind the air at great depth, and by how much less above."""


@dataclass(frozen=True)
class Uplift:
    """Pressure of water under or in the structure, which follows the level of the reservoir.

    Args:
        falls: how the level falls from that of the reservoir.
        on: groups of faces on which it acts.
        pores: groups of elements in whose pores it is.
    """

    falls: HeadLine
    on: tuple[str, ...] = ()
    pores: tuple[str, ...] = ()


@dataclass(frozen=True)
class StructureInService:
    """What acts on a finite element model from its last stage on (theory 16.7).

    Args:
        since: when the service begins, s since 1970.
        wetted: groups of faces in front of which the water stands.
        in_air: groups of faces in the air.
        constant: groups of faces whose temperature does not change.
        film: coefficient of the faces in the air, W/m2K; None: they have its temperature.
        level: series of the level; None for no water.
        air: series of the air temperature, degC; None: temperatures do not change.
        water: temperature of the water; None for no water, or no temperatures.
        linear: whether every gauge may have a motion that goes on.
        settling: times, s, in which motions of every gauge fade.
        loaded: when the sustained loads began to act, s since 1970; None: when the service began.
        uplift: pressures that follow the level.
    """

    since: float
    wetted: tuple[str, ...] = ()
    in_air: tuple[str, ...] = ()
    constant: tuple[str, ...] = ()
    film: Scalar | None = None
    level: Series | None = None
    air: Series | None = None
    water: Series | ReservoirFormula | None = None
    linear: bool = False
    settling: tuple[float, ...] = ()
    loaded: float | None = None
    uplift: tuple[Uplift, ...] = ()

    @property
    def inputs(self) -> tuple[str, ...]:
        """Paths of the files of all that acts."""
        return tuple(dict.fromkeys(one.path for one in self.series))

    @property
    def series(self) -> tuple[Series, ...]:
        """All that acts by series."""
        return tuple(one for one in (self.level, self.air, self.water) if isinstance(one, Series))
