"""One part of a step in time of ground that creeps, ages or yields (theory 18.4, 18.6).

Its stress is carried from part to part. Ground that creeps has moduli of its own in every part of a
step, and a past that creeps on in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.analysis.stage import FactorCache, StageTask, StressState, elastic_step
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.creep.steps import CreepInStep, CreepSteps, CreepStrains
from geoident.model.arrays import Floats


@dataclass(frozen=True, eq=False)
class StepPart:
    """A part of a step, begun.

    Args:
        task: the stage with the moduli of the part, what supports and temperatures impose in it,
            and what is carried: less what the past takes away, with what is imposed.
        past: (n_dofs, c) forces of what was taken away and imposed, N.
        creep: what creeps in it; None where nothing does.
    """

    task: StageTask
    past: Floats
    creep: CreepInStep | None

    def end(self, systems: StageSystems, factors: FactorCache, du: Floats) -> StressState:
        """What is carried at its end, from displacement steps (n_dofs, c)."""
        elastic_step(self.task, systems, factors, du)
        return self.crept()

    def crept(self) -> StressState:
        """What is carried at its end, once its stress is."""
        carried = self.task.carried
        if self.creep is not None and carried.creep is not None:
            self.creep.end(carried.stress, carried.creep)
        return carried


def begin_part(
    task: StageTask,
    systems: StageSystems,
    creep: CreepSteps | None,
    carried: StressState,
    h: float,
) -> StepPart:
    """Begin a part of a step.

    Args:
        task: the stage, with what is imposed in the part.
        systems: the equations of the stages.
        creep: makes the steps of ground that creeps; None where none does.
        carried: at its beginning; it stays.
        h: its length, s; infinite for the end of all creep.
    """
    before, carried, step = carried, carried.copy(), None
    task = replace(task, carried=carried)
    if creep is not None and carried.creep is not None:
        step = creep.begin(
            carried.stress, carried.creep, task.system.points_of, task.state.structures, h
        )
        task = replace(
            task,
            ground_moduli=step.moduli,
            moduli_key=step.key,
            rigidities=systems.structures.grown(task.rigidities, step.members),
            members_grown={name: float(grown.value) for name, grown in step.members.items()},
        )
    task.impose(systems)
    points = systems.discretization.points
    past = points.forces(before.stress - carried.stress, task.system.volume)
    if systems.structures.n_rows:
        past += systems.structures.nodal_forces(before.members - carried.members)
    return StepPart(task, past, step)


def begin_materials(task: StageTask, systems: StageSystems, before: Mapping[int, str]) -> None:
    """Ground that a stage makes another material has not crept as such; what it builds is young.

    Args:
        task: the stage.
        systems: the equations of the stages.
        before: group to material, in the state on which the stage builds.
    """
    creep = task.carried.creep
    assert creep is not None
    for group, material in task.state.materials.items():
        if before.get(group, material) != material and group not in task.state.placed:
            creep.begin(systems.discretization.points_of[group])
    creep.built |= dict.fromkeys(task.state.built, creep.time)


def mixed(states: Sequence[StressState], weights: Sequence[float]) -> StressState:
    """What is carried between some states of one stage, as a sum of them with weights."""

    def total(arrays: Sequence[Floats]) -> Floats:
        return np.asarray(sum(w * array for w, array in zip(weights, arrays, strict=True)))

    def hardened(name: str) -> Floats:
        some = [state.hardened.get(name) for state in states]
        none = next(one for one in some if one is not None) * 0.0
        return total([none if one is None else one for one in some])

    creeps, strains = [state.creep for state in states if state.creep is not None], None
    if creeps:
        first = creeps[0]
        strains = CreepStrains(
            first.points,
            {name: total([one.strains[name] for one in creeps]) for name in first.strains},
            first.at_rest,
            first.placed,
            first.built,
            sum(w * one.time for w, one in zip(weights, creeps, strict=True)),
        )
    return replace(
        states[0],
        stress=total([state.stress for state in states]),
        members=total([state.members for state in states]),
        relieved=total([state.relieved for state in states]),
        hardened={name: hardened(name) for state in states for name in state.hardened},
        creep=strains,
    )
