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
whose stress returns from the beginning of the part to its end (`plastic_step`).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.forward.analysis.plastic_step import PlasticSteps
from geoident.forward.analysis.stage import (
    FactorCache,
    StageTask,
    StressState,
    not_positive_definite,
)
from geoident.forward.analysis.step_parts import begin_part, mixed
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.water import PoreBlocks, WaterInPart
from geoident.forward.consolidation.pores import PoreOperators, PoreSystem
from geoident.forward.creep.steps import CreepSteps
from geoident.forward.time_steps import GAMMA, PartOfStep, TimeLoop, TimeStep
from geoident.model.arrays import Bools, Floats, Ints

MOST_KEPT = 2
"""Matrices that are kept, each with a factor: the parts of a step of ground that creeps have
different moduli."""

_ROUNDING = 1e-12
"""Part of a time within which it is reached."""


@dataclass(frozen=True)
class InTime:
    """Displacements and pressures at a time.

    Args:
        u: (n_dofs, 1 + n) since the beginning of the stage, m, without what supports impose.
        p: (n_nodes, 1 + n) Pa.
        carried: by ground that creeps or yields; None where none does.
    """

    u: Floats
    p: Floats
    carried: StressState | None = None


@dataclass(frozen=True)
class TimePart:
    """What is given in a part of a step.

    Args:
        h: by what flow is multiplied, s.
        drive: w (n_nodes, 1 + n), Pa.
        jump: (n_nodes, 1 + n) changes of the pressures that are given, Pa.
        held: (n_nodes,) where they are given.
        span: when it begins and ends, s since the beginning of the stage.
        loaded: parts of what the stage does that have come then.
    """

    h: float
    drive: Floats
    jump: Floats
    held: Bools
    span: tuple[float, float]
    loaded: tuple[float, float]


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
        self._loop = TimeLoop(steps, begun, self._after, _sum, equations.gamma)

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
        return loop.to(time)

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
        before = part.before
        drive = np.asarray(before.p + sum(weight * one.p for weight, one in part.past))
        jump = np.where(held[:, None], self._given - before.p, 0.0)
        loaded = self._came, self.came(part.span[1])
        self._came = loaded[1]
        given = TimePart(part.h, drive, jump, held, part.span, loaded)
        return self._equations.advance(before, given)


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
        plastic: solves parts of steps in which ground or structures yield; None where none do.

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
        plastic: PlasticSteps | None = None,
    ) -> None:
        self.pores, self._systems, self._operators = pores, systems, operators
        self.n_dofs = len(task.forces)
        points, carried = systems.discretization.points, task.carried
        rest = task.forces - points.forces(carried.stress, task.system.volume)
        if systems.structures.n_rows:
            rest -= systems.structures.nodal_forces(carried.members)
        self.rest = rest + operators.coupling.at(before)
        by_parts = creep is not None or plastic is not None
        self.carried = carried.copy() if by_parts else None
        self.gamma = GAMMA if len(pores.nodes) else 0.5
        self.yielded = np.zeros(points.n_points, dtype=bool)
        self.n_parts = 1
        self._forces = task.forces.copy()
        self._task, self._creep, self._plastic, self._factors = task, creep, plastic, factors
        self._stiff = _of_stiffness(task) if creep is None else np.arange(task.n)
        self._blocks: dict[Hashable, PoreBlocks] = {}
        self._last: tuple[float, Floats] | None = None  # length and motions of the last part

    def forget(self) -> None:
        """Forget factorizations."""
        for blocks in self._blocks.values():
            blocks.forget()

    def asked_by(self, task: StageTask) -> None:
        """What follows is part of a state of the stage: findings and messages name that."""
        self._task = replace(self._task, number=task.number, state=task.state)

    def advance(self, before: InTime, part: TimePart) -> InTime:
        """The end of a part of a step.

        Args:
            before: its beginning.
            part: what is given in it.

        Raises:
            ModelError: the matrix is singular.
            CollapseError: ground that yields cannot carry the loads.
        """
        comes = part.loaded[1] - part.loaded[0]
        task, begun, warmed = _part_of(self._task, comes), None, None
        if self._task.heating is not None:
            warmed = self._task.heating.until(part.span[1])
            task = task.with_thermal(warmed)
        if before.carried is not None:
            length = part.span[1] - part.span[0]
            begun = begin_part(task, self._systems, self._creep, before.carried, length)
            task = begun.task
        water = WaterInPart(
            self._operators, part.h, part.drive, part.jump, self._blocks_of(part.held, task),
            part.span, part.loaded, self.n_parts,
        )  # fmt: skip
        if self._plastic is not None and begun is not None:
            du, dp = self._yielding(self._plastic, replace(task, water=water), before)
            return InTime(before.u + du, before.p + dp, begun.crept())
        forces = comes * self.rest
        if begun is not None:
            forces += begun.past
        elif warmed is not None:  # what is carried from part to part has it in its past
            forces += self._thermal_forces(warmed)
        du, dp = self._elastic(task, water, forces)
        carried = None if begun is None else begun.end(self._systems, self._factors, du)
        return InTime(before.u + du, before.p + dp, carried)

    def _elastic(
        self, task: StageTask, water: WaterInPart, forces: Floats
    ) -> tuple[Floats, Floats]:
        """Changes of u (n_dofs, 1 + n) and p (n_nodes, 1 + n) under forces (n_dofs, 1 + n)."""
        forces, right = forces + water.pushed(), water.right(task.motion)
        du, dp, state, slopes = (
            np.zeros_like(forces),
            water.jump.copy(),
            slice(0, 1),
            slice(1, None),
        )
        self._solve(task, water, (forces[:, state], right[:, state]), (du[:, state], dp[:, state]))
        if forces.shape[1] > 1:
            u = du[:, 0]
            if len(self._stiff) or self._systems.structures.n_rows:
                forces[:, slopes] -= self._stiffness_slopes(task, u)
            moved = u if task.motion is None else u + task.motion[:, 0]
            water.slopes(forces[:, slopes], right[:, slopes], moved, dp[:, 0])
            self._solve(
                task, water, (forces[:, slopes], right[:, slopes]), (du[:, slopes], dp[:, slopes])
            )
        return du, dp

    def _solve(
        self,
        task: StageTask,
        water: WaterInPart,
        right: tuple[Floats, Floats],
        changes: tuple[Floats, Floats],
    ) -> None:
        """Add the solution for some columns to changes of displacements and pressures.

        Without a factor nothing is free to move.
        """
        (forces, flow), (du, dp), blocks = right, changes, water.blocks
        dofs = task.system.dofs
        if blocks is None:
            factor = self._factors.factor(task, self._systems)
            if factor is not None:
                du[dofs] += factor.solve(forces[dofs])
            return
        try:
            factor = blocks.factor(water.h)
        except NotPositiveDefinite as error:
            unknown, n = error.unknown, len(dofs)
            at = unknown if unknown is not None and unknown < n else None
            place = self._systems.describe_unknown(task.system, at)
            raise not_positive_definite(task.state.name, place) from error
        solution = factor.solve(np.concatenate([forces[dofs], blocks.size * flow[blocks.nodes]]))
        du[dofs] += solution[: len(dofs)]
        dp[blocks.nodes] += blocks.size * solution[len(dofs) :]

    def _yielding(
        self, plastic: PlasticSteps, task: StageTask, before: InTime
    ) -> tuple[Floats, Floats]:
        """The same where ground yields: forces are those at the end, so that no error is carried.

        Newton's method begins with what the last part needed, by its length.
        """
        water = task.water
        assert water is not None
        forces = self._forces - (1.0 - water.loaded[1]) * self.rest + water.pushed()
        forces += self._operators.coupling.at(before.p)
        length, guess = water.span[1] - water.span[0], None
        if self._last is not None and self._last[0] > 0.0 and water.h > 0.0:
            guess = length / self._last[0] * self._last[1]
        motions, yielded = plastic.step(replace(task, forces=forces), guess)
        self._last = length, motions[:, 0]
        self.yielded |= yielded
        n, dp = self.n_dofs, water.jump.copy()
        if water.blocks is not None:
            dp += motions[n : n + water.n_nodes]
        return motions[:n], dp

    def _thermal_forces(self, strain: Floats) -> Floats:
        """Forces (n_dofs, 1 + n) by which normal strains (n_points, 1 + n) drive the ground."""
        stress = np.zeros((self._systems.discretization.points.n_strain, *strain.shape))
        self._task.add_thermal_stress(strain, stress, 1.0)
        return self._systems.discretization.points.forces(stress, self._task.system.volume)

    def _stiffness_slopes(self, task: StageTask, du: Floats) -> Floats:
        """Forces (n_dofs, n) of dK/dp by displacements (n_dofs,)."""
        points, structures = self._systems.discretization.points, self._systems.structures
        stress = np.zeros((points.n_strain, points.n_points, task.n))
        members = np.zeros((structures.n_rows, task.n))
        task.add_stiffness_derivatives(self._systems, du, stress, members)
        forces, some = np.zeros((self.n_dofs, task.n)), self._stiff
        if len(some):
            forces[:, some] = points.forces(stress[..., some], task.system.volume)
        return forces + structures.nodal_forces(members) if structures.n_rows else forces

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


def _of_stiffness(task: StageTask) -> Ints:
    """Numbers of the parameters on which moduli of the ground depend: few of them."""
    names = set[str]()
    for material, points in task.system.points_of.items():
        moduli = task.ground_moduli.moduli(material, points)
        names |= moduli.slopes.keys()
        for modes in moduli.modes:
            names |= set(modes.field.names)
    numbers = [n for n, name in enumerate(task.point.names) if name in names]
    return np.array(numbers, dtype=np.int64)


def _sum(states: Sequence[InTime], weights: Sequence[float]) -> InTime:
    """A sum of states of one stage with weights."""
    u = sum(w * one.u for w, one in zip(weights, states, strict=True))
    p = sum(w * one.p for w, one in zip(weights, states, strict=True))
    carried = [one.carried for one in states if one.carried is not None]
    return InTime(np.asarray(u), np.asarray(p), mixed(carried, weights) if carried else None)
