"""A case whose readings a table of runs gives: response surfaces between them (theory 4.8)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from geoident.forward.external.model import ExternalModel
from geoident.forward.external.surfaces.surface import (
    ResponseSurface,
    RunCoordinates,
    error_root,
    rms,
    surfaces_of,
)
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.external import RunTable, SurfaceKind
from geoident.model.results.surface import SurfaceTable
from geoident.units import in_unit, shown_unit

_RANGE_ROUNDING = 1e-9
"""Rounding of coordinates at the ends of the range of the runs, in parts of it."""

_BEYOND = 3.0
"""Accuracies beyond the readings of all runs from which on a reading is named."""

_SHOWN = 6  # readings that a note names


class TableModel(ExternalModel):
    """A case that a table of runs answers by response surfaces, within the range of its runs.

    Surfaces are of readings as gauges show them: of a gauge with a zero the change since then.

    Args:
        case: the case.
        table: of its runs.

    Attributes:
        read: (r, m) readings of the runs that surfaces go through, SI.
        accuracy: (m,) of their channels, SI.
        coordinates: of parameters among the runs.
        surfaces: of the m readings.
    """

    def __init__(self, case: Case, table: RunTable) -> None:
        names = [parameter.name for parameter in case.parameters]
        self._table = table
        self._columns = np.array([names.index(name) for name in table.names], dtype=np.int64)
        super().__init__(case, table.provided, np.isin(np.arange(len(names)), self._columns))
        self.read = _as_read(case, table)
        self.coordinates = RunCoordinates(
            np.array([case.parameters[j].scale == "log" for j in self._columns], dtype=bool),
            table.values.min(axis=0),
            table.values.max(axis=0),
        )
        accuracy = np.array([channel.accuracy for channel in case.channels])
        self.accuracy = np.broadcast_to(accuracy, self.provided.shape)[self.provided]
        u = self.coordinates.of(table.values)
        self.surfaces = _surfaces(
            u.tobytes(), self.read.tobytes(), self.accuracy.tobytes(), u.shape, table.surface
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Runs that were left out, bounds that were moved, and readings beyond all runs."""
        return (*self._table.notes, *self._beyond_runs())

    def domain_fault(self, p: Floats) -> str | None:
        """Why finite p (n,) is outside the range of the runs, or None."""
        beyond = np.flatnonzero(np.abs(self._u(p)) > 1.0 + _RANGE_ROUNDING)
        if not beyond.size:
            return None
        return f"{self._table.names[int(beyond[0])]} is beyond the runs of the table"

    def given_readings(self, p: Floats, *, derivatives: bool, exact: bool) -> Floats:
        """What the surfaces give at p (n,), and their exact derivatives."""
        u, slope = self._u(p), self.coordinates.slope(p[self._columns])
        columns = np.zeros((len(self.surfaces), 1 + len(p)))
        for row, surface in zip(columns, self.surfaces, strict=True):
            row[0], gradient = surface.value(u)
            row[1 + self._columns] = gradient * slope
        return self._placed(columns if derivatives else columns[:, :1])

    def error_root(self, p: Floats) -> Floats:
        """A root B (n_stages, n_channels, k) of the covariance B B^T of the own errors at p (n,).

        SI; 0 where there is no column. It does not depend on what else is asked.
        """
        return np.nan_to_num(self._placed(error_root(self.surfaces, self._u(p))))

    def surface_table(self, p: Floats) -> SurfaceTable:
        """The surfaces and their errors, those of their own at p (n,)."""
        case, places = self.case, np.argwhere(self.provided).tolist()
        channels = [case.channels[j] for _, j in places]
        return SurfaceTable(
            file=self._table.called,
            runs=len(self._table),
            channels=tuple(channel.name for channel in channels),
            stages=tuple(case.stages[i].name for i, _ in places),
            words=tuple(surface.words for surface in self.surfaces),
            left_out=np.array([rms(surface.errors) for surface in self.surfaces]),
            own=np.linalg.norm(self.error_root(p), axis=2)[self.provided],
            accuracy=case.accuracies.T[self.provided],
            lower=self.read.min(axis=0),
            upper=self.read.max(axis=0),
            units=tuple(channel.unit for channel in channels),
            dimensions=tuple(channel.dimension for channel in channels),
        )

    def _u(self, p: Floats) -> Floats:
        """Coordinates among the runs of parameters p (n,)."""
        return self.coordinates.of(p[self._columns])

    def _placed(self, flat: Floats) -> Floats:
        """Numbers (m, ...) of the columns as (n_stages, n_channels, ...); NaN without column."""
        table = np.full((*self.provided.shape, *flat.shape[1:]), np.nan)
        table[self.provided] = flat
        return table

    def _beyond_runs(self) -> tuple[str, ...]:
        """A note on readings far outside those of all runs, if there are any."""
        case = self.case
        low, high = self._placed(self.read.min(axis=0)), self._placed(self.read.max(axis=0))
        rows = {channel.name: j for j, channel in enumerate(case.channels)}
        columns = {stage.name: i for i, stage in enumerate(case.stages)}
        outside = []
        for reading in case.readings:
            channel = case.channels[rows[reading.channel]]
            errors = channel.ratio, channel.offset, channel.drift, channel.drift_per_stage
            if reading.value is None or reading.bad or any(errors) or reading.stage not in columns:
                continue
            at = columns[reading.stage], rows[reading.channel]
            room = _BEYOND * channel.sd(reading)
            if not low[at] - room <= reading.value <= high[at] + room:
                unit = channel.unit, channel.dimension
                value, *ends = (
                    f"{in_unit(x, *unit):.4g}"
                    for x in (reading.value, float(low[at]), float(high[at]))
                )
                name = f" {shown_unit(*unit)}".rstrip()
                outside.append(
                    f"{reading.channel} at {reading.stage} ({value}{name}; the runs gave "
                    f"{ends[0]} to {ends[1]}{name})"
                )
        if not outside:
            return ()
        more = f" and {len(outside) - _SHOWN} more" if len(outside) > _SHOWN else ""
        return (
            f"readings beyond what any run of the table gave: {', '.join(outside[:_SHOWN])}{more}",
        )


def _as_read(case: Case, table: RunTable) -> Floats:
    """Readings (r, m) of the columns, those of gauges with a zero since then."""
    readings = table.readings.copy()
    for j, channel in enumerate(case.channels):
        zero = case.zero_of(channel) - 1  # the virgin state has no column
        if channel.is_zeroed and zero >= 0:
            since = table.readings[:, zero, j][:, None]
            later = np.arange(readings.shape[1]) >= zero
            readings[:, later, j] -= np.where(np.isnan(since), 0.0, since)
    return np.asarray(readings[:, table.provided])


@lru_cache(maxsize=4)
def _surfaces(
    u: bytes, readings: bytes, accuracy: bytes, shape: tuple[int, int], kind: SurfaceKind
) -> tuple[ResponseSurface, ...]:
    """The surfaces of a table, found once a process: a command builds its model several times."""
    sizes = np.frombuffer(accuracy)
    table = np.frombuffer(readings).reshape(shape[0], len(sizes))
    return surfaces_of(np.frombuffer(u).reshape(shape), table, sizes, kind)
