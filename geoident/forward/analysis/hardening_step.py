"""A stage of ground whose stress follows from a law with a state (theory 19).

What a stage changes comes in parts, one after the other, each an equilibrium of its own:

    r = f_0 + share (f - f_0) - C^T V sigma(state, C du) = 0 ,

where f_0 holds what is carried into the stage. Newton's method takes the consistent tangents of the
points, which are not symmetric. A part that does not converge is halved. Interfaces, structures and
other ground that yield are further points, returned to their limits at the end of each part
(`StagePoints`, theory 5).

In a part of a step in time pressures of water are further unknowns (theory 18.6). Their equations
are linear: what the water does comes in the same parts, and pushes the ground from then on. What
comes at once and what first drains after it, however long that takes, comes in ten parts; later
parts of steps are one each.

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
from geoident.fem.yielding.domain import NoProjection, NoReturn
from geoident.fem.yielding.hardening_equations import Solution
from geoident.fem.yielding.hardening_soil import HardeningSoil
from geoident.forward.analysis.constitutive import MaterialPoints, PlasticResponse
from geoident.forward.analysis.plastic_step import PlasticSteps
from geoident.forward.analysis.stage import LastEquilibrium, StageTask
from geoident.forward.analysis.stage_points import StagePoints
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.tangents import StageTangents
from geoident.forward.hardening.soils import past_stress, soil_constants
from geoident.forward.stages import ConstructionState, numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case, format_path
from geoident.model.dual import ParameterPoint

PARTS = 10
"""Parts of a stage, of equal loads; of one that lasts, of what comes at once, and of its first step
in time."""

_LEAST_PART = 1.0 / 640.0
"""Part of a stage below which one that does not converge is not halved."""

_BALANCED, _ROUNDED = 1e-11, 1e-8
"""Out-of-balance force, by the largest at work, that ends a part; that at which it may, where it
falls no more."""

_MOST_STEPS, _MOST_CUTS = 25, 6

_ELASTIC_PART = 1e-9
"""Of the elastic stiffness, left where the tangent is singular: on the edge of two pairs of equal
principal stresses nothing resists what would part them."""

_OUTSIDE = 0.02
"""Part of the strength by which the stress from which ground begins may be beyond it. Stress at
rest at the passive limit is so after the step that brings it to equilibrium; the first step returns
it."""


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
    """Motions of a part, what the points that yield change of E there, and what is left.

    Args:
        du: (n_motions,)
        points: (q,) with a tangent of their own, ascending.
        change: (q, s, s) of V E there.
        solutions: of the parts of each soil.
        residual: (n,) of the unknowns.
        imbalance: the largest of them, by the largest force or flow at work.
    """

    du: Floats
    points: Ints
    change: Floats
    solutions: list[list[Solution]]
    residual: Floats
    imbalance: float


class HardeningSteps:
    """Solves the stages of one analysis in which ground hardens.

    Args:
        case: the case.
        systems: the equations of the stages.
        point: the parameters, with the derivatives that travel with the analysis.
        plastic: knows what else yields; None where nothing does.
    """

    def __init__(
        self,
        case: Case,
        systems: StageSystems,
        point: ParameterPoint,
        plastic: PlasticSteps | None,
    ) -> None:
        self._case, self._systems, self._plastic = case, systems, plastic
        self._points = systems.discretization.points
        soils = {name: m for name, m in case.materials.items() if m.soil is not None}
        self._laws = {
            name: HardeningSoil(soil_constants(material, point), self._points.n_strain)
            for name, material in soils.items()
        }
        self._past = {name: past_stress(m.soil, point) for name, m in soils.items() if m.soil}
        self._vertical = 2 if self._points.n_strain == 6 else 1

    def acts(self, state: ConstructionState) -> bool:
        """Whether any material of a state is a hardening soil."""
        return any(material in self._laws for material in state.materials.values())

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
            past = self._past[soil.name]
            states[:, soil.points] = soil.law.begun(stress, before, past, self._vertical)

    def step(self, task: StageTask, guess: Floats | None = None) -> tuple[Floats, Bools]:
        """Solve a stage, or a part of a step in time; what is carried is brought to its end.

        Args:
            task: the stage; of a part of a step with the forces at its end, and its water.
            guess: (n_motions,) what it may need; None for nothing.

        Returns:
            Motions (n_motions, 1 + n + k) as in `StagePoints`, pressures in Pa: first of all
            displacement steps (n_dofs) beside those that supports impose. And which strain points
            (n_points,) yield.

        Raises:
            CollapseError: no equilibrium was found under the whole load.
            ModelError: the stiffness is singular, or a stress is beyond the strength.
        """
        self.begin(task)
        everything, points = slice(None), StagePoints(self._systems, task)
        start = points.forces(points.carried(everything), points.volume)
        start += points.elastic_forces(task.carried.members)
        change = points.given_forces(everything) - start
        total, done = np.zeros_like(start), 0.0
        yields = np.zeros(points.n_ground, dtype=bool)
        later = task.water is not None and task.water.span[0] > 0.0
        parts = [1.0] if later else [1.0 / PARTS] * PARTS
        guess = np.zeros(len(total)) if guess is None else guess / points.units[:, 0]
        others = [] if self._plastic is None else self._plastic.limited(task, points)
        last: _Iterate | None = None
        while parts:
            share = parts.pop()
            target = start + (done + share) * change
            part = _PartOfStage(self._systems, task, self._present(task), others, share, target)
            try:
                du, yields, responses, last = part.solve(share * guess, last)
            except _NotSolved:
                if share <= _LEAST_PART:
                    raise self._no_equilibrium(task, done, total, yields) from None
                parts += [0.5 * share, 0.5 * share]
                continue
            total += du
            done += share
            start += part.pushed(du)
            guess = du[:, 0] / share
            if self._plastic is not None:
                end = points.carried(slice(0, 1))[..., 0]
                self._plastic.note(task, responses, others, end)
        return total * points.units, yields

    def _present(self, task: StageTask) -> list[_Soil]:
        n = self._points.n_points
        return [
            _Soil(name, numbers(points, n), self._laws[name])
            for name, points in task.system.points_of.items()
            if name in self._laws
        ]

    def _no_equilibrium(
        self, task: StageTask, done: float, total: Floats, yields: Bools
    ) -> CollapseError:
        flows = task.water is not None and task.water.h > 0.0
        beyond = "" if flows else f" beyond {100.0 * done:.3g} % of what it changes"
        msg = f"at {task.moment} no equilibrium was found{beyond}: "
        msg += "the ground comes to its limit load there, or its stiffness to none"
        hint = "Raise the strengths (their start values or bounds), or see whether the stage lacks "
        hint += "support or loads more than is meant. Soil without cohesion that carries no stress "
        hint += "has no stiffness: give it a little cohesion."
        if flows:  # of a part of a step nothing is told
            return CollapseError(msg, hint, stage=task.state.name, fraction=np.nan)
        moved = total[: self._points.n_dofs, 0].copy()
        reached = LastEquilibrium(moved, task.carried.stress[..., 0].copy(), yields)
        return CollapseError(
            msg, hint, stage=task.state.name, fraction=done, reached=reached, proven=False
        )


class _PartOfStage:
    """The equations of one part of a stage.

    Args:
        systems: the equations of the stages.
        task: the stage; what is carried is that at the beginning of the part.
        soils: that are there.
        others: that yield beside them.
        share: of the stage.
        target: (n_motions, 1 + n + k) forces at the end of the part.
    """

    def __init__(
        self,
        systems: StageSystems,
        task: StageTask,
        soils: list[_Soil],
        others: list[MaterialPoints],
        share: float,
        target: Floats,
    ) -> None:
        motion = None if task.motion is None else share * task.motion
        water = None if task.water is None else task.water.part(share)
        self._systems, self._ground = systems, systems.discretization.points
        self._soils, self._others, self._target = soils, others, target
        self._carried = task.carried
        self._task = replace(task, carried=task.carried.copy(), motion=motion, water=water)
        self._points = points = StagePoints(systems, self._task)
        self._moduli = task.moduli_by_material()
        self._tangents = StageTangents(systems, task, self._moduli, points)
        begin = points.carried(slice(0, 1))[..., 0]
        self._trial = points.trial(slice(0, 1))[..., 0]
        work = np.random.default_rng(0).choice([-1.0, 1.0], points.n_points)
        alone = points.forces(begin * work, points.volume)
        self._at_work = max(_largest(points.without_water(f)) for f in (target[:, 0], alone))

    def solve(
        self, guess: Floats, last: _Iterate | None
    ) -> tuple[Floats, Bools, list[PlasticResponse], _Iterate]:
        """Motions (n_motions, 1 + n + k), which points of the ground yield, what else, the end.

        Carries stress and state.

        Args:
            guess: (n_motions,) to begin with.
            last: the end of the part before.

        Raises:
            _NotSolved: Newton's method did not end.
        """
        try:
            end = self._newton(guess, last)
            return (*self._carry(end), end)
        except (NoReturn, NoProjection, NotPositiveDefinite) as error:
            raise _NotSolved from error

    def pushed(self, du: Floats) -> Floats:
        """What the water of the part does (n_motions, 1 + n + k) from then on.

        Args:
            du: (n_motions, 1 + n + k) of the part.
        """
        forces = -self._points.water_forces(du)
        self._points.add_water_derivatives(du[:, 0], forces[:, 1:])
        return forces

    def _newton(self, guess: Floats, last: _Iterate | None) -> _Iterate:
        """The end of the part."""
        iterate, dofs = self._at(guess, last), self._points.dofs
        for _ in range(_MOST_STEPS):
            if iterate.imbalance <= _BALANCED:
                return iterate
            step = np.zeros_like(guess)
            step[dofs] = self._factor(iterate).solve(iterate.residual[:, None])[:, 0]
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
            except (NoReturn, NoProjection):
                continue
            if following.imbalance <= max(2.0 * iterate.imbalance, _ROUNDED):
                return following
        raise _NotSolved

    def _at(self, du: Floats, near: _Iterate | None) -> _Iterate:
        """Stresses, tangents and residual at motions (n_motions,), which are near others."""
        task, points, n_strain = self._task, self._points, self._ground.n_strain
        structures = self._systems.structures
        u = du[: points.n_dofs]
        strain, members = points.strain(du), structures.strain(u)
        if task.motion is not None:
            imposed = structures.strain(task.motion[:, 0])
            members = members + imposed
            strain[:, : points.n_ground] += self._ground.strain(task.motion[:, 0])
            if points.members is not None:
                strain[:, points.n_ground :] += points.members.of_rows(imposed[:, None])[..., 0]
        stress = self._trial.copy()
        for name, place in task.system.points_of.items():
            stress[:, place] += self._moduli[name].stress(strain[:, place])
        places, changes, solutions = [], [], []
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
                by_constants=False,
                near=near.solutions[n] if near else (),
            )
            solutions.append(end.solutions)
            stress[:, soil.points] = end.stress[..., 0]
            places.append(soil.points)
            changes.append(np.moveaxis(end.stress[..., 1:], 1, 0) - soil.law.elasticity)
        for ground in self._others:
            stress[:, ground.points] = self._trial[:, ground.points]
            response = ground.integrate_stress(stress, strain, 0.0)
            assert response is not None
            places.append(response.points)
            changes.append(response.tangent_change)
        internal = points.forces(stress, points.volume)
        if structures.n_rows:
            forces = self._carried.members[:, 0] + task.rigidities[:, 0] * members
            internal += points.elastic_forces(forces[:, None])[:, 0]
        internal += points.water_forces(du)
        residual, rest = np.zeros_like(du), self._target[:, 0] - internal
        residual[points.dofs] = rest[points.dofs]
        scale = max(self._at_work, _largest(points.without_water(internal))) or 1.0
        worst = _largest(points.without_water(residual)) / scale
        if points.n_pores:
            scale = max(scale, _largest(internal), _largest(self._target[:, 0]))
            worst = max(worst, _largest(residual) / scale)
        place = np.concatenate(places)
        order = np.argsort(place, kind="stable")
        place = place[order]
        change = np.concatenate(changes)[order] * points.volume[place][:, None, None]
        return _Iterate(du, place, change, solutions, residual[points.dofs], worst)

    def _factor(self, iterate: _Iterate) -> Factor:
        """Of the consistent tangent."""
        try:
            return self._tangents.factorize(iterate.points, iterate.change, symmetric=False)
        except NotPositiveDefinite:
            less = (1.0 - _ELASTIC_PART) * iterate.change
            return self._tangents.factorize(iterate.points, less, symmetric=False)

    def _carry(self, end: _Iterate) -> tuple[Floats, Bools, list[PlasticResponse]]:
        """Bring what is carried to the end of the part, with its derivatives."""
        task, points, systems = self._task, self._points, self._systems
        n_dofs, dofs, rest = points.n_dofs, points.dofs, slice(1, None)
        du = np.zeros_like(self._target)
        du[:, 0] = end.du
        moved = np.zeros((n_dofs, du.shape[1]))  # with what supports impose
        if task.motion is not None:
            moved[:, : task.motion.shape[1]] = task.motion
            task.add_stress(systems, task.motion, slice(0, task.motion.shape[1]))
        moved[:, 0] += end.du[:n_dofs]
        trial = points.trial(slice(None))
        trial[..., :1] += self._elastic(du[:, :1])
        if du.shape[1] > 1:
            members = task.carried.members[:, rest]
            points.add_stiffness_derivatives(systems, end.du, trial[..., rest], members)
            stress = self._returned(trial, moved, end)[0]
            forces = self._target[:, rest] - points.forces(stress[..., rest], points.volume)
            forces -= points.elastic_forces(members)
            points.add_water_derivatives(end.du, forces)
            if len(dofs):
                du[dofs, rest] = self._factor(end).solve(forces[dofs])
            trial[..., rest] += self._elastic(du[:, rest])
            moved[:, rest] += du[:n_dofs, rest]
        stress, yields, responses = self._returned(trial, moved, end)
        points.carry(stress, du)
        self._carried.take(task.carried)
        return du, yields, responses

    def _elastic(self, du: Floats) -> Floats:
        """E C du (s, m, c) of motions (n_motions, c)."""
        stress = self._points.strain(du)
        for name, place in self._task.system.points_of.items():
            stress[:, place] = self._moduli[name].stress(stress[:, place])
        for ground in self._others:
            if ground.of_structure:
                stress[:, ground.points] = ground.elasticity.stress(stress[:, ground.points])
        return stress

    def _returned(
        self, trial: Floats, moved: Floats, at: _Iterate
    ) -> tuple[Floats, Bools, list[PlasticResponse]]:
        """Stresses (s, m, 1 + n + k) at the end of the part; the state of soils is carried.

        Args:
            trial: (s, m, 1 + n + k) elastic ones.
            moved: (n_dofs, 1 + n + k) displacements.
            at: the end of the part.

        Returns:
            The stresses, which points of the ground yield, and what yields beside the soils.
        """
        stress, responses = trial.copy(), list[PlasticResponse]()
        yields = np.zeros(self._points.n_points, dtype=bool)
        for soil, known in zip(self._soils, at.solutions, strict=True):
            strain = self._ground.strain(moved, soil.points)
            before, states = self._carried, self._carried.hardened[soil.name]
            end = soil.law.integrate(
                before.stress[:, soil.points],
                states[:, soil.points],
                strain,
                known=known,
            )
            stress[:, soil.points] = end.stress
            self._task.carried.hardened[soil.name][:, soil.points] = end.state
            yields[soil.points] = end.yields
        for ground in self._others:
            assert ground.law is not None
            projection = ground.law.project(trial[:, ground.points, 0].copy(), ground.hardened)
            stress[:, ground.points, 0] = projection.stress
            place = numbers(ground.points, self._points.n_points)[projection.yielded]
            response = PlasticResponse(ground, projection, place)
            if trial.shape[2] > 1:
                slopes, _ = response.derivatives(trial[:, place, 1:], of_law=True)
                stress[:, place, 1:] = slopes
            yields[place] = True
            responses.append(response)
        return stress, yields[: self._points.n_ground], responses


def _largest(forces: Floats) -> float:
    return float(np.abs(forces).max(initial=0.0))
