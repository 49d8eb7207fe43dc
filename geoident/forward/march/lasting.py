"""Ground that no stage touches follows the rest (theory 2.1).

Once such ground is in equilibrium, and what acts on it inside stays as it is, no later stage leaves
a force on its inner nodes: neither on those of the state nor, where its moduli grow in proportion,
on those of the derivatives. It then acts on the rest by the forces of its border alone. These need
no stresses: at the end of a stage they balance all others,

    F_L = f - C_N^T V sigma_N          (N: the ground that is not lasting, and structures)

So a stage is solved for the other unknowns (`DirectFactor.solve_rest`), the inner nodes follow them
by half a pass through their part of the factor, and the stresses there,

    sigma_L = sigma_L0 + E C (u - u_0)
    dsigma_L/dp = dsigma_L0/dp + E C (c (u - u_0) + du/dp - du_0/dp)     (dE/dp = c E)

are made when somebody asks for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geoident.fem.elasticity import UniformModuli
from geoident.fem.kinematics import StrainPoints
from geoident.fem.solvers.direct import DirectFactor, Factor
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.march.stage import (
    Carried,
    GivenStress,
    LastingSince,
    StageTask,
    StressAtEnd,
)
from geoident.forward.march.systems import StageSystem, StageSystems
from geoident.forward.stages import numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint

_STILL = 1e-14
"""Change of the forces on inner nodes, relative to the largest, that is rounding."""

_VIRGIN = 1e-13
"""Force on inner nodes of virgin ground, relative to the largest, that is rounding."""

_SAME = 1e-12
"""Difference of slopes of moduli, relative, that is rounding."""


@dataclass(frozen=True, eq=False)
class _Near:
    """What is not lasting in a stage.

    Args:
        volume: (q,) V of its strain points, zero where absent.
        points_of: material to its points, counted among the q.
        places: (m,) where the unknowns that are not the first stand among the outer ones.
    """

    volume: Floats
    points_of: Mapping[str, Ints]
    places: Ints


class LastingGround:
    """The ground of a case that no stage touches, on its mesh.

    Args:
        systems: the equations of the stages.
        changes: (n_nodes,) nodes of ground that changes, and of structures.
        lasts: (n_points,) strain points of ground that does not change.
    """

    def __init__(self, systems: StageSystems, changes: Bools, lasts: Bools) -> None:
        self._systems = systems
        points = systems.discretization.points
        dim = points.kinematics.dim
        self._far, self._near = np.flatnonzero(lasts), np.flatnonzero(~lasts)
        self._lasts = lasts
        of_node = np.repeat(changes, dim)
        self._outer, self._inner = np.flatnonzero(of_node), np.flatnonzero(~of_node)
        self._place = np.full(len(of_node), -1)
        self._place[self._outer] = np.arange(len(self._outer))
        touched = np.zeros(len(changes), dtype=bool)
        touched[sp.csr_array(points.gradients[0][self._far]).indices] = True
        self._beside = np.repeat(~touched[changes], dim)
        self._ready: dict[int, _Near] = {}

    @cached_property
    def _operators(self) -> StrainPoints:
        """The strain points that are not lasting, on the outer nodes alone."""
        points, near = self._systems.discretization.points, self._near
        nodes = self._outer[:: points.kinematics.dim] // points.kinematics.dim
        gradients = tuple(sp.csr_array(D[near][:, nodes]) for D in points.gradients)
        return StrainPoints(
            points.kinematics, gradients, points.volume[near], points.element[near],
            points.position[near],
        )  # fmt: skip

    def proportions(self, ground: ModuliAt, point: ParameterPoint) -> Floats | None:
        """How the moduli of all lasting ground grow in proportion.

        Args:
            ground: its moduli.
            point: the parameters, and those to differentiate by.

        Returns:
            (n,) c with dE/dp = c E for all of it, 1/unit of p; None where there are none.
        """
        found: list[Floats] = []
        for material in self._materials:
            moduli = ground.moduli(material)
            if not isinstance(moduli.value, UniformModuli) or moduli.modes:
                return None
            E, c = moduli.value.matrix, np.zeros(len(point.names))
            top = np.unravel_index(int(np.abs(E).argmax()), E.shape)
            for k, name in enumerate(point.names):
                slope = moduli.slopes.get(name)
                if slope is None:
                    continue
                if not isinstance(slope, UniformModuli):
                    return None
                c[k] = slope.matrix[top] / E[top]
                if np.abs(slope.matrix - c[k] * E).max() > _SAME * np.abs(slope.matrix).max():
                    return None
            found.append(c)
        if not found or any((np.abs(c - found[0]) > _SAME * np.abs(c)).any() for c in found):
            return None
        return found[0]

    def step(
        self, task: StageTask, u: Floats, factor: Factor | None, proportions: Floats
    ) -> Floats | None:
        """Bring a state to equilibrium while lasting ground follows.

        Args:
            task: the stage; what it carries is brought to its end.
            u: (n_dofs, 1 + n) displacements before it.
            factor: of its stiffness.
            proportions: (n,) of the moduli.

        Returns:
            (n_dofs, 1 + n) displacement steps; None, and nothing is done, where the lasting ground
            is not known to be in equilibrium inside.
        """
        since, dofs = task.carried.since, task.system.dofs
        if since is None or not isinstance(factor, DirectFactor) or not factor.n_first:
            return None
        if task.thermal is not None or task.motion is not None:
            return None
        if not self._rests(since, task.forces):
            return None
        moving = _Step(self, task, factor, since)
        rest = moving.advance(slice(0, 1))
        moving.add_slopes(rest, since, proportions)
        if task.n:
            rest = np.hstack([rest, moving.advance(slice(1, None))])
        moving.end()
        du = np.zeros_like(u)
        du[self._outer] = rest
        du[dofs[: factor.n_first]] = factor.first_of(rest[moving.near.places])
        return du

    def begin(self, task: StageTask, u: Floats) -> None:
        """All was solved in a stage: from now on the lasting ground may follow.

        Args:
            task: the stage, at its end.
            u: (n_dofs, 1 + n) displacements there.
        """
        near = self.near(task.number, task.system)
        pull = self.balance(task, near, task.carried.stress[:, self._near], slice(None))
        task.carried.since = LastingSince(
            u.copy(), task.carried.stress[..., 0].copy(), task.forces[self._inner], pull
        )

    def begin_virgin(self, task: StageTask, u: Floats) -> None:
        """Let lasting ground follow from the virgin state on, if it is in equilibrium inside.

        Args:
            task: the virgin state, in which nothing was solved.
            u: (n_dofs, 1 + n) displacements, zero.
        """
        points, stress, forces = (
            self._systems.discretization.points,
            task.carried.stress,
            task.forces,
        )
        of_far = points.forces(stress, np.where(self._lasts, task.system.volume, 0.0))
        free = task.system.dofs[self._place[task.system.dofs] < 0]
        rest = np.abs(forces[free] - of_far[free]).max(axis=0, initial=0.0)
        scale = np.maximum(np.abs(of_far).max(axis=0), np.abs(forces).max(axis=0))
        if (rest <= _VIRGIN * scale).all():
            task.carried.since = LastingSince(
                u.copy(), stress[..., 0].copy(), forces[self._inner], of_far[self._outer]
            )

    def near(self, number: int, system: StageSystem) -> _Near:
        """What is not lasting in a state."""
        if number not in self._ready:
            order = np.full(len(self._lasts), -1)
            order[self._near] = np.arange(len(self._near))
            points_of = {}
            for material, mine in system.points_of.items():
                found = order[numbers(mine, len(order))]
                if len(found := found[found >= 0]):
                    points_of[material] = found
            places = self._place[system.dofs]
            self._ready[number] = _Near(system.volume[self._near], points_of, places[places >= 0])
        return self._ready[number]

    def balance(self, task: StageTask, near: _Near, stress: Floats, columns: slice) -> Floats:
        """Forces (n_outer, k) on the lasting ground's border that balance all others.

        Args:
            task: the stage.
            near: what is not lasting in it.
            stress: (s, q, 1 + n) there.
            columns: which k of the 1 + n.
        """
        found = self.unbalanced(task, near, stress, columns)
        found[self._beside] = 0.0
        return found

    def unbalanced(self, task: StageTask, near: _Near, stress: Floats, columns: slice) -> Floats:
        """Forces (n_outer, k) of all but the lasting ground.

        Args:
            task: the stage.
            near: what is not lasting in it.
            stress: (s, q, 1 + n) there.
            columns: which k of the 1 + n.
        """
        rest = task.forces[self._outer, columns]
        rest -= self._operators.forces(stress[..., columns], near.volume)
        structures = self._systems.structures
        if structures.n_rows:
            rest -= structures.nodal_forces(task.carried.members[:, columns])[self._outer]
        return rest

    def strain(self, moved: Floats) -> Floats:
        """Strains (s, q, k) of what is not lasting, of displacements (n_outer, k)."""
        return self._operators.strain(moved)

    def spread(self, moved: Floats) -> Floats:
        """Displacements (n_dofs, k) of the outer nodes (n_outer, k), of the inner ones none."""
        found = np.zeros((len(self._place), moved.shape[1]))
        found[self._outer] = moved
        return found

    def carried_near(self, carried: Carried) -> Floats:
        """Stresses (s, q, 1 + n) of what is not lasting, copied."""
        return carried.stress[:, self._near]

    def put_near(self, stress: Floats, near: Floats) -> None:
        """Put stresses (s, q, k) of what is not lasting in their place (s, n_points, k)."""
        stress[:, self._near] = near

    def _rests(self, since: LastingSince, forces: Floats) -> bool:
        """Whether forces (n_dofs, k) act on the inner nodes as they did."""
        change = np.abs(forces[self._inner] - since.acting).max(axis=0, initial=0.0)
        return bool((change <= _STILL * np.abs(forces).max(axis=0, initial=0.0)).all())

    @cached_property
    def _materials(self) -> tuple[str, ...]:
        """Names of the materials of lasting ground."""
        system = self._systems[0]
        n = len(self._lasts)
        return tuple(
            m for m, mine in system.points_of.items() if self._lasts[numbers(mine, n)].any()
        )

    def add_stress(self, stress: Floats, ground: ModuliAt, change: Floats) -> None:
        """Add to stresses of lasting ground what displacements make.

        Args:
            stress: (s, n_points, k), changed in place.
            ground: its moduli.
            change: (n_dofs, k) displacements.
        """
        strain = self._systems.discretization.points.strain(change)
        n = len(self._lasts)
        for material in self._materials:
            mine = numbers(self._systems[0].points_of[material], n)
            mine = mine[self._lasts[mine]]
            stress[:, mine] += ground.moduli(material).value.stress(strain[:, mine])


class _Step:
    """One stage for which the lasting ground is at rest inside."""

    def __init__(
        self, lasting: LastingGround, task: StageTask, factor: DirectFactor, since: LastingSince
    ) -> None:
        self._lasting, self._task, self._factor = lasting, task, factor
        self.near = lasting.near(task.number, task.system)
        self._stress = lasting.carried_near(task.carried)
        self._pull = since.pull.copy()
        self._structures = lasting._systems.structures
        self._moduli = task.elasticity()

    def advance(self, columns: slice) -> Floats:
        """Displacement steps (n_outer, k) that balance some columns."""
        task, near = self._task, self.near
        rest = self._lasting.unbalanced(task, near, self._stress, columns)
        rest -= self._pull[:, columns]
        moved = np.zeros_like(rest)
        moved[near.places] = self._factor.solve_rest(rest[near.places])
        strain = self._lasting.strain(moved)
        for material, mine in near.points_of.items():
            self._stress[:, mine, columns] += self._moduli[material].stress(strain[:, mine])
        if self._structures.n_rows:
            spread = self._lasting.spread(moved)
            task.carried.members[:, columns] += task.moduli[:, :1] * self._structures.strain(spread)
        self._pull[:, columns] = self._lasting.balance(task, near, self._stress, columns)
        return moved

    def add_slopes(self, moved: Floats, since: LastingSince, proportions: Floats) -> None:
        """What the step (n_outer, 1) of the state adds to the derivatives before their own."""
        task, strain = self._task, self._lasting.strain(moved)
        for material, mine in self.near.points_of.items():
            for k, name in enumerate(task.point.names):
                slope = task.ground.moduli(material).slopes.get(name)
                if slope is not None:
                    self._stress[:, mine, 1 + k] += slope.stress(strain[:, mine, 0])
        members = task.carried.members[:, 1:]
        if self._structures.n_rows:
            spread = self._lasting.spread(moved)
            members += task.moduli[:, 1:] * self._structures.strain(spread)
        self._pull[:, 1:] += (self._pull[:, :1] - since.pull[:, :1]) * proportions

    def end(self) -> None:
        """Hand on what is carried to the next stage."""
        carried = self._task.carried
        self._lasting.put_near(carried.stress, self._stress)
        assert carried.since is not None
        carried.since = replace(carried.since, pull=self._pull)


def solve_still(factor: Factor, forces: Floats) -> Floats:
    """Solutions (n, k) for forces (n, k), of which there may be none on lasting ground inside."""
    n = factor.n_first if isinstance(factor, DirectFactor) else 0
    if not n or not isinstance(factor, DirectFactor):
        return factor.solve(forces)
    inside = np.abs(forces[:n]).max(axis=0)
    if not (inside <= _VIRGIN * np.abs(forces).max(axis=0)).all():
        return factor.solve(forces)
    rest = factor.solve_rest(forces[n:])
    return np.vstack([factor.first_of(rest), rest])


@dataclass(frozen=True, eq=False)
class LastingStress:
    """Makes the stresses of lasting ground at one parameter vector.

    Args:
        lasting: the ground.
        ground: its moduli.
        proportions: (n,) of them.
    """

    lasting: LastingGround
    ground: ModuliAt
    proportions: Floats

    def update(self, stress: Floats, u: Floats, before: Floats) -> None:
        """Add to stresses (s, n_points, k) what came since displacements were others.

        Args:
            stress: (s, n_points, k), changed in place.
            u: (n_dofs, k) displacements now.
            before: (n_dofs, k) displacements when these stresses were there.
        """
        change = u - before
        if change.shape[1] > 1:
            change[:, 1:] += change[:, :1] * self.proportions
        self.lasting.add_stress(stress, self.ground, change)

    def settle(self, carried: Carried, u: Floats) -> None:
        """Bring what is carried up to date, before a stage in which all is solved.

        Args:
            carried: what is carried, changed in place.
            u: (n_dofs, 1 + n) displacements.
        """
        if carried.since is not None:
            self.update(carried.stress, u, carried.since.u)
            carried.since = None

    def at_end(self, carried: Carried, u: Floats) -> StressAtEnd:
        """The stresses at the end of a stage, made when asked for.

        Args:
            carried: what is carried.
            u: (n_dofs, 1 + n) displacements.
        """
        if carried.since is None:
            return GivenStress(carried.stress)
        near = self.lasting.carried_near(carried)
        return FollowingStress(self, carried.stress, near, u, carried.since.u, carried.since)


@dataclass(frozen=True, eq=False)
class FollowingStress:
    """Stresses at the end of a stage, of which those of lasting ground follow displacements.

    Args:
        of: makes them.
        base: (s, n_points, k) stresses, for lasting ground when displacements were others.
        near: (s, q, k) of what is not lasting.
        u: (n_dofs, k) displacements.
        before: (n_dofs, k) those others.
        since: what is known since then.
    """

    of: LastingStress
    base: Floats
    near: Floats
    u: Floats
    before: Floats
    since: LastingSince

    def whole(self) -> Floats:
        """(s, n_points, k)."""
        found = self.base.copy()
        self.of.lasting.put_near(found, self.near)
        self.of.update(found, self.u, self.before)
        return found

    def values(self) -> FollowingStress:
        """Those of column 0 alone, which stay as they are."""
        base = self.since.stress[..., None]
        near, u, before = self.near[..., :1].copy(), self.u[:, :1].copy(), self.before[:, :1]
        return FollowingStress(self.of, base, near, u, before, self.since)
