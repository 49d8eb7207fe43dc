"""The analysis through the stages and its exact derivatives (theory 2).

At every stage, with sigma the stress at the end of the stage before (zero in what is placed now),

    r_j = f_j - C^T V sigma                     over the points that are present
    K_j du_j = r_j
    sigma <- sigma + E C du_j ,   u <- u + du_j

and, for every parameter h, with the same factorization,

    g_h = dsigma/dp_h + dE/dp_h C du_j
    K_j ddu_j/dp_h = df_j/dp_h - C^T V g_h
    dsigma/dp_h <- g_h + E C ddu_j/dp_h

where supports impose a motion w_j, C w_j takes part in the strain of the step and w_j in u
(linings and bolts add their internal forces and stiffness in the same way, see `structures`),
so one factorization per stage and two calls of the solver give the response and its whole
Jacobian. All columns travel together: column 0 of every array is the state, columns 1..n are
the derivatives. A change of temperature takes its strain eps_0 from C du_j (see `thermal`).

Stages form a tree: u and sigma "of the stage before" are those of the stage on which a stage
builds. Load cases that do not build on each other branch off the same one. Stages in a row on the
same ground of the same materials (load cases, mostly) share one factorization.

`UnitForces` add forces: to the state (condensation's corrected displacements), or as further
columns that carry the response to unit forces (its flexibility). They cost no further
factorization.

A *run* is one analysis at one parameter vector: it owns all that it computes and returns what it
found, so any number of runs of one model may be under way.

Computed once per mesh: C, V, the gradient products. Once per set of present groups: pattern,
analysis, which points are there. Per parameter vector and change of ground: values of K,
factorization.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from geoident.errors import CollapseError
from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.forward.actions.forces import Actions
from geoident.forward.actions.motions import GivenMotions
from geoident.forward.actions.release import PartialRelease, ReleasedParts, UnreleasedForces
from geoident.forward.actions.thermal import ThermalStrains
from geoident.forward.analysis.hardening_step import HardeningSteps
from geoident.forward.analysis.heating import Heating
from geoident.forward.analysis.joint_tractions import JointTractions
from geoident.forward.analysis.plastic_step import PlasticFindings, PlasticSteps, WarmStart
from geoident.forward.analysis.stage import (
    ElasticTrace,
    FactorCache,
    LastEquilibrium,
    StageEnd,
    StageTask,
    StressState,
    UnitForces,
    elastic_step,
)
from geoident.forward.analysis.stages_in_time import (
    StagesInTime,
    moment_of,
    moments_of,
    of_each_length,
    steps_of,
)
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.consolidation.pores import Pores
from geoident.forward.creep.steps import CreepSteps
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.heat.conduction import Conduction
from geoident.forward.in_situ.stress import NEGLIGIBLE_IMBALANCE, InSituStress, StressPlaces
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.joint_water import JointWater
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Values

KEPT_ENTRIES = 8_000_000
"""Entries of the stiffness matrices whose factors are kept at once for adjoints.

Their factors have ten (in the plane) to fifty times as many: 1 to 3 GB.
"""


KnownDisplacements = Callable[[int], Floats | None]
"""Displacements (n_dofs, 1 + n) of a state with their derivatives; None where not known."""


_BEYOND_STRENGTH = (
    "The stage is a row of a test. It asks more than the ground carries at these values: leave out "
    "this row and those after it, or begin the fit with a higher strength."
)


@dataclass(frozen=True)
class RunOptions:
    """How an analysis is made.

    Args:
        derivatives: carry the derivatives by all parameters.
        last: index of the last state wanted; None for all.
        unit_forces: forces beside those of the case.
        explain: find the part of the load that can be carried, where there is a collapse.
        partial: go on after a collapse with the states that do not build on it.
        strict: only diffuse flow, not localised in bands of shear, counts (`PlasticSteps`).
        traced: keep what adjoints need of every stage; without derivatives, and only where nothing
            yields.
        displacements: of elastic states, where they are known; these are not solved for.
        finer: how many times as many steps in time stages that last are divided into.
    """

    derivatives: bool = True
    last: int | None = None
    unit_forces: UnitForces | None = None
    explain: bool = True
    partial: bool = False
    traced: bool = False
    strict: bool = False
    displacements: KnownDisplacements | None = None
    finer: int = 1


@dataclass(frozen=True)
class RunFindings:
    """What an analysis found beside its states.

    Args:
        imbalance: of the in-situ stress as given: largest force that is out of balance, relative to
            the forces at work.
        collapses: stages at which the ground cannot carry the loads.
        plastic: where materials yield; None in a case where none can.
    """

    imbalance: float
    collapses: tuple[CollapseError, ...]
    plastic: PlasticFindings | None


class StagedAnalysis:
    """Analyses a case on its mesh through the stages, for any parameter values.

    Args:
        on_mesh: the case on its mesh.
        systems: the equations of the stages.
        parts: how much of the stress is released.
        warm: where Newton's method may start; None to begin with nothing.
    """

    def __init__(
        self,
        on_mesh: CaseOnMesh,
        systems: StageSystems,
        parts: ReleasedParts,
        warm: WarmStart | None = None,
    ) -> None:
        self.on_mesh, self.systems = on_mesh, systems
        self.case, self.sequence = on_mesh.case, on_mesh.sequence
        self.in_joints = in_joints = JointWater(on_mesh, systems.structures)
        self.actions = Actions(
            on_mesh, lambda state: chain(systems.structures.loads(state), in_joints.parts(state))
        )
        self.thermal = ThermalStrains(on_mesh)
        self.motions = GivenMotions(on_mesh)
        points = on_mesh.discretization.points
        groups = self.sequence.group_of[points.element]
        self.in_situ = InSituStress(on_mesh, StressPlaces(points.position, groups))
        self.joints = JointTractions(on_mesh, systems.structures)
        self.release = PartialRelease(on_mesh, self.actions, parts)
        self.pores = Pores(on_mesh, systems.definite, systems.structures.joints)
        self.conduction = Conduction(on_mesh)
        self.warm = warm or WarmStart()

    def forget(self) -> None:
        """Forget where Newton's method may start."""
        self.warm.forget()

    @property
    def n_outside(self) -> int:
        """Strain points beside the surface from which the in-situ stress counts depth."""
        return self.in_situ.n_outside

    def without_modes(self, point: ParameterPoint) -> ParameterPoint:
        """The same, differentiated by what is not the mode of a field."""
        modes = {name for one in self.on_mesh.fields for name in one.names}
        return ParameterPoint(point.values, tuple(n for n in point.names if n not in modes))

    def virgin_tension(self, values: Values) -> bool:
        """Whether most of the virgin ground is pulled on average, sigma_xx + yy + zz > 0."""
        stress, _ = self.virgin(ParameterPoint(values, ()))
        normal = stress[:NORMAL_COMPONENTS, self.systems[0].present, 0]
        pulled = normal.sum(axis=0) > 0.0
        return bool(2 * np.count_nonzero(pulled) > pulled.size)

    def virgin(self, point: ParameterPoint) -> tuple[Floats, Floats]:
        """The in-situ stress (n_strain, n_points, 1 + n) as given, and how far out of balance.

        The second is that of the stress and of each of its derivatives (1 + n,), see `imbalance`.
        """
        system, stress = self.systems[0], self.in_situ.columns(point)
        stress[:, ~system.present] = 0.0
        return stress, self.imbalance(
            stress, self.actions.forces(0, point), self.joints.columns(point)
        )

    def imbalance(self, stress: Floats, forces: Floats, members: Floats) -> Floats:
        """Largest out-of-balance force (k,) of a free unknown relative to the forces at work.

        Args:
            stress: (n_strain, n_points, k) of the virgin state.
            forces: (n_dofs, k) that act on it.
            members: (n_rows, k) tractions on interfaces.
        """
        system = self.systems[0]
        internal = self.systems.discretization.points.forces(stress, system.volume)
        if len(members):
            internal = internal + self.systems.structures.nodal_forces(members)
        rest = np.abs(forces - internal)[system.dofs].max(axis=0, initial=0.0)
        scale = np.maximum(np.abs(internal).max(axis=0), np.abs(forces).max(axis=0))
        return np.asarray(rest / np.where(scale > 0, scale, 1.0))


class AnalysisRun:
    """One analysis at one parameter vector: its states one by one, then what it found.

    Args:
        analysis: what does not depend on parameters.
        point: the parameters, all of the case.
        options: how the run is made.
        tell: is told the index of every state that was computed.

    Attributes:
        full_point: the parameters, with derivatives by all of them.
        point: the same, with derivatives by those that travel with the run: all or none.
        traces: what adjoints need of the states so far.
        factors: factorizations that are kept.
    """

    def __init__(
        self,
        analysis: StagedAnalysis,
        point: ParameterPoint,
        options: RunOptions,
        tell: Callable[[int], None] = lambda state: None,
    ) -> None:
        systems, derivatives = analysis.systems, options.derivatives and not options.traced
        self._analysis, self._systems, self._options = analysis, systems, options
        self._structures, self._tell = systems.structures, tell
        self.full_point = point
        self.point = point if derivatives else ParameterPoint(point.values, ())
        self._point_without_modes = analysis.without_modes(point) if options.traced else self.point
        self.traces: list[ElasticTrace] = []
        self.factors = FactorCache(KEPT_ENTRIES if options.traced else 0)
        n_strain = systems.discretization.points.n_strain
        self._ground = ModuliAt(analysis.on_mesh, point, n_strain)
        self._plastic: PlasticSteps | None = None
        if analysis.case.yields:
            self._plastic = PlasticSteps(
                analysis.case, systems, analysis.warm, self._ground,
                explain=options.explain, strict=options.strict,
            )  # fmt: skip
        self._hardening: HardeningSteps | None = None
        if analysis.case.hardens:
            self._hardening = HardeningSteps(analysis.case, systems, self.point, self._plastic)
        self._creep: CreepSteps | None = None
        if analysis.case.creeps:
            self._creep = CreepSteps(analysis.on_mesh, self.point, self._ground)
        self._in_time: StagesInTime | None = None
        if analysis.case.consolidates or analysis.case.creeps:
            self._in_time = StagesInTime(
                systems, analysis.pores, self._creep, self._plastic, self._hardening, options.finer
            )
        self._heating: Heating | None = None
        if analysis.case.conducts:
            definite = systems.definite_growing
            self._heating = Heating(analysis.conduction, analysis.on_mesh, self.point, definite)
        self._unreleased: dict[int, UnreleasedForces] = {0: {}}
        self._virgin_stress: Floats | None = None  # where a stage goes back to it
        self._imbalance = 0.0
        self._collapses: list[CollapseError] = []

    @property
    def findings(self) -> RunFindings:
        """What was found so far; all of it once the states are through."""
        plastic = None if self._plastic is None else self._plastic.findings
        return RunFindings(self._imbalance, tuple(self._collapses), plastic)

    def states(self) -> Iterator[StageEnd]:
        """The end of every stage, the virgin state first.

        Raises:
            ModelError: the stiffness of a stage is not positive definite, the virgin stress is
                outside a yield surface, or the ground collapses (`CollapseError`), unless the
                options say to go on: then that state and all that build on it are NaN.
        """
        last = self._options.last
        states = self._analysis.sequence.states[: None if last is None else last + 1]
        last_use = {state.base: n for n, state in enumerate(states) if n and state.base != n - 1}
        kept: dict[int, tuple[Floats, StressState]] = {}  # what later states build on
        u, carried = self._at_rest()
        lost: set[int] = set()
        for n, state in enumerate(states):
            yielded, last_found = None, None
            if not n or state.base not in lost:
                if n and state.base != n - 1:
                    u, carried = kept.pop(state.base)
                    if last_use[state.base] > n:
                        kept[state.base] = u.copy(), carried.copy()
                forces = np.zeros_like(u)
                try:
                    if n == 0:
                        self._begin(carried, forces)
                        yielded = np.zeros(carried.stress.shape[1], dtype=bool)
                    else:
                        yielded = self._advance(n, u, carried, forces)
                except CollapseError as error:
                    if self._analysis.case.of_tests:
                        error.add(_BEYOND_STRENGTH)
                    if not self._options.partial:
                        raise
                    self._collapses.append(error)
                    last_found = _last_of(error, u[:, 0])
            self._tell(n)
            if yielded is None:
                lost.add(n)
                still = np.zeros(carried.stress.shape[1], dtype=bool)
                yield StageEnd(
                    n, u * np.nan, carried.stress * np.nan, carried.members * np.nan, still,
                    last=last_found,
                )  # fmt: skip
            else:
                yield StageEnd(
                    n, u, carried.stress, carried.members, yielded, forces,
                    pores=carried.pores, temperatures=carried.temperatures,
                    hardened=carried.hardened, relieved=carried.relieved,
                )  # fmt: skip
                if last_use.get(n, -1) > n + 1:
                    kept[n] = u.copy(), carried.copy()
        if not self._options.traced:
            self.forget_factors()

    def forget_factors(self) -> None:
        """Forget the factorizations that are kept."""
        self.factors.forget()
        if self._in_time is not None:
            self._in_time.forget_factors()
        if self._heating is not None:
            self._heating.forget_factors()

    def _at_rest(self) -> tuple[Floats, StressState]:
        """Displacements (n_dofs, 1 + n + k) and what is carried, all zero."""
        points, unit = self._systems.discretization.points, self._options.unit_forces
        columns = self.point.n_columns + (unit.n_columns if unit else 0)
        u = np.zeros((self._systems.discretization.n_dofs, columns))
        stress = np.zeros((points.n_strain, points.n_points, columns))
        rows = self._structures.n_rows, columns
        carried = StressState(stress, np.zeros(rows), np.zeros(rows))
        if self._analysis.case.consolidates:
            carried.pores = np.zeros((self._analysis.on_mesh.mesh.n_nodes, columns))
        if self._heating is not None:
            carried.temperatures = self._heating.initial()
        return u, carried

    def _add_actions(self, number: int, forces: Floats) -> Floats:
        """Add what acts in a state to forces (n_dofs, 1 + n + k).

        Returns:
            (n_dofs, n) its derivatives by the parameters that are no modes, for adjoints.
        """
        unit = self._options.unit_forces
        acting = self._analysis.actions.forces(number, self._point_without_modes)
        forces[:, : self.point.n_columns] += acting[:, : self.point.n_columns]
        if unit is not None:
            unit.add_to(forces, number)
        return acting[:, 1:]

    def _begin(self, carried: StressState, forces: Floats) -> None:
        """Set the in-situ stress; bring it to equilibrium if it is not, and forget the motion.

        What is out of balance is small; it is taken as elastic. Where the stress then is must be
        inside the yield surfaces.
        """
        system, stress, n = self._systems[0], carried.stress, self.point.n_columns
        slopes = self._add_actions(0, forces)
        in_situ = self._analysis.in_situ.columns(self._point_without_modes)
        in_situ[:, ~system.present] = 0.0
        stress[..., :n] = in_situ[..., :n]
        tractions = self._analysis.joints.columns(self._point_without_modes)
        carried.members[:, :n] = tractions[:, :n]
        imbalance = self._analysis.imbalance(stress, forces, carried.members)
        self._imbalance = float(imbalance[0])
        if self._options.traced:
            imbalance = self._analysis.imbalance(in_situ, np.hstack([forces, slopes]), tractions)
        task = self._task(0, carried, forces)
        stepped = bool(imbalance.max() > NEGLIGIBLE_IMBALANCE)  # it may come as K0 changes
        du = np.zeros(len(forces))
        if stepped:
            du = elastic_step(task, self._systems, self.factors)[:, 0]
        if self._options.traced:
            self.traces.append(ElasticTrace(task, du, slopes, {}, in_situ[..., 1:], stepped))
        if self._creep is not None:
            carried.creep = self._creep.at_rest(stress)
        if any(state.relaxed for state in self._analysis.sequence.states):
            self._virgin_stress = carried.stress.copy()
        if self._plastic is not None:
            self._plastic.refuse_virgin(task)
        if self._hardening is not None:
            self._hardening.begin(task)

    def _advance(self, number: int, u: Floats, carried: StressState, forces: Floats) -> Bools:
        """Bring a state to equilibrium; updates u (n_dofs, 1 + n + k), what is carried, and forces.

        Returns:
            (n_points,) the strain points that yield.
        """
        analysis, systems, point = self._analysis, self._systems, self.point
        system, state = systems[number], analysis.sequence.states[number]
        slopes = self._add_actions(number, forces)
        before = self._unreleased[state.base]
        unreleased = dict(analysis.release.unreleased(number, before, carried.stress, point))
        if carried.pores is not None:
            for group in state.release.keys() & state.leaving:
                pushed = analysis.pores.push(state.base, group, carried.pores, point)
                unreleased[group] = unreleased[group] + pushed
        for group in (state.release.keys() & state.leaving) if self._structures.joints else ():
            unreleased[group] = unreleased[group] + self._through_joints(number, group, carried)
        self._unreleased[number] = unreleased
        forces += analysis.release.forces(number, unreleased, point)
        # what is gone or placed anew carries nothing; nodes that are gone forget their motion
        carried.clear(~system.present)
        for group in state.placed:
            carried.clear(systems.discretization.points_of[group])
        if state.relaxed:
            assert self._virgin_stress is not None
            placed = analysis.sequence.placed_since(number)
            for group in state.relaxed:
                at = systems.discretization.points_of[group]
                carried.stress[:, at] = 0.0 if group in placed else self._virgin_stress[:, at]
        self._structures.begin(state, carried.members, point)
        carried.relieved[self._structures.begins_anew(state)] = 0.0
        u[~system.touched] = 0.0
        task = self._with_heat(self._task(number, carried, forces))
        yielded = np.zeros(carried.stress.shape[1], dtype=bool)
        flowed = None
        hardening = self._hardening if self._hardening and self._hardening.acts(state) else None
        if hardening is None and (self._in_time is None or not self._in_time.imposes(state)):
            task.impose(systems)
        if self._in_time is not None:
            flowed = self._in_time.step(task, self.factors)
        if flowed is not None:
            du, yielded = flowed
        elif hardening is not None:
            motions, yielded = hardening.step(task)
            du = motions[: len(u)]
        elif self._plastic is not None and self._plastic.yields(state):
            motions, yielded = self._plastic.step(task)
            du = motions[: len(u)]
        else:
            known_displacements = self._options.displacements
            u_known = None if known_displacements is None else known_displacements(number)
            du_known = None if u_known is None else u_known[:, : u.shape[1]] - u
            du = elastic_step(task, systems, self.factors, du_known)
        if task.heating is not None:
            carried.temperatures = task.heating.temperatures(moment_of(state))
        if task.motion is not None:
            du[:, : point.n_columns] += task.motion
        if self._options.traced:
            values = {group: support[:, 0].copy() for group, support in unreleased.items()}
            self.traces.append(ElasticTrace(task, du[:, 0], slopes, values))
        u += du
        return yielded

    def _through_joints(self, number: int, group: int, carried: StressState) -> Floats:
        """How a group that leaves supported the ground through interfaces, (n_dofs, 1 + n + k).

        An interface between two such groups counts for one of them.
        """
        states = self._analysis.sequence.states
        state = states[number]
        base = states[state.base]
        ends = [
            part
            for part in self._structures.joints
            if part.joint is not None
            and part.joint.stands(base)
            and not part.joint.stands(state)
            and group == min(state.leaving.intersection(part.joint.groups), default=None)
        ]
        support = self._analysis.in_joints.support(base, ends, carried.members, self.point)
        if carried.pores is not None:
            support += self._analysis.pores.push_through(state.base, ends, carried.pores)
        return support

    def _with_heat(self, task: StageTask) -> StageTask:
        """A state with the temperatures of its stage.

        What they strain comes at once, unless the stage takes steps in time, which ask for it.
        """
        before, state, number = task.carried.temperatures, task.state, task.number
        if self._heating is None or before is None:
            return task
        states, case = self._analysis.sequence.states, self._analysis.case
        of_each = self._options.finer * of_each_length(case, water=True)
        heating = self._heating.stage(
            number,
            before,
            lambda bends: steps_of(states, number, of_each, bends),
            moments_of(states, number),
        )
        task = replace(task, heating=heating)
        if self._in_time is not None and self._in_time.marches(state):
            return task
        return task.with_thermal(heating.until_moment(moment_of(state)))

    def _task(self, number: int, carried: StressState, forces: Floats) -> StageTask:
        """A state to be brought to equilibrium, with what is imposed after the virgin state."""
        analysis, state, point = self._analysis, self._analysis.sequence.states[number], self.point
        return StageTask(
            number,
            self._systems[number],
            state,
            point,
            self._ground,
            carried,
            forces,
            rigidities=self._structures.moduli(state, point),
            thermal=analysis.thermal.change(number, point) if number else None,
            motion=analysis.motions.change(number, point) if number else None,
        )


def _last_of(error: CollapseError, before: Floats) -> LastEquilibrium | None:
    """What was found on the way to a load that is not carried, after displacements (n_dofs,)."""
    reached = error.reached
    return replace(reached, u=before + reached.u) if isinstance(reached, LastEquilibrium) else None
