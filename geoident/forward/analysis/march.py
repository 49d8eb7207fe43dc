"""A stage of consolidating ground in time, with exact derivatives (theory 18).

With u and p since the beginning of the stage, and r_0 what is then out of balance,

    K u - Q p = lambda r_0 ,     Q^T u' + S p' + H p = 0

where the part lambda of what the stage does has come: all at once, or evenly over a time.

An Euler step h from (u_n, p_n), and the parts of a TR-BDF2 step, are of one form: with w the
pressures that drive the flow in it,

    [  K      -Q      ] [du]   [ dlambda r_0 ]
    [ -Q^T  -(S + h H)] [dp] = [ h H w       ]

    Euler: h = dt, w = p_n.   TR: h = beta dt, w = 2 p_n.   BDF2: w = p_g + b (p_n + p_g),
    b = (1 - gamma)^2 / (gamma (2 - gamma)), p_g the pressure in between

since what is stored changes by what flows. Pressures that are given jump in the first step. The
derivatives of a step have the same matrix: for each parameter, on the right, those of r_0 and of
w, and what its derivatives of K, Q, S and H make of du and dp.

Within a step u and p are the parabolas through its beginning, its middle and its end.

Ground that creeps has a K of its own in every part of a step, by its length, and its past is a load
there (`creeping`); its stress is carried from part to part. Then what a stage does at once comes
before all steps, and nothing creeps meanwhile. Without water the parts of a step are its halves, so
that there is one factorization for each length.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import Factor, NotPositiveDefinite
from geoident.fem.solvers.quasi_definite import QuasiDefinite
from geoident.forward.analysis.creeping import begin_part, mixed
from geoident.forward.analysis.stage import (
    FactorCache,
    StageTask,
    StressState,
    not_positive_definite,
)
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.consolidation.pores import PoreOperators, PoreSystem
from geoident.forward.consolidation.steps import BACK, GAMMA, TimeStep, parabola
from geoident.forward.creep.steps import CreepSteps
from geoident.model.arrays import Bools, Floats, Ints

_MOST_KEPT = 2
"""Factors that are kept of ground that creeps: the parts of a step have different moduli."""

_ROUNDING = 1e-12
"""Part of a time within which it is reached."""


@dataclass(frozen=True)
class InTime:
    """Displacements and pressures at a time.

    Args:
        u: (n_dofs, 1 + n) since the beginning of the stage, m, without what supports impose.
        p: (n_nodes, 1 + n) Pa.
        carried: by ground that creeps; None where none does.
    """

    u: Floats
    p: Floats
    carried: StressState | None = None


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
        self._equations, self._steps, self._given = equations, steps, given
        self._over, self._came = over, 0.0
        self._time, self._done = 0.0, 0
        still = np.zeros((equations.n_dofs, pressures.shape[1]))
        self._now = InTime(still, pressures, equations.carried)
        self._gamma = equations.gamma
        self._parts = (self._now, self._now, self._now)
        self._length = 0.0

    def to(self, time: float) -> InTime:
        """What is reached at a time, s since the beginning; not before the last one asked for.

        Raises:
            ModelError: the equations have no unique solution.
        """
        jumps = time == 0.0 or (self._now.carried is not None and not self._over)
        if jumps and not self._done and not self._came:
            free = np.zeros_like(self._equations.pores.given)
            self._now = self._after(self._now, 0.0, self._now.p, free, (0.0, 0.0))
        if time == 0.0:
            return self._now
        while self._time < time * (1.0 - _ROUNDING):
            self._step()
        left = (self._time - time) / self._length
        return self._now if left < _ROUNDING else self._within(1.0 - left)

    def forget(self) -> None:
        """Forget the factorization; it is made again where it is needed."""
        self._equations.forget()

    def _step(self) -> None:
        step, begun = self._steps[self._done], self._now
        held = self._equations.pores.given
        start, end = self._time, self._time + step.length
        middle = start + self._gamma * step.length
        if step.euler:
            self._now = self._after(begun, step.share, begun.p, held, (start, end))
            between = _sum((begun, self._now), (1.0 - self._gamma, self._gamma))
        else:
            between = self._after(begun, step.share, 2.0 * begun.p, held, (start, middle))
            drive = between.p + BACK * (begun.p + between.p)
            self._now = self._after(between, step.share, drive, held, (middle, end))
        self._parts, self._length = (begun, between, self._now), step.length
        self._time, self._done = end, self._done + 1

    def came(self, time: float) -> float:
        """The part of what the stage does that has come at a time, s."""
        return 1.0 if time >= self._over * (1.0 - _ROUNDING) else time / self._over

    def _after(
        self, before: InTime, h: float, drive: Floats, held: Bools, span: tuple[float, float]
    ) -> InTime:
        """The end of a part of a step; pressures of some nodes (n_nodes,) are given.

        Args:
            before: its beginning.
            h: by what flow is multiplied, s.
            drive: w (n_nodes, 1 + n), Pa.
            held: (n_nodes,) where pressures are given.
            span: when it begins and ends, s.
        """
        jump = np.where(held[:, None], self._given - before.p, 0.0)
        comes, self._came = self.came(span[1]) - self._came, self.came(span[1])
        du, dp, carried = self._equations.advance(h, drive, jump, held, comes, before.carried, span)
        return InTime(before.u + du, before.p + dp, carried)

    def _within(self, part: float) -> InTime:
        """At a part of the last step."""
        return _sum(self._parts, [parabola(part, k, self._gamma) for k in range(3)])


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

    Attributes:
        rest: r_0 (n_dofs, 1 + n), what is out of balance at the beginning of the stage; of ground
            that creeps without what is imposed in it.
        carried: by ground that creeps, at the beginning of the stage.
        gamma: where the parts of a step meet.
    """

    def __init__(
        self,
        task: StageTask,
        systems: StageSystems,
        pores: PoreSystem,
        operators: PoreOperators,
        before: Floats,
        factors: FactorCache,
        creep: CreepSteps | None = None,
    ) -> None:
        self.pores, self._systems, self._operators = pores, systems, operators
        self.n_dofs = len(task.forces)
        points, carried = systems.discretization.points, task.carried
        rest = task.forces - points.forces(carried.stress, task.system.volume)
        if systems.structures.n_rows:
            rest -= systems.structures.nodal_forces(carried.members)
        self.rest = rest + operators.coupling.at(before)
        self.carried = None if creep is None else carried.copy()
        self.gamma = GAMMA if len(pores.nodes) else 0.5
        self._task, self._creep, self._factors = task, creep, factors
        self._stiff = _stiffness_depends(task) or creep is not None
        self._blocks: dict[Hashable, _Blocks] = {}
        self._factor: dict[Hashable, Factor] = {}

    def forget(self) -> None:
        """Forget factorizations."""
        self._factor.clear()

    def advance(
        self,
        h: float,
        drive: Floats,
        jump: Floats,
        held: Bools,
        comes: float,
        carried: StressState | None,
        span: tuple[float, float],
    ) -> tuple[Floats, Floats, StressState | None]:
        """Changes of u (n_dofs, 1 + n) and p (n_nodes, 1 + n) in a part of a step.

        Also what ground that creeps carries at its end.

        Args:
            h: by what flow is multiplied, s.
            drive: w (n_nodes, 1 + n), Pa.
            jump: (n_nodes, 1 + n) changes of the pressures that are given, Pa.
            held: (n_nodes,) where they are given.
            comes: part of what the stage does that comes in it.
            carried: by ground that creeps, at its beginning; None where none does.
            span: when the part begins and ends, s.

        Raises:
            ModelError: the matrix is singular.
        """
        Q, S, H = (self._operators.coupling, self._operators.storage, self._operators.flow)
        task = _part_of(self._task, comes)
        forces = Q.value @ jump
        if self._task.heating is not None:
            warmed = self._task.heating.until(span[1])
            task = task.with_thermal(warmed)
            if self._creep is None:  # what creeps imposes it with its own moduli
                forces += self._thermal_forces(warmed)
        water = h * H.at(drive) + S.value @ jump + h * (H.value @ jump)
        if comes:
            forces += comes * self.rest
        part = None
        if self._creep is not None and carried is not None:
            part = begin_part(task, self._systems, self._creep, carried, span[1] - span[0])
            task = part.task
            forces += part.past
        moved = None
        if task.motion is not None:
            water += Q.value.T @ task.motion
            moved = task.motion[:, 0]
        blocks, factor = self._factorized(h, held, task)
        du, dp = np.zeros_like(forces), jump.copy()
        state = slice(0, 1)
        blocks.solve(factor, forces[:, state], water[:, state], du[:, state], dp[:, state])
        if forces.shape[1] > 1:
            u, p = du[:, 0], dp[:, 0]
            if self._stiff:
                forces[:, 1:] -= self._stiffness_slopes(task, u)
            for n, slope in Q.slopes.items():
                forces[:, 1 + n] += slope @ p
                water[:, 1 + n] += slope.T @ (u if moved is None else u + moved)
            for n, slope in S.slopes.items():
                water[:, 1 + n] += slope @ p
            for n, slope in H.slopes.items():
                water[:, 1 + n] += h * (slope @ p)
            rest = slice(1, None)
            blocks.solve(factor, forces[:, rest], water[:, rest], du[:, rest], dp[:, rest])
        return du, dp, None if part is None else part.end(self._systems, self._factors, du)

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
        forces = points.forces(stress, task.system.volume)
        return forces + structures.nodal_forces(members) if structures.n_rows else forces

    def _factorized(self, h: float, held: Bools, task: StageTask) -> tuple[_Blocks, Factor | None]:
        if not np.any(~held[self.pores.nodes]):
            dofs, nodes = task.system.dofs, self.pores.nodes[:0]
            return _Blocks(None, dofs, nodes, 1.0), self._factors.factor(task, self._systems)
        key = held.tobytes(), task.moduli_key
        if key not in self._blocks:
            _make_room(self._blocks, _MOST_KEPT)
            self._blocks[key] = self._made_for(held, task)
        blocks, key_of_factor = self._blocks[key], (*key, h)
        if key_of_factor not in self._factor:
            _make_room(self._factor, _MOST_KEPT if self._creep is not None else 1)
            matrices = blocks.matrices
            assert matrices is not None
            try:
                self._factor[key_of_factor] = matrices.factor(h)
            except NotPositiveDefinite as error:
                unknown = error.unknown
                n_moving = len(task.system.dofs)
                at = unknown if unknown is not None and unknown < n_moving else None
                place = self._systems.describe_unknown(task.system, at)
                raise not_positive_definite(task.state.name, place) from error
        return blocks, self._factor[key_of_factor]

    def _made_for(self, held: Bools, task: StageTask) -> _Blocks:
        """The blocks of the unknowns where some pressures (n_nodes,) are held."""
        systems, operators = self._systems, self._operators
        system = task.system
        values = systems.stiffness_values(
            system, task.state, task.moduli_by_material(), task.point.values, task.members_grown
        )
        K = system.pattern.lower.whole(values)
        dofs, nodes = system.dofs, self.pores.nodes[~held[self.pores.nodes]]
        Q = operators.coupling.value[dofs][:, nodes]
        S, H = (one.value[nodes][:, nodes] for one in (operators.storage, operators.flow))
        size = float(np.abs(K.data).mean() / np.abs(Q.data).mean()) if Q.nnz else 1.0
        above, below = sp.hstack([K, -size * Q]), sp.hstack([-size * Q.T, -(size**2) * S])
        constant = sp.csr_array(sp.vstack([above, below]))
        nothing = sp.csr_array((len(dofs), len(dofs)))
        growing = sp.csr_array(sp.block_diag([nothing, -(size**2) * H], format="csr"))
        dim = systems.discretization.kinematics.dim
        places = np.concatenate([2 * systems.rank[dofs // dim], 2 * systems.rank[nodes] + 1])
        signs = np.repeat([1.0, -1.0], [len(dofs), len(nodes)])
        matrices = systems.quasi_definite(constant, growing, places=places, signs=signs)
        return _Blocks(matrices, dofs, nodes, size)


@dataclass(frozen=True)
class _Blocks:
    """The matrices of some unknowns.

    Args:
        matrices: of displacements and pressures; None where no pressure is unknown.
        dofs: (n,) of the displacements.
        nodes: (n_p,) of the pressures.
        size: of a pressure, Pa: the unknowns are pressures by it.
    """

    matrices: QuasiDefinite | None
    dofs: Ints
    nodes: Ints
    size: float

    def solve(
        self, factor: Factor | None, forces: Floats, water: Floats, du: Floats, dp: Floats
    ) -> None:
        """Add the solution for some columns to changes of displacements and pressures.

        Without a factor nothing is free to move.
        """
        if factor is None:
            return
        n = len(self.dofs)
        right = np.concatenate([forces[self.dofs], self.size * water[self.nodes]])
        solution = factor.solve(right)
        du[self.dofs] += solution[:n]
        dp[self.nodes] += self.size * solution[n:]


def _part_of(task: StageTask, part: float) -> StageTask:
    """A stage with a part of what supports and temperatures impose in it."""
    if part in (0.0, 1.0):
        return task if part else replace(task, motion=None, thermal=None)
    motion = None if task.motion is None else part * task.motion
    thermal = None if task.thermal is None else part * task.thermal
    return replace(task, motion=motion, thermal=thermal)


def _stiffness_depends(task: StageTask) -> bool:
    """Whether moduli of the ground or of structures depend on parameters."""
    names = set(task.point.names)
    for material, points in task.system.points_of.items():
        moduli = task.ground_moduli.moduli(material, points)
        if names & moduli.slopes.keys() or moduli.modes:
            return True
    return bool(task.rigidities[:, 1:].any())


def _make_room(kept: dict[Hashable, Any], most: int) -> None:
    """Forget the oldest, so that there is room for one more."""
    while len(kept) >= most:
        del kept[next(iter(kept))]


def _sum(states: Sequence[InTime], weights: Sequence[float]) -> InTime:
    """A sum of states of one stage with weights."""
    u = sum(w * one.u for w, one in zip(weights, states, strict=True))
    p = sum(w * one.p for w, one in zip(weights, states, strict=True))
    carried = [one.carried for one in states if one.carried is not None]
    return InTime(np.asarray(u), np.asarray(p), mixed(carried, weights) if carried else None)
