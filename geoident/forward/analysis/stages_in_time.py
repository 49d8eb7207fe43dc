"""Stages in which water flows or ground creeps, one after the other, in one analysis (theory 18).

A stage that lasts goes on through its moments: the first does what the stage does, later ones go on
in time. One without duration is the end of all flow: pressures are those at rest, or of the steady
flow between given heads; and of all creep, one step of infinite length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.analysis.elastic_parts import InTime
from geoident.forward.analysis.hardening_step import HardeningSteps
from geoident.forward.analysis.march import March, StepEquations
from geoident.forward.analysis.plastic_step import PlasticSteps
from geoident.forward.analysis.stage import FactorCache, StageTask, elastic_step
from geoident.forward.analysis.step_parts import begin_materials, begin_part
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.consolidation.pores import Pores
from geoident.forward.creep.steps import CreepSteps
from geoident.forward.stages import ConstructionState
from geoident.forward.time_steps import (
    OF_EACH_LENGTH,
    OF_EACH_WITHOUT_WATER,
    TimeStep,
    divided,
    settled,
    stage_steps,
)
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case


@dataclass(frozen=True)
class _Going:
    """A stage under way.

    Args:
        march: in time.
        reached: what was reached at its last moment.
        rest: (n_dofs, 1 + n) what is out of balance at its beginning, N.
        motion: (n_dofs, 1 + n) what supports impose in it, m; None for none.
    """

    march: March
    reached: InTime
    rest: Floats
    motion: Floats | None


class StagesInTime:
    """The stages of one analysis in which water flows or ground creeps.

    Args:
        systems: the equations of the stages.
        pores: of the case.
        creep: makes the steps of ground that creeps; None where none does.
        plastic: solves what yields; None in a case where nothing does.
        hardening: solves stages with hardening soil; None where there is none.
        finer: how many times as many steps in time are made as usual.
    """

    def __init__(
        self,
        systems: StageSystems,
        pores: Pores,
        creep: CreepSteps | None,
        plastic: PlasticSteps | None,
        hardening: HardeningSteps | None,
        finer: int = 1,
    ) -> None:
        self._systems, self._pores, self._creep, self._finer = systems, pores, creep, finer
        self._plastic, self._hardening = plastic, hardening
        self._sequence = systems.on_mesh.sequence
        self._going: dict[int, _Going] = {}

    def forget_factors(self) -> None:
        """Forget factorizations; they are made again where they are needed."""
        for going in self._going.values():
            going.march.forget()

    def imposes(self, state: ConstructionState) -> bool:
        """Whether parts of steps impose what supports and temperatures do in a state."""
        return self._creep is not None or self._yields(state) is not None

    def _yields(self, state: ConstructionState) -> PlasticSteps | HardeningSteps | None:
        """What solves the steps of a state; None where nothing yields while water flows."""
        plastic, hardening = self._plastic, self._hardening
        if not self._pores.consolidates(state):
            return None
        if hardening is not None and hardening.acts(state):
            return hardening
        return plastic if plastic is not None and plastic.yields(state) else None

    def marches(self, state: ConstructionState) -> bool:
        """Whether a state is reached in steps in time."""
        creeps = self._creep is not None and state.lasts is not None
        return creeps or self._pores.consolidates(state)

    def step(self, task: StageTask, factors: FactorCache) -> tuple[Floats, Bools] | None:
        """Bring a state in which water flows to its moment.

        The pressures of the state join what acts on the nodes (`StageTask.forces`).

        Args:
            task: the state; what it carries is brought to its moment.
            factors: of stages without time.

        Returns:
            (n_dofs, 1 + n) displacement steps beside those that supports impose, and (n_points,)
            which strain points yield; None where all flow has come to its end: only forces and
            pressures are those of the state then.

        Raises:
            ModelError: the stiffness is not positive definite.
            CollapseError: ground that yields cannot carry the loads.
        """
        carried = task.carried
        pores = carried.pores  # None in a case that does not consolidate
        given = self._pores.given(task.number, task.point)
        if self._creep is not None and not task.state.goes_on:
            before = self._sequence.states[task.state.base].materials
            begin_materials(task, self._systems, before)
        if not self.marches(task.state):
            if pores is not None:
                pores[:] = self._pores.steady(task.number, given, task.point)
            if pores is not None and given.any():
                task.forces[:] += self._pores.operators(task.number, task.point).coupling.at(pores)
            if self._creep is None:
                return None
            still = np.zeros(carried.stress.shape[1], dtype=bool)
            return self._to_the_end(task, self._creep, factors), still
        going = self._goes_on(task, given, factors)
        moment = moment_of(task.state)
        reached, yielded = going.march.to(task, moment)
        reached = self._still_to_come(going, reached, moment, task)
        du = reached.u - going.reached.u
        self._going[task.number] = replace(going, reached=reached)
        if pores is not None:
            pores[:] = reached.p
        if reached.carried is None:
            if task.heating is not None:
                warmed = task.heating.until_moment(moment)
                task.add_thermal_stress(warmed, carried.stress, -1.0)
                task = task.with_thermal(warmed)
            elastic_step(task, self._systems, factors, du)
        else:
            carried.take(reached.carried)
        operators = self._pores.operators(task.number, task.point)
        task.forces[:] += operators.coupling.at(reached.p)
        return du, yielded

    def _to_the_end(self, task: StageTask, creep: CreepSteps, factors: FactorCache) -> Floats:
        """Displacement steps (n_dofs, 1 + n) of what a stage does, and of all creep."""
        part = begin_part(task, self._systems, creep, task.carried, np.inf)
        du = elastic_step(part.task, self._systems, factors)
        task.carried.take(part.crept())
        return du

    def _still_to_come(
        self, going: _Going, reached: InTime, moment: float, task: StageTask
    ) -> InTime:
        """What is reached, less what supports impose later; forces act less what comes later.

        The analysis takes motions of supports as all imposed at once.
        """
        later = 1.0 - going.march.came(moment)
        if not later:
            return reached
        task.forces[:] -= later * going.rest
        if going.motion is None:
            return reached
        return replace(reached, u=reached.u - later * going.motion)

    def _goes_on(self, task: StageTask, given: Floats, factors: FactorCache) -> _Going:
        """The stage of a state, begun now or at an earlier moment."""
        state, number = task.state, task.number
        if state.goes_on:
            return self._going.pop(state.base)
        system = self._pores[number]
        before = self._before(task)
        operators = self._pores.operators(number, task.point)
        of_each = self._finer * of_each_length(
            self._systems.on_mesh.case, water=len(system.nodes) > 0
        )
        bends = () if task.heating is None else task.heating.bends
        steps = steps_of(self._sequence.states, number, of_each, bends)
        nonlinear = self._yields(state)
        if steps and isinstance(nonlinear, HardeningSteps):
            steps = settled(steps)
        equations = StepEquations(
            task,
            self._systems,
            system,
            operators,
            before,
            factors,
            creep=self._creep,
            nonlinear=nonlinear,
        )
        march = March(equations, steps, before, given, state.over)
        nothing = InTime(np.zeros_like(task.forces), before, equations.carried)
        return _Going(march, nothing, equations.rest, task.motion)

    def _before(self, task: StageTask) -> Floats:
        """Pressures (n_nodes, 1 + n) with which a stage begins, Pa.

        Where the water at rest changes, all pressure is what it was: that in excess jumps.
        """
        state, number, carried = task.state, task.number, task.carried.pores
        if carried is None:
            shape = self._systems.on_mesh.mesh.n_nodes, task.forces.shape[1]
            return np.zeros(shape)
        before, nodes = np.zeros_like(carried), self._pores[number].nodes
        before[nodes] = carried[nodes]
        if state.water != self._sequence.states[state.base].water:
            stay = np.intersect1d(nodes, self._pores[state.base].nodes)
            before[stay] += self._pores.at_rest(state.base, stay, task.point)
            before[stay] -= self._pores.at_rest(number, stay, task.point)
        return before


def moment_of(state: ConstructionState) -> float:
    """When a state is, s since the beginning of its stage."""
    return float(state.lasts or 0.0) if state.at is None else state.at


def of_each_length(case: Case, *, water: bool) -> int:
    """How many steps of each length a stage of a case has.

    Args:
        case: the case.
        water: whether water or heat flows in the stage; else ground creeps alone.
    """
    if case.time_steps is not None:
        return case.time_steps
    return OF_EACH_LENGTH if water else OF_EACH_WITHOUT_WATER


def order_of_steps(case: Case) -> int:
    """With so many times as many steps in time their error falls by that power of it.

    Stress that returns to a yield surface, or follows one, does so to the first order.
    """
    return 1 if case.consolidates and (case.yields or case.hardens) else 2


def moments_of(states: Sequence[ConstructionState], number: int) -> list[float]:
    """The moments of the stage that begins with a state, s since its beginning, ascending.

    Args:
        states: of the case.
        number: of the state.
    """
    moments, at = [moment_of(states[number])], number
    for later in range(number + 1, len(states)):
        if states[later].goes_on and states[later].base == at:
            moments.append(moment_of(states[later]))
            at = later
    return moments


def steps_of(
    states: Sequence[ConstructionState], number: int, of_each: int, bends: Sequence[float] = ()
) -> list[TimeStep]:
    """The steps in time of the stage that begins with a state; none where no time passes.

    Args:
        states: of the case.
        number: of the state.
        of_each: steps of each length.
        bends: times, s, at which something given in it changes its slope, ascending.
    """
    state = states[number]
    if not state.lasts:
        return []
    first = min(moment for moment in moments_of(states, number) if moment > 0.0)
    return divided(stage_steps(state.lasts, first, state.over, of_each), bends)
