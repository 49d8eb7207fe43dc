"""A case on its mesh, ready to answer: the one class by which others use the forward model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from geoident.errors import CollapseError, Fault, InputError
from geoident.fem.solvers import Solver
from geoident.forward.checks import (
    check_on_mesh,
    imbalance_notes,
    notes_on_mesh,
)
from geoident.forward.gauges.adjoints import AdjointTable, ReadingAdjoints
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.observation import MarchState, Observation
from geoident.forward.ground.field import field_notes, point_field, with_modes
from geoident.forward.in_situ.growth import growth_notes, point_growths, start_faults
from geoident.forward.march.fields import MeshRecorder
from geoident.forward.march.march import Run, RunOptions
from geoident.forward.march.plastic_step import PlasticFindings
from geoident.forward.march.stage import StageEnd
from geoident.forward.march.virgin import contradictions, overburden_notes, surface_gaps
from geoident.forward.openings.face import (
    FaceState,
    advance_of,
    conversion_note,
    face_note,
    face_states,
)
from geoident.forward.protocols import Survey
from geoident.forward.reducible import ReducibleResponse, SharedReduction
from geoident.forward.response import Marches
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.forces import MemberRecorder
from geoident.forward.yielding.equivalent import equivalent_notes
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import Mesh
from geoident.model.parameter import Values
from geoident.model.results.result import FieldSeries
from geoident.model.results.yielded import Mechanism


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
    """A case on its mesh with its fields there, and their modes among its parameters.

    What grows with depth or stress is there, too.

    Raises:
        InputError: a constant that grows is not positive somewhere at the start values.
    """
    case, positions = on_mesh.case, on_mesh.discretization.points.position
    fields = []
    for field in case.fields:
        points = on_mesh.material_points(field.material)
        fields.append(point_field(field, points, positions[points], case.start))
    growths = point_growths(on_mesh)
    if faults := start_faults(case, growths):
        raise InputError(faults)
    if not fields and not growths:
        return on_mesh
    return on_mesh.with_fields(with_modes(case, fields), tuple(fields), growths)


class StagedModel(Marches):
    """The staged forward model of a case (theory 1 and 2); it checks nothing (see `checks`).

    Args:
        on_mesh: the case and the mesh that it fits.
        observation: its gauges there.
        solver: factorizes the stiffness matrices.
    """

    def __init__(self, on_mesh: CaseOnMesh, observation: Observation, *, solver: Solver) -> None:
        super().__init__(on_mesh, observation, solver=solver)
        self._shared = SharedReduction()
        self._all_readings: dict[int, ReadingAdjoints] = {}
        self._other_readings: dict[tuple[int, bytes], ReadingAdjoints] = {}

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
        start = self.case.start
        unknowns = self.systems[0].dofs
        noted = notes_on_mesh(
            self.on_mesh,
            self.observation,
            edges_held=self.actions.hold_edges(ParameterPoint(start, ()), unknowns),
            n_outside=max(
                self.march.n_outside,
                self.actions.n_outside,
                *(growth.n_outside for growth in self.on_mesh.growths),
            ),
            in_tension=self.march.virgin_tension(start),
        )
        varied = field_notes(self.on_mesh.case, self.on_mesh.fields)
        growing = growth_notes(self.on_mesh.growths, self.case.start)
        return (*noted, *conversion_note(self.face, self.on_mesh), *varied, *growing)

    def face_states(self, values: Values) -> tuple[FaceState, ...]:
        """What distances to the face become at some parameters; see `openings.face`."""
        return face_states(self.face, self.on_mesh, values)

    def virgin_notes(self) -> tuple[str, ...]:
        """What to know of the in-situ stress at the start values; nothing is factorized."""
        start = self.case.start
        stress, imbalance = self.march.virgin(ParameterPoint(start, ()))
        return (
            *self._equivalent_notes(stress[..., 0]),
            *overburden_notes(self.march, start),
            *imbalance_notes(float(imbalance[0])),
            *(self._contradiction_notes(start) if self.case.imbalance_accepted else ()),
        )

    def _equivalent_notes(self, stress: Floats) -> Iterator[str]:
        """Curved strengths as c and phi, in the in-situ stress (n_strain, n_points)."""
        for name, points in self.systems[0].points_of.items():
            material = self.case.materials[name]
            yield from equivalent_notes(material, stress[:, points], self.case.start)

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

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""
        return self.observation.unreadable(channel, self.case.stage_names.index(stage))

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> ReducibleResponse:
        """The response in the readings of some (channel, stage) pairs.

        Args:
            pairs: what was read.
            times: when each was read, seconds since 1970; None for what is known of its stage.
        """
        return ReducibleResponse(self, self._shared, pairs, times)

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
        recorder = MeshRecorder(self.on_mesh, self.structures) if fields else None
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
            backwards = ways.cost_less(len(self.names)) and not self.is_lent(p)
            back = ways if backwards else None
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
            None if recorder is None else recorder.fields.series(),
            members.table() if last is None else None,
            tuple(error.message for error in found.collapses),
            found.plastic.planes.activity(),
            (
                *face_note(self.face, self.on_mesh, values),
                *_equal_notes(equal, self.case.stage_names),
                *_unbalanced_notes(found.plastic),
                *imbalance_notes(found.imbalance),
                *self._contradiction_notes(values),
            ),
            self.observation.increments(seen_at[:, :, 0], self.sequence.bases),
            reactions=None if recorder is None else recorder.reactions.table(),
            yielded=None if recorder is None else recorder.yielded_ground(),
            mechanism=None if recorder is None else _first_mechanism(found.collapses),
            advance=None if recorder is None else advance_of(self.face, self.on_mesh, values),
        )

    def fields_up_to_collapse(self, p: Floats) -> FieldSeries:
        """The states that do not build on a stage that collapses; what is known of the others.

        Args:
            p: (n,) parameters.
        """
        recorder = MeshRecorder(self.on_mesh, self.structures)
        options = RunOptions(derivatives=False, partial=True)
        for end in self.at(p, options).states():
            recorder.add(end)
        return recorder.fields.series()

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
        known = self.last_adjoints
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
        even_only: no flow in bands of shear is looked for; where there is no other, the model
            counts as one without solution.
    """

    def __init__(
        self,
        model: StagedModel,
        p: Floats,
        tell: Callable[[StageEnd], None] = lambda end: None,
        *,
        even_only: bool = False,
    ) -> None:
        model.count_evaluation()
        self._model, self._values, self._tell = model, model.values(p), tell
        self._run = model.at(
            p, RunOptions(derivatives=False, partial=True, explain=False, even_only=even_only)
        )
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


def _equal_notes(equal: Mapping[str, int], stages: Sequence[str]) -> Iterator[str]:
    """Which channels read principal stresses that are not told apart, each with one such state."""
    for channel, state in equal.items():
        yield (
            f"gauge '{channel}' reads one of several equal principal stresses at "
            f"'{stages[state]}': which of them is not determined, and its sensitivities are those "
            "for growing parameters"
        )


def _first_mechanism(collapses: Sequence[CollapseError]) -> Mechanism | None:
    """How the ground moves at the first stage that collapses, where that is known."""
    motions = (error.motion for error in collapses)
    return next((motion for motion in motions if isinstance(motion, Mechanism)), None)


def _unbalanced_notes(found: PlasticFindings) -> Iterator[str]:
    """What a march left unbalanced, or beyond the yield surface."""
    why = (
        "with a dilation far below the friction the flow tends to shear in bands: the acoustic "
        "tensor has no positive determinant at {:.0f} % of the strain points that yield{}. A "
        "larger dilation (or associated flow) has an exact solution"
    )

    def reason(stage: str) -> str:
        bands = found.localising[stage]
        return why.format(100 * bands.part, f", and {bands.band}" if bands.band else "")

    for stage, part in found.unbalanced.items():
        yield (
            f"at stage '{stage}' {100 * part:.2g} % of the change of load is not balanced: "
            + reason(stage)
        )
    for stage, part in found.overstressed.items():
        short = 100 * found.localising[stage].short
        yield (
            f"at stage '{stage}' the ground keeps {100 * part:.1g} % of the stress beyond the "
            f"yield surface, where the even flow ends (motions are short by {short:.1g} % of the "
            "largest, as its path promises): " + reason(stage)
        )
