"""How the outside talks with a running command: progress out, requests to stop in.

The command line has a `Monitor` of its own; a notebook or a test may give another one.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from geoident.errors import TimeIsUp
from geoident.model.results.result import Iteration
from geoident.workflow.executing.stop import StopRequest
from geoident.workflow.programs.workplace import OnCluster

OUT_OF_TIME = "Time limit reached; the same command continues from here."

NOTHING_SENT = "There was nothing to run in parallel: the cluster was not used."

GRACE = 5.0
"""Seconds after its time for which an evaluation that has begun may go on."""

FOR_THE_END = 0.1
"""Part of its time that a run may spend beyond it on what a result says beside the parameters."""


class Monitor:
    """Is told how a command proceeds; this one says nothing."""

    def warn(self, message: str) -> None:
        """Something that the user should know even when asked to be quiet."""

    def inform(self, message: str) -> None:
        """A line worth reading."""

    def detail(self, message: str) -> None:
        """A line for those who asked for more."""

    def stage(self, name: str, number: int, total: int) -> None:
        """A stage of an evaluation is computed.

        Args:
            name: of the stage.
            number: of the stage; 0 is the virgin state.
            total: number of the last one.
        """

    def step(self, iteration: Iteration) -> None:
        """One iteration of an identifier is done."""

    def part(self, words: str, done: float) -> None:
        """A part of a long computation is done.

        Args:
            words: what has been reached.
            done: share of the whole, 0 to 1, as far as it can be told.
        """


@dataclass
class Control:
    """What a running command reports to and obeys.

    Args:
        monitor: is told of the progress.
        stop: the wish to stop.
        max_time: seconds after which an identifier ends with what it has; None for no limit.
        out_of_time: the limit was reached.
        started: when, by the clock of the machine that never goes back, s.
        further: seconds after the limit from which on `GRACE` counts.
        jobs: processes that may work on it; None for all cores, where that saves time.
        cluster: where what can be computed at a time is computed instead; None for processes here.
    """

    monitor: Monitor = field(default_factory=Monitor)
    stop: StopRequest = field(default_factory=StopRequest)
    max_time: float | None = None
    out_of_time: bool = False
    started: float = field(default_factory=time.monotonic)
    further: float = 0.0
    jobs: int | None = 1
    cluster: OnCluster | None = None

    def remaining(self) -> float | None:
        """Seconds that are left; None where there is no limit."""
        if self.max_time is None:
            return None
        return max(0.0, self.max_time - (time.monotonic() - self.started))

    def require_cluster(self) -> None:
        """Say at once that a cluster which is to be used is not there.

        Raises:
            InputError: it is not.
        """
        if self.cluster is not None:
            self.cluster.require()

    def tell_of_cluster(self) -> None:
        """At the end, say if a cluster was given and is not what has computed."""
        if self.cluster is not None and not self.cluster.used:
            self.monitor.inform(NOTHING_SENT)

    def on_iteration(self, iteration: Iteration) -> str | None:
        """Is called by identifiers with every iteration; returns a reason to stop now, or None."""
        self.monitor.step(iteration)
        return self.over()

    def over(self) -> str | None:
        """Why to stop now, as the time is used up, or None."""
        if self.max_time is None or time.monotonic() - self.started < self.max_time:
            return None
        self.out_of_time = True
        return OUT_OF_TIME

    def within(self) -> None:
        """Is asked between the stages of an evaluation, and cuts it short where it takes too long.

        Raises:
            TimeIsUp: the time is used up, and the grace too.
        """
        if self.max_time is None:
            return
        if time.monotonic() - self.started > self.max_time + self.further + GRACE:
            self.out_of_time = True
            raise TimeIsUp(OUT_OF_TIME)

    def finish(self) -> None:
        """The search is over: what a result says beside the parameters may take a little longer."""
        if self.max_time is not None and self.out_of_time:
            spent = time.monotonic() - self.started
            self.further = max(spent - self.max_time, 0.0) + FOR_THE_END * self.max_time
