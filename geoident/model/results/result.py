"""What a command found: plain tables in SI units, ready to be written and shown."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import ErrorParts, ReadingTable, weighted_mean
from geoident.model.mesh import Mesh
from geoident.model.parameter import Prior
from geoident.model.results.alarms import AlarmState
from geoident.model.results.backtest import Backtest
from geoident.model.results.bands import Prediction
from geoident.model.results.columns import VIEWS, Record, column, derived, select
from geoident.model.results.convergence import ConvergenceState
from geoident.model.results.costs import Counts
from geoident.model.results.decisions import DecisionState, TellingReading
from geoident.model.results.findings import Finding
from geoident.model.results.in_service import (
    ChangeRow,
    Judged,
    ParameterChangeRow,
    PowerRow,
    SeasonalFit,
)
from geoident.model.results.interfaces import InterfaceStates
from geoident.model.results.left_out import LeftOutTable
from geoident.model.results.model_error import ModelErrorTable
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.plan import GaugePlan
from geoident.model.results.posterior import PosteriorDraws
from geoident.model.results.reduced import KeptReducedModel
from geoident.model.results.rivals import Evidence, ModelComparison, Rivals
from geoident.model.results.safety import StageSafety
from geoident.model.results.settlement import SettlementState
from geoident.model.results.shells import ShellForces
from geoident.model.results.surface import SurfaceTable
from geoident.model.results.times import StageTimes
from geoident.model.results.updates import UpdateHistory
from geoident.model.results.varied import FieldEstimate
from geoident.model.results.yielded import Mechanism, YieldedGround
from geoident.model.yielding import Certificate
from geoident.units import shown_unit, si_unit, size_in

GIVEN = ("json", "diff")
"""Views without what the case says of the parameters."""

PARAMETERS = ("parameter", "other")
"""Axes along which all parameters of a result stand."""

STOPPED = "out-of-budget"
"""Status of an outcome that was cut short as its time was used up."""


class ParameterTable(Record):
    """The identified parameters, one entry of every array each.

    A parameter that neither readings nor its prior determine keeps its ``value`` for further
    computing but has NaN in ``sd``, ``lower95``, ``upper95``; whoever shows it says "not
    determined" in place of the number. One that only its prior knows has the numbers of the prior.

    Args:
        names: n names.
        values: (n,) SI.
        sd: (n,) standard deviation, SI.
        lower95: (n,) lower end of the 95 % interval, SI.
        upper95: (n,) upper end.
        lower: (n,) lower bound.
        upper: (n,) upper bound.
        start: (n,) start value.
        at_bound: (n,) the value lies on a bound.
        determined: (n,) readings (and prior) determine it.
        priors: what is known of each beside the readings, None for nothing.
        units: n units for display, as the user wrote them.
        dimensions: n keys of `geoident.units.DIMENSIONS`.
        covariance: (n, n) SI; NaN rows where not determined.
        correlation: (n, n).
        fields: of each the name of the field of which it is the coefficient of a mode, or nothing;
            empty where there are no fields.
        descriptions: what each is in the words of the case; empty where the case says nothing.
    """

    names: tuple[str, ...] = column("parameter", name="parameter")
    values: Floats = column(
        "parameter", name="value", dimension="parameter", known="known", array="estimate"
    )
    sd: Floats = column("parameter", dimension="parameter", array="estimate_sd")
    lower95: Floats = column(
        "parameter",
        name="ci95",
        part=("bound", "lower"),
        dimension="parameter",
        array="estimate_lower95",
    )
    upper95: Floats = column(
        "parameter",
        name="ci95",
        part=("bound", "upper"),
        dimension="parameter",
        array="estimate_upper95",
    )
    units: tuple[str, ...] = column(
        "parameter",
        name="display_unit",
        title="unit",
        dimension="parameter",
        hidden=("xarray", "diff"),
    )
    start: Floats = column("parameter", dimension="parameter", hidden=GIVEN)
    lower: Floats = column("parameter", dimension="parameter", hidden=GIVEN, array="lower_bound")
    upper: Floats = column("parameter", dimension="parameter", hidden=GIVEN, array="upper_bound")
    at_bound: Bools = column("parameter")
    determined: Bools = column("parameter")
    priors: tuple[Prior | None, ...] = column("parameter", prefix="prior_")
    dimensions: tuple[str, ...] = column("parameter", name="dimension", hidden=VIEWS)
    covariance: Floats = column("parameter", "other")
    correlation: Floats = column("parameter", "other", sheet="{other}")
    fields: tuple[str, ...] = column(
        "parameter", default=(), name="field", optional=True, hidden=VIEWS
    )
    descriptions: tuple[str, ...] = column(
        "parameter", default=(), name="description", optional=True, hidden=("xarray", "diff")
    )

    @property
    def known(self) -> Bools:
        """(n,) by readings, or at least by a prior: the value is one for people."""
        return np.asarray(self.determined | np.isfinite(self.sd))

    def described(self, i: int) -> str:
        """What a parameter is in the words of the case; empty where it says nothing.

        Args:
            i: its row.
        """
        return self.descriptions[i] if self.descriptions else ""

    @property
    @derived("parameter", name="name", hidden=VIEWS)
    def own_names(self) -> tuple[str, ...]:
        """N names, as plain texts beside the labels of the axis."""
        return self.names

    @property
    @derived("other", name="other")
    def other_names(self) -> tuple[str, ...]:
        """N names, of the columns of covariance and correlation."""
        return self.names

    @property
    @derived("parameter", name="unit", hidden=VIEWS)
    def si_units(self) -> tuple[str, ...]:
        """N SI units."""
        return tuple(map(si_unit, self.dimensions))

    @property
    @derived("parameter", name="prior", hidden=VIEWS)
    def prior_texts(self) -> tuple[str, ...]:
        """N priors as texts; empty for none."""
        return tuple("" if prior is None else str(prior) for prior in self.priors)

    @property
    def named(self) -> Ints:
        """Numbers (k,) of the parameters that the case names: without the modes of fields."""
        modes = self.fields or ("",) * len(self.names)
        return np.flatnonzero([not name for name in modes])

    def of(self, names: Sequence[str]) -> ParameterTable:
        """The rows of these parameters, in this order."""
        return self.picked(np.array([self.names.index(name) for name in names], dtype=np.int64))

    def picked(self, order: Ints) -> ParameterTable:
        """Some rows (k,) of the table."""
        return select(self, PARAMETERS, order)


class GaugeTable(Record):
    """The channels of the gauges: what was read of them, and what the model says at all stages.

    The wide tables (n_channels, n_stages) are views of the readings: of several readings of a
    channel in a stage they hold the weighted mean of those used, else of the good ones; a bad one
    only where there is no good one. NaN where there is none.

    Args:
        channels: names of the channels.
        stages: names of the stages, the virgin state not among them.
        computed: (n_channels, n_stages) the model at the estimate, SI; NaN where it says nothing.
        first: (n_channels, dim) reference points, m; NaN for fixed ground.
        second: (n_channels, dim) points whose motion is read, m.
        readings: all of them.
        gauges: names of the gauges to which the channels belong.
        dimensions: of each channel, keys of `geoident.units.DIMENSIONS`.
        units: of each channel, in which people want to see it.
        accuracy: (n_channels,) standard deviation of one reading, SI.
        errors: for each channel what its readings share of their errors, None where nothing; as
            estimated where they are. Empty where no channel shares any.
        times: when the stages and their moments are; None where no stage lasts.
    """

    channels: tuple[str, ...] = column("gauge", name="gauge")
    stages: tuple[str, ...] = column("stage", name="stage")
    computed: Floats = column("gauge", "stage", dimension="gauge")
    first: Floats = column(
        "gauge", "axis", name="points", part=("end", "first"), dimension="length"
    )
    second: Floats = column(
        "gauge", "axis", name="points", part=("end", "second"), dimension="length"
    )
    readings: ReadingTable = column(group="readings")
    gauges: tuple[str, ...] = column("gauge", name="instrument")
    dimensions: tuple[str, ...] = column("gauge", name="dimension")
    units: tuple[str, ...] = column("gauge", name="display_unit")
    accuracy: Floats = column("gauge", dimension="gauge")
    errors: tuple[ErrorParts | None, ...] = column("gauge", default=(), optional=True)
    times: StageTimes | None = column(default=None, group="times", optional=True)

    @property
    def ends(self) -> Bools:
        """(n_stages,) which are ends of stages; the others are moments of stages that last."""
        if self.times is None:
            return np.ones(len(self.stages), dtype=np.bool_)
        return self.times.ends(self.stages)

    @property
    def series_times(self) -> Floats | None:
        """(1 + n_stages,) days of all states for a series of pictures; None for their numbers."""
        return None if self.times is None else self.times.series

    @classmethod
    def from_columns(
        cls, *, mesh_errors: Floats | None = None, mesh_doubts: Floats | None = None,
        step_errors: Floats | None = None, step_doubts: Floats | None = None,
        surface_errors: Floats | None = None, **columns: Any,
    ) -> GaugeTable:  # fmt: skip
        """The table from its columns, with the errors of channels stage by stage.

        Args:
            mesh_errors: (n_channels, n_stages), see there.
            mesh_doubts: likewise.
            step_errors: likewise.
            step_doubts: likewise.
            surface_errors: (n_channels, n_stages, k), see there.
            **columns: all others.
        """
        table = cls(**columns)
        errors: list[ErrorParts | None] = []
        for i, parts in enumerate(table.errors):
            mesh, steps = (
                () if error is None or doubt is None else tuple(
                    row
                    for row in zip(table.stages, error[i].tolist(), doubt[i].tolist(), strict=True)
                    if row[1] or row[2]
                )
                for error, doubt in ((mesh_errors, mesh_doubts), (step_errors, step_doubts))
            )  # fmt: skip
            surface = [] if surface_errors is None else list(
                zip(table.stages, map(tuple, surface_errors[i].tolist()), strict=True)
            )  # fmt: skip
            errors.append(
                parts
                and replace(
                    parts,
                    mesh=mesh,
                    steps=steps,
                    surface=tuple(row for row in surface if any(row[1])),
                )
            )
        return replace(table, errors=tuple(errors))

    @property
    @derived("gauge", "stage", name="mesh_error", dimension="gauge", stored=True, optional=True)
    def mesh_errors(self) -> Floats | None:
        """(n_channels, n_stages) errors of the mesh that count in the covariance, SI."""
        return self._by_stage([() if e is None else e.mesh for e in self.errors], 1)

    @property
    @derived("gauge", "stage", name="mesh_doubt", dimension="gauge", stored=True, optional=True)
    def mesh_doubts(self) -> Floats | None:
        """(n_channels, n_stages) by how much these are uncertain, SI."""
        return self._by_stage([() if e is None else e.mesh for e in self.errors], 2)

    @property
    @derived("gauge", "stage", name="step_error", dimension="gauge", stored=True, optional=True)
    def step_errors(self) -> Floats | None:
        """(n_channels, n_stages) errors by the steps in time that count in the covariance, SI."""
        return self._by_stage([() if e is None else e.steps for e in self.errors], 1)

    @property
    @derived("gauge", "stage", name="step_doubt", dimension="gauge", stored=True, optional=True)
    def step_doubts(self) -> Floats | None:
        """(n_channels, n_stages) by how much these are uncertain, SI."""
        return self._by_stage([() if e is None else e.steps for e in self.errors], 2)

    @property
    @derived(
        "gauge", "stage", "surface_error_source",
        name="surface_error", dimension="gauge", stored=True, optional=True,
    )  # fmt: skip
    def surface_errors(self) -> Floats | None:
        """(n_channels, n_stages, k) standard deviations of the k shared errors of surfaces, SI."""
        return self._by_stage([() if e is None else e.surface for e in self.errors], 1)

    def _by_stage(self, rows: Sequence[Sequence[tuple[Any, ...]]], place: int) -> Floats | None:
        """Numbers (n_channels, n_stages, ...) at a place of rows that begin with their stage."""
        known = [
            (i, self.stages.index(row[0]), row[place])
            for i, own in enumerate(rows)
            for row in own
            if row[0] in self.stages
        ]
        if not known:
            return None
        most = max(np.size(value) for *_, value in known)
        table = np.zeros((len(self.channels), len(self.stages), most))
        for i, j, value in known:
            table[i, j, : np.size(value)] = value
        return table if np.ndim(known[0][2]) else table[:, :, 0]

    @property
    @derived("gauge", name="unit")
    def si_units(self) -> tuple[str, ...]:
        """SI unit of each channel."""
        return tuple(map(si_unit, self.dimensions))

    @property
    @derived("reading", name="dimension", group="readings")
    def reading_dimensions(self) -> tuple[str, ...]:
        """Dimension of each reading."""
        known = dict(zip(self.channels, self.dimensions, strict=True))
        return tuple(known.get(channel, "") for channel in self.readings.channel)

    @property
    @derived("reading", name="unit", group="readings")
    def reading_units(self) -> tuple[str, ...]:
        """SI unit of each reading."""
        return tuple(map(si_unit, self.reading_dimensions))

    @property
    @derived("gauge", "stage", dimension="gauge")
    def residual(self) -> Floats:
        """(n_channels, n_stages) measured minus computed, SI."""
        return self.measured - self.computed

    @property
    @derived("gauge", "stage", dimension="gauge")
    def measured(self) -> Floats:
        """(n_channels, n_stages) readings, SI."""
        return self._wide[0]

    @property
    @derived("gauge", "stage", dimension="gauge")
    def sd(self) -> Floats:
        """(n_channels, n_stages) standard deviation of each reading, SI."""
        return self._wide[1]

    @property
    @derived("gauge", "stage")
    def used(self) -> Bools:
        """(n_channels, n_stages) the reading took part in the identification."""
        return self._wide[2]

    @property
    @derived("gauge", "stage")
    def bad(self) -> Bools:
        """(n_channels, n_stages) the reading is known to be wrong."""
        return self._wide[3]

    @cached_property
    def shown_units(self) -> tuple[str, ...]:
        """The unit of each channel, in which `in_units` gives its readings."""
        pairs = zip(self.units, self.dimensions, strict=True)
        return tuple(shown_unit(unit, dimension) for unit, dimension in pairs)

    @cached_property
    def common_unit(self) -> str | None:
        """The unit of all channels; None where they have several."""
        units = set(self.shown_units)
        return units.pop() if len(units) == 1 else None

    @cached_property
    def finest(self) -> Mapping[str, float]:
        """The smallest standard deviation, SI, of the readings in a unit, where one is known."""
        smallest: dict[str, float] = {}
        for unit, sd in zip(self.shown_units, self.sd, strict=True):
            known = sd[sd > 0.0]
            if known.size:
                smallest[unit] = min(smallest.get(unit, np.inf), float(known.min()))
        return smallest

    def in_units(self, values: Floats) -> Floats:
        """SI values (n_channels, ...) in the units in which people want to see them."""
        pairs = zip(self.shown_units, self.dimensions, strict=True)
        size = np.array([size_in(*pair) or 1.0 for pair in pairs], dtype=np.float64)
        return np.asarray(values / size.reshape(-1, *(1,) * (values.ndim - 1)))

    def place(self, row: int) -> tuple[int, int] | None:
        """Row and column of a reading in the wide tables; None if its channel is not there."""
        return self._places.get((self.readings.channel[row], self.readings.stage[row]))

    @cached_property
    def rows(self) -> Mapping[tuple[int, int], Ints]:
        """Row and column of the wide tables to the (m,) readings that count there."""
        rows: dict[tuple[int, int], list[int]] = {}
        taken = np.flatnonzero(np.isfinite(self.readings.value))
        rank = np.where(self.readings.used, 0, np.where(self.readings.bad, 2, 1))
        for k in taken[np.argsort(rank[taken], kind="stable")].tolist():
            place = self.place(k)
            if place is not None:
                group = rows.setdefault(place, [])
                if not group or rank[k] == rank[group[0]]:
                    group.append(k)
        return {place: np.array(group, dtype=np.int64) for place, group in rows.items()}

    @cached_property
    def _places(self) -> dict[tuple[str, str], tuple[int, int]]:
        names = product(enumerate(self.channels), enumerate(self.stages))
        return {(channel, stage): (i, j) for (i, channel), (j, stage) in names}

    @cached_property
    def _wide(self) -> tuple[Floats, Floats, Bools, Bools]:
        measured, sd = (np.full(self.computed.shape, np.nan) for _ in range(2))
        used, bad = (np.zeros(self.computed.shape, dtype=np.bool_) for _ in range(2))
        table = self.readings
        for place, rows in self.rows.items():
            own = (table.sd if table.own_sd is None else table.own_sd)[rows]
            measured[place], sd[place] = _combined(table.value[rows], table.sd[rows], own)
            used[place], bad[place] = bool(table.used[rows].any()), bool(table.bad[rows[0]])
        return measured, sd, used, bad


def _combined(values: Floats, sd: Floats, own: Floats) -> tuple[float, float]:
    """The weighted mean of the (m,) readings of a channel in a stage, and its deviation.

    What they share, sd^2 - own^2, does not average out.
    """
    if len(values) == 1:
        return float(values[0]), float(sd[0])
    mean, alone = weighted_mean(values, own)
    shared = float(np.mean(np.maximum(sd**2 - own**2, 0.0)))
    return mean, math.sqrt(alone**2 + shared)


class AccuracyTable(Record):
    """Accuracies that were estimated from the residuals, one entry of every column each.

    Args:
        names: c components of variance, such as ``extensometer: reading``, or a kind of gauge where
            all that its gauges state was multiplied with one factor.
        values: (c,) standard deviations, SI; factors of kinds.
        lower95: (c,) lower end of the 95 % interval; 0 where the readings do not show any.
        upper95: (c,) upper end; infinite where the readings do not determine it.
        parts: c parts of `geoident.model.gauges.PARTS`; empty for a factor.
        dimensions: c keys of `geoident.units.DIMENSIONS`; dimensionless for a factor.
        units: c units in which people want to see them.
        of_reading: (k,) numbers of the components to which the own errors of the k readings belong,
            -1 for none.
        points: (K, c) logarithms of factors on these variances that are possible as well.
        odds: (K,) how likely these are; their sum is one.
        flat: (K,) logarithms of their weights before any reading.
    """

    names: tuple[str, ...] = column("component", name="component")
    values: Floats = column("component")
    lower95: Floats = column("component")
    upper95: Floats = column("component")
    parts: tuple[str, ...] = column("component")
    dimensions: tuple[str, ...] = column("component")
    units: tuple[str, ...] = column("component")
    of_reading: Ints = column(
        "reading", default_factory=lambda: np.zeros(0, dtype=np.int64), optional=True
    )
    points: Floats = column(
        "point", "component", default_factory=lambda: np.zeros((0, 0)), optional=True
    )
    odds: Floats = column("point", default_factory=lambda: np.zeros(0), optional=True)
    flat: Floats = column("point", default_factory=lambda: np.zeros(0), optional=True)

    @property
    def determined(self) -> Bools:
        """(c,) the readings tell them from the others."""
        return np.asarray(np.isfinite(self.upper95), dtype=np.bool_)


class Diagnostics(Record):
    """The influence of each reading; NaN where it was not used.

    The arrays have an entry for each of the k readings, or in the wide view (see `wide`) one for
    each channel and stage. Readings of a channel in one stage are removed together: ``distance``
    and ``influence`` are those of all of them.

    Args:
        loss: the loss that was minimised, such as ``huber (delta 1.345)``.
        squares: plain weighted squares (and the prior's part) at the estimate, whatever the loss.
        scale: robust scatter of the standardized residuals: near 1 if the accuracies are right.
        standardized: (k,) measured minus computed, in accuracies.
        studentized: (k,) the same in its own standard deviation, by root of 1 - leverage.
        weight: (k,) what the loss leaves of the reading, 0 to 1.
        leverage: (k,) diagonal of the hat matrix: 1 decides alone.
        distance: (k,) Cook's distance.
        influence: (k, n) change of each parameter by the readings, in standard deviations of the
            parameter (DFBETAS); infinite where nothing else determines it.
        misfit: size of the residuals by that of the errors as stated or estimated, near 1 for a
            right model; NaN where there are no more readings than parameters.
        above: probability that chance makes them at least as large.
        below: probability that it makes them at most as large.
    """

    loss: str
    squares: float = column(name="weighted_squares")
    scale: float
    standardized: Floats = column("reading", group="readings")
    studentized: Floats = column("reading", group="readings")
    weight: Floats = column("reading", group="readings")
    leverage: Floats = column("reading", group="readings")
    distance: Floats = column("reading", group="readings")
    influence: Floats = column(
        "reading", "parameter", group="readings", sheet="influence_{parameter}"
    )
    misfit: float = np.nan
    above: float = 1.0
    below: float = 1.0

    def wide(self, gauges: GaugeTable) -> Diagnostics:
        """The same with arrays (n_channels, n_stages).

        Several readings in one place have the residual of the one farthest off, the sum of their
        leverages, and what is left of their weights by the information that each gives.

        Args:
            gauges: with the readings that these diagnostics are of.
        """
        shape = gauges.computed.shape
        wide: dict[str, Any] = {name: np.full(shape, np.nan) for name in DIAGNOSTIC_COLUMNS}
        influence = np.full((*shape, *self.influence.shape[1:]), np.nan)
        for place, rows in gauges.rows.items():
            t = self.studentized[rows]
            worst = rows[np.argmax(np.where(np.isnan(t), np.inf, np.abs(t)))]
            wide["standardized"][place] = self.standardized[worst]
            wide["studentized"][place] = self.studentized[worst]
            wide["weight"][place] = _left(self.weight[rows], gauges.readings.sd[rows])
            wide["leverage"][place] = self.leverage[rows].sum()
            wide["distance"][place] = self.distance[worst]
            influence[place] = self.influence[worst]
        return replace(self, influence=influence, **wide)


DIAGNOSTIC_COLUMNS = ("standardized", "studentized", "weight", "leverage", "distance")


def _left(weight: Floats, sd: Floats) -> float:
    """What is left of the weights (m,) of readings with standard deviations (m,)."""
    return float(weight[0] if len(weight) == 1 else np.average(weight, weights=1.0 / sd**2))


class Iteration(Record):
    """One step of an identifier.

    Args:
        method: name of the method.
        number: from 0 (the start).
        objective: the discrepancy (with the prior's part) at ``values``.
        values: (n,) parameters, SI.
        step: size of the step in scaled parameters.
        counts: costs up to here.
        note: such as ``accepted``, ``rejected``, ``restart``.
    """

    method: str
    number: int = column(title="iteration")
    objective: float
    values: Floats = column("parameter", dimension="parameter", sheet="{parameter}")
    step: float
    counts: Counts = column()
    note: str = ""


@dataclass(frozen=True)
class Grid:
    """The discrepancy over one or two parameters.

    Args:
        names: the parameters of the axes.
        axes: for every axis its values (k,), SI.
        objective: (len(axes[0]), ...) discrepancy; infinite where the model has no solution.
    """

    names: tuple[str, ...]
    axes: tuple[Floats, ...]
    objective: Floats


@dataclass(frozen=True)
class LastStates:
    """Of states without equilibrium: the last one that was found on the way to each.

    Args:
        states: (k,) their numbers.
        displacement: (k, n_nodes, dim), m.
        stress: (k, n_elements, 6), Pa; NaN in absent elements.
        yielded: (k, n_elements).
    """

    states: Ints
    displacement: Floats
    stress: Floats
    yielded: Bools


@dataclass(frozen=True)
class FieldSeries:
    """The state of the whole mesh, stage by stage, the virgin state first.

    Args:
        mesh: the mesh.
        displacement: (n_states, n_nodes, dim), m; 0 at nodes that are absent. NaN at states
            without equilibrium, as is the stress.
        stress: (n_states, n_elements, 6) mean stress of each element, xx yy zz xy yz xz, Pa;
            NaN in absent elements.
        present: (n_states, n_elements).
        yielded: (n_states, n_elements); none at states without equilibrium.
        last: what is known of states without equilibrium; None where there are none.
        temperature: (n_states, n_nodes) degC; None in a case that conducts no heat.
        excess: (n_states, n_nodes) pressure of water in excess of that at rest, Pa; 0 in ground
            that drains at once. None where no water takes time to leave.
    """

    mesh: Mesh
    displacement: Floats
    stress: Floats
    present: Bools
    yielded: Bools
    last: LastStates | None = None
    temperature: Floats | None = None
    excess: Floats | None = None

    @cached_property
    def shown(self) -> FieldSeries:
        """The same with the last equilibrium that was found in place of one that there is not."""
        if self.last is None:
            return self
        names = ("displacement", "stress", "yielded")
        arrays = {name: getattr(self, name).copy() for name in names}
        for name, array in arrays.items():
            array[self.last.states] = getattr(self.last, name)
        return replace(self, **arrays)


class SupportReactions(Record):
    """Resultants of what supports exert on the ground.

    Args:
        supports: names, in the order of the case.
        states: names of the states, the virgin state first.
        force: (n_supports, n_states, dim) along the axes, N: per metre out of plane in plane
            strain, of the whole circumference about an axis. NaN where a support does not hold.
    """

    supports: tuple[str, ...] = column("support", name="support")
    states: tuple[str, ...] = column("state", name="state", title="stage")
    force: Floats = column(
        "support",
        "state",
        "axis",
        dimension="force",
        unit="N, or N/m in plane strain",
        sheet="R_{axis}",
        shown="kN",
    )

    @property
    def standing(self) -> list[list[int]]:
        """Numbers of each support and state where it holds."""
        places: list[list[int]] = np.argwhere(np.isfinite(self.force).any(axis=2)).tolist()
        return places


class MemberForces(Record):
    """Forces in beams and bars, NaN while a structure does not stand.

    Args:
        structures: (n_members,) name of the structure of each straight piece.
        numbers: (n_members,) its number within the structure, from 1.
        stages: names of the stages, the virgin state not among them.
        ends: (n_members, 2, dim) its two ends, m.
        axial: (n_members, n_stages) N, tension positive: N per metre of a lining, N of one bar.
        moment: (n_members, 2, n_stages) M at the two ends, N m per metre, positive with tension on
            the open side (from first to second end: on the right); of one pile that bends N m, in a
            solid its size; NaN for other bars.
        shear: (n_members, n_stages) Q = dM/ds, N per metre, of one pile N; NaN for other bars.
        per_metre: (n_members,) it is a lining or wall, about an axis per metre of circumference.
        hoop: (n_members, n_stages) N_t around the axis, N per metre; NaN where there is none.
        prestress: (n_members, n_stages) the axial force of one bar, N, that a jack gives at this
            stage and at which it is locked off; NaN where none does.
        utilisation: (n_members, n_stages) the part of the strength of a lining that N and M use at
            its weaker end, about an axis also N_t; 1 at the limit, infinite where no strength
            could bear them. NaN where no strength is given; None where none of any is.
        grout: (n_members, n_stages) force per length, N/m, with which grout holds a piece of one
            bar, dN/ds from head to toe; NaN where there is none; None without any grout.
    """

    structures: tuple[str, ...] = column("member", name="structure")
    numbers: Ints = column("member", name="number")
    stages: tuple[str, ...] = column("stage", name="stage")
    ends: Floats = column(
        "member",
        "end",
        "axis",
        name="points",
        title="ends",
        sheet="{axis}_{end}",
        dimension="length",
        shown="m",
    )
    axial: Floats = column(
        "member", "stage", name="N", dimension="force", unit="N, or N/m where per_metre", shown="kN"
    )
    moment: Floats = column(
        "member",
        "end",
        "stage",
        name="M",
        sheet="M_{end}",
        dimension="moment",
        unit="N m/m",
        shown="kNm",
    )
    shear: Floats = column("member", "stage", name="Q", dimension="force", unit="N/m", shown="kN")
    per_metre: Bools = column("member", hidden=("csv",))
    hoop: Floats = column(
        "member", "stage", name="N_hoop", dimension="force", unit="N/m", shown="kN", optional=True
    )
    prestress: Floats = column(
        "member", "stage", sheet="stressed_to", dimension="force", shown="kN", optional=True
    )
    utilisation: Floats | None = column("member", "stage", default=None, unit="1", optional=True)
    grout: Floats | None = column(
        "member", "stage", default=None, dimension="line load", shown="kN/m", optional=True
    )

    @property
    @derived("member", name="member", hidden=VIEWS)
    def members(self) -> tuple[str, ...]:
        """Name of each piece, such as ``lining:12``."""
        pairs = zip(self.structures, self.numbers, strict=True)
        return tuple(f"{name}:{number}" for name, number in pairs)


def fingerprint(identity: str, status: str, objective: float) -> str:
    """SHA-256 that tells the outcome of a command from others.

    Args:
        identity: hash of all that it depends on.
        status: how it ended.
        objective: the misfit.
    """
    return hashlib.sha256(f"{identity} {status} {float(objective)!r}".encode()).hexdigest()


class Provenance(Record):
    """Where a result comes from.

    Args:
        command: that made it.
        versions: of the program and the libraries.
        seed: of random numbers.
        case_file: path of the case as seen from the folder of the result.
        case_sha256, mesh_sha256, readings_sha256: hashes of what it was made from.
        identity: hash of everything that it depends on.
        created: date and time.
        seconds: that the computation took, NaN if unknown.
        stamp: checksums of the files that it was made from, by which it is known to be up to date
            without reading them as a case; empty where they are not all files.
        fit_file: path of the fit that it was made from, as seen from its folder; empty for none.
        fit_fingerprint: `Result.fingerprint` of that fit.
    """

    command: str
    versions: Mapping[str, str] = column()
    seed: int
    case_file: str
    case_sha256: str
    mesh_sha256: str
    readings_sha256: str
    identity: str
    created: str
    seconds: float = column(default=math.nan, optional=True)
    stamp: str = column(default="", optional=True)
    fit_file: str = column(default="", optional=True)
    fit_fingerprint: str = column(default="", optional=True)


class Result(Record):
    """All that a command such as ``geoident fit``, ``predict`` or ``scan`` found.

    Args:
        kind: the command, ``fit``, ``predict``, ``scan``, ``sample``, ``backtest``, ``control``,
            ``plan`` or ``safety``.
        status: ``converged``, ``not-converged``, ``not-determined``, ``poor-fit``,
            ``out-of-budget``, ``done``.
        exit_code: of the command.
        method: names of the methods of the chain, joined by `` + ``.
        reason: why it stopped, one sentence with the remedy where there is one.
        objective: what was minimised, with the prior's part, at the estimate; NaN if none. The
            plain weighted squares, unless the loss is robust: those are in ``diagnostics``.
        findings: what an engineer must know before using the numbers.
        case_text: the case verbatim.
        case_resolved: the same with overrides applied, as YAML.
        parameters, gauges, prediction, history, grid, fields, counts: see their types.
        sensitivity: (n_channels, n_stages, n) derivative of the computed readings, or None.
        diagnostics: the influence of each of ``gauges.readings`` on a fit, or None.
        members: forces in linings and bolts, or None if there are none.
        shells: forces in shells, or None if there are none.
        reactions: of the supports, or None if they were not asked for.
        yielded: how far ground yields, or None where nothing can.
        mechanism: how the ground moves at the first stage that collapses, or with its strength
            divided by the smallest factor of safety; or None.
        reaction: of the ground around an opening in closed form, or None.
        advance: of a tunnel whose stages say how far its face is, or None.
        reduced: a reduced model that was to be kept, or None.
        certificate: what an identification of yield limits can say for itself, or None.
        accuracies: those that were estimated, or None.
        model_error: how far the ground may differ from the model, or None for none.
        posterior: draws of the parameters, or None.
        rivals: other minima that are nearly as low, with the lowest, or None.
        evidence: how well the model explains the readings, or None.
        comparison: of a ladder of models, of which this is the chosen one, or None.
        surface: the response surfaces of a table of runs, or None.
        left_out: how well gauges that the fit left out are predicted, or None.
        seasonal: coefficients and errors of the gauges of a structure in service, or None.
        changes: what new readings of a structure in service show.
        power: changes of it that may happen, and whether they would be seen.
        judged: readings after the end of a fit, held against it, or None.
        alarms: what is known of each alarm value of each channel.
        decisions: what is known of each decision that depends on a reading.
        telling: earlier readings that would tell how probable these are.
        safety: factors of safety of stages.
        convergence: what a convergence law says of each channel.
        settlement: what a settlement law says of each channel.
        plan: of gauges that are to be read, or None.
        updates: how a fit came about as readings came, or None where it was never updated.
        varied: what is known of each constant that varies from place to place.
        backtest: fits of the first stages and their predictions of later ones; of a fit that of all
            but its last stage; or None.
    """

    kind: str
    status: str
    exit_code: int
    method: str
    reason: str
    objective: float
    findings: tuple[Finding, ...] = column("finding", group="findings", optional=True)
    case_text: str = column(group="case", name="verbatim", dataset=True)
    case_resolved: str = column(group="case", name="resolved", dataset=True)
    provenance: Provenance = column()
    parameters: ParameterTable = column(group="parameters")
    gauges: GaugeTable = column(group="gauges")
    counts: Counts = column()
    sensitivity: Floats | None = column(
        "gauge",
        "stage",
        "parameter",
        default=None,
        group="sensitivity",
        optional=True,
        dimension="gauge",
        unit="{} per SI unit of the parameter",
    )
    prediction: Prediction | None = column(default=None, group="prediction", optional=True)
    history: tuple[Iteration, ...] = column("iteration", default=(), group="history")
    grid: Grid | None = None
    fields: FieldSeries | None = None
    singular_values: Floats | None = column(
        "direction", default=None, group="parameters", optional=True
    )
    notes: tuple[str, ...] = column(default=(), optional=True)
    diagnostics: Diagnostics | None = column(default=None, group="diagnostics", optional=True)
    members: MemberForces | None = column(default=None, group="structures", optional=True)
    shells: ShellForces | None = column(default=None, group="shells", optional=True)
    interfaces: InterfaceStates | None = column(default=None, group="interfaces", optional=True)
    reactions: SupportReactions | None = column(default=None, group="reactions", optional=True)
    yielded: YieldedGround | None = column(default=None, group="yielded", optional=True)
    mechanism: Mechanism | None = None
    reaction: GroundReaction | None = column(default=None, group="opening", optional=True)
    advance: FaceAdvance | None = column(default=None, group="face", optional=True)
    reduced: KeptReducedModel | None = None
    certificate: Certificate | None = column(default=None, group="certificate", optional=True)
    accuracies: AccuracyTable | None = column(default=None, group="accuracies", optional=True)
    model_error: ModelErrorTable | None = column(default=None, group="model_error", optional=True)
    posterior: PosteriorDraws | None = None
    rivals: Rivals | None = column(default=None, group="rivals", optional=True)
    evidence: Evidence | None = column(default=None, group="evidence", optional=True)
    comparison: ModelComparison | None = column(default=None, group="models", optional=True)
    backtest: Backtest | None = column(default=None, group="backtest", optional=True)
    varied: tuple[FieldEstimate, ...] = ()
    surface: SurfaceTable | None = column(default=None, group="surface", optional=True)
    left_out: LeftOutTable | None = column(default=None, group="left_out", optional=True)
    seasonal: SeasonalFit | None = column(default=None, group="seasonal", optional=True)
    judged: Judged | None = column(default=None, group="judged", optional=True)
    changes: tuple[ChangeRow, ...] = column("change", default=(), group="changes", optional=True)
    parameter_changes: tuple[ParameterChangeRow, ...] = column(
        "parameter_change", default=(), group="parameter_changes", optional=True
    )
    power: tuple[PowerRow, ...] = column("planned_change", default=(), group="power", optional=True)
    alarms: tuple[AlarmState, ...] = column("alarm", default=(), group="alarms", optional=True)
    decisions: tuple[DecisionState, ...] = column(
        "decision", default=(), group="decisions", optional=True
    )
    telling: tuple[TellingReading, ...] = column(
        "telling", default=(), group="telling_readings", optional=True
    )
    safety: tuple[StageSafety, ...] = column("safety", default=(), group="safety", optional=True)
    convergence: tuple[ConvergenceState, ...] = column(
        "law_gauge", default=(), group="convergence", optional=True
    )
    settlement: tuple[SettlementState, ...] = column(
        "law_row", default=(), group="settlement", optional=True
    )
    plan: GaugePlan | None = column(default=None, group="plan", optional=True)
    updates: UpdateHistory | None = column(default=None, group="updates", optional=True)

    @property
    def fingerprint(self) -> str:
        """Tells this outcome from others, also of the same input: one that was cut short."""
        return fingerprint(self.provenance.identity, self.status, self.objective)

    @property
    def labels(self) -> dict[str, Sequence[str]]:
        """What stands along the axes that all tables share, and along the fits of a backtest."""
        names, gauges = self.parameters.names, self.gauges
        steps = () if self.backtest is None else self.backtest.steps
        return {
            "parameter": names,
            "other": names,
            "gauge": gauges.channels,
            "stage": gauges.stages,
            "fit": [gauges.stages[step.last] for step in steps],
        }

    @property
    def quantities(self) -> dict[str, Sequence[tuple[str, str]]]:
        """Unit and dimension of each parameter and of each channel."""
        table, gauges = self.parameters, self.gauges
        return {
            "parameter": list(zip(table.units, table.dimensions, strict=True)),
            "gauge": list(zip(gauges.units, gauges.dimensions, strict=True)),
        }

    @property
    def in_service(self) -> bool:
        """It is of a structure in service: its readings belong to dates, not to stages."""
        return self.seasonal is not None or self.kind == "control"

    @cached_property
    def for_people(self) -> Result:
        """The same without the coefficients of the modes of fields: the fields stand for them."""
        named = self.parameters.named
        if len(named) == len(self.parameters.names):
            return self
        posterior = self.posterior
        return replace(
            select(self, PARAMETERS, named),
            posterior=None if posterior is None else select(posterior, PARAMETERS, named),
            certificate=self.certificate,
        )

    @cached_property
    def at_ends(self) -> Result:
        """The same with forces, reactions, yielded ground and planes at the ends of stages alone.

        Of stages that last there are many moments, more than tables of these can show.
        """
        if self.gauges.ends.all():
            return self
        ends = np.flatnonzero(self.gauges.ends)
        states, certificate = np.concatenate([[0], ends + 1]), self.certificate
        if certificate is not None:
            activity = select(certificate.activity, ("stage",), ends)
            certificate = replace(certificate, activity=activity)
        return replace(
            self,
            members=self.members and select(self.members, ("stage",), ends),
            shells=self.shells and select(self.shells, ("stage",), ends),
            interfaces=self.interfaces and select(self.interfaces, ("stage",), ends),
            reactions=self.reactions and select(self.reactions, ("state",), states),
            yielded=self.yielded and select(self.yielded, ("state",), states),
            certificate=certificate,
        )


Labelled = Sequence[tuple[str, Result]]
"""Results with their labels, such as the names of their files."""
