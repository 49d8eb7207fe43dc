"""A case whose readings a table of runs gives: response surfaces between them (theory 4.8)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from geoident.forward.external.differences import Linear
from geoident.forward.external.model import ExternalModel
from geoident.forward.external.runs import ComputedRuns
from geoident.forward.external.surfaces.surface import (
    ResponseSurface,
    RunCoordinates,
    error_root,
    rms,
    surfaces_of,
)
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.external import RunTable, SurfaceKind
from geoident.model.results.surface import SurfaceTable
from geoident.units import in_unit, shown_unit

_RANGE_ROUNDING = 1e-9
"""Rounding of coordinates at the ends of the range of the runs, in parts of it."""

_BEYOND = 3.0
"""Accuracies beyond the readings of all runs from which on a reading is named."""

_SHOWN = 6  # readings that a note names


class SurfaceRuns(ComputedRuns):
    """Response surfaces in place of runs: what they give, and its exact derivatives.

    Surfaces are of readings as gauges show them: of a gauge with a zero the change since then.

    Args:
        case: the case.
        table: of its runs.
    """

    def __init__(self, case: Case, table: RunTable) -> None:
        self._table = table
        names = [parameter.name for parameter in case.parameters]
        self._columns = np.array([names.index(name) for name in table.names], dtype=np.int64)
        self.seen: Bools = np.isin(np.arange(len(names)), self._columns)
        self.given: Bools = table.given
        self.read = _as_read(case, table)
        log = [case.parameters[j].scale == "log" for j in self._columns.tolist()]
        self.coordinates = RunCoordinates(
            np.array(log, dtype=bool), table.values.min(axis=0), table.values.max(axis=0)
        )
        accuracy = np.array([channel.accuracy for channel in case.channels])
        self.accuracy = np.broadcast_to(accuracy, self.given.shape)[self.given]
        self.surfaces = _surfaces(
            self.coordinates.of(table.values), self.read, self.accuracy, table.surface
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Runs that were left out, and bounds that were moved."""
        return self._table.notes

    def computed(self, p: Floats) -> Floats:
        """Readings (n_stages, n_channels), SI, at p (n,); NaN where there is no column."""
        return self._placed(np.array([value for value, _ in self._at(p)]))

    def derivatives(self, p: Floats) -> Floats:
        """Their derivatives (n_stages, n_channels, n) at p (n,)."""
        slope = self.coordinates.slope(p[self._columns])
        jacobian = np.zeros((len(self.surfaces), len(p)))
        jacobian[:, self._columns] = [gradient * slope for _, gradient in self._at(p)]
        return self._placed(jacobian)

    def error_root(self, p: Floats) -> Floats:
        """A root B (n_stages, n_channels, k) of the covariance B B^T of the own errors at p (n,).

        SI; 0 where there is no column. It does not depend on what else is asked.

        Args:
            p: (n,) where.
        """
        root = error_root(self.surfaces, self.coordinates.of(p[self._columns]))
        return np.asarray(np.nan_to_num(self._placed(root)))

    def why_outside(self, p: Floats) -> str | None:
        """Why p (n,) is outside of the runs, or None."""
        u = self.coordinates.of(p[self._columns])
        beyond = np.flatnonzero(np.abs(u) > 1.0 + _RANGE_ROUNDING)
        if not beyond.size:
            return None
        return f"{self._table.names[int(beyond[0])]} is beyond the runs of the table"

    def table(self, case: Case, p: Floats) -> SurfaceTable:
        """The surfaces and their errors, those of their own at p (n,).

        Args:
            case: of the runs.
            p: (n,) where.
        """
        own = np.linalg.norm(self.error_root(p), axis=2)[self.given]
        places = np.argwhere(self.given).tolist()
        channels = [case.channels[j] for _, j in places]
        return SurfaceTable(
            file=self._table.called,
            runs=len(self._table),
            channels=tuple(channel.name for channel in channels),
            stages=tuple(case.stages[i].name for i, _ in places),
            words=tuple(surface.words for surface in self.surfaces),
            left_out=np.array([rms(surface.errors) for surface in self.surfaces]),
            own=own,
            accuracy=case.accuracies.T[self.given],
            lower=self.read.min(axis=0),
            upper=self.read.max(axis=0),
            units=tuple(channel.unit for channel in channels),
            dimensions=tuple(channel.dimension for channel in channels),
        )

    def _at(self, p: Floats) -> list[tuple[float, Floats]]:
        u = self.coordinates.of(p[self._columns])
        return [surface.value(u) for surface in self.surfaces]

    def _placed(self, flat: Floats) -> Floats:
        """Numbers (m, ...) of the columns as (n_stages, n_channels, ...); NaN without column."""
        table = np.full((*self.given.shape, *flat.shape[1:]), np.nan)
        table[self.given] = flat
        return table


def _as_read(case: Case, table: RunTable) -> Floats:
    """Readings (r, m) of the columns, those of gauges with a zero since then."""
    readings = table.readings.copy()
    for j, channel in enumerate(case.channels):
        zero = case.zero_of(channel) - 1  # the virgin state has no column
        if channel.is_zeroed and zero >= 0:
            since = table.readings[:, zero, j][:, None]
            later = np.arange(readings.shape[1]) >= zero
            readings[:, later, j] -= np.where(np.isnan(since), 0.0, since)
    return np.asarray(readings[:, table.given])


def _surfaces(
    u: Floats, readings: Floats, accuracy: Floats, kind: SurfaceKind
) -> tuple[ResponseSurface, ...]:
    """The surfaces of a table, found once a process: a command builds its model several times."""
    return _found(u.tobytes(), readings.tobytes(), accuracy.tobytes(), u.shape, kind)


@lru_cache(maxsize=4)
def _found(
    u: bytes, readings: bytes, accuracy: bytes, shape: tuple[int, int], kind: SurfaceKind
) -> tuple[ResponseSurface, ...]:
    sizes = np.frombuffer(accuracy)
    table = np.frombuffer(readings).reshape(shape[0], len(sizes))
    return surfaces_of(np.frombuffer(u).reshape(shape), table, sizes, kind)


class TableModel(ExternalModel):
    """A case that a table of runs answers, within the range of its runs.

    Args:
        case: the case.
        surfaces: between its runs.
    """

    def __init__(self, case: Case, surfaces: SurfaceRuns) -> None:
        super().__init__(case, surfaces)
        self.surfaces = surfaces

    def domain_fault(self, p: Floats) -> str | None:
        """Why finite p (n,) is outside the range of the runs, or None."""
        return self.surfaces.why_outside(p)

    def linear(self, p: Floats, *, exact: bool = False) -> Linear:
        """What the surfaces give at p (n,), (m,), and their derivatives.

        Args:
            p: (n,) parameters.
            exact: of no effect: derivatives are exact.
        """
        v = self.differences.values(p)
        jacobian = self.surfaces.jacobian(p, self._check)
        return Linear(p, v, jacobian[self.surfaces.given])

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know: of the table, its surfaces, and readings beyond its runs."""
        return (*self.surfaces.notes, *self._outside())

    def surface_table(self, p: Floats) -> SurfaceTable:
        """The surfaces and their errors, those of their own at p (n,)."""
        return self.surfaces.table(self.case, p)

    def _outside(self) -> tuple[str, ...]:
        """A note on readings far outside those of all runs, if there are any."""
        case, given = self.case, self.surfaces.given
        low, high = np.full((2, *given.shape), np.nan)
        low[given], high[given] = self.surfaces.read.min(axis=0), self.surfaces.read.max(axis=0)
        rows = {channel.name: j for j, channel in enumerate(case.channels)}
        columns = {stage.name: i for i, stage in enumerate(case.stages)}
        outside = []
        for reading in case.readings:
            channel = case.channels[rows[reading.channel]]
            own = (channel.offset, channel.drift, channel.drift_per_stage)
            if reading.value is None or reading.bad or any(own) or reading.stage not in columns:
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
