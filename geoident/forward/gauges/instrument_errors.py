"""What gauges make of the motion by themselves: a ratio, an offset since the zero, and a drift.

A reading of channel a in state j, taken at time t, with the zero in state j0 at t0, is

    v = ratio G'_a (u_j - u_j0) + offset + drift (t - t0) + drift_per_stage n        for j after j0

with n the stages from the zero to the reading: those in the history of j that are not in that of
j0, so that load cases on the side do not count. The moments of a stage are one stage.

A channel that reads a value instead of a change has its offset in every reading, and its drift per
stage since the first stage.

All derivatives are exact: what is added is linear in its parameters, the ratio is a factor. Where
the time of a reading is not known, it is that of the end of its stage; without a date there, it is
NaN if the channel drifts in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.parameter import Values


@dataclass(frozen=True)
class ReadingPlaces:
    """Which channels were read, at which states, and when.

    Args:
        rows: (g,) numbers of the channels.
        states: (g,) numbers of the states.
        times: (g,) seconds since 1970; NaN for what is known of the stage.
    """

    rows: Ints
    states: Ints
    times: Floats

    @classmethod
    def of(
        cls, case: Case, pairs: Sequence[tuple[str, str]], times: Sequence[float | None]
    ) -> ReadingPlaces:
        """Of (channel, stage) pairs, and the times at which they were read, or none.

        Args:
            case: the case.
            pairs: channel and stage of every reading.
            times: when each was read; None for what is known of its stage; empty for all None.
        """
        channels = {channel.name: k for k, channel in enumerate(case.channels)}
        stages = {stage: k for k, stage in enumerate(case.stage_names)}
        days = [np.nan if time is None else time for time in times or [None] * len(pairs)]
        return cls(
            np.array([channels[c] for c, _ in pairs], dtype=np.int64),
            np.array([stages[s] for _, s in pairs], dtype=np.int64),
            np.array(days, dtype=np.float64),
        )

    def only(self, kept: Bools) -> ReadingPlaces:
        """Some of them, (g,)."""
        return ReadingPlaces(self.rows[kept], self.states[kept], self.times[kept])


class InstrumentErrors:
    """Ratios, offsets and drifts of the channels of a case.

    Args:
        case: channels, dates and readings.
        built_on: (n_states, n_states) see `ConstructionSequence.built_on`.

    Attributes:
        times: (n_states, n_channels) s, as `Case.times`, of the readings, of the ends of stages
            where nothing was read; NaN where that is not known.
    """

    def __init__(self, case: Case, built_on: Bools) -> None:
        # [i, j]: states, or stages, in the history of j that are not in that of i
        begins = np.array([True, *(not stage.goes_on for stage in case.stages)])
        missing = (~built_on).T.astype(np.int64)
        self._states_since = missing @ built_on.astype(np.int64)
        self._stages_since = missing @ (built_on & begins[:, None]).astype(np.int64)
        self._channels = case.channels
        zero = np.array([case.zero_of(channel) for channel in case.channels], np.int64)
        self._zero = zero
        ends = np.array([case.times.get(name, np.nan) for name in case.stage_names])
        self._start = ends[zero]
        self.times: Floats = np.repeat(ends[:, None], len(case.channels), axis=1)
        for place, times in _read_at(case).items():
            self.times[place] = np.mean(times)

    @property
    def none(self) -> bool:
        """Whether no channel adds anything."""
        return not any(c.offset or c.drift or c.drift_per_stage for c in self._channels)

    def scaled(self, table: Floats, values: Values, names: Sequence[str], rows: Ints) -> Floats:
        """Readings times the ratios of their channels.

        Args:
            table: (g, 1 + n) readings with derivatives by names, or (g, 1), SI.
            values: parameters by name, SI.
            names: the n of them by which to differentiate.
            rows: (g,) channels.
        """
        ratios = {k: c.ratio for k, c in enumerate(self._channels) if c.ratio is not None}
        if not ratios:
            return table
        table = np.array(table)
        for k, ratio in ratios.items():
            at = np.flatnonzero(rows == k)
            factor = ratio.columns(values, names if table.shape[1] > 1 else ())
            slopes = table[at, :1] * factor[1:]
            table[at] *= factor[0]
            table[at, 1:] += slopes
        return table

    def ratios(self, values: Values) -> Floats:
        """(n_channels,) the ratios at parameters by name, SI."""
        return np.array(
            [1.0 if c.ratio is None else c.ratio.columns(values, ())[0] for c in self._channels]
        )

    def not_added(self, rows: Ints) -> str | None:
        """Why some channels (g,) are not what they see and something more, a clause, or None."""
        names = [self._channels[k].name for k in rows.tolist() if self._channels[k].ratio]
        return f"gauge '{names[0]}' has a ratio" if names else None

    def added(self, values: Values, names: Sequence[str], read: ReadingPlaces) -> Floats:
        """What is added to some readings (g), SI, and its derivatives, (g, 1 + n).

        Args:
            values: parameters by name, SI.
            names: the n of them by which to differentiate.
            read: where and when.
        """
        rows, states = read.rows, read.states
        table = np.zeros((len(rows), 1 + len(names)))
        if self.none or not len(rows):
            return table
        known = np.where(np.isnan(read.times), self.times[states, rows], read.times)
        since = self._stages_since[self._zero[rows], states]
        later = self._states_since[self._zero[rows], states] > 0
        elapsed = known - self._start[rows]
        by_channel = np.argsort(rows, kind="stable")
        for own in np.split(by_channel, np.flatnonzero(np.diff(rows[by_channel])) + 1):
            channel = self._channels[rows[own[0]]]
            for scalar, factor in (
                (channel.offset, (later[own] | (not channel.is_zeroed)).astype(np.float64)),
                (channel.drift, elapsed[own]),
                (channel.drift_per_stage, since[own].astype(np.float64)),
            ):
                if scalar is not None:
                    table[own] += np.outer(factor, scalar.columns(values, names))
        return table


def _read_at(case: Case) -> dict[tuple[int, int], list[float]]:
    """State and channel to the times of its good readings, where they are known."""
    states = {name: n for n, name in enumerate(case.stage_names)}
    rows = {channel.name: n for n, channel in enumerate(case.channels)}
    times: dict[tuple[int, int], list[float]] = {}
    for reading in case.readings:
        if reading.time is not None and reading.value is not None and not reading.bad:
            place = states[reading.stage], rows[reading.channel]
            times.setdefault(place, []).append(reading.time)
    return times
