"""Which readings take part in an identification, and why the others do not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from geoident.errors import InputError
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import Reading


class Readable(Protocol):
    """A model that can tell which channels it can read when."""

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel cannot be read at the end of a stage, or None if it can."""


@dataclass(frozen=True)
class Unused:
    """A reading that does not take part, and why."""

    reading: Reading
    reason: str


@dataclass(frozen=True)
class Selection:
    """The readings of a case, parted.

    Args:
        case: the case.
        used: readings that take part, in the order of the file.
        unused: the others.
    """

    case: Case
    used: tuple[Reading, ...]
    unused: tuple[Unused, ...]

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Channel and stage of each used reading."""
        return tuple((reading.channel, reading.stage) for reading in self.used)

    @property
    def times(self) -> tuple[float | None, ...]:
        """When each used reading was taken, seconds since 1970, where it is known."""
        return tuple(reading.time for reading in self.used)

    @property
    def measured(self) -> Floats:
        """The (g,) used readings, m."""
        return np.array([reading.value for reading in self.used], dtype=np.float64)

    @property
    def sd(self) -> Floats:
        """The (g,) standard deviations of the used readings, m."""
        return np.array([self.accuracy(reading) for reading in self.used], dtype=np.float64)

    def unused_by_stage(self) -> tuple[str, ...]:
        """The unused readings in words, those of one stage and reason together."""
        together: dict[tuple[str, str], list[str]] = {}
        for unused in self.unused:
            key = (unused.reading.stage, unused.reason)
            together.setdefault(key, []).append(unused.reading.channel)
        return tuple(
            f"{', '.join(channels)} at {stage}: {reason}"
            for (stage, reason), channels in together.items()
        )

    def accuracy(self, reading: Reading) -> float:
        """Standard deviation of a reading, m: its own, or that of its channel."""
        if reading.accuracy is not None:
            return reading.accuracy
        return self._accuracies[reading.channel]

    @cached_property
    def _accuracies(self) -> dict[str, float]:
        return {channel.name: channel.accuracy for channel in self.case.channels}


def select_readings(case: Case, model: Readable) -> Selection:
    """Part the readings of a case into those that an identification uses and the others."""
    used: list[Reading] = []
    unused: list[Unused] = []
    for reading in case.readings:
        reason = _why_unused(case, reading, model)
        if reason is None:
            used.append(reading)
        else:
            unused.append(Unused(reading, reason))
    return Selection(case, tuple(used), tuple(unused))


def _why_unused(case: Case, reading: Reading, model: Readable) -> str | None:
    if reading.value is None:
        return "no value was read"
    if reading.bad:
        return f"flagged as bad: {reading.bad}"
    if case.fit.stages is not None and reading.stage not in case.fit.stages:
        return "the stage is not in fit.stages"
    return model.unreadable(reading.channel, reading.stage)


def require_enough(selection: Selection) -> None:
    """Refuse readings and priors that are fewer than the parameters.

    Raises:
        InputError: how many there are, and what to do.
    """
    parameters = selection.case.parameters
    priors = sum(1 for parameter in parameters if parameter.prior is not None)
    if len(selection.used) + priors >= len(parameters) and selection.used:
        return
    known = f"{_count(len(selection.used), 'usable reading')}"
    known += f" and {_count(priors, 'prior')}" if priors else ""
    fault = selection.case.source.fault(
        ("readings",),
        code="too-few-readings",
        message=f"{known} cannot determine {_count(len(parameters), 'parameter')}"
        f" ({', '.join(parameter.name for parameter in parameters)})",
        hint=_remedy(selection),
    )
    raise InputError([fault])


def _remedy(selection: Selection) -> str:
    remedy = "Add readings, give priors, or make some parameters given numbers."
    if not selection.unused:
        return remedy
    reasons = sorted({unused.reason for unused in selection.unused})
    return f"{remedy} {len(selection.unused)} readings are not used: {'; '.join(reasons)}."


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
