"""From what a case says of the errors of its gauges to the covariance of its readings (theory 7).

Shared errors are named by what shares them: the zero of a channel; the head of a gauge, the set-up
of a survey or a step along a casing at an epoch. An epoch is a day of a stage, or the stage
where no dates are known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from geoident.identify.problem.errors import ErrorStructure
from geoident.model.arrays import Bools
from geoident.model.case import Case
from geoident.model.gauges import Channel, ErrorParts, Reading

DAY = 86400.0
"""Seconds."""

MESH = "mesh"
"""The error of the mesh: one factor for all readings, and one for each channel."""

SURFACE = "surface"
"""The errors of response surfaces: independent ones that all readings share."""

ErrorSource = tuple[str | float, ...]
"""What a shared error is that of, such as ``("zero", "EX1.a5")``."""

ChannelReading = tuple[Channel, Reading]
"""A reading and its channel."""


def used_rows(case: Case, used: Bools) -> tuple[ChannelReading, ...]:
    """The used readings (k,) of a case with their channels."""
    channels = {channel.name: channel for channel in case.channels}
    taken = [reading for reading, flag in zip(case.readings, used, strict=True) if flag]
    return tuple((channels[reading.channel], reading) for reading in taken)


def error_structure(rows: Sequence[ChannelReading]) -> ErrorStructure:
    """The errors of readings, whether they share any or not.

    Args:
        rows: readings with their channels.
    """
    table = _Table(steps=_steps(rows))
    for number, row in enumerate(rows):
        table.add(number, row)
    return table.structure()


def own_sd(channel: Channel, reading: Reading) -> float:
    """Standard deviation of what a reading has by itself, SI.

    Its own if it has one; that of a mean of n falls with the root of n.
    """
    if reading.accuracy is not None:
        return reading.accuracy
    size = channel.accuracy if channel.errors is None else channel.errors.reading
    return size / math.sqrt(reading.count) if reading.count > 1 else size


def total_sd(channel: Channel, reading: Reading) -> float:
    """Standard deviation of a reading with all that it shares, SI."""
    own = own_sd(channel, reading)
    if channel.errors is None:
        return own
    of_gauge = (
        size for part, _, size in _shared(channel, reading, {}) if part not in (MESH, SURFACE)
    )
    return math.hypot(own, *of_gauge)


@dataclass
class _Table:
    """Collects the entries of B."""

    steps: Mapping[str, tuple[float, ...]]
    sources: dict[ErrorSource, int] = field(default_factory=dict)
    components: dict[str, None] = field(default_factory=dict)
    of_source: list[str] = field(default_factory=list)
    entries: list[tuple[int, int, float]] = field(default_factory=list)
    sd: list[float] = field(default_factory=list)
    component: list[str] = field(default_factory=list)

    def add(self, number: int, row: ChannelReading) -> None:
        """Takes a reading."""
        channel, reading = row
        self.sd.append(own_sd(channel, reading))
        estimated = channel.errors is not None and reading.accuracy is None
        self.component.append(self._component(channel, "reading") if estimated else "")
        if channel.errors is None:
            return
        for part, source, size in _shared(channel, reading, self.steps):
            if size == 0.0:
                continue
            place = self.sources.setdefault(source, len(self.sources))
            name = self._component(channel, part)
            if place == len(self.of_source):
                self.of_source.append(name)
            # Kinds of gauges that share a set-up need not say the same of its error: that it is
            # estimated counts, whichever row of a file comes first.
            known = (self.of_source[place], name)
            self.of_source[place] = min(filter(None, known), default="")
            self.entries.append((number, place, size))

    def structure(self) -> ErrorStructure:
        """All of it."""
        at = np.array([(i, k) for i, k, _ in self.entries], dtype=np.int64).reshape(-1, 2)
        size = np.array([size for _, _, size in self.entries], dtype=np.float64)
        shape = (len(self.sd), len(self.sources))
        taken = {*self.component, *self.of_source}
        names = tuple(name for name in self.components if name in taken)
        numbers = {"": -1} | {name: number for number, name in enumerate(names)}
        return ErrorStructure(
            sd=np.array(self.sd, dtype=np.float64),
            component=np.array([numbers[name] for name in self.component], dtype=np.int64),
            columns=sp.csr_array((size, (at[:, 0], at[:, 1])), shape=shape),
            column_component=np.array([numbers[name] for name in self.of_source], dtype=np.int64),
            names=names,
        )

    def _component(self, channel: Channel, part: str) -> str:
        """The component of a part of the error of a channel; empty where its size is given."""
        name = channel.errors.component(part) if channel.errors else None
        if name is not None:
            self.components.setdefault(name)
        return name or ""


def _shared(
    channel: Channel, reading: Reading, steps: Mapping[str, tuple[float, ...]]
) -> Iterator[tuple[str, ErrorSource, float]]:
    """The shared errors of a reading: part, what it is that of, and standard deviation."""
    parts = channel.errors
    assert parts is not None
    few = 1.0 / math.sqrt(reading.epochs)
    day = -1.0 if reading.time is None else reading.time // DAY
    yield "zero", ("zero", channel.name), parts.zero
    for stage, error, doubt in parts.mesh:
        if stage == reading.stage:
            yield MESH, (MESH,), error
            yield MESH, (MESH, channel.name), doubt
    for stage, sizes in parts.surface:
        if stage == reading.stage:
            for number, size in enumerate(sizes):
                yield SURFACE, (SURFACE, number), size
    yield from _of_epoch(channel, parts, (reading.stage, day), few, steps)
    yield from _of_epoch(channel, parts, ("zero at", channel.zero), parts.zero_surveyed, steps)


def _of_epoch(
    channel: Channel,
    parts: ErrorParts,
    epoch: ErrorSource,
    few: float,
    steps: Mapping[str, tuple[float, ...]],
) -> Iterator[tuple[str, ErrorSource, float]]:
    """What a survey shares: of an epoch of readings, or of that of the zero.

    Args:
        channel: the channel.
        parts: what its errors are made of.
        epoch: of the survey.
        few: part of the errors that is left of a mean of several days.
        steps: run to the places of its channels, m.
    """
    yield "head", ("head", channel.gauge, channel.probe, *epoch), parts.head * few
    yield (
        "epoch",
        ("epoch", parts.survey or channel.gauge, channel.probe, *epoch),
        parts.epoch * few,
    )
    before = 0.0
    for place in steps.get(channel.run, (channel.along,)):
        if place > channel.along:
            break
        size = parts.along * math.sqrt(place - before) * few
        yield "along", ("along", channel.run or channel.name, *epoch, place), size
        before = place


def _steps(rows: Sequence[ChannelReading]) -> dict[str, tuple[float, ...]]:
    """Run to the places of its channels, from the reference end on, m."""
    found: dict[str, set[float]] = {}
    for channel, _ in rows:
        if channel.run:
            found.setdefault(channel.run, set()).add(channel.along)
    return {run: tuple(sorted(places)) for run, places in found.items()}
