"""The model of a case on a mesh: one analysis through the stages at a parameter vector (theory 2).

An analysis gives what the gauges see of every state. Its derivatives travel with it (tangents, one
column a parameter), or are taken back from the readings afterwards (adjoints, one column a
reading), whichever costs less. Where nothing yields the last run with tangents is kept: who asks
for later stages at the same parameters goes on where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Protocol

import numpy as np

from geoident.errors import CollapseError
from geoident.fem.solvers import Solver
from geoident.fem.solvers.kept_solutions import SolutionStore
from geoident.forward.analysis.analysis import (
    AnalysisRun,
    KnownDisplacements,
    RunFindings,
    RunOptions,
    StagedAnalysis,
)
from geoident.forward.analysis.fields import MeshRecorder
from geoident.forward.analysis.plastic_step import PlasticFindings
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.analysis.stages_in_time import order_of_steps
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.virgin import contradictions
from geoident.forward.checks import imbalance_notes, inadmissible_numbers
from geoident.forward.gauges.adjoints import ReadingAdjoints
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.observation import AnalysisState, PlacedGauges
from geoident.forward.ground.elasticity import inadmissible_moduli
from geoident.forward.observed import Details, Observed, ObservedModel, Query
from geoident.forward.openings.face import advance_of, advancing_face, face_note
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.forces import MemberRecorder
from geoident.forward.structures.interface_states import InterfaceRecorder
from geoident.forward.yielding.varied import inadmissible_strengths
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Values
from geoident.model.results.costs import Counts
from geoident.model.results.yielded import Mechanism

MOST_KEPT = 100_000_000
"""Numbers that the states of a kept analysis may take: 0.8 GB."""

_MOST_WAYS = 8
"""Sets of readings whose way back through the stages is remembered: those of a fit, of its survey
and of a backtest's parts are fewer."""

_WHOLE = RunOptions()
"""All states with their derivatives."""

Each = Callable[[StageEnd], None]
"""Is given the values of every state."""

Tell = Callable[[StageEnd, AnalysisRun], None]
"""Is given every state of a run while its factorization is there; its arrays change afterwards."""

Seen = tuple[StageEnd, Floats, tuple[str, ...]]
"""A state, what all channels see of it, and those that read one of several equal stresses."""


class KnowsDisplacements(Protocol):
    """The analyses recorded for a reduced model, and this: `reduced.reduction.Reduction`."""

    def displacements(self, p: Floats) -> KnownDisplacements | None:
        """Displacements of the states at p (n,); None where they are not known well enough."""


class ResumableRun:
    """One run at one parameter vector, as far as it was asked for: it goes on where it stopped.

    Of a state is kept what does not depend on the number of parameters: its displacements and
    stresses, and what the gauges see of it.

    Args:
        model: of the case.
        p: (n,) parameters, SI.
        options: how the run is made.
        keeps_ends: whether the values of the states are kept.

    Attributes:
        p: as given.
        run: whose states are wanted, to the last one.
        observed: of every state, what all channels see with derivatives, (n_channels, k).
        states: the same with the state and the channels that read one of several equal stresses.
    """

    def __init__(
        self, model: StagedKernel, p: Floats, options: RunOptions, *, keeps_ends: bool = True
    ) -> None:
        model.evaluations += 1
        self.p, self.run = p.copy(), model.at(p, options)
        self.observed: list[Floats] = []
        self.states: list[Seen] = []
        self._model, self._keeps_ends = model, keeps_ends
        self._ends = self.run.states()

    def to(self, last: int, tell: Tell | None = None) -> None:
        """Go on to a state. No factor is held while the run waits.

        Args:
            last: index of the state.
            tell: is given every state that is computed now.

        Raises:
            ModelError: the model has no solution. It cannot go on then.
        """
        for end in islice(self._ends, max(last + 1 - len(self.observed), 0)):
            seen = self._model.see(end, self.run)
            if tell is not None:
                tell(end, self.run)
            self.observed.append(seen)
            if self._keeps_ends:
                equal = self._model.coinciding(end, self.run)
                self.states.append((_values(end), seen, equal))
        self.run.forget_factors()

    def computed(self, last: int) -> Floats:
        """All channels at all stages (n_channels, n_stages), SI; NaN of stages after a state.

        Raises:
            ModelError: the model has no solution.
        """
        self.to(last)
        model, observed = self._model, Observed(np.stack(self.observed)[..., :1])
        places = model.readable_until(len(self.observed) - 1)
        return model.table(self.p, observed, places, derivatives=False)[..., 0]


class StagedKernel(ObservedModel):
    """The staged forward model of a case (theory 1 and 2), without what `StagedModel` adds.

    It checks nothing (see `checks`).

    Args:
        on_mesh: the case and the mesh that it fits.
        gauges: those of the case, on its mesh.
        solver: factorizes the stiffness matrices.

    Attributes:
        face: what turns distances to a tunnel face into released parts.
        reduction: the analyses that were recorded last for a reduced model; None where none were.
    """

    def __init__(self, on_mesh: CaseOnMesh, gauges: PlacedGauges, *, solver: Solver) -> None:
        sequence = self.sequence = on_mesh.sequence
        super().__init__(on_mesh.case, gauges, sequence.built_on, sequence.bases)
        self.on_mesh, self.gauges, self.mesh = on_mesh, gauges, on_mesh.mesh
        self.discretization = on_mesh.discretization
        self._solver = solver
        self.systems = StageSystems(on_mesh, solver)
        self.structures = self.systems.structures
        self.face = advancing_face(on_mesh, solver)
        self.analysis = StagedAnalysis(on_mesh, self.systems, self.face, self.face.warm)
        self.actions = self.analysis.actions
        self.reduction: KnowsDisplacements | None = None
        self._kept: ResumableRun | None = None
        self._ways: dict[tuple[int, bytes, bytes], ReadingAdjoints] = {}

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        done = self._solver.counts
        solved = done.analyses, done.factorizations, done.solves, done.iterations
        return Counts(self.evaluations, *solved)

    @property
    def solver_name(self) -> str:
        """Name of the sparse solver."""
        return self._solver.name

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Have solutions that take long kept, where the solver can; None for no longer."""
        self._solver.keep_solutions(store)

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state, the virgin state first."""
        return tuple(len(self.systems[n].dofs) for n in range(len(self.bases)))

    @property
    def yields(self) -> bool:
        """Whether any material or structure of the case has yield limits, or hardens."""
        return self.case.yields or self.case.hardens

    @property
    def keeps_analysis(self) -> bool:
        """Whether the states of an analysis are kept: nothing yields, and they are not too many."""
        points = self.discretization.points
        each = self.discretization.n_dofs + points.n_strain * points.n_points
        return not self.yields and each * len(self.bases) <= MOST_KEPT

    def why_unseen(self, state: int, row: int) -> str:
        """Why a channel cannot be read at a state at which it can't, a clause."""
        return self.gauges.reasons[row]

    def domain_fault(self, p: Floats) -> str | None:
        """Why finite p (n,) is outside the domain, or None."""
        values = self.values(p)
        fault = inadmissible_numbers(self.case, self.sequence, values)
        for name in () if fault else self.sequence.materials:
            fields = self.on_mesh.elastic_fields(name)
            growths = self.on_mesh.elastic_growths(name)
            if fields or growths:
                s = self.discretization.points.n_strain
                material = replace(self.case.materials[name], elastic=self.on_mesh.elastic(name))
                fault = fault or inadmissible_moduli(material, fields, values, s, growths)
            fault = fault or inadmissible_strengths(self.on_mesh, name, values)
        return fault

    def forget(self) -> None:
        """Begin the next run as a new model does: only the symbolic factorizations stay."""
        self.analysis.forget()
        self.face.forget()
        self._kept = None

    def at(self, p: Floats, options: RunOptions = _WHOLE) -> AnalysisRun:
        """One analysis at parameters p (n,); its states come one by one.

        Args:
            p: (n,) parameters.
            options: how the run is made.
        """
        return AnalysisRun(
            self.analysis, ParameterPoint(self.values(p), self.names), options, self._told
        )

    def see(self, end: StageEnd, run: AnalysisRun) -> Floats:
        """What all channels see of a state, (n_channels, k)."""
        return self.gauges.values(AnalysisState(end, run.point, self.structures))

    def coinciding(self, end: StageEnd, run: AnalysisRun) -> tuple[str, ...]:
        """Channels that read one of several equal principal stresses at a state."""
        return self.gauges.coinciding(AnalysisState(end, run.point, self.structures))

    def way_back(self, places: ReadingPlaces, last: int) -> ReadingAdjoints:
        """The way back from some readings through the stages up to a state."""
        key = last, places.rows.tobytes(), places.states.tobytes()
        if key not in self._ways:
            if len(self._ways) >= _MOST_WAYS:
                self._ways.clear()
            self._ways[key] = ReadingAdjoints(
                self.analysis, self.gauges, places.rows, places.states, last
            )
        return self._ways[key]

    def observe(
        self,
        p: Floats,
        query: Query,
        *,
        adjoints: bool | None = None,
        each: Each | None = None,
        tell: Tell | None = None,
    ) -> Observed:
        """What all channels see of the states of an analysis at p (n,).

        Args:
            p: (n,) parameters, SI.
            query: what is wanted.
            adjoints: whether derivatives are by adjoints; None for what costs less.
            each: is given the values of every state.
            tell: is given every state while its factorization is there.

        Raises:
            CollapseError: a stage collapses; with ``query.partial`` that is among the failures.
            ModelError: the stiffness of a stage is not positive definite.
            ValueError: ``adjoints`` where ground yields, or a reading is not linear in the state.
        """
        # Only surveys and partial runs may take displacements from the reduced model; evaluations
        # for a fit never do.
        may_use_reduced = (query.survey or query.partial) and tell is None
        reduction = self.reduction if may_use_reduced else None
        known = reduction.displacements(p) if reduction is not None else None
        back = self._way_chosen(p, query, adjoints) if query.derivatives and not known else None
        run, states = self._analysed(p, query, back, tell, known)
        values = self.values(p)
        recorder = MeshRecorder(self.on_mesh, self.structures) if query.fields else None
        with_members = query.survey and query.last == len(self.bases) - 1
        members = MemberRecorder(self.structures, self.sequence, values) if with_members else None
        joints = None
        if with_members and self.structures.joints:
            joints = InterfaceRecorder(self.structures, self.sequence, values)
        observed, equal = [], dict[str, int]()
        for end, seen, names in states:
            observed.append(seen)
            equal |= dict.fromkeys(names, end.number)
            if recorder is not None:
                recorder.add(end)
            if members is not None and self.structures.parts:
                members.add(end.number, end.members)
            if joints is not None:
                joints.add(end.number, end.u[:, 0], end.members[:, 0])
            if each is not None:
                each(end)
        seen_at = np.stack(observed)
        jacobian = None if back is None else back.jacobian(run, end, seen_at)
        findings = run.findings
        plastic = findings.plastic
        details = Details(activity=None if plastic is None else plastic.planes.activity())
        if query.survey:
            details = replace(
                details,
                members=None if members is None else members.table(),
                shells=None if members is None else members.shells(),
                interfaces=None if joints is None else joints.table(),
                notes=self._notes_at(values, findings, equal),
            )
        if recorder is not None:
            details = replace(
                details,
                fields=recorder.fields.series(),
                reactions=recorder.reactions.table(),
                yielded=recorder.yielded_ground(),
                mechanism=_first_mechanism(findings.collapses),
                advance=advance_of(self.face, self.on_mesh, values),
            )
        return Observed(seen_at, jacobian, findings.collapses, details)

    def _way_chosen(self, p: Floats, query: Query, adjoints: bool | None) -> ReadingAdjoints | None:
        """The way back where derivatives are by adjoints; None where they are by tangents."""
        if adjoints is None:
            if self._kept is not None and np.array_equal(self._kept.p, p):
                return None  # an analysis with tangents is there
            way = self.way_back(query.places, query.last)
            return way if way.cost_less(len(self.names)) else None
        return self.way_back(query.places, query.last) if adjoints else None

    def _analysed(
        self,
        p: Floats,
        query: Query,
        back: ReadingAdjoints | None,
        tell: Tell | None,
        known: KnownDisplacements | None,
    ) -> tuple[AnalysisRun, Iterator[Seen] | Sequence[Seen]]:
        """An analysis at p (n,) and its states: of the one that is kept, or one by one."""
        kept = self._kept if tell is None else None
        at_p = kept is not None and np.array_equal(kept.p, p)
        # A run with displacements of the reduced model is not kept: evaluations would take it.
        keep = at_p or (query.derivatives and known is None)
        if back is None and self.keeps_analysis and keep:
            self._kept = None  # its memory is free for the next
            analysis = kept if at_p and kept is not None else ResumableRun(self, p, _WHOLE)
            analysis.to(query.last, tell)
            self._kept = analysis
            return analysis.run, analysis.states[: query.last + 1]
        self.evaluations += 1
        # Where the loads collapse at the start, the user wants to know how much of them is carried;
        # who searches elsewhere, only that they are not.
        at_start = bool(np.array_equal(p, [parameter.start for parameter in self.case.parameters]))
        options = RunOptions(
            derivatives=query.derivatives,
            last=query.last,
            explain=query.survey or at_start,
            partial=query.partial,
            traced=back is not None,
            displacements=known,
        )
        run = self.at(p, options)
        return run, self._seen_of(run, back, tell, coinciding=query.survey)

    def _seen_of(
        self, run: AnalysisRun, back: ReadingAdjoints | None, tell: Tell | None, *, coinciding: bool
    ) -> Iterator[Seen]:
        for end in run.states():
            seen = self.see(end, run) if back is None else back.observed(end, run)
            if tell is not None:
                tell(end, run)
            yield end, seen, self.coinciding(end, run) if coinciding else ()

    def computed(self, p: Floats, each: Each | None = None) -> Floats:
        """All channels at all stages (n_channels, n_stages) at p (n,), SI, without derivatives.

        Args:
            p: (n,) parameters, SI.
            each: is given the values of every state.
        """
        last = len(self.bases) - 1
        query = Query(self.readable_until(last), last, derivatives=False, partial=True)
        observed = self.observe(p, query, each=each)
        return self.table(p, observed, query.places, derivatives=False)[..., 0]

    def time_step_errors(self, p: Floats) -> Floats:
        """Errors (n_channels, n_stages) of readings by the steps in time, exact less computed, SI.

        With twice as many a quarter of the error is left, or half of it (`order_of_steps`).

        Args:
            p: (n,) parameters, SI.

        Raises:
            ModelError: the model has no solution there.
        """
        options = RunOptions(derivatives=False, partial=True, explain=False, finer=2)
        finer = ResumableRun(self, p, options, keeps_ends=False).computed(len(self.bases) - 1)
        less = 2.0 ** order_of_steps(self.case)
        return (finer - self.computed(p)) * less / (less - 1.0)

    def _notes_at(
        self, values: Values, findings: RunFindings, equal: Mapping[str, int]
    ) -> tuple[str, ...]:
        """What the user should know of an analysis."""
        return (
            *face_note(self.face, self.on_mesh, values),
            *equal_notes(equal, self.case.stage_names),
            *(() if findings.plastic is None else residual_notes(findings.plastic)),
            *imbalance_notes(findings.imbalance),
            *self.contradiction_notes(values),
        )

    def contradiction_notes(self, values: Values) -> tuple[str, ...]:
        """Where weight and in-situ stress disagree at some values, and where that is accepted."""
        accepted = " (accepted: in_situ.equilibrium)" if self.case.imbalance_accepted else ""
        return tuple(
            f"{fault.message}{accepted}" for fault in contradictions(self.analysis, values)
        )

    def _told(self, state: int) -> None:
        if self.on_state is not None:
            self.on_state(state)


def _values(end: StageEnd) -> StageEnd:
    """The values of a state without derivatives, copied."""
    return replace(
        end,
        u=end.u[:, :1].copy(),
        stress=end.stress[..., :1].copy(),
        members=end.members[:, :1].copy(),
        yielded=end.yielded.copy(),
        forces=None if end.forces is None else end.forces[:, :1].copy(),
        pores=None if end.pores is None else end.pores[:, :1].copy(),
    )


def equal_notes(equal: Mapping[str, int], stages: Sequence[str]) -> Iterator[str]:
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


def residual_notes(findings: PlasticFindings) -> Iterator[str]:
    """At which stages Newton's method did not converge, what is left, and what it may mean."""
    for stage, part in findings.overstressed.items():
        bands = findings.localising[stage]
        off = "may be off by" if bands.balanced else "are too small by more than"
        unstable = f", and {bands.band}" if bands.band else ""
        yield (
            f"stage '{stage}' has not converged: residual {100 * part:.2g} % of its change of "
            f"load, carried by stress beyond the yield surface, and motions {off} "
            f"{100 * bands.short:.2g} % of the largest. It may mean that shear goes into bands as "
            "wide as the elements, as with a dilation far below the friction: the acoustic tensor "
            f"has no positive determinant at {100 * bands.part:.0f} % of the strain points that "
            f"yield{unstable}. Or the stage is near its limit load. A larger dilation (or "
            "associated flow) has an exact solution"
        )
