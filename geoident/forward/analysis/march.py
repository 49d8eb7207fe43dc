"""A stage of consolidating ground in time, with exact derivatives (theory 18).

With u and p since the beginning of the stage, and r_0 what is then out of balance,

    K u - Q p = lambda r_0 ,     Q^T u' + S p' + H p = 0

where the part lambda of what the stage does has come: all at once, or evenly over a time.

An Euler step from (u_n, p_n), and the parts of a TR-BDF2 step, are of one form (`PartOfStep`): with
w the pressures that drive the flow in it, those at its beginning and of what was before,

    [  K      -Q      ] [du]   [ dlambda r_0 ]
    [ -Q^T  -(S + h H)] [dp] = [ h H w       ]

since what is stored changes by what flows. Pressures that are given jump in the first step. The
derivatives of a step have the same matrix: for each parameter, on the right, those of r_0 and of
w, and what its derivatives of K, Q, S and H make of du and dp.

Ground that creeps has a K of its own in every part of a step, by its length, and its past is a load
there (`step_parts`); its stress is carried from part to part. Then what a stage does at once comes
before all steps, and nothing creeps meanwhile. Without water the parts of a step are its halves, so
that there is one factorization for each length.

Ground that yields has its stress carried in the same way. Each part is an equilibrium of its own,
whose stress returns from the beginning of the part to its end (`plastic_step`), or follows a law
with a state there (`hardening_step`).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np

from geoident.forward.analysis.elastic_parts import ElasticParts, InTime, TimePart
from geoident.forward.analysis.hardening_step import HardeningSteps
from geoident.forward.analysis.plastic_step import PlasticSteps
from geoident.forward.analysis.stage import FactorCache, StageTask
from geoident.forward.analysis.step_parts import begin_part, mixed
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.water import PoreBlocks
from geoident.forward.consolidation.pores import PoreOperators, PoreSystem
from geoident.forward.creep.steps import CreepSteps
from geoident.forward.time_steps import GAMMA, PartOfStep, TimeLoop, TimeStep
from geoident.model.arrays import Bools, Floats

MOST_KEPT = 2
"""Matrices that are kept, each with a factor: the parts of a step of ground that creeps have
different moduli."""

_ROUNDING = 1e-12
"""Part of a time within which it is reached."""


class March:
    """One stage at one parameter vector, as far as it was asked for.

    Args:
        equations: of the stage.
        steps: in time; none where no time passes.
        pressures: (n_nodes, 1 + n) before the stage, Pa.
        given: (n_nodes, 1 + n) pressures where they are given in it, Pa.
        over: time in which what the stage does comes evenly, s; 0: at once.
    """

    def __init__(
        self,
        equations: StepEquations,
        steps: list[TimeStep],
        pressures: Floats,
        given: Floats,
        over: float = 0.0,
    ) -> None:
        self._equations, self._given = equations, given
        equations.n_parts = 1 + 2 * len(steps)
        self._over, self._came = over, 0.0
        still = np.zeros((equations.n_dofs, pressures.shape[1]))
        begun = InTime(still, pressures, equations.carried)
        self._loop = TimeLoop(steps, begun, self._after, self._total, equations.gamma)

    def to(self, task: StageTask, time: float) -> tuple[InTime, Bools]:
        """What is reached at a time, and which strain points (n_points,) yielded on the way there.

        Args:
            task: the state at that time.
            time: s since the beginning; not before the last one asked for.

        Raises:
            ModelError: the equations have no unique solution.
            CollapseError: ground that yields cannot carry the loads.
        """
        equations = self._equations
        equations.asked_by(task)
        equations.yielded = np.zeros_like(equations.yielded)
        return self._to(time), equations.yielded

    def _to(self, time: float) -> InTime:
        loop = self._loop
        jumps = time == 0.0 or (loop.now.carried is not None and not self._over)
        if jumps and loop.begins and not self._came:
            free = np.zeros_like(self._equations.pores.given)
            loop.now = self._advance(PartOfStep(loop.now, (0.0, 0.0), 0.0, ()), free)
        reached = loop.to(time)
        self._equations.finish()
        return reached

    def forget(self) -> None:
        """Forget the factorization; it is made again where it is needed."""
        self._equations.forget()

    def came(self, time: float) -> float:
        """The part of what the stage does that has come at a time, s."""
        return 1.0 if time >= self._over * (1.0 - _ROUNDING) else time / self._over

    def _after(self, part: PartOfStep[InTime]) -> InTime:
        """The end of a part of a step."""
        return self._advance(part, self._equations.pores.given)

    def _advance(self, part: PartOfStep[InTime], held: Bools) -> InTime:
        """The same where pressures of some nodes (n_nodes,) are given."""
        loaded = self._came, self.came(part.span[1])
        self._came = loaded[1]
        return self._equations.advance(TimePart(part, self._given, held, loaded))

    def _total(self, states: Sequence[InTime], weights: Sequence[float]) -> InTime:
        """A sum of states with weights."""
        self._equations.finish()
        return _sum(states, weights)


class StepEquations:
    """The equations of the steps of a stage at one parameter vector.

    Args:
        task: the stage.
        systems: the equations of the stages.
        pores: where pressures are.
        operators: of the water.
        before: (n_nodes, 1 + n) pressures before the stage, Pa.
        factors: of stages without water.
        creep: makes the steps of ground that creeps; None where none does.
        nonlinear: solves parts of steps in which ground or structures yield; None where none do.

    Attributes:
        rest: r_0 (n_dofs, 1 + n), what is out of balance at the beginning of the stage; where
            stress is carried from part to part without what is imposed in it.
        carried: by ground that creeps or yields, at the beginning of the stage.
        gamma: where the parts of a step meet.
        yielded: (n_points,) which strain points yielded since it was last set.
        n_parts: number of the parts of all steps of the stage, about.
    """

    def __init__(
        self,
        task: StageTask,
        systems: StageSystems,
        pores: PoreSystem,
        operators: PoreOperators,
        before: Floats,
        factors: FactorCache,
        *,
        creep: CreepSteps | None = None,
        nonlinear: PlasticSteps | HardeningSteps | None = None,
    ) -> None:
        self.pores, self._systems, self._operators = pores, systems, operators
        self.n_dofs = len(task.forces)
        points, carried = systems.discretization.points, task.carried
        rest = task.forces - points.forces(carried.stress, task.system.volume)
        if systems.structures.n_rows:
            rest -= systems.structures.nodal_forces(carried.members)
        self.rest = rest + operators.coupling.at(before)
        by_parts = creep is not None or nonlinear is not None
        self.carried = carried.copy() if by_parts else None
        self.gamma = GAMMA if len(pores.nodes) else 0.5
        self.yielded = np.zeros(points.n_points, dtype=bool)
        self.n_parts = 1
        self._forces = task.forces.copy()
        self._task, self._creep, self._factors = task, creep, factors
        self._nonlinear = nonlinear
        self._elastic = ElasticParts(systems, operators, factors)
        self._blocks: dict[Hashable, PoreBlocks] = {}
        self._last: tuple[float, Floats] | None = None  # length and motions of the last part

    def forget(self) -> None:
        """Forget factorizations."""
        for blocks in self._blocks.values():
            blocks.forget()

    def asked_by(self, task: StageTask) -> None:
        """What follows is part of a state of the stage: findings and messages name that."""
        self._task = replace(self._task, number=task.number, state=task.state)

    def advance(self, part: TimePart) -> InTime:
        """The end of a part of a step; of elastic ground its derivatives are there by `finish`.

        Args:
            part: what is given in it.

        Raises:
            ModelError: the matrix is singular.
            CollapseError: ground that yields cannot carry the loads.
        """
        comes, step = part.loaded[1] - part.loaded[0], part.step
        before = step.before
        task, begun, warmed = _part_of(self._task, comes), None, None
        if self._task.heating is not None:
            warmed = self._task.heating.until(step.span[1])
            task = task.with_thermal(warmed)
        if self._nonlinear is not None:
            return self._yielding(self._nonlinear, task, part)
        if before.carried is not None:
            length = step.span[1] - step.span[0]
            begun = begin_part(task, self._systems, self._creep, before.carried, length)
            task = begun.task
        blocks = self._blocks_of(part.held, task)
        forces = comes * self.rest
        if begun is not None:
            forces += begun.past
        elif warmed is not None:  # what is carried from part to part has it in its past
            forces += self._thermal_forces(warmed)
        after = self._elastic.advance(task, part, blocks, forces)
        if begun is None:
            return after
        self.finish()
        return replace(after, carried=begun.end(self._systems, self._factors, after.u - before.u))

    def finish(self) -> None:
        """Solve for derivatives that lag behind."""
        self._elastic.finish()

    def _yielding(
        self, nonlinear: PlasticSteps | HardeningSteps, task: StageTask, part: TimePart
    ) -> InTime:
        """The same where ground yields: forces are those at the end, so that no error is carried.

        Newton's method begins with what the last part needed, by its length.
        """
        before, blocks = part.step.before, self._blocks_of(part.held, task)
        assert before.carried is not None
        water = part.water(self._operators, blocks, n_parts=self.n_parts)
        task = replace(task, carried=before.carried.copy(), water=water)
        if isinstance(nonlinear, PlasticSteps):
            task.impose(self._systems)
        forces = self._forces - (1.0 - water.loaded[1]) * self.rest + water.pushed()
        forces += self._operators.coupling.at(before.p)
        length, guess = water.span[1] - water.span[0], None
        if self._last is not None and self._last[0] > 0.0 and water.h > 0.0:
            guess = length / self._last[0] * self._last[1]
        motions, yielded = nonlinear.step(replace(task, forces=forces), guess)
        self._last = length, motions[:, 0]
        self.yielded |= yielded
        n, dp = self.n_dofs, water.jump.copy()
        if water.blocks is not None:
            dp += motions[n : n + water.n_nodes]
        return InTime(before.u + motions[:n], before.p + dp, task.carried)

    def _thermal_forces(self, strain: Floats) -> Floats:
        """Forces (n_dofs, 1 + n) by which normal strains (n_points, 1 + n) drive the ground."""
        stress = np.zeros((self._systems.discretization.points.n_strain, *strain.shape))
        self._task.add_thermal_stress(strain, stress, 1.0)
        return self._systems.discretization.points.forces(stress, self._task.system.volume)

    def _blocks_of(self, held: Bools, task: StageTask) -> PoreBlocks | None:
        """The matrices where some pressures (n_nodes,) are held; None where all are."""
        nodes = self.pores.nodes[~held[self.pores.nodes]]
        if not len(nodes):
            return None
        key = held.tobytes(), task.moduli_key
        if key not in self._blocks:
            while len(self._blocks) >= MOST_KEPT:  # the oldest makes room
                del self._blocks[next(iter(self._blocks))]
            stiffness = self._systems.stiffness_values(
                task.system, task.state, task.moduli_by_material(), task.point.values,
                task.members_grown,
            )  # fmt: skip
            self._blocks[key] = PoreBlocks(
                self._systems, task.system, stiffness, self._operators, nodes
            )
        return self._blocks[key]


def _part_of(task: StageTask, part: float) -> StageTask:
    """A stage with a part of what supports and temperatures impose in it."""
    if part in (0.0, 1.0):
        return task if part else replace(task, motion=None, thermal=None)
    motion = None if task.motion is None else part * task.motion
    thermal = None if task.thermal is None else part * task.thermal
    return replace(task, motion=motion, thermal=thermal)


def _sum(states: Sequence[InTime], weights: Sequence[float]) -> InTime:
    """A sum of states of one stage with weights."""
    u = sum(w * one.u for w, one in zip(weights, states, strict=True))
    p = sum(w * one.p for w, one in zip(weights, states, strict=True))
    carried = [one.carried for one in states if one.carried is not None]
    return InTime(np.asarray(u), np.asarray(p), mixed(carried, weights) if carried else None)
