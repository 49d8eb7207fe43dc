"""Channels that are shown together, and how: by gauge, or by a line on which several gauges lie.

A settlement trough is a levelling line, or single settlements at one level; a pendulum is several
displacements on one plumb line. What lies on no line is shown over time only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.result import GaugeTable, Result
from geoident.report.text.case import ACROSS, ALONG, gauge_entry, gauge_quantity

TROUGH, CASING, EXTENSOMETER, PLUMB, FIBRE = "trough", "casing", "extensometer", "plumb", "fibre"
_LEAST_ON_LINE = 3
_NEAR = 1e-3
"""Part of the length of a line by which points may be off it."""


@dataclass(frozen=True)
class Instrument:
    """Channels that are shown together.

    Args:
        name: of the gauge; for an inclinometer with its axis; for several gauges first and last.
        rows: its channels in the table of gauges.
        labels: names of its anchors, points or depths; empty for a gauge of one channel.
        quantity: what the channels read, with unit and direction, as an axis says it.
        kind: of the gauge, as the case has it; empty where that is not known.
        line: how it is shown along its length: one of `TROUGH`, `CASING`, `EXTENSOMETER`, `PLUMB`,
            `FIBRE`; empty where it has no length.
        places: (k,) where the channels are along the line, m.
        along: what the places are, for an axis.
        fixed: place on the line that does not move, m; None for none.
    """

    name: str
    rows: tuple[int, ...]
    labels: tuple[str, ...]
    quantity: str
    kind: str = ""
    line: str = ""
    places: tuple[float, ...] = ()
    along: str = ""
    fixed: float | None = None

    @property
    def downwards(self) -> bool:
        """What it reads is positive downwards, and so is drawn over time and along the ground."""
        return self.quantity.endswith(", downwards)")


def instruments(result: Result) -> tuple[Instrument, ...]:
    """The channels by gauge, dimension and, of an inclinometer, axis."""
    table = result.gauges
    rows: dict[tuple[str, str, str], list[int]] = {}
    for row, (gauge, dimension) in enumerate(zip(table.gauges, table.dimensions, strict=True)):
        deep = gauge_entry(result, gauge).get("kind") == "inclinometer"
        axis = table.channels[row][len(gauge) + 1 :][:1] if deep else ""
        rows.setdefault((gauge, dimension, axis), []).append(row)
    return tuple(_instrument(result, *key, own) for key, own in rows.items())


def _instrument(
    result: Result, gauge: str, dimension: str, axis: str, rows: list[int]
) -> Instrument:
    table, kind = result.gauges, str(gauge_entry(result, gauge).get("kind", ""))
    labels = tuple(table.channels[r][len(gauge) + 1 + len(axis) :] for r in rows)
    quantity = gauge_quantity(result, gauge, dimension)
    if axis == "S":
        quantity = quantity.replace(ACROSS, ALONG)
    name = f"{gauge}.{axis}" if axis else gauge
    instrument = Instrument(name, tuple(rows), labels, quantity, kind)
    if axis:
        depths = np.array([float(label) for label in labels])
        return _on_line(instrument, CASING, depths, "depth along the casing (m)")
    if len(rows) == 1:
        return instrument
    if dimension == "length" and kind in {"", "extensometer"}:
        apart = np.linalg.norm(table.second[rows] - table.first[rows], axis=1)
        return replace(
            _on_line(instrument, EXTENSOMETER, apart, "depth from the head (m)"), fixed=0.0
        )
    if (kind, dimension) == ("levelling", "length"):
        return _on_line(instrument, TROUGH, *_along(table.second[rows]))
    if (kind, dimension) == ("strain", "strain"):
        return _on_line(instrument, FIBRE, *_along(table.second[rows]))
    return instrument


def _on_line(instrument: Instrument, line: str, places: Floats, along: str) -> Instrument:
    """An instrument with its length; as it was where it has none."""
    if not np.isfinite(places).all() or np.ptp(places) == 0.0:
        return instrument
    return replace(instrument, line=line, places=tuple(map(float, places)), along=along)


def _along(points: Floats) -> tuple[Floats, str]:
    """Places (k,) of points (k, dim) along their line: a coordinate, or else the length."""
    extent = np.ptp(points, axis=0)
    moving = np.flatnonzero(extent > _NEAR * extent.max(initial=0.0))
    if len(moving) == 1:
        return points[:, moving[0]], f"{'xyz'[moving[0]]} (m)"
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.r_[0.0, np.cumsum(steps)], "distance along the line (m)"


def lines(result: Result) -> tuple[Instrument, ...]:
    """All that has a length: instruments of several channels, and gauges that lie on one line."""
    every = instruments(result)
    single = [one for one in every if len(one.rows) == 1]
    return (
        *(one for one in every if one.line),
        *_grouped(result.gauges, single, _level, TROUGH),
        *_grouped(result.gauges, single, _plumb_line, PLUMB),
    )


def _grouped(
    table: GaugeTable,
    single: Sequence[Instrument],
    line_of: Callable[[GaugeTable, Instrument], Iterable[tuple[float | str, ...]]],
    line: str,
) -> list[Instrument]:
    """Gauges of one channel that lie on one line: the longest lines first, each gauge on one."""
    groups: dict[tuple[float | str, ...], list[Instrument]] = {}
    for one in single:
        for place in line_of(table, one):
            groups.setdefault(place, []).append(one)
    grouped, taken = [], set[int]()
    for own in sorted(groups.values(), key=len, reverse=True):
        left = [one for one in own if one.rows[0] not in taken]
        if len(left) >= _LEAST_ON_LINE:
            taken |= {one.rows[0] for one in left}
            grouped.append(_line_of_gauges(table, left, line))
    return sorted(grouped, key=lambda one: one.rows)


def _line_of_gauges(table: GaugeTable, own: Sequence[Instrument], line: str) -> Instrument:
    rows = [one.rows[0] for one in own]
    points = table.second[rows]
    places, along = (points[:, -1], f"{'xyz'[points.shape[1] - 1]} (m)")
    fixed = None
    if line == TROUGH:
        places, along = _along(points)
    elif np.isfinite(table.first[rows]).all():
        fixed = float(table.first[rows[0], -1])
    order = np.argsort(places, kind="stable")
    names = [own[k].name for k in order]
    return Instrument(
        f"{names[0]} to {names[-1]}",
        tuple(rows[k] for k in order),
        tuple(names),
        own[0].quantity,
        own[0].kind,
        line,
        tuple(float(places[k]) for k in order),
        along,
        fixed,
    )


def _level(table: GaugeTable, one: Instrument) -> Iterable[tuple[float | str, ...]]:
    """The level lines of a settlement: through its point along each horizontal axis."""
    if one.kind != "settlement":
        return
    row = one.rows[0]
    point, base = table.second[row], _rounded(table.first[row])
    for k in range(len(point) - 1):
        yield (k, *_rounded(np.delete(point, k)), *base)


def _plumb_line(table: GaugeTable, one: Instrument) -> Iterable[tuple[float | str, ...]]:
    """The plumb line of a displacement or settlement that is read against one point of it."""
    row = one.rows[0]
    if one.kind in {"displacement", "settlement"}:
        first, second = table.first[row], table.second[row]
        if np.isfinite(first).all() and np.allclose(first[:-1], second[:-1], atol=1e-6):
            yield (one.quantity, *_rounded(first))


def _rounded(point: Floats) -> tuple[float | str, ...]:
    """Coordinates to a millimetre; NaN is equal to NaN."""
    return tuple("-" if np.isnan(x) else round(float(x), 3) for x in point)
