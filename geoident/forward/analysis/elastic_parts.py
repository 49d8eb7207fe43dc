"""Parts of steps in time of elastic ground: one solve for each (theory 18.2).

Derivatives of a part depend on its motions; the motions of the next part do not depend on these
derivatives. To solve is to read the whole factor, whatever the number of right-hand sides: so the
derivatives of a part are solved for together with the motions of the next one, where both have one
matrix. They lag behind by one part, until `finish`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import Factor, NotPositiveDefinite
from geoident.forward.analysis.stage import (
    FactorCache,
    StageTask,
    StressState,
    not_positive_definite,
)
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.water import PoreBlocks, WaterInPart
from geoident.forward.consolidation.pores import PoreOperators
from geoident.forward.time_steps import PartOfStep
from geoident.model.arrays import Bools, Floats, Ints


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


@dataclass(frozen=True, eq=False)
class TimePart:
    """A part of a step, and what is given in it.

    Args:
        step: the part, s since the beginning of the stage.
        given: (n_nodes, 1 + n) pressures where they are given, Pa.
        held: (n_nodes,) where they are given.
        loaded: parts of what the stage does that have come when it begins and ends.
    """

    step: PartOfStep[InTime]
    given: Floats
    held: Bools
    loaded: tuple[float, float]

    def water(
        self,
        operators: PoreOperators,
        blocks: PoreBlocks | None,
        *,
        n_parts: int = 1,
        columns: slice = slice(None),
    ) -> WaterInPart:
        """What the water does in it.

        Args:
            operators: Q, S and H.
            blocks: the matrices; None where no pressure is free.
            n_parts: number of the parts of all steps of the stage, about, where ground yields.
            columns: of the state and its derivatives.
        """
        step, begun = self.step, self.step.before.p[:, columns]
        drive = begun.copy()
        for weight, state in step.past:
            drive += weight * state.p[:, columns]
        jump = np.where(self.held[:, None], self.given[:, columns] - begun, 0.0)
        return WaterInPart(operators, step.h, drive, jump, blocks, step.span, self.loaded, n_parts)

    def pressures(self, change: Floats, columns: slice) -> Floats:
        """Those at its end, (n_nodes, c), Pa, from changes where they are not given."""
        free = self.step.before.p[:, columns] + change
        return np.where(self.held[:, None], self.given[:, columns], free)


@dataclass(frozen=True, eq=False)
class _Lagging:
    """A part whose motions are known and whose derivatives are not.

    Args:
        task: the stage in it.
        part: what is given in it.
        blocks: the matrices; None where no pressure is free.
        forces: (n_dofs, 1 + n) that act, without those of pressures.
        du: (n_dofs,) displacement step.
        after: its end; derivatives are filled in.
    """

    task: StageTask
    part: TimePart
    blocks: PoreBlocks | None
    forces: Floats
    du: Floats
    after: InTime


_STATE, _SLOPES = slice(0, 1), slice(1, None)


class ElasticParts:
    """Solves for parts of the steps of a stage, in a row.

    Args:
        systems: the equations of the stages.
        operators: of the water.
        factors: of stages without water.
    """

    def __init__(
        self, systems: StageSystems, operators: PoreOperators, factors: FactorCache
    ) -> None:
        self._systems, self._operators, self._factors = systems, operators, factors
        self._lagging: _Lagging | None = None

    def advance(
        self, task: StageTask, part: TimePart, blocks: PoreBlocks | None, forces: Floats
    ) -> InTime:
        """The end of a part; its derivatives are there after the next part, or `finish`.

        Args:
            task: the stage in it.
            part: what is given in it.
            blocks: the matrices; None where no pressure is free.
            forces: (n_dofs, 1 + n) that act in it, without those of pressures, N.

        Raises:
            ModelError: the matrix is singular.
        """
        lags = self._lagging
        if lags is not None and (lags.blocks is not blocks or lags.part.step.h != part.step.h):
            self.finish()
            lags = None
        water = part.water(self._operators, blocks, columns=_STATE)
        state = forces[:, _STATE] + water.pushed(), water.right(task.motion)
        sides = [_of_unknowns(task, blocks, *state)]
        if lags is not None:
            sides.append(self._slopes(lags))
        solution = self._solution(task, blocks, part.step.h, np.hstack(sides))
        if lags is not None:
            self._fill(lags, solution[:, _SLOPES])
        before = part.step.before
        after = InTime(np.full_like(before.u, np.nan), np.full_like(before.p, np.nan))
        du, dp = self._changes(task, blocks, solution[:, _STATE])
        after.u[:, _STATE] = before.u[:, _STATE] + du
        after.p[:, _STATE] = part.pressures(dp, _STATE)
        if forces.shape[1] > 1:
            self._lagging = _Lagging(task, part, blocks, forces, du[:, 0], after)
        return after

    def finish(self) -> None:
        """Solve for the derivatives that lag behind.

        Raises:
            ModelError: the matrix is singular.
        """
        lags = self._lagging
        if lags is not None:
            side = self._slopes(lags)
            self._fill(lags, self._solution(lags.task, lags.blocks, lags.part.step.h, side))

    def _slopes(self, lags: _Lagging) -> Floats:
        """Right sides (k, n) of the derivatives of a part, at whose beginning they are known."""
        task, part, du = lags.task, lags.part, lags.du
        water = part.water(self._operators, lags.blocks)
        forces = (lags.forces + water.pushed())[:, _SLOPES]
        flow = water.right(task.motion)[:, _SLOPES]
        self._take_stiffness(task, du, forces)
        moved = du if task.motion is None else du + task.motion[:, 0]
        water.slopes(forces, flow, moved, lags.after.p[:, 0] - part.step.before.p[:, 0])
        return _of_unknowns(task, lags.blocks, forces, flow)

    def _fill(self, lags: _Lagging, solution: Floats) -> None:
        """Fill in the derivatives of a part from a solution (k, n)."""
        du, dp = self._changes(lags.task, lags.blocks, solution)
        lags.after.u[:, _SLOPES] = lags.part.step.before.u[:, _SLOPES] + du
        lags.after.p[:, _SLOPES] = lags.part.pressures(dp, _SLOPES)
        self._lagging = None

    def _solution(
        self, task: StageTask, blocks: PoreBlocks | None, h: float, right: Floats
    ) -> Floats:
        """Of right sides (k, c); where nothing is free to move k is 0."""
        factor = self._factor(task, blocks, h)
        return right if factor is None else factor.solve(right)

    def _factor(self, task: StageTask, blocks: PoreBlocks | None, h: float) -> Factor | None:
        if blocks is None:
            return self._factors.factor(task, self._systems)
        try:
            return blocks.factor(h)
        except NotPositiveDefinite as error:
            unknown, n = error.unknown, len(task.system.dofs)
            at = unknown if unknown is not None and unknown < n else None
            place = self._systems.describe_unknown(task.system, at)
            raise not_positive_definite(task.state.name, place) from error

    def _changes(
        self, task: StageTask, blocks: PoreBlocks | None, solution: Floats
    ) -> tuple[Floats, Floats]:
        """Changes of displacements (n_dofs, c) and of free pressures (n_nodes, c)."""
        du = np.zeros((len(task.forces), solution.shape[1]))
        dp = np.zeros((self._operators.flow.value.shape[0], solution.shape[1]))
        n = len(task.system.dofs)
        du[task.system.dofs] = solution[:n]
        if blocks is not None:
            dp[blocks.nodes] = blocks.size * solution[n:]
        return du, dp

    def _take_stiffness(self, task: StageTask, du: Floats, forces: Floats) -> None:
        """Take dK/dp times displacements (n_dofs,) from forces (n_dofs, n)."""
        columns = _stiff(task)
        if not len(columns):
            return
        points, structures = self._systems.discretization.points, self._systems.structures
        stress = np.zeros((points.n_strain, points.n_points, task.n))
        members = np.zeros((structures.n_rows, task.n))
        task.add_stiffness_derivatives(self._systems, du, stress, members)
        some = np.ascontiguousarray(stress[..., columns])
        forces[:, columns] -= points.forces(some, task.system.volume)
        if structures.n_rows:
            forces -= structures.nodal_forces(members)


def _of_unknowns(
    task: StageTask, blocks: PoreBlocks | None, forces: Floats, flow: Floats
) -> Floats:
    """Right sides (k, c) from forces (n_dofs, c) and flow (n_nodes, c)."""
    if blocks is None:
        return forces[task.system.dofs]
    return np.concatenate([forces[task.system.dofs], blocks.size * flow[blocks.nodes]])


def _stiff(task: StageTask) -> Ints:
    """Numbers of the parameters on which moduli of the ground or of structures depend."""
    names = dict[str, None]()
    for material, points in task.system.points_of.items():
        moduli = task.ground_moduli.moduli(material, points)
        names |= dict.fromkeys(moduli.slopes)
        for modes in moduli.modes:
            names |= dict.fromkeys(modes.field.names)
    of_ground = np.array([name in names for name in task.point.names], dtype=bool)
    return np.flatnonzero(of_ground | task.rigidities[:, 1:].any(axis=0))
