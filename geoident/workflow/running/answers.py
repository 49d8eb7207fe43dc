"""A model asked at thousands of parameter vectors: in processes, kept on disk as it goes.

One analysis at a parameter vector answers for the used readings and for all that the gauges could
read. Answers are kept in the checkpoint in blocks, so that a run goes on where it was cut short:
samplers that are given the same seed ask the same again.

Where ground yields, an evaluation begins from one near by: some points that follow each other are a
part, and each part begins with a model that has forgotten the others. So the answers are the same
to the last bit in any number of processes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.observed import ObservedModel
from geoident.identify.posterior.draws import Stopped
from geoident.identify.problem.ahead import BESIDE, ReadingsAt, prefetching, starts_warm
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.workflow.executing.executor import BegunExecutor, SetUp, in_order
from geoident.workflow.running.computed import accuracies
from geoident.workflow.running.control import OUT_OF_TIME, Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.readings import times_of

_KIND = "answers"
_SECONDS = 3.0  # of computing that a power failure may cost


@dataclass(frozen=True)
class Answer:
    """What a model says at one parameter vector.

    Args:
        used: (g,) of the used readings, SI; None where there is no solution.
        later: (m,) of all that can be read, SI; NaN where the ground does not stand.
    """

    used: Floats | None
    later: Floats


class Asked:
    """A model, and what it is asked for.

    Args:
        model: of the case.
        case: the case.
        readings: of which some are used.

    Attributes:
        case: the case.
        places: (m, 2) numbers of channels and stages of all that can be read.
        pairs: channels and stages of the used readings and of all that can be read.
        times: when each of these is read, where it is known.
        everything: the response in them.
    """

    def __init__(self, model: ObservedModel, case: Case, readings: ReadingTable) -> None:
        self.model, self.case = model, case
        self.places = readable(model, case)
        used = readings.used
        pairs = [pair for pair, taken in zip(readings.pairs, used, strict=True) if taken]
        times = times_of(readings, used)
        later = [(case.channels[i].name, case.stages[j].name) for i, j in self.places.tolist()]
        self._split = len(pairs)
        self._used = model.response(pairs, times)
        self.pairs, self.times = (*pairs, *later), (*times, *(None for _ in later))
        self.everything = model.response(self.pairs, self.times)

    @property
    def beside(self) -> int:
        """How many points that follow each other are one part."""
        return BESIDE if starts_warm(self.everything) else 1

    def answers(self, part: Floats) -> Iterator[Answer]:
        """What the model says at p (k, n), SI, whatever it was asked before."""
        self.everything.forget()
        for p in part:
            yield self.answer(p)

    def answer(self, p: Floats) -> Answer:
        """What the model says at p (n,), SI."""
        nothing = np.full(len(self.places), np.nan)
        if self._used.admissible(p) is not None:
            return Answer(None, nothing)
        try:
            v = self.everything.readings(p)
            return Answer(v[: self._split], v[self._split :])
        except ModelError:
            pass
        try:  # it may collapse only after the readings that are used
            used = self._used.readings(p)
            survey = self.model.survey(p, fields=False, partial=True)
            return Answer(used, survey.computed[tuple(self.places.T)])
        except ModelError:
            return Answer(None, nothing)


def readable(model: ObservedModel, case: Case) -> Ints:
    """Numbers (m, 2) of channels and stages that can be read."""
    can: Bools = np.isfinite(accuracies(case))
    for i, channel in enumerate(case.channels):
        for j, stage in enumerate(case.stages):
            can[i, j] &= model.unreadable(channel.name, stage.name) is None
    return np.argwhere(can)


@dataclass
class KeptAnswers:
    """The answers of a model, each computed once.

    Args:
        compute: answers at several p at once, (k, n), SI, one after the other as they are ready.
        log: keeps them; None where they cost nothing.
        control: stops the run.
    """

    compute: Callable[[Floats], Iterator[Answer]]
    log: Log | None
    control: Control
    _known: dict[bytes, Answer] = field(default_factory=dict)
    _unkept: list[tuple[Floats, Answer]] = field(default_factory=list)
    _blocks: int = 0
    _kept_at: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        while self.log is not None:
            block = self.log.find(_KIND, np.array([float(self._blocks)]))
            if block is None:
                break
            self._blocks += 1
            for p, used, later in zip(block["p"], block["used"], block["later"], strict=True):
                solved = bool(np.all(np.isfinite(used)))
                self._known[p.tobytes()] = Answer(used if solved else None, later)

    def __call__(self, points: Floats) -> Sequence[Floats | None]:
        """Answers for the used readings at p (k, n), SI.

        Raises:
            Interrupted: a stop was asked for.
            Stopped: the time is up.
        """
        return [answer.used for answer in self.at(points)]

    def at(self, points: Floats) -> list[Answer]:
        """All answers at p (k, n), SI; those that are not known are computed.

        Raises:
            Interrupted: a stop was asked for.
            Stopped: the time is up.
        """
        unknown = [k for k, p in enumerate(points) if p.tobytes() not in self._known]
        try:
            if unknown:
                self._compute(points[unknown])
        finally:
            self.keep()
        return [self._known[p.tobytes()] for p in points]

    def _compute(self, points: Floats) -> None:
        answers = self.compute(points)
        for p in points:
            self.control.stop.check()
            if self.control.over() is not None:
                raise Stopped(OUT_OF_TIME)
            answer = next(answers)
            self._known[p.tobytes()] = answer
            self._unkept.append((p, answer))

    def keep(self, *, now: bool = False) -> None:
        """Write what is not on disk yet, every few seconds or now."""
        if self.log is None or not self._unkept:
            return
        if not now and time.monotonic() - self._kept_at < _SECONDS:
            return
        answers = [answer for _, answer in self._unkept]
        width = max((len(a.used) for a in answers if a.used is not None), default=0)
        nothing = np.full(width, np.nan)
        arrays = {
            "p": np.array([p for p, _ in self._unkept]),
            "used": np.array([nothing if a.used is None else a.used for a in answers]),
            "later": np.array([a.later for a in answers]),
        }
        self.log.add(_KIND, np.array([float(self._blocks)]), arrays)
        self._blocks += 1
        self._unkept.clear()
        self._kept_at = time.monotonic()


Compute = Callable[[Floats], Iterator[Answer]]
"""Answers at several p at once, (k, n), SI, one after the other as they are ready."""


def here(asked: Asked) -> Compute:
    """A computation in this process."""

    def compute(points: Floats) -> Iterator[Answer]:
        parts = _parts(points, asked.beside)
        with prefetching(asked.everything, [ReadingsAt(part) for part in parts]) as turn:
            for number, part in enumerate(parts):
                turn(number)  # runs of a model elsewhere are made several at a time
                yield from asked.answers(part)

    return compute


def _parts(points: Floats, size: int) -> list[Floats]:
    """Points (k, n) by so many that follow each other."""
    return [points[first : first + size] for first in range(0, len(points), size)]


BeginWorkers = Callable[[SetUp[Floats, list[Answer]]], BegunExecutor[Floats, list[Answer]]]
"""Begins processes: those of this machine, or on a cluster."""


@contextmanager
def in_processes(begin: BeginWorkers, build: Callable[[], Asked], beside: int) -> Iterator[Compute]:
    """A computation in several processes, each with a model of its own.

    Args:
        begin: begins them.
        build: makes the model there.
        beside: how many points that follow each other are one part.
    """
    with begin(partial(_answering, build)) as processes:

        def compute(points: Floats) -> Iterator[Answer]:
            for answer in in_order(processes.run(_parts(points, beside))):
                if answer.value is None:
                    message = (
                        "No process computes the model at a parameter vector: the last one {}."
                    )
                    last = answer.losses[-1] if answer.losses else "was stopped"
                    raise ModelError(message.format(last))
                yield from answer.value

        yield compute


def _answering(build: Callable[[], Asked]) -> Callable[[Floats], list[Answer]]:
    asked = build()

    def answer(part: Floats) -> list[Answer]:
        with one_thread():
            return list(asked.answers(part))

    return answer
