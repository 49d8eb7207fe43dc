"""Readings that one mistake may have changed together: what was written or read at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from geoident.identify.assessment.mistakes import Suspects
from geoident.model.arrays import Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, ReadingTable

_SERIES = 3
"""Readings of a channel that can show a missed zero."""
_MOST = 40_000
"""Squares of the channels of a gauge, or the gauges of a kind, times the readings of each, beyond
which exchanged names are not looked for: they would be as many hypotheses."""


def suspects(case: Case, readings: ReadingTable) -> tuple[Suspects, ...]:
    """The used readings that one mistake may have changed together.

    By a factor or a zero: each by itself, those of a channel, of an axis of an inclinometer, a
    gauge, a kind of gauges and a file, and of a gauge or kind those of one stage. Equal sets count
    once, as the smallest of these. By an exchange: two channels of a gauge, two gauges of a kind,
    two axes, two readings of a stage, and all channels of an axis or gauge in reverse order.

    Args:
        case: of the readings.
        readings: all of them.
    """
    rows = np.flatnonzero(readings.used)
    channel = [readings.channel[k] for k in rows]
    gauge = [readings.gauge[k] for k in rows]
    stage = [readings.stage[k] for k in rows]
    kind = kinds_of(case, readings)
    file = [case.readings[k].location.file if not case.readings[k].key else "" for k in rows]
    number = {name: n for n, name in enumerate(dict.fromkeys(channel))}
    of_channel = np.array([number[name] for name in channel], dtype=np.int64)
    series = np.bincount(of_channel, minlength=len(number)) >= _SERIES
    zeroed = np.array([series[n] for n in of_channel], dtype=np.bool_) & np.array(
        [one.is_zeroed for one in channels_of(case, channel)], dtype=np.bool_
    )
    levels: list[tuple[str, Sequence[str]]] = [
        ("reading", [str(n) for n in range(len(rows))]),
        ("channel", channel),
        ("gauge", gauge),
        ("axis", [_axis(one, of) for one, of in zip(channel, gauge, strict=True)]),
        ("stage of a gauge", [f"{a}\n{b}" for a, b in zip(gauge, stage, strict=True)]),
        ("kind", kind),
        ("stage of a kind", [f"{a}\n{b}" for a, b in zip(kind, stage, strict=True)]),
        ("file", file),
    ]
    distinct: dict[bytes, Suspects] = {}
    for level, owners in levels:
        for name, members in groups_of(owners).items():
            if name:
                whole = level in ("channel", "gauge", "kind") and bool(zeroed[members].all())
                free = whole or level == "reading"
                channels = of_channel[members] if free else of_channel[:0]
                distinct.setdefault(members.tobytes(), Suspects(members, level, name, channels))
    return (*distinct.values(), *_exchanges(case, readings))


def _exchanges(case: Case, readings: ReadingTable) -> Iterator[Suspects]:
    """Readings that may stand in the places of others; equal exchanges count once."""
    when: dict[str, dict[tuple[str, str], int]] = {}
    for n, k in enumerate(np.flatnonzero(readings.used).tolist()):
        at = readings.stage[k], str(readings.time[k])
        when.setdefault(readings.channel[k], {})[at] = n
    gauges: dict[str, list[Channel]] = {}
    for one in case.channels:
        if one.name in when:
            gauges.setdefault(one.gauge, []).append(one)
    known: set[tuple[bytes, bytes]] = set()
    mean = sum(map(len, when.values())) / max(len(when), 1)
    for level, name, pairs in _pairs(gauges, int(np.sqrt(_MOST / max(mean, 1.0)))):
        every = [
            (when[first][at], when[second][at])
            for first, second in pairs
            for at in sorted(when[first].keys() & when[second].keys())
        ]
        # in one row of a sheet, or in all of them
        for chosen in [every, *([one] for one in every if len(pairs) == 1 and len(every) > 1)]:
            here = np.array([*chosen, *(pair[::-1] for pair in chosen)], dtype=np.int64)
            here = here.reshape(-1, 2)[np.argsort(here.reshape(-1, 2)[:, 0])]
            key = here[:, 0].tobytes(), here[:, 1].tobytes()
            if len(here) and key not in known:
                known.add(key)
                of = "one row" if len(chosen) < len(every) else level
                yield Suspects(here[:, 0], of, name, source=here[:, 1])


def _pairs(
    gauges: dict[str, list[Channel]], most: int
) -> Iterator[tuple[str, str, list[tuple[str, str]]]]:
    """Level, names for people, and pairs of channels that may have changed places.

    Args:
        gauges: channels of each.
        most: channels of a gauge, or gauges of a kind, of which any two are paired.
    """
    for gauge, channels in gauges.items():
        names = [one.name for one in channels]
        alike = {one.name: one.dimension for one in channels}
        if len(names) <= most:
            for first, second in combinations(names, 2):
                if alike[first] == alike[second]:
                    yield "channels", f"{first} and {second}", [(first, second)]
        axes = groups_of([_axis(one.name, gauge) for one in channels])
        for axis, members in axes.items():
            line = [names[n] for n in members.tolist()]
            if len(line) > 2 and len({alike[name] for name in line}) == 1:
                half = list(zip(line, line[::-1], strict=True))[: len(line) // 2]
                yield "order", axis, half
        for (first, a), (second, b) in combinations(axes.items(), 2):
            if len(a) == len(b) > 1 and alike[names[a[0]]] == alike[names[b[0]]]:
                both = [(names[i], names[j]) for i, j in zip(a.tolist(), b.tolist(), strict=True)]
                yield "axes", f"{first} and {second}", both
    kinds = groups_of([f"{of[0].kind}\n{of[0].dimension}" for of in gauges.values()])
    every = list(gauges)
    for members in kinds.values():
        if len(members) > most:
            continue
        for i, j in combinations(members.tolist(), 2):
            first, second = every[i], every[j]
            ends = {one.name.removeprefix(first): one.name for one in gauges[first]}
            others = {one.name.removeprefix(second): one.name for one in gauges[second]}
            common = [(ends[end], others[end]) for end in ends if end in others]
            if common:
                yield "gauges", f"{first} and {second}", common


def _axis(channel: str, gauge: str) -> str:
    """The channels of a gauge that differ by a number only: the depths of one axis."""
    letters = re.match(r"[^\d.+-]*", channel.removeprefix(gauge).removeprefix("."))
    return f"{gauge}.{letters[0]}" if letters and letters[0] else gauge


def channels_of(case: Case, names: Sequence[str]) -> list[Channel]:
    """The channels of names."""
    of = {channel.name: channel for channel in case.channels}
    return [of[name] for name in names]


def kinds_of(case: Case, readings: ReadingTable) -> list[str]:
    """Kind of the gauge of each used reading, with the dimension of what it reads."""
    used = [readings.channel[k] for k in np.flatnonzero(readings.used)]
    return [f"{one.kind}\n{one.dimension}" for one in channels_of(case, used)]


def groups_of(owners: Sequence[str]) -> dict[str, Ints]:
    """Owner to the numbers of what it owns."""
    members: dict[str, list[int]] = {}
    for n, owner in enumerate(owners):
        members.setdefault(owner, []).append(n)
    return {owner: np.array(each, dtype=np.int64) for owner, each in members.items()}
