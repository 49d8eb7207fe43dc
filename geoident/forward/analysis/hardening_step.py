"""A stage of ground whose stress follows from a law with a state (theory 19).

What a stage changes comes in parts, one after the other, each an equilibrium of its own:

    r = f_0 + share (f - f_0) - C^T V sigma(state, C du) = 0 ,

where f_0 holds what is carried into the stage. Newton's method takes the consistent tangents of the
points, which are not symmetric. A part that does not converge is halved.

Derivatives go from part to part with stress and state. With g_h = dsigma/dp_h at kept du,

    K_T ddu/dp_h = df/dp_h - C^T V g_h ,

one factorization at the end of a part for all columns; then stress and state follow from C ddu.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import CollapseError, ModelError
from geoident.fem.location import format_point
from geoident.fem.solvers.direct import Factor, NotPositiveDefinite
from geoident.fem.yielding.domain import NoReturn
from geoident.fem.yielding.hardening_soil import HardeningSoil, Solution
from geoident.forward.analysis.stage import LastEquilibrium, StageTask
from geoident.forward.analysis.stage_points import StagePoints
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.tangents import StageTangents
from geoident.forward.hardening.soils import SoilLaws
from geoident.forward.stages import ConstructionState, numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case, format_path
from geoident.model.dual import ParameterPoint

PARTS = 10
"""Parts of a stage, of equal loads."""

POINT_PARTS = 2
"""Parts of the strain of each of them at a strain point."""

_LEAST_PART = 1.0 / 640.0
"""Part of a stage below which one that does not converge is not halved."""

_BALANCED, _ROUNDED = 1e-11, 1e-8
"""Out-of-balance force, by the largest at work, that ends a part; that at which it may, where it
falls no more."""

_MOST_STEPS, _MOST_CUTS = 25, 6

_ELASTIC_PART = 1e-9
"""Of the elastic stiffness, left where the tangent is singular: on the edge of two pairs of equal
principal stresses nothing resists what would part them."""

_OUTSIDE = 1e-6
"""Part of the strength by which a stress in situ may be beyond it: rounding."""


class _NotSolved(ArithmeticError):
    """Newton's method did not end."""


@dataclass(frozen=True, eq=False)
class _Soil:
    """The points of a soil in a stage, ascending."""

    name: str
    points: Ints
    law: HardeningSoil


@dataclass(frozen=True, eq=False)
class _Iterate:
    """At a displacement step: of each soil tangents less E and solutions, and what is left."""

    du: Floats
    changes: list[Floats]
    solutions: list[list[Solution]]
    residual: Floats
    imbalance: float


class HardeningSteps:
    """Solves the stages of one analysis in which ground hardens.

    Args:
        case: the case.
        systems: the equations of the stages.
        point: the parameters, with the derivatives that travel with the analysis.
    """

    def __init__(self, case: Case, systems: StageSystems, point: ParameterPoint) -> None:
        self._case, self._systems = case, systems
        self._points = systems.discretization.points
        self._soils = SoilLaws(dict(case.materials), point, self._points.n_strain)
        self._vertical = 2 if self._points.n_strain == 6 else 1

    def acts(self, state: ConstructionState) -> bool:
        """Whether any material of a state is a hardening soil."""
        return any(material in self._soils.laws for material in state.materials.values())

    def begin(self, task: StageTask) -> None:
        """Give the points that have no state yet the state that their stress implies.

        Raises:
            ModelError: the stress of a point is beyond its strength.
        """
        carried = task.carried
        for soil in self._present(task):
            if soil.name not in carried.hardened:
                carried.hardened[soil.name] = np.zeros(
                    (soil.law.n_state, *carried.stress.shape[1:])
                )
            states, stress = carried.hardened[soil.name], carried.stress[:, soil.points]
            before = states[:, soil.points]
            ratio = np.where(before[1, :, 0] == 0.0, soil.law.mobilised(stress[..., 0]), 0.0)
            worst = int(np.argmax(ratio))
            if ratio[worst] > 1.0 + _OUTSIDE:
                at = format_point(self._points.position[soil.points[worst]])
                msg = f"the stress from which '{soil.name}' begins at stage '{task.state.name}' is "
                msg += f"beyond its strength near {at}, by a factor of {ratio[worst]:.3g}"
                hint = "Raise the strength, or correct the in-situ stress (K0): the ground must "
                hint += "carry it."
                path = ("materials", soil.name, "yield")
                where = self._case.source.locate(path)
                raise ModelError(msg, hint, location=where, path=format_path(path))
            past = self._soils.past[soil.name]
            states[:, soil.points] = soil.law.begun(stress, before, past, self._vertical)

    def step(self, task: StageTask) -> tuple[Floats, Bools]:
        """Solve a stage; what is carried is brought to its end.

        Returns:
            (n_dofs, 1 + n + k) displacement steps beside those that supports impose, and which
            strain points (n_points,) yield.

        Raises:
            CollapseError: no equilibrium was found under the whole load.
            ModelError: the stiffness is singular, or a stress is beyond the strength.
        """
        self.begin(task)
        carried, systems = task.carried, self._systems
        start = self._points.forces(carried.stress, task.system.volume)
        if systems.structures.n_rows:
            start += systems.structures.nodal_forces(carried.members)
        change = task.forces - start
        total, done = np.zeros_like(task.forces), 0.0
        yields = np.zeros(carried.stress.shape[1], dtype=bool)
        parts, guess = [1.0 / PARTS] * PARTS, np.zeros(len(total))
        while parts:
            share = parts.pop()
            target = start + (done + share) * change
            part = _PartOfStage(self._systems, task, self._present(task), share, target)
            try:
                du, yields = part.solve(share * guess)
            except _NotSolved:
                if share <= _LEAST_PART:
                    raise self._no_equilibrium(task, done, total, yields) from None
                parts += [0.5 * share, 0.5 * share]
                continue
            total += du
            done += share
            guess = du[:, 0] / share
        return total, yields

    def _present(self, task: StageTask) -> list[_Soil]:
        n = self._points.n_points
        return [
            _Soil(name, numbers(points, n), self._soils.laws[name])
            for name, points in task.system.points_of.items()
            if name in self._soils.laws
        ]

    def _no_equilibrium(
        self, task: StageTask, done: float, total: Floats, yields: Bools
    ) -> CollapseError:
        msg = f"at {task.moment} no equilibrium was found beyond {100.0 * done:.3g} % of what it "
        msg += "changes: the ground comes to its limit load there, or its stiffness to none"
        hint = "Raise the strengths (their start values or bounds), or see whether the stage lacks "
        hint += "support or loads more than is meant. Soil without cohesion that carries no stress "
        hint += "has no stiffness: give it a little cohesion."
        reached = LastEquilibrium(total[:, 0].copy(), task.carried.stress[..., 0].copy(), yields)
        return CollapseError(
            msg, hint, stage=task.state.name, fraction=done, reached=reached, proven=False
        )


class _PartOfStage:
    """The equations of one part of a stage.

    Args:
        systems: the equations of the stages.
        task: the stage; what is carried is that at the beginning of the part.
        soils: that are there.
        share: of the stage.
        target: (n_dofs, 1 + n + k) forces at the end of the part.
    """

    def __init__(
        self,
        systems: StageSystems,
        task: StageTask,
        soils: list[_Soil],
        share: float,
        target: Floats,
    ) -> None:
        motion = None if task.motion is None else share * task.motion
        self._systems, self._points = systems, systems.discretization.points
        self._soils, self._target = soils, target
        self._carried = task.carried
        self._task = replace(task, carried=task.carried.copy(), motion=motion)
        self._moduli = task.moduli_by_material()
        self._tangents = StageTangents(systems, task, self._moduli, StagePoints(systems, task))
        self._dofs, self._volume = task.system.dofs, task.system.volume
        self._joined = np.concatenate([soil.points for soil in soils])
        self._order = np.argsort(self._joined, kind="stable")
        work = np.random.default_rng(0).choice([-1.0, 1.0], self._points.n_points)
        alone = self._points.forces(task.carried.stress[..., 0] * work, self._volume)
        self._at_work = max(float(np.abs(f).max(initial=0.0)) for f in (target[:, 0], alone))

    def solve(self, guess: Floats) -> tuple[Floats, Bools]:
        """Displacement steps (n_dofs, 1 + n + k), and which points yield; carries stress and state.

        Args:
            guess: (n_dofs,) displacement step to begin with.

        Raises:
            _NotSolved: Newton's method did not end.
        """
        try:
            end = self._newton(guess)
            return self._carry(end)
        except (NoReturn, NotPositiveDefinite) as error:
            raise _NotSolved from error

    def _newton(self, guess: Floats) -> _Iterate:
        """The end of the part."""
        iterate = self._at(guess)
        for _ in range(_MOST_STEPS):
            if iterate.imbalance <= _BALANCED:
                return iterate
            step = np.zeros_like(guess)
            step[self._dofs] = self._factor(iterate).solve(iterate.residual[:, None])[:, 0]
            following = self._cut(iterate, step)
            if iterate.imbalance <= _ROUNDED and following.imbalance >= iterate.imbalance:
                return iterate
            iterate = following
        raise _NotSolved

    def _cut(self, iterate: _Iterate, step: Floats) -> _Iterate:
        """Follow a step, or the largest half of it that makes nothing much worse."""
        for cut in range(_MOST_CUTS):
            try:
                following = self._at(iterate.du + 0.5**cut * step, iterate)
            except NoReturn:
                continue
            if following.imbalance <= max(2.0 * iterate.imbalance, _ROUNDED):
                return following
        raise _NotSolved

    def _at(self, du: Floats, near: _Iterate | None = None) -> _Iterate:
        """Stresses, tangents and residual at a displacement step (n_dofs,), one near another."""
        task, n_strain = self._task, self._points.n_strain
        whole = du if task.motion is None else du + task.motion[:, 0]
        strain = self._points.strain(whole)
        stress = self._carried.stress[..., 0].copy()
        changes, solutions = [], []
        for name, points in task.system.points_of.items():
            stress[:, points] += self._moduli[name].stress(strain[:, points])
        for n, soil in enumerate(self._soils):
            q = len(soil.points)
            columns = np.zeros((n_strain, q, 1 + n_strain))
            columns[..., 0] = strain[:, soil.points]
            columns[..., 1:] = np.eye(n_strain)[:, None]
            before = np.zeros_like(columns)
            before[..., 0] = self._carried.stress[:, soil.points, 0]
            state = np.zeros((soil.law.n_state, q, 1 + n_strain))
            state[..., 0] = self._carried.hardened[soil.name][:, soil.points, 0]
            end = soil.law.integrate(
                before,
                state,
                columns,
                POINT_PARTS,
                by_constants=False,
                near=near.solutions[n] if near else (),
            )
            stress[:, soil.points] = end.stress[..., 0]
            change = np.moveaxis(end.stress[..., 1:], 1, 0) - soil.law.elasticity
            changes.append(change * self._volume[soil.points][:, None, None])
            solutions.append(end.solutions)
        internal = self._points.forces(stress, self._volume)
        structures = self._systems.structures
        if structures.n_rows:
            more = task.rigidities[:, 0] * structures.strain(whole)
            internal += structures.nodal_forces(self._carried.members[:, 0] + more)
        residual = (self._target[:, 0] - internal)[self._dofs]
        scale = max(self._at_work, float(np.abs(internal).max(initial=0.0))) or 1.0
        worst = float(np.abs(residual).max(initial=0.0)) / scale
        return _Iterate(du, changes, solutions, residual, worst)

    def _factor(self, iterate: _Iterate) -> Factor:
        """Of the consistent tangent."""
        points, change = self._joined[self._order], np.concatenate(iterate.changes)[self._order]
        try:
            return self._tangents.factorize(points, change, symmetric=False)
        except NotPositiveDefinite:
            less = (1.0 - _ELASTIC_PART) * change
            return self._tangents.factorize(points, less, symmetric=False)

    def _carry(self, end: _Iterate) -> tuple[Floats, Bools]:
        """Bring what is carried to the end of the part, with its derivatives."""
        task, systems, carried = self._task, self._systems, self._task.carried
        du = np.zeros_like(self._target)
        du[:, 0] = end.du
        moved = np.zeros_like(self._target)  # with what supports impose
        if task.motion is not None:
            moved[:, : task.motion.shape[1]] = task.motion
            task.add_stress(systems, task.motion, slice(0, task.motion.shape[1]))
        moved[:, 0] += end.du
        task.add_stress(systems, du[:, :1], slice(0, 1))
        if du.shape[1] > 1:
            columns = slice(1, None)
            task.add_stiffness_derivatives(
                systems, end.du, carried.stress[..., columns], carried.members[:, columns]
            )
            self._integrate(moved, end)
            rest = self._target[:, columns] - self._points.forces(
                carried.stress[..., columns], self._volume
            )
            if systems.structures.n_rows:
                rest -= systems.structures.nodal_forces(carried.members[:, columns])
            if len(self._dofs):
                du[self._dofs, columns] = self._factor(end).solve(rest[self._dofs])
            task.add_stress(systems, du[:, columns], columns)
            moved[:, columns] += du[:, columns]
        yields = self._integrate(moved, end)
        self._carried.take(carried)
        return du, yields

    def _integrate(self, moved: Floats, at: _Iterate) -> Bools:
        """Stress and state of the soils after displacements (n_dofs, 1 + n + k), carried."""
        yields = np.zeros(self._points.n_points, dtype=bool)
        for soil, known in zip(self._soils, at.solutions, strict=True):
            strain = self._points.strain(moved, soil.points)
            before, states = self._carried, self._carried.hardened[soil.name]
            end = soil.law.integrate(
                before.stress[:, soil.points],
                states[:, soil.points],
                strain,
                POINT_PARTS,
                known=known,
            )
            self._task.carried.stress[:, soil.points] = end.stress
            self._task.carried.hardened[soil.name][:, soil.points] = end.state
            yields[soil.points] = end.yields
        return yields
