"""Where readings lie in the table of a model: channels, states and times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case


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
        channels, stages = [channel.name for channel in case.channels], case.stage_names
        given = [np.nan if time is None else time for time in times or [None] * len(pairs)]
        return cls(
            np.array([channels.index(c) for c, _ in pairs], dtype=np.int64),
            np.array([stages.index(s) for _, s in pairs], dtype=np.int64),
            np.array(given, dtype=np.float64),
        )

    def only(self, kept: Bools) -> ReadingPlaces:
        """Some of them, (g,)."""
        return ReadingPlaces(self.rows[kept], self.states[kept], self.times[kept])
