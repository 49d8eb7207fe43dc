"""All that is unknown in a stage where something may yield: in ground, water, members that yield.

Members that yield are further strain points behind those of the ground, and the rotations of their
beams further unknowns behind the displacements (`MemberPoints`). So the equations of a stage, their
potential, collapse and derivatives hold for them as they stand. The elastic stiffness K has no
rotations; a tangent is condensed,

    S = A_uu - A_ur A_rr^-1 A_ru ,     A = B^T w T D B ,

and takes the place of the condensed elastic stiffness of the beam in K: both couple all of its
nodes, so the pattern stays.

In a part of a step in time the pressures of the water are unknown as well: they stand between
displacements and rotations, divided by their size (`water.PoreBlocks`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp

from geoident.fem.solvers.direct import Factor, SolverCounts
from geoident.fem.stiffness import StiffnessPattern
from geoident.forward.analysis.constitutive import MaterialPoints
from geoident.forward.analysis.stage import StageTask
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.structures.limits import given_back
from geoident.forward.structures.strain_points import STRESSES, MemberPoints
from geoident.model.arrays import Bools, Floats, Ints

_MOST_TURNS, _MOST_CUTS = 60, 40
"""Newton steps for rotations, and shares of one that are tried; a few are usual."""

_TURNED = 1e-13
"""Of the largest moment at work: what rotations leave out of balance."""

_STIFF = 1e-10
"""Part of the elastic stiffness that is left to rotations: two hinges at a node leave one free."""

_FLAT = 0.1
"""Slope of the potential at the end of a step, as part of that at its beginning, that is none."""


class StagePoints:
    """Strain points of the ground, and of members that yield; what moves them, and the water.

    Motions are displacements (n_dofs), pressures of all nodes by their size (n_pores; none where no
    water flows) and rotations of members (n_turns), one behind the other.

    Args:
        systems: the equations of the stages.
        task: the stage.

    Attributes:
        members: those that yield, or None.
        volume: (m,) of all points.
        dofs: (n,) places of the unknowns among the motions.
        n_pores: number of pressures; those that are given stay zero.
        n_free: number of them that are free.
    """

    def __init__(self, systems: StageSystems, task: StageTask) -> None:
        self._ground, self._structures = systems.discretization.points, systems.structures
        self._task, self.members = task, systems.member_points(task.state)
        self.volume, self.dofs = task.system.volume, task.system.dofs
        self.n_pores, self.n_free, self._size = 0, 0, 1.0
        if task.water is not None and task.water.blocks is not None:
            blocks = task.water.blocks
            self.n_pores, self.n_free, self._size = (
                task.water.n_nodes,
                len(blocks.nodes),
                blocks.size,
            )
            self.dofs = np.concatenate([self.dofs, self.n_dofs + blocks.nodes])
        if self.members is not None:
            self.volume = np.concatenate([self.volume, self.members.weight])
            turns = self.n_dofs + self.n_pores + np.arange(self.members.n_turns)
            self.dofs = np.concatenate([self.dofs, turns])

    @property
    def n_ground(self) -> int:
        """Number of strain points of the ground."""
        return self._ground.n_points

    @property
    def n_points(self) -> int:
        """Number m of all strain points."""
        return len(self.volume)

    @property
    def n_dofs(self) -> int:
        """Number of displacements."""
        return self._ground.n_dofs

    @property
    def n_turns(self) -> int:
        """Number of rotations."""
        return 0 if self.members is None else self.members.n_turns

    @property
    def units(self) -> Floats:
        """(n_motions, 1) of motions: 1 of displacements and rotations, Pa/m of pressures."""
        units = np.ones((self.n_dofs + self.n_pores + self.n_turns, 1))
        units[self._pores] = self._size
        return units

    @property
    def _pores(self) -> slice:
        return slice(self.n_dofs, self.n_dofs + self.n_pores)

    @property
    def _turns(self) -> slice:
        return slice(self.n_dofs + self.n_pores, None)

    def extended(self, forces: Floats) -> Floats:
        """Forces (n_dofs, ...) with what acts on pressures and rotations, which is zero."""
        rest = self.n_pores + self.n_turns
        return np.concatenate([forces, np.zeros((rest, *forces.shape[1:]))]) if rest else forces

    def given_forces(self, columns: slice) -> Floats:
        """What acts on all motions (n_motions, c): forces, and the right sides of the water.

        Args:
            columns: c columns of what the analysis carries.
        """
        task = self._task
        forces = self.extended(task.forces[:, columns])
        if task.water is not None and self.n_pores:
            forces[self._pores] = self._size * task.water.right(task.motion)[:, columns]
        return forces

    def without_water(self, du: Floats) -> Floats:
        """Displacements and rotations of motions (n_motions,)."""
        return np.concatenate([du[: self.n_dofs], du[self._turns]])

    def water_forces(self, du: Floats) -> Floats:
        """The left sides (n_motions, ...) of what water does at motions (n_motions, ...)."""
        forces = np.zeros_like(du)
        water = self._task.water
        if water is not None and self.n_pores:
            pressures = self._size * du[self._pores]
            forces[: self.n_dofs], right = water.internal(du[: self.n_dofs], pressures)
            forces[self._pores] = self._size * right
        return forces

    def add_water_derivatives(self, du: Floats, forces: Floats) -> None:
        """Add what derivatives of Q, S and H make of motions to what acts on them.

        Args:
            du: (n_motions,)
            forces: (n_motions, n + k), changed in place.
        """
        task, water = self._task, self._task.water
        if water is None:
            return
        u, pressures = du[: self.n_dofs], water.jump[:, 0].copy()
        if task.motion is not None:
            u = u + task.motion[:, 0]
        if self.n_pores:
            pressures += self._size * du[self._pores]
        right = np.zeros((water.n_nodes, forces.shape[1]))
        water.slopes(forces[: self.n_dofs], right, u, pressures)
        if self.n_pores:
            forces[self._pores] += self._size * right

    def strain(self, u: Floats) -> Floats:
        """Strains (s, m, ...) of motions (n_motions, ...)."""
        strain = self._ground.strain(u[: self.n_dofs])
        if self.members is None:
            return strain
        more = self.members.strain(u[: self.n_dofs], u[self._turns])
        return np.concatenate([strain, more], axis=1)

    def forces(self, stress: Floats, volume: Floats) -> Floats:
        """Forces and moments (n_motions, ...) of stresses (s, m, ...)."""
        n = self.n_ground
        forces = self.extended(self._ground.forces(stress[:, :n], volume[:n]))
        if self.members is not None:
            more, moments = self.members.forces(stress[:, n:], volume[n:])
            forces[: self.n_dofs] += more
            forces[self._turns] = moments
        return forces

    def elastic_forces(self, forces: Floats) -> Floats:
        """Forces and moments (n_motions, k) of structures that do not yield.

        Args:
            forces: q (n_rows, k) of all structures.
        """
        if self.members is not None:
            forces = np.where(self.members.yields[:, None], 0.0, forces)
        return self.extended(self._structures.nodal_forces(forces))

    def carried(self, columns: slice) -> Floats:
        """Stresses (s, m, c) with which the stage begins, a copy."""
        return self._with_members(columns, self._task.carried.members)

    def trial(self, columns: slice) -> Floats:
        """The same with what comes back as open interfaces close: what elastic stress adds to."""
        carried = self._task.carried
        return self._with_members(columns, carried.members + carried.relieved)

    def _with_members(self, columns: slice, forces: Floats) -> Floats:
        stress = self._task.carried.stress[..., columns]
        if self.members is None:
            return stress.copy()
        return np.concatenate([stress, self.members.of_rows(forces[:, columns])], axis=1)

    def carry(self, stress: Floats, du: Floats) -> None:
        """Carry on the stresses at the end of the stage, and the forces of structures.

        Args:
            stress: (s, m, 1 + n + k) at its end.
            du: (n_motions, 1 + n + k); their derivatives by moduli are carried already.
        """
        carried = self._task.carried
        carried.stress[:] = stress[:, : self.n_ground]
        self._task.add_member_forces(self._structures, du[: self.n_dofs], slice(None))
        if self.members is None:
            return
        elastic = carried.members + carried.relieved
        self.members.into_rows(stress[:, self.n_ground :], carried.members)
        for part in self.members.parts:
            plastic = elastic[part.rows] - carried.members[part.rows]
            relieved = given_back(part.structure, self._task.point, plastic)
            if relieved is not None:
                carried.relieved[part.rows[0]] = relieved

    def add_stiffness_derivatives(
        self, systems: StageSystems, du: Floats, stress: Floats, members: Floats
    ) -> None:
        """Add dE/dp_h eps of all points, see `StageTask`.

        Args:
            systems: the equations of the stages.
            du: (n_motions,), without what supports impose.
            stress: dsigma/dp (s, m, n + k), changed in place.
            members: derivatives (n_rows, n + k) of the forces of structures, changed in place.
        """
        task, n = self._task, self.n_ground
        u = du[: self.n_dofs]
        task.add_stiffness_derivatives(systems, u, stress[:, :n], members)
        if self.members is None:
            return
        strain = self.members.strain(u, du[self._turns])
        if task.motion is not None:
            imposed = self._structures.strain(task.motion[:, :1])
            strain += self.members.of_rows(imposed)[..., 0]
        for part in self.members.parts:
            place = slice(n + part.points.start, n + part.points.stop)
            for c, rows in enumerate(part.rows):
                slopes = task.rigidities[rows, 1:] * strain[c, part.points, None]
                stress[c, place, : task.n] += slopes


class Turning:
    """Rotations in equilibrium with displacements: those at which the potential is least.

    Newton's method with a line search, which ends as the potential is convex and piecewise
    quadratic. So iterations of the stage see displacements alone: two ends of members that both
    flow at a node leave its rotation free, and steps in it would mean nothing.

    Args:
        members: the members.
        grounds: they as materials, their points numbered among them.
        stress: (s, m) before the stage.
    """

    def __init__(
        self, members: MemberPoints, grounds: Sequence[MaterialPoints], stress: Floats
    ) -> None:
        self._members, self._grounds, self._stress = members, grounds, stress
        self._elastic = np.zeros((len(members), STRESSES, STRESSES))
        for ground in grounds:
            numbers = np.arange(len(members))[ground.points]
            self._elastic[numbers] = ground.elasticity.matrices(numbers)[:, :STRESSES, :STRESSES]
        self._elastic *= members.weight[:, None, None]
        self._by = members.turns.toarray().reshape(STRESSES, len(members), -1)

    def balanced(self, u: Floats, turns: Floats) -> Floats:
        """Rotations (n_turns,) in equilibrium with displacements (n_dofs,), from a first guess."""
        members = self._members
        moved = members.strain(u, 0.0 * turns)
        rest, tangent, scale = self._at(moved, turns)
        for _ in range(_MOST_TURNS):
            if np.abs(rest).max() <= _TURNED * scale:
                break
            way = sl.cho_solve(sl.cho_factor(tangent), rest)
            whole, low, high = float(rest @ way), 0.0, 1.0
            share, at_low, at_high = 1.0, whole, 0.0
            for _ in range(_MOST_CUTS):
                rest, tangent, scale = self._at(moved, turns + share * way)
                descent = float(rest @ way)
                if (descent > 0.0 and share == 1.0) or abs(descent) <= _FLAT * whole:
                    break
                if descent > 0.0:
                    low, at_low, at_high = share, descent, 0.5 * at_high
                else:
                    high, at_high, at_low = share, descent, 0.5 * at_low
                share = (low * at_high - high * at_low) / (at_high - at_low)
            turns = turns + share * way
        return turns

    def _at(self, moved: Floats, turns: Floats) -> tuple[Floats, Floats, float]:
        """Moments (n_turns,) that are left, their tangent, and the largest moment at work."""
        members, by = self._members, self._by
        strain = moved.copy()
        strain[:STRESSES] += by @ turns
        stress, blocks = self._stress.copy(), self._elastic.copy()
        for ground in self._grounds:
            response = ground.integrate_stress(stress, strain, 0.0)
            if response is not None:
                change = (1.0 - _STIFF) * response.tangent_change[:, :STRESSES, :STRESSES]
                blocks[response.points] += change * members.weight[response.points][:, None, None]
        weighted = stress[:STRESSES] * members.weight
        elastic = np.einsum("mij,jm->im", self._elastic, strain[:STRESSES])
        trial = np.abs(self._stress[:STRESSES] * members.weight) + np.abs(elastic)
        size = float(np.einsum("imt,im->t", np.abs(by), trial).max())
        rows, turned = by.reshape(-1, len(turns)), np.einsum("mij,jmt->imt", blocks, by)
        tangent = rows.T @ turned.reshape(rows.shape)
        return -(rows.T @ weighted.ravel()), tangent, size


def _by_blocks(blocks: Floats) -> sp.csr_array:
    """(3 m, 3 m) of matrices (m, 3, 3) at points, component by component."""
    m = len(blocks)
    columns = np.arange(m)[:, None] + m * np.arange(STRESSES)
    data, rows = blocks.transpose(1, 0, 2).ravel(), np.arange(STRESSES * m + 1)
    entries = (data, np.tile(columns.ravel(), STRESSES), STRESSES * rows)
    return sp.csr_array(entries, shape=(STRESSES * m, STRESSES * m))


class MemberTangents:
    """Tangents of the members that yield, on the pattern of K.

    What rotations follow couples all nodes of its beam and is made as one dense matrix; points
    without rotations, of bars and interfaces, add their own.

    Args:
        members: the members.
        moduli: (n_rows,) D of all structures.
        pattern: of K.
    """

    def __init__(self, members: MemberPoints, moduli: Floats, pattern: StiffnessPattern) -> None:
        self._members, m = members, len(members)
        turn = (np.diff(members.turns.indptr).reshape(STRESSES, m) > 0).any(axis=0)
        self._turning, self._alone = np.flatnonzero(turn), np.asarray(~turn)
        bent = self._rows(members.motion, self._turning)
        self._moving = np.unique(bent.indices)
        self._motion = sp.csr_array(sp.csc_array(bent)[:, self._moving])
        self._turns = self._rows(members.turns, self._turning)
        D = np.zeros((STRESSES, m))
        for part in members.parts:
            D[: len(part.rows), part.points] = moduli[part.rows]
        self._elastic = np.zeros((m, STRESSES, STRESSES))
        self._elastic[:, range(STRESSES), range(STRESSES)] = (D * members.weight).T
        lower, n_dofs = pattern.lower, members.motion.shape[1]
        self._nnz = len(lower.indices)
        self._unknown = np.full(n_dofs, -1, dtype=np.int64)
        self._unknown[pattern.dofs] = np.arange(lower.n)
        self._unknowns = self._unknown[self._moving]
        self._keys = (np.repeat(np.arange(lower.n), np.diff(lower.indptr)) << 32) | lower.indices
        i, j = np.tril_indices(len(self._moving))
        place, held = self._places_of(self._unknowns[i], self._unknowns[j])
        self._pairs, self._places = (i[~held], j[~held]), place[~held]

    def _rows(self, operator: sp.csr_array, points: Ints) -> sp.csr_array:
        """The rows of some points (q,), component by component."""
        rows = np.arange(STRESSES)[:, None] * len(self._members) + points
        return sp.csr_array(operator[rows.ravel()])

    def _places_of(self, one: Ints, other: Ints) -> tuple[Ints, Bools]:
        """Places (k,) in K of pairs of unknowns, and which of them it does not have."""
        key = (np.minimum(one, other) << 32) | np.maximum(one, other)
        place = np.minimum(np.searchsorted(self._keys, key), self._nnz - 1)
        return place, (np.minimum(one, other) < 0) | (self._keys[place] != key)

    @cached_property
    def _condensed_elastic(self) -> Floats:
        """(k, k) of the displacements that move beams: what K has of them."""
        return self._condensed(self._elastic[self._turning])[0]

    def added(self, points: Ints, change: Floats) -> tuple[Floats, Floats, _Turning]:
        """What changes at some members add to K, (nnz,) below and above, and how rotations follow.

        Args:
            points: (q,) members, ascending.
            change: (q, s, s) changes of w D.
        """
        change = change[:, :STRESSES, :STRESSES]
        alone = self._alone[points]
        below, above = self._direct(points[alone], change[alone])
        blocks = self._elastic.copy()
        blocks[points] += change
        stiffness, turning = self._condensed(blocks[self._turning])
        added = (stiffness - self._condensed_elastic)[self._pairs]
        np.add.at(below, self._places, added)
        np.add.at(above, self._places, added)
        return below, above, turning

    def _direct(self, points: Ints, change: Floats) -> tuple[Floats, Floats]:
        """What points (q,) without rotations add, (nnz,) below and above the diagonal."""
        motion = self._rows(self._members.motion, points)
        matrix = sp.coo_array(motion.T @ (_by_blocks(change) @ motion))
        row, column = self._unknown[matrix.coords[0]], self._unknown[matrix.coords[1]]
        place, held = self._places_of(row, column)
        sums = []
        for side in (row >= column, row <= column):
            some = side & ~held
            total = np.zeros(self._nnz)
            np.add.at(total, place[some], matrix.data[some])
            sums.append(total)
        return sums[0], sums[1]

    def _condensed(self, blocks: Floats) -> tuple[Floats, _Turning]:
        """S (k, k) of moduli (q, 3, 3) times weights of beams, and how rotations follow."""
        D = _by_blocks(blocks)
        turns = self._turns
        by_motion, by_turns = D @ self._motion, D @ turns
        coupling = (self._motion.T @ by_turns).toarray()
        stiffness = (self._motion.T @ by_motion).toarray()
        if not self._members.n_turns:
            return stiffness, _Turning(self._unknowns, coupling, None)
        scale = self._turn_scale
        values, modes = np.linalg.eigh((turns.T @ by_turns).toarray() * np.outer(scale, scale))
        modes *= scale[:, None]
        inverse = (modes / np.maximum(values, _STIFF)) @ modes.T
        stiffness -= coupling @ inverse @ coupling.T
        return stiffness, _Turning(self._unknowns, coupling, inverse)

    @cached_property
    def _turn_scale(self) -> Floats:
        """(n_turns,) rotations at which the elastic stiffness of each is 1."""
        turns, elastic = self._turns, _by_blocks(self._elastic[self._turning])
        return np.asarray(1.0 / np.sqrt((turns.T @ elastic @ turns).diagonal()))


class _Turning:
    """How rotations follow displacements in a tangent.

    Args:
        unknowns: (k,) numbers of the displacements that move members, -1 where fixed.
        coupling: A_ur (k, n_turns).
        inverse: A_rr^-1 (n_turns, n_turns); None where nothing turns.
    """

    def __init__(self, unknowns: Ints, coupling: Floats, inverse: Floats | None) -> None:
        free = unknowns >= 0
        self._unknowns = unknowns[free]
        self._coupling, self._inverse = coupling[free], inverse

    def expand(self, factor: Factor) -> Factor:
        """The factor of a tangent with rotations, of that without them (n unknowns)."""
        inverse, n = self._inverse, factor.n
        if inverse is None:
            return factor

        def solve(rest: Floats) -> Floats:
            forces, moments = rest[:n].copy(), rest[n:]
            forces[self._unknowns] -= self._coupling @ (inverse @ moments)
            u = factor.solve(forces)
            moments = moments - self._coupling.T @ u[self._unknowns]
            return np.concatenate([u, inverse @ moments])

        return Factor(n + self._coupling.shape[1], SolverCounts(), solve, lambda: factor.valid)
