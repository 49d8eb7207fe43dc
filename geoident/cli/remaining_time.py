"""How long a search may still take, told from how fast its steps shrink."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

_DONE = 1e-8
"""Step, in scaled parameters, at which a search counts as finished."""

_MOST = 100.0


@dataclass
class Pace:
    """Watches the iterations of a search.

    Args:
        max_time: seconds that the search may take at most, or None.
        clock: tells seconds.
    """

    max_time: float | None = None
    clock: Callable[[], float] = time.monotonic
    started: float = field(init=False)

    def __post_init__(self) -> None:
        self.started = self.clock()
        self._steps: list[float] = []

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return self.clock() - self.started

    def add(self, step: float) -> None:
        """An iteration with a step of this size is done."""
        self._steps.append(step)

    def remaining(self) -> float | None:
        """Seconds that are still to be expected; None where the steps do not shrink yet.

        The last two steps give the ratio by which they shrink, the iterations so far their time.
        """
        left = None if self.max_time is None else max(0.0, self.max_time - self.elapsed)
        iterations = self._iterations_left()
        if iterations is None:
            return left
        expected = iterations * self.elapsed / len(self._steps)
        return expected if left is None else min(expected, left)

    def _iterations_left(self) -> float | None:
        steps = [step for step in self._steps if step > 0.0 and math.isfinite(step)][-2:]
        if len(steps) < 2 or steps[1] >= steps[0]:
            return None
        return min(_MOST, max(0.0, math.log(_DONE / steps[1]) / math.log(steps[1] / steps[0])))


def clock_text(seconds: float) -> str:
    """A time for people.

    >>> clock_text(7.2), clock_text(75), clock_text(7300)
    ('7 s', '1 min 15 s', '2 h 01 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
