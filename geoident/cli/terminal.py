"""What a command says while it works: to stderr, with a live line where that is a terminal.

How long a search may still take is told from how fast its steps shrink.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import click
from rich.console import Console
from rich.text import Text

from geoident.cli.options import Options
from geoident.model.parameter import Parameter
from geoident.model.results.result import Iteration
from geoident.report.text.parameters import iteration_text
from geoident.workflow.running.control import Monitor

_EYE = 0.1
"""Seconds between updates of the live line within an iteration."""

_DONE = 1e-8
"""Step, in scaled parameters, at which a search counts as finished."""

_MOST = 100.0


class Terminal(Monitor):
    """The monitor of commands that run at a terminal or under a script.

    Args:
        options: how much to say.
        parameters: those that iterations tell the values of.
    """

    def __init__(self, options: Options, parameters: tuple[Parameter, ...] = ()) -> None:
        self._options = options
        self._parameters = parameters
        self._status: Any = None
        self._pace = Pace(options.max_time)
        self._step = ""
        self._stage = ""
        self._shown = -1.0

    def warn(self, message: str) -> None:
        """Said even when quiet."""
        self._say(f"warning: {message}")

    def inform(self, message: str) -> None:
        """Said unless quiet."""
        if not self._options.quiet:
            self._say(message)

    def detail(self, message: str) -> None:
        """Said when verbose."""
        if self._options.verbose:
            self._say(message)

    def step(self, iteration: Iteration) -> None:
        """One iteration: a line when verbose, else the live line."""
        line = iteration_text(iteration, self._parameters)
        self._pace.add(iteration.step)
        self._step, self._stage = line, ""
        if self._status is not None:
            self._refresh()
        else:
            self.detail(f"{line}, step {iteration.step:.1e}")

    def part(self, words: str, done: float) -> None:
        """A part of a long computation is done: on the live line, else a line when verbose.

        Args:
            words: what has been reached.
            done: share of the whole, 0 to 1.
        """
        self._pace.done = done
        self._step, self._stage = words, ""
        if self._status is None:
            self.detail(words)
        elif self._pace.elapsed - self._shown > _EYE:
            self._refresh()

    def stage(self, name: str, number: int, total: int) -> None:
        """A stage is computed: on the live line, not more often than eyes can follow.

        Args:
            name: of the stage.
            number: of the stage, 0 for the initial state.
            total: number of the last one.
        """
        self._stage = f"stage {number} of {total}, {name}" if number else ""
        if self._status is not None and self._pace.elapsed - self._shown > _EYE:
            self._refresh()

    def _refresh(self) -> None:
        self._shown = self._pace.elapsed
        self._status.update(self)

    def __rich__(self) -> Text:
        """The live line now: a terminal asks several times a second, so its clock goes evenly."""
        remaining = self._pace.remaining()
        words = [self._step, self._stage, clock_text(self._pace.elapsed)]
        words += [] if remaining is None else [f"about {about_text(remaining)} left"]
        text = " | ".join(word for word in words if word)
        return Text(text, no_wrap=True, overflow="ellipsis")  # brackets are no markup

    @contextmanager
    def live(self, title: str) -> Iterator[None]:
        """Show a live line meanwhile, on a terminal and unless verbose or quiet."""
        if self._options.quiet or self._options.verbose or not sys.stderr.isatty():
            yield
            return
        with Console(stderr=True, highlight=False, markup=False).status(title) as status:
            self._status = status
            try:
                yield
            finally:
                self._status = None

    def _say(self, message: str) -> None:
        if self._status is not None:
            self._status.console.print(message, markup=False, highlight=False, soft_wrap=True)
        else:
            click.echo(message, err=True)


@dataclass
class Pace:
    """Watches the iterations of a search.

    Args:
        max_time: seconds that the search may take at most, or None.
        clock: tells seconds.
        done: share of the whole that is done, where that is known; 0 where not.
    """

    max_time: float | None = None
    clock: Callable[[], float] = time.monotonic
    done: float = 0.0
    started: float = field(init=False)

    def __post_init__(self) -> None:
        self.started = self.clock()
        self._steps: list[float] = []
        self._at = self.started
        self._done_at = (0.0, self.started)

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return self.clock() - self.started

    def add(self, step: float) -> None:
        """An iteration with a step of this size is done."""
        self._steps.append(step)
        self._at = self.clock()

    def remaining(self) -> float | None:
        """Seconds that are still to be expected; None where the steps do not shrink yet.

        The last two steps give the ratio by which they shrink, the iterations so far their time.
        Between two iterations it counts down: what has gone by since the last one is subtracted.
        """
        left = None if self.max_time is None else max(0.0, self.max_time - self.elapsed)
        if self.done > 0.0:
            if self.done != self._done_at[0]:
                self._done_at = self.done, self.clock()
            took = self._done_at[1] - self.started
            return self._counted(took * (1.0 - self.done) / self.done, self._done_at[1], left)
        iterations = self._iterations_left()
        if iterations is None:
            return left
        each = (self._at - self.started) / len(self._steps)
        return self._counted(iterations * each, self._at, left)

    def _counted(self, expected: float, at: float, left: float | None) -> float:
        """What is left of the seconds that were expected at a time, and no more than ``left``."""
        expected = max(0.0, expected - (self.clock() - at))
        return expected if left is None else min(expected, left)

    def _iterations_left(self) -> float | None:
        steps = [step for step in self._steps if step > 0.0 and math.isfinite(step)][-2:]
        if len(steps) < 2 or steps[1] >= steps[0]:
            return None
        return min(_MOST, max(0.0, math.log(_DONE / steps[1]) / math.log(steps[1] / steps[0])))


def about_text(seconds: float) -> str:
    """A time that is only known roughly.

    >>> about_text(7.2), about_text(53), about_text(113), about_text(1500), about_text(7300)
    ('5 s', '55 s', '2 min', '25 min', '2 h 02 min')
    """
    if seconds < 55.0:
        return f"{max(5, 5 * round(seconds / 5))} s"
    minutes = max(1, round(seconds / 60))
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


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
