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
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

GAMMA = 2.0 - math.sqrt(2.0)
BETA = 0.5 * GAMMA
BACK = (1.0 - GAMMA) ** 2 / (GAMMA * (2.0 - GAMMA))
"""Weight of the first part of a step in its second."""

OF_EACH_LENGTH = 6
"""Steps of each length: errors of settlements and pressures are some 1e-4 of the largest."""

OF_EACH_WITHOUT_WATER = 3
"""The same of ground that creeps without water, whose motions do not jump: errors are as small."""

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
