"""How far ahead a backtest looks: in a series of readings as far as the prediction does.

Of a few stages of construction the next one is what is asked. In a series of readings the next one
follows a day later, and is met by bands that fail a year ahead (theory 13.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.forward.ground.field import named_parameters
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.results.backtest import Horizon
from geoident.model.results.bands import Bands
from geoident.workflow.estimating.model_error import ENOUGH

SERIES = 6
"""Stages that were read from which on they are a series."""


@dataclass(frozen=True)
class Clock:
    """When the stages of a case end.

    Args:
        ends: (n_stages,) s, or numbers of the stages where the time of one is not known.
        dated: they are times.
    """

    ends: Floats
    dated: bool

    @classmethod
    def of(cls, case: Case) -> Clock:
        """That of a case."""
        ends = np.array([case.times.get(stage.name, np.nan) for stage in case.stages])
        dated = bool(np.isfinite(ends).all())
        return cls(ends if dated else np.arange(len(ends), dtype=np.float64), dated)

    def ahead(self, last: int) -> Floats:
        """(n_stages,) how long after one of them each ends."""
        return np.asarray(self.ends - self.ends[last])


def asked_ahead(case: Case, stages: Sequence[int]) -> float:
    """How far ahead of its fit a prediction looks, s or stages; 0 where the next stage counts.

    Args:
        case: with the stages that its fit uses, and those that come later.
        stages: numbers of those that were read.
    """
    if len(stages) < SERIES:
        return 0.0
    last = stages[-1]
    if case.fit.stages is not None:
        last = min(last, max(n for n, s in enumerate(case.stages) if s.name in case.fit.stages))
    return float(Clock.of(case).ahead(last).max())


def begin_of_test(case: Case, readings: ReadingTable, stages: Sequence[int]) -> int | None:
    """Number of the last stage to fit for a test that looks as far ahead as the prediction.

    Where no fit can, because the readings before are too few for a model error, the first that has
    enough. None where the next stage counts, or no fit has enough.

    Args:
        case: of the readings.
        readings: of which some are used.
        stages: numbers of the stages of these.
    """
    asked = asked_ahead(case, stages)
    if asked <= 0.0:
        return None
    number = {stage.name: n for n, stage in enumerate(case.stages)}
    used = np.array([number[stage] for _, stage in set(readings.used_pairs)])
    least = len(named_parameters(case)) + ENOUGH
    enough = [n for n in stages[:-1] if np.count_nonzero(used <= n) >= least]
    if not enough:
        return None
    clock = Clock.of(case)
    far = [n for n in enough if clock.ahead(n)[stages[-1]] >= asked]
    return max(far, default=min(enough))


def horizons_of(
    bands: Sequence[tuple[int, Bands]], stages: Sequence[int], clock: Clock
) -> tuple[Horizon, ...]:
    """How predictions came true by how far they looked ahead, in twice as many stages each time.

    Args:
        bands: the last fitted stage of each fit, and its predictions (n_channels, n_stages).
        stages: numbers of the stages that were read.
        clock: of the case.
    """
    if len(stages) < SERIES:
        return ()
    order = np.array(stages)
    rows: list[Horizon] = []
    first = 1
    while first < len(stages):
        last = min(2 * first - 1, len(stages) - 1)
        z: list[float] = []
        inside, time = 0, 0.0
        for begin, one in bands:
            ahead = order[order > begin][first - 1 : last]
            if not len(ahead):
                continue
            wanted = np.zeros(one.mean.shape, dtype=np.bool_)
            wanted[:, ahead] = True
            part = one.only(wanted)
            z += part.z[part.scored].tolist()
            inside += int(np.count_nonzero(part.inside))
            time = max(time, float(clock.ahead(begin)[ahead[-1]]))
        if z:
            rms = float(np.sqrt(np.mean(np.square(z))))
            rows.append(Horizon(first, last, time if clock.dated else np.nan, len(z), inside, rms))
        first *= 2
    return tuple(rows)
