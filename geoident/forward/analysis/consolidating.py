"""Stages of ground that consolidates, one after the other, in one analysis (theory 17).

A stage that lasts goes on through its moments: the first does what the stage does, later ones go on
in time. One without duration is the end of all flow: pressures are those at rest, or of the steady
flow between given heads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.forward.analysis.march import InTime, March, StepEquations
from geoident.forward.analysis.stage import FactorCache, StageTask, elastic_step
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.consolidation.pores import Pores
from geoident.forward.consolidation.steps import OF_EACH_LENGTH, time_steps
from geoident.model.arrays import Floats


@dataclass
class _Going:
    """A stage under way, and what of it was reached at its last moment."""

    march: March
    reached: InTime


class ConsolidationSteps:
    """The stages of one analysis in which ground consolidates.

    Args:
        systems: the equations of the stages.
        pores: of the case.
        finer: how many times as many steps in time are made as usual.
    """

    def __init__(self, systems: StageSystems, pores: Pores, finer: int = 1) -> None:
        self._systems, self._pores, self._finer = systems, pores, finer
        self._sequence = systems.on_mesh.sequence
        self._going: dict[int, _Going] = {}

    def forget_factors(self) -> None:
        """Forget factorizations; they are made again where they are needed."""
        for going in self._going.values():
            going.march.forget()

    def step(self, task: StageTask, factors: FactorCache) -> Floats | None:
        """Bring a state in which water flows to its moment.

        The pressures of the state join what acts on the nodes (`StageTask.forces`).

        Args:
            task: the state; what it carries is brought to its moment.
            factors: of stages without time.

        Returns:
            (n_dofs, 1 + n) displacement steps beside those that supports impose; None where all
            flow has come to its end: only forces and pressures are those of the state then.

        Raises:
            ModelError: the stiffness is not positive definite.
        """
        pores = task.carried.pores
        assert pores is not None  # of a case that consolidates
        if not self._pores.consolidates(task.state):
            pores[:] = 0.0
            return None
        going = self._goes_on(task)
        reached = going.march.to(self._moment(task.number))
        du = reached.u - going.reached.u
        self._going[task.number] = _Going(going.march, reached)
        pores[:] = reached.p
        elastic_step(task, self._systems, factors, du)
        operators = self._pores.operators(task.number, task.point)
        task.forces[:] += operators.coupling.at(pores)
        return du

    def _goes_on(self, task: StageTask) -> _Going:
        """The stage of a state, begun now or at an earlier moment."""
        state, number = task.state, task.number
        if state.goes_on:
            return self._going.pop(state.base)
        system, lasts = self._pores[number], state.lasts
        before = np.zeros_like(task.carried.pores)
        before[system.nodes] = task.carried.pores[system.nodes]
        operators = self._pores.operators(number, task.point)
        equations = StepEquations(task, self._systems, system, operators, before)
        steps = []
        if lasts:
            steps = time_steps(lasts, self._first(number), self._finer * OF_EACH_LENGTH)
        march = March(equations, steps, before, self._pores.given(number, task.point))
        return _Going(march, InTime(np.zeros_like(task.forces), before))

    def _moment(self, number: int) -> float:
        """When a state is, s since the beginning of its stage."""
        state = self._sequence.states[number]
        return float(state.lasts or 0.0) if state.at is None else state.at

    def _first(self, number: int) -> float:
        """The first moment of a stage after its beginning, s."""
        states, moments, at = self._sequence.states, [self._moment(number)], number
        for later in range(number + 1, len(states)):
            if states[later].goes_on and states[later].base == at:
                moments.append(self._moment(later))
                at = later
        return min(moment for moment in moments if moment > 0.0)
