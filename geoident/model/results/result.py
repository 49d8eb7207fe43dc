"""What a command found: plain tables in SI units, ready to be written and shown."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import ErrorParts, ReadingTable, weighted_mean
from geoident.model.mesh import Mesh
from geoident.model.parameter import Prior
from geoident.model.results.backtest import Backtest
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.model_error import ModelErrorTable
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.posterior import PosteriorDraws
from geoident.model.results.reduced import KeptReducedModel
from geoident.model.results.rivals import Evidence, ModelComparison, Rivals
from geoident.model.results.surface import SurfaceTable
from geoident.model.results.varied import FieldEstimate
from geoident.model.results.yielded import Mechanism, YieldedGround
from geoident.model.yielding import Certificate
from geoident.units import shown_unit, size_in

STOPPED = "out-of-budget"
"""Status of an outcome that was cut short as its time was used up."""


@dataclass(frozen=True)
class ParameterTable:
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
    """

    names: tuple[str, ...]
    values: Floats
    sd: Floats
    lower95: Floats
    upper95: Floats
    lower: Floats
    upper: Floats
    start: Floats
    at_bound: Bools
    determined: Bools
    priors: tuple[Prior | None, ...]
    units: tuple[str, ...]
    dimensions: tuple[str, ...]
    covariance: Floats
    correlation: Floats
    fields: tuple[str, ...] = ()

    @property
    def named(self) -> Ints:
        """Numbers (k,) of the parameters that the case names: without the modes of fields."""
        modes = self.fields or ("",) * len(self.names)
        return np.flatnonzero([not name for name in modes])

    def picked(self, order: Ints) -> ParameterTable:
        """Some rows (k,) of the table."""
        columns = ("values", "sd", "lower95", "upper95", "lower", "upper", "start")
        flags = ("at_bound", "determined")
        words = ("names", "priors", "units", "dimensions", *(("fields",) if self.fields else ()))
        square = np.ix_(order, order)
        selected: dict[str, Any] = {name: getattr(self, name)[order] for name in (*columns, *flags)}
        selected |= {name: tuple(getattr(self, name)[i] for i in order) for name in words}
        return replace(
            self,
            covariance=self.covariance[square],
            correlation=self.correlation[square],
            **selected,
        )


@dataclass(frozen=True)
class GaugeTable:
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
    """

    channels: tuple[str, ...]
    stages: tuple[str, ...]
    computed: Floats
    first: Floats
    second: Floats
    readings: ReadingTable
    gauges: tuple[str, ...]
    dimensions: tuple[str, ...]
    units: tuple[str, ...]
    accuracy: Floats
    errors: tuple[ErrorParts | None, ...] = ()

    @property
    def measured(self) -> Floats:
        """(n_channels, n_stages) readings, SI."""
        return self._wide[0]

    @property
    def sd(self) -> Floats:
        """(n_channels, n_stages) standard deviation of each reading, SI."""
        return self._wide[1]

    @property
    def used(self) -> Bools:
        """(n_channels, n_stages) the reading took part in the identification."""
        return self._wide[2]

    @property
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


@dataclass(frozen=True)
class AccuracyTable:
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

    names: tuple[str, ...]
    values: Floats
    lower95: Floats
    upper95: Floats
    parts: tuple[str, ...]
    dimensions: tuple[str, ...]
    units: tuple[str, ...]
    of_reading: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    points: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    odds: Floats = field(default_factory=lambda: np.zeros(0))
    flat: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def determined(self) -> Bools:
        """(c,) the readings tell them from the others."""
        return np.asarray(np.isfinite(self.upper95), dtype=np.bool_)


@dataclass(frozen=True)
class Diagnostics:
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
    squares: float
    scale: float
    standardized: Floats
    studentized: Floats
    weight: Floats
    leverage: Floats
    distance: Floats
    influence: Floats
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


@dataclass(frozen=True)
class Iteration:
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
    number: int
    objective: float
    values: Floats
    step: float
    counts: Counts
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
    """

    mesh: Mesh
    displacement: Floats
    stress: Floats
    present: Bools
    yielded: Bools
    last: LastStates | None = None

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


@dataclass(frozen=True)
class SupportReactions:
    """Resultants of what supports exert on the ground.

    Args:
        supports: names, in the order of the case.
        states: names of the states, the virgin state first.
        force: (n_supports, n_states, dim) along the axes, N: per metre out of plane in plane
            strain, of the whole circumference about an axis. NaN where a support does not hold.
    """

    supports: tuple[str, ...]
    states: tuple[str, ...]
    force: Floats


@dataclass(frozen=True)
class MemberForces:
    """Forces in beams and bars, NaN while a structure does not stand.

    Args:
        structures: (n_members,) name of the structure of each straight piece.
        numbers: (n_members,) its number within the structure, from 1.
        stages: names of the stages, the virgin state not among them.
        ends: (n_members, 2, dim) its two ends, m.
        axial: (n_members, n_stages) N, tension positive: N per metre of a lining, N of one bar.
        moment: (n_members, 2, n_stages) M at the two ends, N m per metre, positive with tension on
            the open side (from first to second end: on the right); NaN for bars.
        shear: (n_members, n_stages) Q = dM/ds, N per metre; NaN for bars.
        per_metre: (n_members,) it is a lining or wall, about an axis per metre of circumference.
        hoop: (n_members, n_stages) N_t around the axis, N per metre; NaN where there is none.
        prestress: (n_members, n_stages) the axial force of one bar, N, that a jack gives at this
            stage and at which it is locked off; NaN where none does.
    """

    structures: tuple[str, ...]
    numbers: Ints
    stages: tuple[str, ...]
    ends: Floats
    axial: Floats
    moment: Floats
    shear: Floats
    per_metre: Bools
    hoop: Floats
    prestress: Floats


def fingerprint(identity: str, status: str, objective: float) -> str:
    """SHA-256 that tells the outcome of a command from others.

    Args:
        identity: hash of all that it depends on.
        status: how it ended.
        objective: the misfit.
    """
    return hashlib.sha256(f"{identity} {status} {float(objective)!r}".encode()).hexdigest()


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from.

    Args:
        command: that made it.
        versions: of the program and the libraries.
        seed: of random numbers.
        case_file: path of the case as seen from the folder of the result.
        case_sha256, mesh_sha256, readings_sha256: hashes of what it was made from.
        identity: hash of everything that it depends on.
        created: date and time.
        format: of the file that it was read from, if that is not the present one.
        seconds: that the computation took, NaN if unknown.
        stamp: checksums of the files that it was made from, by which it is known to be up to date
            without reading them as a case; empty where they are not all files.
        fit_file: path of the fit that it was made from, as seen from its folder; empty for none.
        fit_fingerprint: `Result.fingerprint` of that fit.
    """

    command: str
    versions: Mapping[str, str]
    seed: int
    case_file: str
    case_sha256: str
    mesh_sha256: str
    readings_sha256: str
    identity: str
    created: str
    format: str = ""
    seconds: float = float("nan")
    stamp: str = ""
    fit_file: str = ""
    fit_fingerprint: str = ""


@dataclass(frozen=True)
class Result:
    """All that a command such as ``geoident fit``, ``predict`` or ``scan`` found.

    Args:
        kind: the command, ``fit``, ``predict``, ``scan``, ``sample`` or ``backtest``.
        status: ``converged``, ``not-converged``, ``not-determined``, ``poor-fit``,
            ``out-of-budget``, ``done``.
        exit_code: of the command.
        method: names of the methods of the chain, joined by `` + ``.
        reason: why it stopped, one sentence with the remedy where there is one.
        objective: what was minimised, with the prior's part, at the estimate; NaN if none. The
            plain weighted squares, unless the loss is robust: those are in ``diagnostics``.
        findings: sentences on what is not determined and which directions only the prior fixes.
        case_text: the case verbatim.
        case_resolved: the same with overrides applied, as YAML.
        parameters, gauges, prediction, history, grid, fields, counts: see their types.
        sensitivity: (n_channels, n_stages, n) derivative of the computed readings, or None.
        diagnostics: the influence of each of ``gauges.readings`` on a fit, or None.
        members: forces in linings and bolts, or None if there are none.
        reactions: of the supports, or None if they were not asked for.
        yielded: how far ground yields, or None where nothing can.
        mechanism: how the ground moves at the first stage that collapses, or None.
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
    findings: tuple[str, ...]
    case_text: str
    case_resolved: str
    provenance: Provenance
    parameters: ParameterTable
    gauges: GaugeTable
    counts: Counts
    sensitivity: Floats | None = None
    prediction: Prediction | None = None
    history: tuple[Iteration, ...] = ()
    grid: Grid | None = None
    fields: FieldSeries | None = None
    singular_values: Floats | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
    diagnostics: Diagnostics | None = None
    members: MemberForces | None = None
    reactions: SupportReactions | None = None
    yielded: YieldedGround | None = None
    mechanism: Mechanism | None = None
    reaction: GroundReaction | None = None
    advance: FaceAdvance | None = None
    reduced: KeptReducedModel | None = None
    certificate: Certificate | None = None
    accuracies: AccuracyTable | None = None
    model_error: ModelErrorTable | None = None
    posterior: PosteriorDraws | None = None
    rivals: Rivals | None = None
    evidence: Evidence | None = None
    comparison: ModelComparison | None = None
    backtest: Backtest | None = None
    varied: tuple[FieldEstimate, ...] = ()
    surface: SurfaceTable | None = None

    @property
    def fingerprint(self) -> str:
        """Tells this outcome from others, also of the same input: one that was cut short."""
        return fingerprint(self.provenance.identity, self.status, self.objective)

    @cached_property
    def for_people(self) -> Result:
        """The same without the coefficients of the modes of fields: the fields stand for them."""
        named = self.parameters.named
        if len(named) == len(self.parameters.names):
            return self
        readings = self.gauges.readings
        if readings.sensitivity is not None:
            readings = replace(readings, sensitivity=readings.sensitivity[:, named])
        diagnostics = self.diagnostics
        if diagnostics is not None:
            diagnostics = replace(diagnostics, influence=diagnostics.influence[..., named])
        return replace(
            self,
            parameters=self.parameters.picked(named),
            gauges=replace(self.gauges, readings=readings),
            sensitivity=None if self.sensitivity is None else self.sensitivity[..., named],
            diagnostics=diagnostics,
            history=tuple(replace(step, values=step.values[named]) for step in self.history),
            backtest=None if self.backtest is None else self.backtest.picked(named),
            posterior=None if self.posterior is None else self.posterior.picked(named),
            rivals=None if self.rivals is None else self.rivals.picked(named),
        )


Labelled = Sequence[tuple[str, Result]]
"""Results with their labels, such as the names of their files."""
