"""A case on its mesh, ready to answer: the one class by which others use the forward model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import islice

import numpy as np

from geoident.errors import Fault
from geoident.fem.solvers.direct import Solver
from geoident.forward.affine import condensation_obstacle
from geoident.forward.checks import (
    check_on_mesh,
    imbalance_notes,
    inadmissible_numbers,
    notes_on_mesh,
)
from geoident.forward.equations import ReadingRows, export, export_obstacle
from geoident.forward.gauges.adjoints import AdjointTable, ReadingAdjoints
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.gauges.observable import MarchState
from geoident.forward.gauges.observation import Observation
from geoident.forward.ground.field import field_notes, point_field, with_modes
from geoident.forward.ground.moduli import inadmissible_moduli
from geoident.forward.march.fields import FieldRecorder
from geoident.forward.march.kept import MOST_KEPT, KeptMarch
from geoident.forward.march.march import March, Run, RunFindings, RunOptions
from geoident.forward.march.stage import StageEnd, UnitForces
from geoident.forward.march.systems import StageSystems
from geoident.forward.march.virgin import contradictions, overburden_notes, surface_gaps
from geoident.forward.openings.model import OpeningResponse, opening_in_mesh
from geoident.forward.openings.site import Circle
from geoident.forward.protocols import Survey
from geoident.forward.reduced.reduction import Reduction
from geoident.forward.reduced.response import ReducedResponse
from geoident.forward.staged_system import StagedSystem, bilinear
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.forces import MemberRecorder
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import Mesh
from geoident.model.parameter import Values
from geoident.model.response import BilinearSystem, CertifiedResponse, Condensed
from geoident.model.results.result import Counts
from geoident.model.yielding import Activity

_DEPENDENT = 1e-10
"""Singular value of S, relative to the largest, below which readings count as dependent."""

WHOLE = RunOptions()
"""All states with their derivatives."""


def staged_model(mesh: Mesh, case: Case, *, solver: Solver) -> StagedModel:
    """The staged forward model of a case on a mesh, after all checks.

    Args:
        mesh: its mesh.
        case: the case.
        solver: factorizes the stiffness matrices.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """
    on_mesh, observation = check_on_mesh(case, mesh)
    return StagedModel(with_fields(on_mesh), observation, solver=solver)


def with_fields(on_mesh: CaseOnMesh) -> CaseOnMesh:
    """A case on its mesh with its fields there, and their modes among its parameters."""
    case, positions = on_mesh.case, on_mesh.discretization.points.position
    fields = []
    for field in case.fields:
        points = on_mesh.material_points(field.material)
        fields.append(point_field(field, points, positions[points], case.start))
    return on_mesh.with_fields(with_modes(case, fields), tuple(fields)) if fields else on_mesh


class StagedModel:
    """The staged forward model of a case (theory 1 and 2); it checks nothing (see `checks`).

    Args:
        on_mesh: the case and the mesh that it fits.
        observation: its gauges there.
        solver: factorizes the stiffness matrices.
    """

    def __init__(self, on_mesh: CaseOnMesh, observation: Observation, *, solver: Solver) -> None:
        self.on_mesh, self.observation = on_mesh, observation
        self.case, self.mesh, self.sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
        self.names = tuple(parameter.name for parameter in self.case.parameters)
        self.instrument_errors = InstrumentErrors(self.case, self.sequence.built_on)
        self._solver = solver
        self._evaluations = 0
        self.on_state: Callable[[int], None] | None = None  # is told of every state computed
        self.discretization = on_mesh.discretization
        self.systems = StageSystems(on_mesh, solver)
        self.structures = self.systems.structures
        self.march = March(on_mesh, self.systems)
        self.actions = self.march.actions
        self._all_readings: dict[int, ReadingAdjoints] = {}
        self._other_readings: dict[tuple[int, bytes], ReadingAdjoints] = {}
        self._last_adjoints: AdjointTable | None = None
        self._kept: KeptMarch | None = None
        self._paid: tuple[bytes, int] = b"", -1
        self._free = Counts()
        self.reduction: Reduction | None = None

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        spent, free = self._solver.counts, self._free
        return Counts(
            self._evaluations,
            spent.analyses,
            spent.factorizations - free.factorizations,
            spent.solves - free.solves,
        )

    @property
    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return any(material.yields for material in self.case.materials.values())

    @property
    def solver_name(self) -> str:
        """Name of the sparse solver."""
        return self._solver.name

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state, the virgin state first."""
        states = range(len(self.sequence.states))
        return tuple(len(self.systems[n].dofs) for n in states)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        noted = notes_on_mesh(
            self.on_mesh,
            self.observation,
            n_outside=max(self.march.n_outside, self.actions.n_outside),
            in_tension=self.march.virgin_tension(self.case.start),
        )
        return (*noted, *field_notes(self.on_mesh.case, self.on_mesh.fields))

    def virgin_notes(self) -> tuple[str, ...]:
        """What to know of the in-situ stress at the start values; nothing is factorized."""
        start = self.case.start
        _, imbalance = self.march.virgin(ParameterPoint(start, ()))
        return (
            *overburden_notes(self.march, start),
            *imbalance_notes(float(imbalance[0])),
            *(self._contradiction_notes(start) if self.case.imbalance_accepted else ()),
        )

    def contradictions(self) -> list[Fault]:
        """Where weight and in-situ stress disagree at the start values, unless that is accepted.

        Nothing is factorized.
        """
        gaps = surface_gaps(self.march, self.case.start)
        if gaps or self.case.imbalance_accepted:
            return gaps
        return contradictions(self.march, self.case.start)

    def _contradiction_notes(self, values: Values) -> tuple[str, ...]:
        """The same at any values, and where it is accepted."""
        accepted = " (accepted: in_situ.equilibrium)" if self.case.imbalance_accepted else ""
        return tuple(f"{fault.message}{accepted}" for fault in contradictions(self.march, values))

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        if not np.all(np.isfinite(p)):
            return "a parameter is not finite"
        values = self.values(p)
        found = inadmissible_numbers(self.case, self.sequence, values)
        for name in () if found else self.sequence.materials:
            fields = self.on_mesh.elastic_fields(name)
            if fields:
                s = self.discretization.points.n_strain
                found = found or inadmissible_moduli(self.case.materials[name], fields, values, s)
        return found

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def count_evaluation(self) -> int:
        """One more parameter vector was evaluated: how many so far."""
        self._evaluations += 1
        return self._evaluations

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""
        return self.observation.unreadable(channel, self.case.stage_names.index(stage))

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> StagedResponse:
        """The response in the readings of some (channel, stage) pairs.

        Args:
            pairs: what was read.
            times: when each was read, seconds since 1970; None for what is known of its stage.
        """
        return StagedResponse(self, pairs, times)

    def at(self, p: Floats, options: RunOptions = WHOLE) -> Run:
        """One march at parameters p (n,); its states come one by one.

        Args:
            p: (n,) parameters.
            options: how to march.
        """
        return Run(self.march, ParameterPoint(self.values(p), self.names), options, self._tell)

    def _tell(self, state: int) -> None:
        if self.on_state is not None:
            self.on_state(state)

    # A march that goes on where it was left

    @property
    def keeps_march(self) -> bool:
        """Whether the states of a march are kept: nothing yields, and they are not too many."""
        points = self.discretization.points
        each = self.discretization.n_dofs + points.n_strain * points.n_points
        return not self.yields and each * len(self.sequence.states) <= MOST_KEPT

    def paid(self, p: Floats, last: int) -> None:
        """A march at p (n,) up to a state was counted, in this run or in one that this goes on.

        Should its states be computed again for what comes later, they are not counted again.
        """
        key, before = self._paid
        self._paid = p.tobytes(), max(last, before) if key == p.tobytes() else last

    def is_paid(self, p: Floats) -> bool:
        """Whether the last march with derivatives that was counted is that at p (n,)."""
        return self.keeps_march and self._paid[0] == p.tobytes()

    def march_to(
        self,
        p: Floats,
        last: int,
        tell: Callable[[StageEnd, Run], None] | None = None,
    ) -> KeptMarch:
        """The march with derivatives at p (n,), which goes on where it was left, to a state.

        Args:
            p: (n,) parameters, SI.
            last: index of the state.
            tell: is given every state with its run while its factorization is there: the march is
                made anew.

        Raises:
            ModelError: the stiffness of a stage is not positive definite.
        """
        kept = self._kept
        if kept is None or kept.p != tuple(map(float, p)) or tell is not None:
            self._kept = None  # its memory is free for the next
            if self._paid[0] != p.tobytes():
                self.count_evaluation()
                self.paid(p, -1)
            kept = KeptMarch(self.at(p, RunOptions()), self._see)
        free = self._paid[1]
        try:
            for to in sorted({min(free, last), last}):
                before = self._solver.counts.factorizations, self._solver.counts.solves
                kept.go_on(to, tell)
                if to <= free:
                    self._set_free(*before)
        except BaseException:
            self._kept = None
            raise
        self._kept = kept
        self.paid(p, last)
        return kept

    def _set_free(self, factorizations: int, solves: int) -> None:
        """What was done since these counts is not to be counted."""
        spent = self._solver.counts
        self._free += Counts(0, 0, spent.factorizations - factorizations, spent.solves - solves)

    def _see(self, end: StageEnd, run: Run) -> tuple[Floats, tuple[str, ...]]:
        """What channels see of a state, and which read one of several equal stresses."""
        state = MarchState(end, run.point, self.structures)
        return self.observation.values(state), self.observation.coinciding(state)

    def survey(
        self, p: Floats, *, fields: bool, partial: bool = False, last: int | None = None
    ) -> Survey:
        """All channels at all stages, their derivatives, and the fields if wanted.

        One factorization per stage, more where ground yields; none for those of the march that was
        made last, if that was here.

        Args:
            p: (n,) parameters.
            fields: whether displacements and stresses are wanted.
            partial: where a stage collapses, give what can be known without it.
            last: index of the last state wanted: readings of later ones are NaN, and forces in
                structures are left out; None for all.

        Raises:
            CollapseError: a stage collapses; with ``partial``, only if nothing is left.
        """
        values = self.values(p)
        recorder = FieldRecorder(self.on_mesh) if fields else None
        members = MemberRecorder(self.structures, self.sequence, values)

        def record(end: StageEnd) -> None:
            if recorder is not None:
                recorder.add(end)
            if self.structures.parts and last is None:
                members.add(end.state, end.members)

        until = len(self.sequence.states) - 1 if last is None else last
        back, equal = None, dict[str, int]()
        if self.is_paid(p):
            march = self.march_to(p, until)
            run, observed = march.run, march.observed[: until + 1]
            for end, names in zip(march.ends[: until + 1], march.equal, strict=False):
                equal |= dict.fromkeys(names, end.state)
                record(end)
        else:
            self.count_evaluation()
            ways, observed = self._readings_until(until), []
            back = ways if ways.cost_less(len(self.names)) else None
            run = self.at(p, RunOptions(partial=partial, last=last, traced=back is not None))
            for end in run.states():
                state = MarchState(end, run.point, self.structures)
                seen = self.observation.values(state) if back is None else back.observed(end, run)
                observed.append(seen)
                equal |= dict.fromkeys(self.observation.coinciding(state), end.state)
                record(end)
        seen_at = np.stack(observed)
        if back is None:
            table = self.relative(seen_at)
        else:
            table = self._table_by_adjoints(back, run, end, seen_at)
        table = self.with_later(table)
        table = self.instrument_errors.added_to_all(table, values, self.names)
        table = table[1:].swapaxes(0, 1)  # without the virgin state
        found = run.findings
        if found.collapses and not np.isfinite(table).any():
            raise found.collapses[0]
        return Survey(
            table[..., 0],
            table[..., 1:],
            None if recorder is None else recorder.series(),
            members.table() if last is None else None,
            tuple(error.message for error in found.collapses),
            found.activity,
            (
                *_equal_notes(equal, self.case.stage_names),
                *_unbalanced_notes(found),
                *imbalance_notes(found.imbalance),
                *self._contradiction_notes(values),
            ),
            self.observation.increments(seen_at[:, :, 0], self.sequence.bases),
        )

    def steps(self, pairs: Sequence[tuple[str, str]]) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g): 1, 0 or -1.

        Args:
            pairs: their channels and stages.
        """
        places = ReadingPlaces.of(self.case, pairs, ())
        return self.observation.steps(self.sequence.built_on, places.rows, places.states)

    def _readings_until(self, last: int) -> ReadingAdjoints:
        """What can be read of all stages up to a state, and the way back from it."""
        if last not in self._all_readings:
            readable = self.observation.readable[: last + 1].copy()
            readable[0] = False
            states, rows = np.nonzero(readable)
            found = ReadingAdjoints(self.march, self.observation, rows, states, last)
            self._all_readings[last] = found
        return self._all_readings[last]

    def _table_by_adjoints(
        self, ways: ReadingAdjoints, run: Run, end: StageEnd, observed: Floats
    ) -> Floats:
        """All readings and their derivatives (n_states, n_channels, 1 + n), NaN where none is.

        A fit ends where it evaluated last: the derivatives of the readings that it was given are
        known then, and only those of the others are taken back through the stages.
        """
        n = len(run.given.names)
        table = np.full((len(observed), len(self.observation.channels), 1 + n), np.nan)
        known = self._last_adjoints
        if known is not None and known.values == run.given.values:
            here = known.states <= ways.last
            table[known.states[here], known.rows[here]] = known.table[here]
            ways = self._without(ways, known)
        if ways.rows.size:
            table[ways.states, ways.rows] = ways.table(run, end, observed)
        return table

    def _without(self, ways: ReadingAdjoints, known: AdjointTable) -> ReadingAdjoints:
        """The way back from the readings that are not known."""
        of_known = np.zeros(self.observation.readable.shape, dtype=bool)
        of_known[known.states, known.rows] = True
        left = ~of_known[ways.states, ways.rows]
        key = ways.last, left.tobytes()
        if key not in self._other_readings:
            self._other_readings = {
                key: ReadingAdjoints(
                    self.march, self.observation, ways.rows[left], ways.states[left], ways.last
                )
            }
        return self._other_readings[key]

    def keep_adjoints(self, table: AdjointTable) -> None:
        """Keep readings with their derivatives, for a survey of the same parameters."""
        self._last_adjoints = table

    def with_later(self, table: Floats) -> Floats:
        """Readings (n_states, n_channels, k), NaN of the states that are not in the table."""
        missing = len(self.sequence.states) - len(table)
        return np.pad(table, ((0, missing), (0, 0), (0, 0)), constant_values=np.nan)

    def computed(self, p: Floats, tell: Callable[[StageEnd], None] = lambda end: None) -> Floats:
        """All channels at all stages (n_channels, n_stages) at p (n,), SI, without derivatives.

        Args:
            p: (n,) parameters, SI.
            tell: is given every state, of which only the values count.
        """
        if not self.is_paid(p):
            return StageByStage(self, p, tell).computed()
        march = self.march_to(p, len(self.sequence.states) - 1)
        for end in march.ends:
            tell(end)
        return self.readings_of(np.stack(march.observed)[..., :1], self.values(p))

    def readings_of(self, observed: Floats, values: Values) -> Floats:
        """All channels at all stages (n_channels, n_stages), SI; NaN of stages after the last.

        Args:
            observed: (m, n_channels, 1) what they see of the first m states.
            values: parameters by name, SI.
        """
        table = self.with_later(self.relative(observed))
        table = self.instrument_errors.added_to_all(table, values, ())
        return np.asarray(table[1:, :, 0].T)

    def relative(self, observed: Floats) -> Floats:
        """Readings from what the channels see since placing: mostly less what was there at zero.

        Args:
            observed: (n_states, n_channels, k).

        Returns:
            (n_states, n_channels, k); NaN where a channel can't be read.
        """
        states = np.arange(len(observed))[:, None]
        rows = np.arange(observed.shape[1])[None]
        result = self.observation.readings(observed, rows, states)
        result[~self.observation.readable[: len(observed)]] = np.nan
        return result


class StageByStage:
    """What all channels read at one parameter vector, without derivatives, as far as it is wanted.

    It goes on where it stopped, so the model must not be asked for anything else in between.

    Args:
        model: the staged model.
        p: (n,) parameters, SI.
        tell: is given every state.
    """

    def __init__(
        self, model: StagedModel, p: Floats, tell: Callable[[StageEnd], None] = lambda end: None
    ) -> None:
        model.count_evaluation()
        self._model, self._values, self._tell = model, model.values(p), tell
        self._run = model.at(p, RunOptions(derivatives=False, partial=True, explain=False))
        self._states = self._run.states()
        self._observed: list[Floats] = []

    def computed(self, last: int | None = None) -> Floats:
        """(n_channels, n_stages), SI; NaN of stages after the last state that is wanted.

        Args:
            last: index of that state; None for all.

        Raises:
            ModelError: the model has no solution.
        """
        model = self._model
        more = None if last is None else max(last + 1 - len(self._observed), 0)
        for end in islice(self._states, more):
            state = MarchState(end, self._run.point, model.structures)
            self._observed.append(model.observation.values(state))
            self._tell(end)
        return model.readings_of(np.stack(self._observed), self._values)


class StagedResponse:
    """Readings of some (channel, stage) pairs as a function of the parameters.

    Fulfils the protocols ``Response``, ``AffineElastic`` and ``ComplementaritySystem`` of the
    identifiers. The march ends with the last stage that a reading needs.

    Args:
        model: the staged model.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.
    """

    def __init__(
        self,
        model: StagedModel,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        self._model = model
        self._pairs, self._given_times = tuple(pairs), tuple(times)
        self._start = np.array([parameter.start for parameter in model.case.parameters])
        self._start_point = ParameterPoint(model.case.start, model.names)
        self._activity: tuple[bytes, Activity | None] | None = None  # p and what was found there
        self._increments: tuple[bytes, Floats] | None = None  # likewise
        self._places = ReadingPlaces.of(model.case, pairs, times)
        self._row, self._state = self._places.rows, self._places.states
        self._last = int(self._state.max(initial=0))
        self.reduction: Reduction | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self._model.names

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self._model.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return self._model.admissible(p)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), m."""
        return self._run(p)[:, 0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        return self.by_adjoints(p) if self._backwards else self.by_tangents(p)

    @property
    def _backwards(self) -> bool:
        """Whether derivatives come by adjoints: a reduced model needs tangents."""
        if not self.adjoints.cost_less(len(self.names)):
            return False
        return self.reduction is None or not self.reduction.covers()

    def remembers(self, p: Floats) -> None:
        """The answer at p (n,) with derivatives is known and was counted, from an earlier run."""
        if self._model.keeps_march and not self._backwards:
            self._model.paid(p, self._last)

    def by_tangents(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n): one column a parameter through the stages."""
        table = self._run(p, derivatives=True)
        return table[:, 0], table[:, 1:]

    def keep_marches(self, *, economical: bool = True, most: int = 4) -> None:
        """Keep what marches with derivatives find from now on, for a reduced model.

        Args:
            economical: only where it costs less than the marches that a search saves by it.
            most: how many marches count at most, the newest.
        """
        model = self._model
        if self.reduction is not None or model.observation.not_linear(self._row) is not None:
            return
        known = model.reduction
        if economical and known is not None and known.last >= self._last and known.economical:
            self.reduction = known  # that of another response goes as far
            return
        self.reduction = Reduction(
            model.march, model.observation, self._last, most=most, economical=economical
        )
        model.reduction = self.reduction

    def reduction_obstacle(self) -> str | None:
        """Why there is no reduced model, a clause, or None if there may be one."""
        not_linear = self._model.observation.not_linear(self._row)
        if not_linear or self.reduction is None:
            return not_linear
        return self.reduction.obstacle

    def march_again(self, visited: Sequence[Floats]) -> None:
        """Have the reduced model made of the marches at some parameter vectors (n,), in that order.

        Those that were not made since they are kept are made now.
        """
        reduction = self.reduction
        if reduction is None or reduction.obstacle is not None:
            return
        for number, p in list(enumerate(visited))[-reduction.most :]:
            if not reduction.knows(p):
                reduction.number = number
                self._run(p, derivatives=True, again=True)
        reduction.order(visited[-reduction.most :])

    def expect_march(self, number: int) -> None:
        """The next march is the one of a number in a search, from 0."""
        if self.reduction is not None:
            self.reduction.number = number

    def leap(
        self, p: Floats, key: bytes, find: Callable[[CertifiedResponse], Floats]
    ) -> Floats | None:
        """What is found with the reduced model of the marches that were kept, (k,); None for none.

        Args:
            p: (n,) where the search is.
            key: tells this question from others that are asked there.
            find: looks for it.
        """
        found = self.reduced()
        return None if found is None else find(found)

    def reduced(
        self, *, bounded: bool = False, reference: Floats | None = None
    ) -> ReducedResponse | None:
        """The reduced model of the marches that were kept; None where there is none.

        Args:
            bounded: with bounds of the errors of the readings; costs a march and its way back.
            reference: (n,) parameters whose moduli measure; None for those of the last march.
        """
        model, reduction = self._model, self.reduction
        made = None if reduction is None else reduction.model(reference)
        if reduction is None or made is None:
            return None
        duals = None
        if bounded:
            run = model.at(made.reference, RunOptions(last=self._last, traced=True))
            for _ in run.states():
                pass
            rows = model.observation.operator(self._row)
            weights = model.observation.weights_of_states(self._row, self._state, self._last)
            duals = reduction.duals(run, rows, weights)
        values = model.values(made.reference)
        added = model.instrument_errors.added(values, self.names, self._places)
        return ReducedResponse(
            made,
            model.observation,
            self._row,
            self._state,
            added,
            model.sequence.bases,
            self.admissible,
            duals,
        )

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see at p (n,).

        (n_states, n_channels), SI, up to the last stage that a reading needs. Of the last run if
        it was made there.
        """
        if self._increments is None or self._increments[0] != p.tobytes():
            self.readings(p)
        assert self._increments is not None
        return self._increments[1]

    def by_adjoints(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n): one column a reading back through the stages.

        Raises:
            ValueError: ground yields, or a reading is not linear in the state.
        """
        model = self._model
        model.count_evaluation()
        run = model.at(p, RunOptions(last=self._last, traced=True))
        observed = [(end, self.adjoints.observed(end, run)) for end in run.states()]
        seen = np.stack([of_end for _, of_end in observed])
        change = model.observation.increments(seen[:, :, 0], model.sequence.bases)
        self._increments = p.tobytes(), change
        table = self.adjoints.table(run, observed[-1][0], seen)
        model.keep_adjoints(AdjointTable(run.given.values, self._row, self._state, table.copy()))
        self._activity = p.tobytes(), run.findings.activity
        table += model.instrument_errors.added(model.values(p), self.names, self._places)
        return table[:, 0], table[:, 1:]

    @cached_property
    def adjoints(self) -> ReadingAdjoints:
        """The way back from these readings."""
        model = self._model
        return ReadingAdjoints(model.march, model.observation, self._row, self._state, self._last)

    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return self._model.yields

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,), of the last run if it was made there.

        Raises:
            ValueError: nothing can yield.
        """
        if self._activity is None or self._activity[0] != p.tobytes():
            self.readings(p)
        found = None if self._activity is None else self._activity[1]
        if found is None:
            raise ValueError("no material of the case yields")
        return found

    def system_obstacle(self) -> str | None:
        """Why the equations are no `BilinearSystem`, a clause, or None if they are one."""
        model = self._model
        not_linear = model.observation.not_linear(self._row)
        return not_linear or export_obstacle(model.march, self._start_point)

    def system(self) -> BilinearSystem:
        """The equations of all stages as one system of vectors."""
        return bilinear(self.staged_system(), self._start)

    def staged_system(self) -> StagedSystem:
        """The equations stage by stage, as arrays."""
        model, start = self._model, self._start_point
        added = model.instrument_errors.added(start.values, self.names, self._places)
        operator = model.observation.operator(self._row)
        rows = ReadingRows(operator, self._active(), added)
        return export(model.march, start, rows, self._last)

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """The closed form of these readings, or why there is none."""
        model = self._model
        found = opening_in_mesh(model.on_mesh, Circle(centre, radius))
        return found if isinstance(found, str) else found.response(self._pairs, self._given_times)

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, or None if they are."""
        model = self._model
        return model.observation.not_linear(self._row) or condensation_obstacle(model.march)

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        """The condensed equations at p (theory 4.1), for the whole sequence of stages at once.

        Let K be the operator of all stages together, block lower triangular, and G the one that
        adds displacement increments up to readings. One march with the columns G^T gives
        S = G K^-1 G^T; forces c with S c = measured - v, in least squares where readings depend on
        each other, bring the displacements to the readings. The equation error of parameters q
        there, carried to the gauges, is G K^-1 e(q) = (measured - v) - J (q - p), with J the
        Jacobian of a march under those forces: exact, since e is affine in q. Two factorizations a
        stage.

        Args:
            p: (n,) parameters.
            measured: (g,) readings, m.
            sd: (g,) their standard deviations, SI; where readings share errors, the matrix (g, g)
                that makes their errors independent and of size one.
        """
        unit = self._unit_forces()
        table = self._run(p, unit)
        gap, flexibility = measured - table[:, 0], table[:, 1:]
        if sd.ndim == 1:
            weighted, aim = flexibility / sd[:, None], gap / sd
        else:
            weighted, aim = sd @ flexibility, sd @ gap
        multipliers = np.asarray(np.linalg.lstsq(weighted, aim, rcond=_DEPENDENT)[0])
        corrected = replace(unit, multipliers=multipliers)
        jacobian = self._run(p, corrected, derivatives=True)[:, 1:]
        return Condensed(table[:, 0], flexibility, -jacobian, -jacobian @ p - gap)

    def _run(
        self,
        p: Floats,
        unit_forces: UnitForces | None = None,
        *,
        derivatives: bool = False,
        again: bool = False,
    ) -> Floats:
        """Readings (g, 1 + n + k).

        Args:
            p: (n,) parameters, SI.
            unit_forces: forces along the readings.
            derivatives: carry the derivatives by all parameters.
            again: for what it leaves for the reduced model.
        """
        model = self._model
        plain = unit_forces is None
        if derivatives and plain and model.keeps_march:
            observed = self._kept_march(p, again=again)
            self._activity = p.tobytes(), None
        elif plain and not derivatives and model.is_paid(p):
            observed = np.stack(model.march_to(p, self._last).observed)[: self._last + 1, :, :1]
        else:
            observed = self._fresh_march(p, unit_forces, derivatives=derivatives)
        change = model.observation.increments(observed[:, :, 0], model.sequence.bases)
        self._increments = p.tobytes(), change
        table = model.observation.readings(observed, self._row, self._state)
        names = self.names if derivatives else ()
        added = model.instrument_errors.added(model.values(p), names, self._places)
        table[:, : added.shape[1]] += added
        return np.asarray(table)

    def _kept_march(self, p: Floats, *, again: bool) -> Floats:
        """What channels see of a march at p (n,), which may go on later, (m, n_channels, 1 + n).

        What it leaves for the reduced model of another response, whose marches go further, is not
        recorded, but where it is made again for that.
        """
        model, reduction = self._model, self.reduction
        recorder, last = None, self._last
        if reduction is not None and (again or reduction.last == last) and not reduction.knows(p):
            recorder, last = reduction.recorder(p), max(last, reduction.last)
        march = model.march_to(p, last, None if recorder is None else recorder.add)
        if reduction is not None and recorder is not None:
            reduction.add(recorder.snapshot)
        return np.stack(march.observed[: self._last + 1])

    def _fresh_march(
        self, p: Floats, unit_forces: UnitForces | None, *, derivatives: bool
    ) -> Floats:
        """What channels see of a march at p (n,) that is made now, (m, n_channels, 1 + n + k)."""
        model = self._model
        model.count_evaluation()
        # Where the loads collapse at the start, the user wants to know how much of them is carried;
        # who searches elsewhere, only that they are not.
        explain = bool(np.array_equal(p, self._start))
        run = model.at(
            p, RunOptions(derivatives, self._last, unit_forces=unit_forces, explain=explain)
        )
        kept = self.reduction if derivatives and unit_forces is None else None
        recorder = None if kept is None else kept.recorder(p)
        seen = []
        for end in run.states():
            seen.append(model.observation.values(MarchState(end, run.point, model.structures)))
            if recorder is not None:
                recorder.add(end, run)
        if kept is not None and recorder is not None:
            kept.add(recorder.snapshot)
        self._activity = p.tobytes(), run.findings.activity
        return np.stack(seen)

    def _unit_forces(self) -> UnitForces:
        """Unit forces along every reading: G^T.

        A reading adds up the increments of all stages that led to its own, less those that led to
        its zero. Where its stage builds on its zero, its unit force is a dead load that acts from
        the stage after the zero on.
        """
        rows = self._model.observation.operator(self._row)
        return UnitForces(rows.toarray().T, self._active())

    def _active(self) -> Floats:
        """(n_states, g) weight of the step of a state in a reading: 1, 0 or -1."""
        built_on = self._model.sequence.built_on
        return self._model.observation.steps(built_on, self._row, self._state)


def _equal_notes(equal: Mapping[str, int], stages: Sequence[str]) -> Iterator[str]:
    """Which channels read principal stresses that are not told apart, each with one such state."""
    for channel, state in equal.items():
        yield (
            f"gauge '{channel}' reads one of several equal principal stresses at "
            f"'{stages[state]}': which of them is not determined, and its sensitivities are those "
            "for growing parameters"
        )


def _unbalanced_notes(found: RunFindings) -> Iterator[str]:
    """What a march left unbalanced."""
    for stage, part in found.unbalanced.items():
        yield (
            f"at stage '{stage}' {100 * part:.2g} % of the change of load is not balanced: with a "
            "dilation far below the friction the flow tends to shear in bands; a larger dilation "
            "(or none given: associated) has an exact solution"
        )
