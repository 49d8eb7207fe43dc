"""Steps in time of a stage that lasts: short ones first, then ever longer ones (theory 18.2).

Each is one of TR-BDF2 (Bank et al., IEEE Transactions on Electron Devices 32, 1985), of the second
order and L-stable: a part gamma of the step by the trapezoidal rule, the rest by the second order
backward formula. With gamma = 2 - sqrt 2 both have one matrix, that of a backward Euler step of
length beta = gamma / 2 of the whole.

What a stage does comes at once, and pressures jump. Two steps of backward Euler in the beginning
take from that jump what no step resolves; they are as long as the matrix of the first TR-BDF2 steps
wants. Steps double in length, a number of them of each length, so that the length is in proportion
to the time that went by, and there is one factorization for each length.

Steps depend on the case alone, never on parameters: an analysis is a smooth function of these.
Water, heat and creep go the same steps: `TimeLoop` is how.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

GAMMA = 2.0 - math.sqrt(2.0)
BETA = 0.5 * GAMMA
BACK = (1.0 - GAMMA) ** 2 / (GAMMA * (2.0 - GAMMA))
"""Weight of the first part of a step in its second."""

OF_EACH_LENGTH = 6
"""Steps of each length: errors of settlements and pressures are some 1e-4 of the largest."""

OF_EACH_WITHOUT_WATER = 3
"""The same of ground that creeps without water, whose motions do not jump: errors are as small."""

_ROUNDING = 1e-12
"""Part of a time within which it is reached."""

_BENDS = 2
"""Bends of what acts that make a step too long."""

_BEFORE = 2
"""Lengths of steps that are gone through before the first moment that is looked at."""

_LEAST = 6
"""Lengths of steps of a stage, at least: even if only its end is looked at, the way counts."""


@dataclass(frozen=True)
class TimeStep:
    """A step.

    Args:
        length: s.
        euler: whether it is one of backward Euler; else of TR-BDF2.
    """

    length: float
    euler: bool = False

    @property
    def share(self) -> float:
        """By what flow is multiplied in its matrix, s."""
        return self.length if self.euler else BETA * self.length


State = TypeVar("State")

Total = Callable[[Sequence[State], Sequence[float]], State]
"""The sum of some states with weights."""


@dataclass(frozen=True)
class PartOfStep(Generic[State]):
    """A part of a step: a change at a rate F, from y_0 to y_1 = y_0 + h F(y_1 + w).

    Args:
        before: y_0.
        span: when it begins and ends, s.
        h: s.
        past: weights and states of which w is the sum; Euler: none. TR: y_n. BDF2: b (y_n + y_g),
            b = (1 - gamma)^2 / (gamma (2 - gamma)), y_n at the beginning of the step, y_g between
            its parts.
    """

    before: State
    span: tuple[float, float]
    h: float
    past: Sequence[tuple[float, State]]


class TimeLoop(Generic[State]):
    """The states of one stage, as far as they were asked for.

    Within a step they are the parabolas through its beginning, its middle and its end.

    Args:
        steps: in time; none where no time passes.
        begun: the state at the beginning.
        after: the state at the end of a part of a step.
        total: sums states.
        gamma: where the parts of a step meet.

    Attributes:
        now: the state at the end of the last step.
    """

    def __init__(
        self,
        steps: Sequence[TimeStep],
        begun: State,
        after: Callable[[PartOfStep[State]], State],
        total: Total[State],
        gamma: float = GAMMA,
    ) -> None:
        self.now = begun
        self._steps, self._after, self._total, self._gamma = steps, after, total, gamma
        self._parts, self._done, self._time = (begun, begun, begun), 0, 0.0

    @property
    def begins(self) -> bool:
        """Whether no step has been gone yet."""
        return not self._done

    def to(self, time: float) -> State:
        """The state at a time, s, not before the beginning of the last step."""
        while self._time < time * (1.0 - _ROUNDING):
            self._step()
        if self.begins:
            return self.now
        left = (self._time - time) / self._steps[self._done - 1].length
        if left < _ROUNDING:
            return self.now
        return self._total(self._parts, [parabola(1.0 - left, k, self._gamma) for k in range(3)])

    def _step(self) -> None:
        step, begun, after, gamma = self._steps[self._done], self.now, self._after, self._gamma
        start, end, h = self._time, self._time + step.length, step.share
        middle = start + gamma * step.length
        if step.euler:
            self.now = after(PartOfStep(begun, (start, end), h, ()))
            between = self._total((begun, self.now), (1.0 - gamma, gamma))
        else:
            between = after(PartOfStep(begun, (start, middle), h, [(1.0, begun)]))
            past = [(BACK, begun), (BACK, between)]
            self.now = after(PartOfStep(between, (middle, end), h, past))
        self._parts, self._time, self._done = (begun, between, self.now), end, self._done + 1


def settled(steps: Sequence[TimeStep]) -> list[TimeStep]:
    """Two steps of backward Euler in the place of each of those of the shortest length.

    Between the parts of a TR-BDF2 step what decays within it swings past its end. Ground whose
    strains do not come back must not see that after a jump.

    Args:
        steps: of a stage.
    """
    whole, shortest = list[TimeStep](), min(step.length for step in steps if not step.euler)
    for step in steps:
        at_first = not step.euler and step.length == shortest
        whole += [TimeStep(0.5 * step.length, euler=True)] * 2 if at_first else [step]
    return whole


def divided(steps: Sequence[TimeStep], bends: Sequence[float]) -> list[TimeStep]:
    """Steps of which each has at most one bend of what acts within it: others are halved.

    Args:
        steps: in a row.
        bends: times, s since the beginning of the first, ascending.
    """
    whole, start = list[TimeStep](), 0.0
    for step in steps:
        end = start + step.length
        whole += _halved(step, [time for time in bends if start < time < end], start)
        start = end
    return whole


def _halved(step: TimeStep, bends: Sequence[float], start: float) -> list[TimeStep]:
    if len(bends) < _BENDS:
        return [step]
    half, middle = TimeStep(0.5 * step.length, euler=step.euler), start + 0.5 * step.length
    first = _halved(half, [time for time in bends if time < middle], start)
    return first + _halved(half, [time for time in bends if time >= middle], middle)


def parabola(x: float, k: int, gamma: float) -> float:
    """The k-th parabola of those through 0, gamma and 1, at a part x of a step."""
    nodes = (0.0, gamma, 1.0)
    others = [node for n, node in enumerate(nodes) if n != k]
    return math.prod((x - node) / (nodes[k] - node) for node in others)


def stage_steps(lasts: float, first: float, over: float, of_each: int) -> list[TimeStep]:
    """The steps of a stage; one ends where all that it does has come.

    Args:
        lasts: how long it lasts, s, above zero.
        first: the first moment that is looked at, s, above zero; at most the end.
        over: the time in which what it does comes evenly, s; 0: at once.
        of_each: steps of each length.
    """
    if not 0.0 < over < lasts:
        return time_steps(lasts, first, of_each)
    rest = time_steps(lasts - over, min(over, lasts - over), of_each)
    return time_steps(over, min(first, over), of_each) + rest


def time_steps(lasts: float, first: float, of_each: int = OF_EACH_LENGTH) -> list[TimeStep]:
    """Steps that begin with a jump.

    Args:
        lasts: how long they last together, s, above zero.
        first: the first moment that is looked at, s, above zero; at most the end.
        of_each: steps of each length.
    """
    lengths = _LEAST
    while _begun(lengths, of_each) * first < _begun(_BEFORE, of_each) * lasts:
        lengths += 1
    shortest = lasts / _begun(lengths, of_each)
    steps = [TimeStep(BETA * shortest, euler=True)] * 2
    return steps + [TimeStep(shortest * 2**n) for n in range(lengths) for _ in range(of_each)]


def _begun(lengths: int, of_each: int) -> float:
    """Time of the steps of the first lengths, by the shortest."""
    return 2.0 * BETA + of_each * (2.0**lengths - 1.0)
