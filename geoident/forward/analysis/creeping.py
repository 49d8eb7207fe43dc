"""Stages of ground that creeps or ages, one after the other, in one analysis (theory 13.2).

What a stage does comes at once, and nothing creeps meanwhile. Then time passes in steps, each of
two halves of one size: each half is an equilibrium with the moduli and the past of its size.
Within a step all is the parabola through its beginning, its middle and its end. A stage without
duration is one step of infinite size: the end of all creep, with what the stage does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.analysis.stage import FactorCache, StageTask, StressState, elastic_step
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.creep.steps import CreepSteps, CreepStrains
from geoident.model.arrays import Floats

_ROUNDING = 1e-12
"""Part of a time within which it is reached."""

OF_EACH_LENGTH = 4
"""Steps of each length."""

_LEAST, _BEFORE = 8, 2
"""Lengths of steps of a stage at least; those that are gone through before its first moment."""


def step_lengths(lasts: float, first: float, of_each: int = OF_EACH_LENGTH) -> list[float]:
    """Lengths of the steps of a stage, s: each some times, then doubled.

    Args:
        lasts: how long it lasts, s, above zero.
        first: the first moment that is looked at, s, above zero.
        of_each: steps of each length.
    """
    n = _LEAST
    while (2**_BEFORE - 1) * lasts > (2**n - 1) * first:
        n += 1
    shortest = lasts / (of_each * (2.0**n - 1.0))
    return [shortest * 2.0**k for k in range(n) for _ in range(of_each)]


@dataclass
class _Reached:
    """What is reached at a time of a stage.

    Args:
        u: (n_dofs, c) displacements since its beginning, m, without what supports impose.
        carried: stress, forces of structures, and what creeps.
    """

    u: Floats
    carried: StressState

    def copy(self) -> _Reached:
        return _Reached(self.u.copy(), self.carried.copy())


class _Going:
    """A stage under way.

    Args:
        task: the stage, after what it does.
        steps: lengths of its steps, s.
        creep: makes them.
        u: (n_dofs, c) displacements of what it does.
    """

    def __init__(self, task: StageTask, steps: list[float], creep: CreepSteps, u: Floats) -> None:
        self._task, self._steps, self._creep = task, steps, creep
        self._now = _Reached(u.copy(), task.carried.copy())
        self._time, self._done = 0.0, 0
        self._parts: tuple[_Reached, _Reached, _Reached] | None = None
        self.told = u  # up to the last moment

    def to(self, time: float, systems: StageSystems, factors: FactorCache) -> _Reached:
        """What is reached at a time, s since the beginning; not before the last one asked for."""
        while self._time < time * (1.0 - _ROUNDING):
            length = self._steps[self._done]
            passes = self._time + length > time * (1.0 + _ROUNDING)
            begun = self._now.copy() if passes else self._now
            self._half(0.5 * length, systems, factors)
            between = self._now.copy() if passes else self._now
            self._half(0.5 * length, systems, factors)
            self._parts = (begun, between, self._now) if passes else None
            self._time, self._done = self._time + length, self._done + 1
        if self._parts is None:
            return self._now
        part = 1.0 - (self._time - time) / self._steps[self._done - 1]
        return _at(self._parts, part)

    def _half(self, h: float, systems: StageSystems, factors: FactorCache) -> None:
        """Go on by half a step, h in s."""
        carried, task = self._now.carried, self._task
        assert carried.creep is not None
        step = self._creep.begin(carried.stress, carried.creep, task.system.points_of, h)
        now = replace(task, carried=carried, ground_moduli=step.moduli, moduli_key=step.key)
        self._now.u += elastic_step(now, systems, factors)
        step.end(carried.stress, carried.creep)


def _at(parts: tuple[_Reached, _Reached, _Reached], x: float) -> _Reached:
    """The parabola through beginning, middle and end of a step at a part x of it."""
    begun, between, end = parts
    a, b, c = (1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)

    def mixed(one: Floats, other: Floats, last: Floats) -> Floats:
        return a * one + b * other + c * last

    first, second, third = (one.carried.creep for one in parts)
    assert first is not None
    assert second is not None
    assert third is not None
    strains = {m: mixed(q, second.strains[m], third.strains[m]) for m, q in first.strains.items()}
    time = first.time + x * (third.time - first.time)
    creep = CreepStrains(first.points, strains, first.at_rest, first.placed, time)
    carried = replace(
        begun.carried,
        stress=mixed(begun.carried.stress, between.carried.stress, end.carried.stress),
        members=mixed(begun.carried.members, between.carried.members, end.carried.members),
        creep=creep,
    )
    return _Reached(mixed(begun.u, between.u, end.u), carried)


class CreepingStages:
    """The stages of one analysis in which ground creeps or ages.

    Args:
        systems: the equations of the stages.
        creep: makes the steps.
        finer: how many times as many steps are made as usual.
    """

    def __init__(self, systems: StageSystems, creep: CreepSteps, finer: int = 1) -> None:
        self._systems, self._creep, self._finer = systems, creep, finer
        self._sequence = systems.on_mesh.sequence
        self._going: dict[int, _Going] = {}

    def begin(self, carried: StressState) -> None:
        """Begin with the virgin state, under which the ground is at rest."""
        carried.creep = self._creep.at_rest(carried.stress)

    def step(self, task: StageTask, factors: FactorCache) -> Floats:
        """Bring a state to its moment.

        Args:
            task: the state, before supports and temperatures impose anything; what it carries is
                brought to its moment.
            factors: those that are kept.

        Returns:
            (n_dofs, 1 + n) displacement steps beside those that supports impose.

        Raises:
            ModelError: the stiffness is not positive definite.
        """
        state, carried = task.state, task.carried
        assert carried.creep is not None
        if state.goes_on:
            going = self._going.pop(state.base)
            before = going.told
        else:
            before = np.zeros_like(task.forces)
            du = self._at_once(task, factors)
            if not state.lasts:
                return du
            first = self._first(task.number)
            steps = step_lengths(state.lasts, first, self._finer * OF_EACH_LENGTH)
            later = replace(task, motion=None, thermal=None, forces=task.forces.copy())
            going = _Going(later, steps, self._creep, du)
        reached = going.to(self._moment(task.number), self._systems, factors)
        carried.stress[:], carried.members[:] = reached.carried.stress, reached.carried.members
        reached_creep = reached.carried.creep
        assert reached_creep is not None
        carried.creep = reached_creep.copy()
        going.told = reached.u.copy()
        self._going[task.number] = going
        return going.told - before

    def _at_once(self, task: StageTask, factors: FactorCache) -> Floats:
        """What a stage does, with all creep that follows where it has no duration."""
        carried, before = task.carried, self._sequence.states[task.state.base].materials
        assert carried.creep is not None
        for group, material in task.state.materials.items():
            if before.get(group, material) != material and group not in task.state.placed:
                carried.creep.begin(self._systems.discretization.points_of[group])
        h = np.inf if task.state.lasts is None else 0.0
        step = self._creep.begin(carried.stress, carried.creep, task.system.points_of, h)
        task = replace(task, ground_moduli=step.moduli, moduli_key=step.key)
        task.impose(self._systems)
        du = elastic_step(task, self._systems, factors)
        step.end(carried.stress, carried.creep)
        return du

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
