"""Gauges and their readings.

Every gauge, whatever its kind, reduces to *channels*: one channel measures one quantity, such as a
relative displacement. An extensometer has one channel per anchor, named ``gauge.anchor``; the other
kinds have one channel, named as the gauge.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from geoident.errors import Location
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.parameter import Scalar
from geoident.model.results.columns import Record, column, derived

MovingPoint = tuple[tuple[float, ...], tuple[float, ...]]
"""A point (dim,), m, and the vector (dim,) whose product with its displacement adds to a reading.

A vector without unit adds a length; one in 1/m adds an angle.
"""

DAY = 86400.0
"""Seconds; readings of one day are of one epoch."""

SHELL_FORCES = ("n_11", "n_22", "n_12", "m_11", "m_22", "m_12")
"""Quantities of a shell that channels may read: forces and moments per metre."""

PARTS = ("reading", "zero", "head", "epoch", "along")
"""What the error of a reading may be made of; see `ErrorParts`."""


_NAMED = 6


def named_channels(names: Sequence[str]) -> str:
    """Names of channels for a sentence; of many how many they are, and the first ones.

    >>> named_channels(["CV", "EX.a5"])
    'CV, EX.a5'
    >>> named_channels([f"P{n}" for n in range(1, 25)])
    '24 channels (P1, P2, P3, P4, P5, P6 and 18 more)'
    """
    names = list(dict.fromkeys(names))
    if len(names) <= _NAMED:
        return ", ".join(names)
    return f"{len(names)} channels ({', '.join(names[:_NAMED])} and {len(names) - _NAMED} more)"


class ErrorParts(Record):
    """What the errors of a channel's readings are made of: standard deviations, SI.

    Args:
        reading: of each reading by itself, independent of all others.
        zero: of the zero of the channel, which all its readings share.
        head: of the head of the gauge, which all its channels share at an epoch.
        epoch: of the set-up of a survey, which all its readings share at an epoch.
        along: what adds up along the run of the channel as a random walk, per root of a metre.
        survey: what is surveyed together; the name of the gauge if that is all.
        zero_surveyed: size of the head's, the set-up's and the casing's error in the zero, in parts
            of that in a reading: 1 where the zero was read as later readings were, less for a mean
            of several days, 0 where `zero` is all of its error.
        estimated: pairs of a part and the component of variance to which it belongs, for parts that
            are to be estimated: only their ratios within a component are then known before.
        already_estimated: likewise, of parts that were estimated: their sizes are the estimates.
        mesh: of stages the name, the error there of what is computed on the mesh, SI, signed: all
            readings share one factor on it, of variance one; and by how much it is uncertain, which
            the readings of a channel share. No part of the gauge's accuracy.
        steps: the same of the steps in time, with a factor of its own.
        surface: of stages the name, and the standard deviations there, SI, of independent errors
            that all readings share: those of the response surfaces of a table of runs. No part of
            the gauge's accuracy.
    """

    reading: float = column(name="error_sd", part=("error_part", "reading"), dimension="gauge")
    zero: float = column(
        default=0.0, name="error_sd", part=("error_part", "zero"), dimension="gauge"
    )
    head: float = column(
        default=0.0, name="error_sd", part=("error_part", "head"), dimension="gauge"
    )
    epoch: float = column(
        default=0.0, name="error_sd", part=("error_part", "epoch"), dimension="gauge"
    )
    along: float = column(
        default=0.0, name="error_sd", part=("error_part", "along"), dimension="gauge"
    )
    survey: str = ""
    zero_surveyed: float = 0.0
    estimated: tuple[tuple[str, str], ...] = ()
    already_estimated: tuple[tuple[str, str], ...] = ()
    mesh: tuple[tuple[str, float, float], ...] = ()
    steps: tuple[tuple[str, float, float], ...] = ()
    surface: tuple[tuple[str, tuple[float, ...]], ...] = ()

    def total(self, along: float = 0.0, own: float | None = None, epochs: int = 1) -> float:
        """Standard deviation of one reading, SI, at a place along its run, m.

        Args:
            along: the place.
            own: what the reading has by itself, SI; None for `reading`.
            epochs: over how many days it is a mean, whose set-ups are averaged, too.

        >>> round(ErrorParts(3e-4, zero=4e-4, along=1e-4).total(75.0), 7)
        0.001
        """
        added_up = self.along * math.sqrt(along)
        shared = math.hypot(self.head, self.epoch, added_up)
        own = self.reading if own is None else own
        of_zero = shared * self.zero_surveyed
        return math.hypot(own, self.zero, shared / math.sqrt(epochs), of_zero)

    def component(self, part: str) -> str | None:
        """The component of variance to which a part belongs; None where its size is given."""
        return dict(self.estimated).get(part)


class Reads(Enum):
    """Which states a reading is made of."""

    CHANGE = "change"
    """The state at the end of its stage, less that at the zero of its channel."""
    VALUE = "value"
    """The state at the end of its stage alone: an absolute reading, which has no zero."""
    VIRGIN = "virgin"
    """The virgin state alone, whenever it was read: overcoring in undisturbed ground."""


@dataclass(frozen=True)
class Channel:
    """What one gauge reads, zeroed at a stage: mostly direction . (u(second) - u(first)).

    Args:
        name: name under which readings are given.
        gauge: name of the gauge it belongs to.
        kind: of the gauge; says what is read (`forward.gauges.kinds.OBSERVABLES`).
        first: (dim,) coordinates of the reference point in m; None for fixed ground.
        second: (dim,) coordinates of the point whose motion is read, m.
        direction: (dim,) unit vector; along the line from first to second where the gauge reads
            a change of distance (positive: the points move apart), down for a settlement.
        accuracy: standard deviation of one reading, SI, as the gauge states it; of a reading that
            was taken `sd` tells it.
        zero: name of the stage at whose end the channel reads zero.
        key: path of keys in the case where the channel is written.
        ratio: factor on what the model says of every reading; None for one.
        offset: added to every reading after the zero, SI (a zero that was itself misread, a head
            that slipped); None for none.
        drift: what a reading gains by itself in time since the zero, SI per second; None for none.
        drift_per_stage: the same for every stage since the zero, SI.
        dimension: of its readings, a key of `geoident.units.DIMENSIONS`.
        unit: in which people want to see them; lengths in mm.
        terms: the motions that add up to the reading where it is not the difference of the two
            points along the direction; empty where it is.
        turns: (dim, dim) M of a channel that reads a rotation M : grad u at the second point, with
            (grad u)_ij = du_i / dx_j; empty for others.
        errors: what its readings share of their errors; None where all are independent. Their
            total is ``accuracy``.
        run: what the channel is a part of, along which errors add up, such as the casing of an
            inclinometer in one axis; empty for none.
        along: place of the channel on its run, m from the end to which readings refer.
        probe: what reads it, where a gauge has several probes, which share no errors.
        reads: whether it reads a change since its zero, or a value.
        quantity: which of the quantities of its kind: a component of stress or strain (``xx``),
            a principal value (``major``), the force (``N``, ``M``, ``Q``) or the fibre (``inside``,
            ``outside``, ``axis``) of a beam; empty where the kind has one.
        structure: name of the structure that it sits on; empty for none.
        member: number of the bolt in its structure, from 0.
        compression: what it reads is positive in compression.
        effective: of a stress: of the skeleton; else of skeleton and water together.
        towards: (dim,) a point on the side of a beam that counts as its inside, m; None: the side
            without ground.
        interface: name of the interface that it spans; empty for none.
        fibre: distance of the fibre from the axis of its beam, m; None: half of its thickness.
        alarm: names of alarm values to readings, SI; a negative one is reached from above.
        limits: the same of values that readings of either sign reach by their size, all positive.
        branch: it is read only in stages that build on its zero.
    """

    name: str
    gauge: str
    kind: str
    first: tuple[float, ...] | None
    second: tuple[float, ...]
    direction: tuple[float, ...]
    accuracy: float
    zero: str
    key: tuple[str | int, ...] = ()
    ratio: Scalar | None = None
    offset: Scalar | None = None
    drift: Scalar | None = None
    drift_per_stage: Scalar | None = None
    dimension: str = "length"
    unit: str = "mm"
    terms: tuple[MovingPoint, ...] = ()
    turns: tuple[tuple[float, ...], ...] = ()
    errors: ErrorParts | None = None
    run: str = ""
    along: float = 0.0
    probe: str = ""
    reads: Reads = Reads.CHANGE
    quantity: str = ""
    structure: str = ""
    interface: str = ""
    member: int = 0
    compression: bool = False
    effective: bool = False
    towards: tuple[float, ...] | None = None
    fibre: float | None = None
    alarm: Mapping[str, float] = field(default_factory=dict, hash=False)
    limits: Mapping[str, float] = field(default_factory=dict, hash=False)
    branch: bool = False

    @property
    def is_zeroed(self) -> bool:
        """Whether it reads zero at its zero, by definition."""
        return self.reads is Reads.CHANGE

    @property
    def error_parts(self) -> ErrorParts:
        """What the errors of its readings are made of; of independent ones that of each alone."""
        return self.errors or ErrorParts(self.accuracy)

    @property
    def own_accuracy(self) -> float:
        """Standard deviation of what one reading has by itself, SI, as the gauge states it."""
        return self.error_parts.reading

    def own_sd(self, reading: Reading) -> float:
        """Standard deviation of what a reading has by itself, SI.

        Its own if it has one; that of a mean of n falls with the root of n.
        """
        if reading.accuracy is not None:
            return reading.accuracy
        return self.own_accuracy / math.sqrt(reading.count)

    def sd(self, reading: Reading) -> float:
        """Standard deviation of a reading with all that it shares, SI."""
        own = self.own_sd(reading)
        return own if self.errors is None else self.errors.total(self.along, own, reading.epochs)

    @property
    def motions(self) -> tuple[MovingPoint, ...]:
        """Points and the vectors that their displacements are multiplied with, all added up."""
        if self.terms:
            return self.terms
        against = tuple(-x for x in self.direction)
        ends = ((self.first, against), (self.second, self.direction))
        return tuple((point, vector) for point, vector in ends if point is not None)


@dataclass(frozen=True)
class Reading:
    """One reading of a channel, from the cell of a file to the identification.

    Args:
        channel: name of the channel.
        stage: name of the stage at whose end it was taken; empty while only its date is known.
        value: in the SI unit of the channel's dimension; None where the field sheet is blank
            (counted, not used).
        accuracy: standard deviation, SI, where the reading has its own, else None.
        location: where it is written: the name of the channel, or the value in the wide layout.
        time: when it was taken, seconds since 1970; None where only the stage is known.
        bad: why it is not to be used; empty for a good one.
        when: where the stage or date is written.
        key: path of keys in the case; empty for a row of a file.
        count: how many readings it is the mean of.
        epochs: how many days these are from, if it is a mean of dated ones.
        note: remark of the field sheet; empty for none.
        zone: seconds by which the clock of its date is ahead of UTC, if the file says it.
        unit: in which the file gives it; empty where it is not of a file, or of a sensor.
        since: when it was taken, s since the beginning of its stage, if that is how it is given;
            its stage is a moment of that as soon as the moments are known.
    """

    channel: str
    stage: str
    value: float | None
    accuracy: float | None = None
    location: Location = Location("")
    time: float | None = None
    bad: str = ""
    when: Location = field(default=Location(""), compare=False)
    key: tuple[str | int, ...] = field(default=(), compare=False)
    count: int = field(default=1, compare=False)
    epochs: int = field(default=1, compare=False)
    note: str = field(default="", compare=False)
    zone: float | None = field(default=None, compare=False)
    unit: str = field(default="", compare=False)
    since: float | None = field(default=None, compare=False)


def taken_together(channel: Channel, readings: Sequence[Reading]) -> Reading:
    """The weighted mean of readings of a channel in one stage, as one reading.

    What they share, such as a zero, does not average out; of set-ups it is the number of days. It
    is as accurate as the gauge unless one of them says its own accuracy.

    Args:
        channel: of all of them.
        readings: one at least, each with a value.
    """
    if len(readings) == 1:
        return readings[0]
    own = np.array([channel.own_sd(reading) for reading in readings])
    value, accuracy = weighted_mean(np.array([r.value for r in readings], dtype=np.float64), own)
    times = [reading.time for reading in readings if reading.time is not None]
    dated = len(times) == len(readings)
    return replace(
        readings[-1],
        value=value,
        accuracy=None if all(reading.accuracy is None for reading in readings) else accuracy,
        time=sum(times) / len(times) if dated else None,
        count=sum(reading.count for reading in readings),
        epochs=len({time // DAY for time in times}) if dated else 1,
    )


def weighted_mean(values: Floats, sd: Floats) -> tuple[float, float]:
    """The mean of values (m,) by their standard deviations, and its own."""
    weight = sd**-2.0
    return float(weight @ values / weight.sum()), float(weight.sum() ** -0.5)


@dataclass(frozen=True)
class StageReadings:
    """When the dated readings of a stage were taken, before several of a channel became one.

    Args:
        stage: its name.
        complete: when it was complete, seconds since 1970; None where it has no date.
        number: of readings that were given to it.
        channels: number of channels that were read.
        first: when the first of them was taken; None where there are none.
        last: when the last of them was taken.
        between: how many of those that count were taken nearer to the end of the next stage than to
            that of this one.
    """

    stage: str
    complete: float | None
    number: int
    channels: int
    first: float | None = None
    last: float | None = None
    between: int = 0


class ReadingTable(Record):
    """All readings of a case, one entry of every column each, in the order of the files.

    Values are in the SI unit of the dimension of their channel. n is the number of parameters.

    Args:
        channel: k names of channels.
        gauge: k names of the gauges to which they belong.
        stage: k names of stages.
        time: (k,) when each was taken, seconds since 1970; NaN where only the stage is known.
        value: (k,) what was read; NaN where the field sheet is blank.
        sd: (k,) standard deviation: its own, or that of its channel.
        used: (k,) it took part in the identification.
        bad: (k,) it is known to be wrong.
        reason: k texts, why it is not used; empty for one that is.
        computed: (k,) the model at the time of the reading; NaN where it says nothing.
        sensitivity: (k, n) derivatives of ``computed``, SI, or None.
        own_sd: (k,) the part of ``sd`` that no other reading shares; None where that is all.
        epochs: (k,) over how many days each is a mean; None where each is of one.
        note: k remarks of the field sheets, empty for none; or nothing if there are none at all.
    """

    channel: tuple[str, ...] = column("reading")
    gauge: tuple[str, ...] = column("reading")
    stage: tuple[str, ...] = column("reading")
    time: Floats = column("reading", unit="s since 1970-01-01")
    value: Floats = column("reading")
    sd: Floats = column("reading")
    used: Bools = column("reading")
    bad: Bools = column("reading")
    reason: tuple[str, ...] = column("reading")
    computed: Floats = column("reading")
    sensitivity: Floats | None = column("reading", "parameter", default=None, optional=True)
    own_sd: Floats | None = column("reading", default=None, optional=True)
    epochs: Ints | None = column("reading", default=None, optional=True)
    note: tuple[str, ...] = column("reading", default=(), optional=True)

    def __len__(self) -> int:
        return len(self.channel)

    @property
    @derived("reading")
    def residual(self) -> Floats:
        """(k,) measured minus computed, SI."""
        return self.value - self.computed

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Channel and stage of each reading."""
        return tuple(zip(self.channel, self.stage, strict=True))

    @property
    def used_pairs(self) -> list[tuple[str, str]]:
        """Channel and stage of those that are used."""
        return [pair for pair, used in zip(self.pairs, self.used, strict=True) if used]

    @property
    def notes(self) -> tuple[str, ...]:
        """Remark of each reading; empty for none."""
        return self.note or ("",) * len(self)

    @property
    def unused(self) -> Ints:
        """(m,) rows of the readings that are not used."""
        return np.flatnonzero(~self.used)
