"""When the states of a result are, where stages last."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.case import VIRGIN, Case
from geoident.model.gauges import DAY
from geoident.model.results.columns import Record, column

_APART = 1e-6
"""Part of the whole time by which states that follow at once are apart in a series of pictures."""


class StageTimes(Record):
    """When the stages of a result end, and the moments of those that last are.

    Args:
        whole: name of the stage of which each is the end or a moment.
        date: (n_stages,) seconds since 1970; NaN without dates.
        elapsed: (n_stages,) time since the case began, s: since the first stage that lasts.
        since: (n_stages,) time since its stage began, s; NaN for stages that do not last.
    """

    whole: tuple[str, ...] = column("stage", title="moment_of", array="whole", sheet="moment of")
    date: Floats = column("stage", unit="s since 1970-01-01", dated=True)
    elapsed: Floats = column("stage", dimension="time", shown="d", sheet="since the beginning")
    since: Floats = column("stage", dimension="time", shown="d", sheet="since its stage began")

    @classmethod
    def of(cls, case: Case) -> StageTimes | None:
        """Those of a case; None where no stage lasts."""
        if not case.lasts:
            return None
        times = np.array([case.times.get(stage.name, np.nan) for stage in case.stages])
        begin = case.times.get(VIRGIN, np.nan)
        if not np.isfinite(begin):
            first = [time - (s.at or 0.0) for s, time in zip(case.stages, times, strict=True)]
            begin = np.nanmin(first) if np.isfinite(first).any() else np.nan
        return cls(
            whole=tuple(stage.whole for stage in case.stages),
            date=times if case.dates else np.full(len(times), np.nan),
            elapsed=times - begin,
            since=np.array([np.nan if s.at is None else s.at for s in case.stages]),
        )

    def ends(self, stages: Sequence[str]) -> Bools:
        """(n_stages,) which are ends of stages; the others are moments of them."""
        return np.array([a == b for a, b in zip(stages, self.whole, strict=True)], dtype=np.bool_)

    @property
    def series(self) -> Floats | None:
        """(1 + n_stages,) days of all states, the virgin state first, for a series of pictures.

        They increase, by a little where no time passes. The end of all flow, which has no time,
        comes a tenth of the whole later. None where they cannot increase: a stage begins before
        the one ahead of it ends.
        """
        days = np.concatenate([[0.0], self.elapsed]) / DAY
        known = int(np.isfinite(days).cumprod().sum())
        days[known:] = days[known - 1] * (1.0 + 0.1 * np.arange(1, len(days) - known + 1))
        steps = np.diff(days)
        if not days[known - 1] or (steps < 0.0).any():
            return None
        least = _APART * max(float(days[-1]), 1e-3)
        return np.concatenate([[0.0], np.cumsum(np.maximum(steps, least))])
