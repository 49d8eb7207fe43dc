"""The response of a staged model: chosen readings as a function of the parameters.

A march at a parameter vector goes through all stages that a reading needs. It is counted, and kept
where nothing yields: who asks for later stages goes on where it was left. A response chooses
readings of what gauges see of its states, with derivatives by tangents or by adjoints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np

from geoident.fem.solvers import Solver
from geoident.fem.solvers.kept_solutions import SolutionStore
from geoident.forward.affine import condensation_obstacle
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.equations import ReadingRows, export, export_obstacle
from geoident.forward.gauges.adjoints import AdjointTable, ReadingAdjoints
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.gauges.observation import MarchState, Observation
from geoident.forward.ground.elasticity import inadmissible_moduli
from geoident.forward.march.march import KnownMotion, March, Run, RunOptions
from geoident.forward.march.plastic_step import WarmStart
from geoident.forward.march.stage import StageEnd, UnitForces
from geoident.forward.march.systems import StageSystems
from geoident.forward.model_response import ModelResponse
from geoident.forward.openings.face import advancing_face
from geoident.forward.openings.model import OpeningResponse, opening_in_mesh
from geoident.forward.openings.site import Circle
from geoident.forward.reduced.reduction import Reduction
from geoident.forward.staged_system import StagedSystem, bilinear
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.response import BilinearSystem, Condensed
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity

WHOLE = RunOptions()
"""All states with their derivatives."""

MOST_KEPT = 100_000_000
"""Numbers that the states of a march may take: 0.8 GB."""

See = Callable[[StageEnd, Run], tuple[Floats, tuple[str, ...]]]
"""What all channels see of a state, (n_channels, 1 + n), and whose principal stresses coincide."""

Tell = Callable[[StageEnd, Run], None]
"""Is given a state with its run."""

_DEPENDENT = 1e-10
"""Singular value of S, relative to the largest, below which readings count as dependent."""


@dataclass(eq=False)
class KeptMarch:
    """One elastic march with derivatives, as far as it was asked for: it goes on where it was left.

    A fit asks for the readings of its last parameters, then for what the mesh does to them, at the
    end for all that later stages will show. All of it is one march. Of a state is kept what does
    not depend on the number of parameters: its displacements and stresses, and what the gauges see
    of it.

    Args:
        run: whose states are wanted, to the last one.
        see: what gauges see.

    Attributes:
        ends: the states so far; of displacements and stresses, their values alone.
        observed: of every state, what all channels see with derivatives, (n_channels, 1 + n).
        equal: of every state, the channels that read one of several equal principal stresses.
    """

    run: Run
    see: See
    ends: list[StageEnd] = field(default_factory=list)
    observed: list[Floats] = field(default_factory=list)
    equal: list[tuple[str, ...]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._states = self.run.states()

    @property
    def p(self) -> tuple[float, ...]:
        """The values of all parameters."""
        return tuple(self.run.given.values.values())

    @property
    def last(self) -> int:
        """The state to which it has come; -1 before the first."""
        return len(self.ends) - 1

    def go_on(self, last: int, tell: Tell | None = None) -> None:
        """March on to a state. It holds no factor while it waits.

        Args:
            last: index of the state.
            tell: is given every state that is computed now, whole, with the run; its arrays change.

        Raises:
            ModelError: the stiffness of a stage is not positive definite. It cannot go on then.
        """
        for end in islice(self._states, max(last - self.last, 0)):
            observed, equal = self.see(end, self.run)
            if tell is not None:
                tell(end, self.run)
            self.observed.append(observed)
            self.equal.append(equal)
            self.ends.append(_values(end))
        self.run.factors.forget()


class Marches:
    """Marches of a case with its gauges, each counted.

    Args:
        on_mesh: the case and the mesh that it fits.
        observation: its gauges there.
        solver: factorizes the stiffness matrices.

    Attributes:
        on_state: is told of every state computed.
        last_adjoints: readings with their derivatives at the parameters that were evaluated last.
        face: what turns distances to a tunnel face into released parts.
    """

    def __init__(self, on_mesh: CaseOnMesh, observation: Observation, *, solver: Solver) -> None:
        self.on_mesh, self.observation = on_mesh, observation
        self.case, self.mesh, self.sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
        self.names = tuple(parameter.name for parameter in self.case.parameters)
        self.instrument_errors = InstrumentErrors(self.case, self.sequence.built_on)
        self._solver = solver
        self._evaluations = 0
        self.on_state: Callable[[int], None] | None = None
        self.last_adjoints: AdjointTable | None = None
        self.discretization = on_mesh.discretization
        self.systems = StageSystems(on_mesh, solver)
        self.structures = self.systems.structures
        self.face = advancing_face(on_mesh, solver)
        self.march = March(on_mesh, self.systems, self.face)
        self.actions = self.march.actions
        self._kept: KeptMarch | None = None
        self._paid: tuple[bytes | None, int] = None, -1
        self._free = Counts()
        self._lent: tuple[bytes, KnownMotion] | None = None

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        spent = self._spent()
        return replace(spent, evaluations=self._evaluations) - self._free

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Have solutions that take long kept, where the solver can; None for no longer."""
        self._solver.keep_solutions(store)

    def _spent(self) -> Counts:
        """What the solver has done so far."""
        done = self._solver.counts
        return Counts(0, done.analyses, done.factorizations, done.solves, done.iterations)

    @property
    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return any(material.yields for material in self.case.materials.values())

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        if not np.all(np.isfinite(p)):
            return "a parameter is not finite"
        values = self.values(p)
        found = inadmissible_numbers(self.case, self.sequence, values)
        for name in () if found else self.sequence.materials:
            fields = self.on_mesh.elastic_fields(name)
            growths = self.on_mesh.elastic_growths(name)
            if fields or growths:
                s = self.discretization.points.n_strain
                material = replace(self.case.materials[name], elastic=self.on_mesh.elastic(name))
                found = found or inadmissible_moduli(material, fields, values, s, growths)
        return found

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def count_evaluation(self) -> int:
        """One more parameter vector was evaluated: how many so far."""
        self._evaluations += 1
        return self._evaluations

    def at(self, p: Floats, options: RunOptions = WHOLE) -> Run:
        """One march at parameters p (n,); its states come one by one.

        Args:
            p: (n,) parameters.
            options: how to march.
        """
        lent = self._lent
        if lent is not None and lent[0] == p.tobytes() and options.unit_forces is None:
            options = replace(options, known=lent[1], traced=False)
        return Run(self.march, ParameterPoint(self.values(p), self.names), options, self._tell)

    def lend(self, p: Floats, known: KnownMotion) -> None:
        """Displacements at p (n,) are known; marches there need not solve for them.

        Args:
            p: (n,) parameters.
            known: the displacements.
        """
        self._lent = p.tobytes(), known

    def is_lent(self, p: Floats) -> bool:
        """Whether displacements at p (n,) are known."""
        return self._lent is not None and self._lent[0] == p.tobytes()

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
        tell: Tell | None = None,
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
            kept = KeptMarch(self.at(p), self._see)
        free = self._paid[1]
        try:
            for to in sorted({min(free, last), last}):
                before = self._spent()
                kept.go_on(to, tell)
                if to <= free:
                    self._set_free(before)
        except BaseException:
            self._kept = None
            raise
        self._kept = kept
        self.paid(p, last)
        return kept

    def forget(self) -> None:
        """Begin the next march as a new model does: of earlier ones only analyses stay."""
        self.march.forget()
        self.face.forget()
        self.last_adjoints = self._kept = self._lent = None
        self._paid = None, -1

    def _set_free(self, before: Counts) -> None:
        """What was done since these counts is not to be counted, but for analyses."""
        self._free += replace(self._spent() - before, analyses=0)

    def _see(self, end: StageEnd, run: Run) -> tuple[Floats, tuple[str, ...]]:
        """What channels see of a state, and which read one of several equal stresses."""
        state = MarchState(end, run.point, self.structures)
        return self.observation.values(state), self.observation.coinciding(state)

    def _tell(self, state: int) -> None:
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
    )


class StagedResponse(ModelResponse):
    """Readings of some (channel, stage) pairs as a function of the parameters.

    Fulfils the protocols ``Response``, ``AffineElastic`` and ``ComplementaritySystem`` of the
    identifiers. The march ends with the last stage that a reading needs.

    Args:
        marches: of the case.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.

    Attributes:
        reduction: is given the marches with derivatives, for a reduced model; None for none.
        learns: whether it is given the next one, too.
    """

    def __init__(
        self,
        marches: Marches,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        super().__init__(marches)
        self._marches = marches
        self._pairs, self._given_times = tuple(pairs), tuple(times)
        self._start = np.array([parameter.start for parameter in marches.case.parameters])
        self._start_point = ParameterPoint(marches.case.start, marches.names)
        self._activity: tuple[bytes, Activity | None] | None = None  # p and what was found there
        self._increments: tuple[bytes, Floats] | None = None  # likewise
        self._places = ReadingPlaces.of(marches.case, pairs, times)
        self._row, self._state = self._places.rows, self._places.states
        self._last = int(self._state.max(initial=0))
        self.reduction: Reduction | None = None
        self.learns = True

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), m."""
        return self._run(p)[:, 0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        return self.by_adjoints(p) if self.backwards else self.by_tangents(p)

    @property
    def backwards(self) -> bool:
        """Whether derivatives come by adjoints: not while marches are kept."""
        if not self.adjoints.cost_less(len(self.names)):
            return False
        return self.reduction is None or not self.reduction.covers()

    def remembers(self, p: Floats) -> None:
        """The answer at p (n,) with derivatives is known and was counted, from an earlier run."""
        if self._marches.keeps_march and not self.backwards:
            self._marches.paid(p, self._last)

    def forget(self) -> None:
        """Begin the next evaluation as a new model does; what a reduced model is made of stays."""
        self._marches.forget()
        self._activity = self._increments = None

    def starts(self) -> WarmStart:
        """From where evaluations may begin now, without factors."""
        return self._marches.march.warm.copy()

    def begin_from(self, starts: object) -> None:
        """Begin the next evaluation from what was known then.

        Args:
            starts: of this model, as they were.
        """
        assert isinstance(starts, WarmStart)
        self._marches.march.warm = starts

    def by_tangents(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n): one column a parameter through the stages.

        A march that is kept goes as far as the reduced model is to go.
        """
        reduction = self.reduction if self.learns else None
        recorder = None if reduction is None or reduction.knows(p) else reduction.recorder(p)
        if reduction is None or recorder is None:
            table = self._run(p, derivatives=True)
        else:
            table = self._run(p, derivatives=True, last=reduction.last, tell=recorder.add)
            reduction.add(recorder.snapshot)
        return table[:, 0], table[:, 1:]

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
        marches = self._marches
        marches.count_evaluation()
        run = marches.at(p, RunOptions(last=self._last, traced=True))
        observed = [(end, self.adjoints.observed(end, run)) for end in run.states()]
        seen = np.stack([of_end for _, of_end in observed])
        change = marches.observation.increments(seen[:, :, 0], marches.sequence.bases)
        self._increments = p.tobytes(), change
        table = self.adjoints.table(run, observed[-1][0], seen)
        values = run.given.values
        marches.last_adjoints = AdjointTable(values, self._row, self._state, table.copy())
        self._activity = p.tobytes(), run.findings.plastic.planes.activity()
        table += marches.instrument_errors.added(marches.values(p), self.names, self._places)
        return table[:, 0], table[:, 1:]

    @cached_property
    def adjoints(self) -> ReadingAdjoints:
        """The way back from these readings."""
        marches = self._marches
        return ReadingAdjoints(
            marches.march, marches.observation, self._row, self._state, self._last
        )

    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return self._marches.yields

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
        marches = self._marches
        not_linear = marches.observation.not_linear(self._row)
        return not_linear or export_obstacle(marches.march, self._start_point)

    def system(self) -> BilinearSystem:
        """The equations of all stages as one system of vectors."""
        return bilinear(self.staged_system(), self._start)

    def staged_system(self) -> StagedSystem:
        """The equations stage by stage, as arrays."""
        marches, start = self._marches, self._start_point
        added = marches.instrument_errors.added(start.values, self.names, self._places)
        operator = marches.observation.operator(self._row)
        rows = ReadingRows(operator, self._active(), added)
        return export(marches.march, start, rows, self._last)

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """The closed form of these readings, or why there is none."""
        marches = self._marches
        found = opening_in_mesh(marches.on_mesh, Circle(centre, radius))
        return found if isinstance(found, str) else found.response(self._pairs, self._given_times)

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, or None if they are."""
        marches = self._marches
        return marches.observation.not_linear(self._row) or condensation_obstacle(marches.march)

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
        last: int = 0,
        tell: Tell | None = None,
    ) -> Floats:
        """Readings (g, 1 + n + k).

        Args:
            p: (n,) parameters, SI.
            unit_forces: forces along the readings.
            derivatives: carry the derivatives by all parameters.
            last: index of a later state to which it is to go.
            tell: is given every state with its run, while it is there.
        """
        marches = self._marches
        plain, goes_on = unit_forces is None, max(last, self._last)
        if plain and (marches.keeps_march if derivatives else marches.is_paid(p)):
            kept = marches.march_to(p, goes_on, tell).observed[: self._last + 1]
            observed = np.stack(kept)[..., : None if derivatives else 1]
            self._activity = p.tobytes(), None
        else:
            observed = self._march(p, unit_forces, derivatives=derivatives, tell=tell)
        change = marches.observation.increments(observed[:, :, 0], marches.sequence.bases)
        self._increments = p.tobytes(), change
        table = marches.observation.readings(observed, self._row, self._state)
        names = self.names if derivatives else ()
        added = marches.instrument_errors.added(marches.values(p), names, self._places)
        table[:, : added.shape[1]] += added
        return np.asarray(table)

    def _march(
        self,
        p: Floats,
        unit_forces: UnitForces | None,
        *,
        derivatives: bool,
        tell: Tell | None,
    ) -> Floats:
        """What channels see, (m, n_channels, 1 + n + k), of a march that is not kept."""
        marches = self._marches
        marches.count_evaluation()
        # Where the loads collapse at the start, the user wants to know how much of them is carried;
        # who searches elsewhere, only that they are not.
        explain = bool(np.array_equal(p, self._start))
        run = marches.at(
            p, RunOptions(derivatives, self._last, unit_forces=unit_forces, explain=explain)
        )
        seen = []
        for end in run.states():
            seen.append(marches.observation.values(MarchState(end, run.point, marches.structures)))
            if tell is not None:
                tell(end, run)
        self._activity = p.tobytes(), run.findings.plastic.planes.activity()
        return np.stack(seen)

    def _unit_forces(self) -> UnitForces:
        """Unit forces along every reading: G^T.

        A reading adds up the increments of all stages that led to its own, less those that led to
        its zero. Where its stage builds on its zero, its unit force is a dead load that acts from
        the stage after the zero on.
        """
        rows = self._marches.observation.operator(self._row)
        return UnitForces(rows.toarray().T, self._active())

    def _active(self) -> Floats:
        """(n_states, g) weight of the step of a state in a reading: 1, 0 or -1."""
        built_on = self._marches.sequence.built_on
        return self._marches.observation.steps(built_on, self._row, self._state)
