"""The march through the stages and its exact derivatives (theory 2).

At every stage, with sigma the stress at the end of the stage before (zero in what is placed now),

    r_j = f_j - C^T V sigma                     over the points that are present
    K_j du_j = r_j
    sigma <- sigma + E C du_j ,   u <- u + du_j

and, for every parameter h, with the same factorization,

    g_h = dsigma/dp_h + dE/dp_h C du_j
    K_j ddu_j/dp_h = df_j/dp_h - C^T V g_h
    dsigma/dp_h <- g_h + E C ddu_j/dp_h

(linings and bolts add their internal forces and stiffness in the same way, see `structures`),
so one factorization per stage and two calls of the solver give the response and its whole
Jacobian. All columns travel together: column 0 of every array is the state, columns 1..n are
the derivatives. A change of temperature takes its strain eps_0 from C du_j (see `thermal`).

Stages form a tree: u and sigma "of the stage before" are those of the stage on which a stage
builds. Load cases that do not build on each other branch off the same one. Stages in a row on the
same ground of the same materials (load cases, mostly) share one factorization.

A *push* adds forces: to the state (condensation's corrected displacements), or as further columns
that carry the response to unit forces (its flexibility). It costs no further factorization.

Computed once per mesh: C, V, the gradient products. Once per set of present groups: pattern,
analysis, which points are there. Per parameter vector and change of ground: values of K,
factorization.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from geoident.errors import CollapseError
from geoident.forward.actions.forces import Actions
from geoident.forward.actions.release import PartialRelease
from geoident.forward.actions.thermal import NORMAL_COMPONENTS, ThermalStrains
from geoident.forward.ground.elasticity import elasticity
from geoident.forward.in_situ.stress import BALANCED, InSituStress
from geoident.forward.march.base_states import Branches
from geoident.forward.march.discretization import StageSystem, StageSystems
from geoident.forward.march.elastic_step import ElasticSteps
from geoident.forward.march.plastic_step import PERFECT, PlasticOptions, PlasticSteps
from geoident.forward.march.state import Borne, Push, Standing
from geoident.forward.march.step import StepTask
from geoident.forward.stages import State, Timeline
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.mesh import Mesh


class March:
    """Marches one case on one mesh through its stages, for any parameter values."""

    def __init__(
        self,
        case: Case,
        mesh: Mesh,
        timeline: Timeline,
        systems: StageSystems,
        actions: Actions,
    ) -> None:
        self._case = case
        self._timeline = timeline
        self._systems = systems
        self._structures = systems.structures
        self._actions = actions
        self._thermal = ThermalStrains(case, timeline, systems)
        points = systems.points
        groups = timeline.group_of[points.element]
        self._virgin = InSituStress(case, mesh, points.position, groups, timeline.groups)
        self._release = PartialRelease(timeline, systems, actions)
        self._elastic = ElasticSteps(case, systems)
        self.plastic = PlasticSteps(case, systems)
        self.imbalance = 0.0
        self.collapses: list[CollapseError] = []  # of the last run, if it was to go on

    @property
    def n_outside(self) -> int:
        """Strain points beside the surface from which the in-situ stress counts depth."""
        return self._virgin.n_outside

    def virgin_tension(self, values: Mapping[str, float]) -> bool:
        """Whether most of the virgin ground is pulled on average, sigma_xx + yy + zz > 0."""
        stress = self._virgin.columns(values, ())[:NORMAL_COMPONENTS, self._systems[0].present, 0]
        return bool(np.mean(stress.sum(axis=0) > 0.0) > 0.5)

    def run(
        self,
        values: Mapping[str, float],
        *,
        names: Sequence[str] = (),
        last: int | None = None,
        push: Push | None = None,
        plastic: PlasticOptions = PERFECT,
    ) -> Iterator[Standing]:
        """Yield the standing at the end of every state, the virgin state first.

        Args:
            values: parameter values.
            names: the parameters to differentiate by.
            last: index of the last state wanted.
            push: forces beside those of the case.
            plastic: how yielding is treated.

        Raises:
            ModelError: the stiffness of a stage is not positive definite, the virgin stress is
                outside a yield surface, or the ground collapses (`CollapseError`), unless
                ``plastic`` says to go on: then that state and all that build on it are NaN.
        """
        points = self._systems.points
        n_columns = 1 + len(names)
        k = push.n_columns if push else 0
        stress = np.zeros((points.n_strain, points.n_points, n_columns + k))
        u = np.zeros((points.compatibility.shape[1], stress.shape[2]))
        borne = Borne(stress, np.zeros((self._structures.n_rows, stress.shape[2])))
        states = self._timeline.states[: None if last is None else last + 1]
        branches = Branches(states)
        self._elastic.forget()
        self.collapses = []
        self.plastic.begin(values, plastic)
        lost: set[int] = set()
        for n, state in enumerate(states):
            if n and state.base in lost:
                lost.add(n)
                yield _unknown(n, u, borne)
                continue
            branches.go_to(n, u, borne)
            forces = np.zeros_like(u)
            forces[:, :n_columns] = self._actions.forces(n, values, names)
            if push is not None:
                push.add_to(forces, n)
            try:
                yielded = self._advance(n, values, names, u, borne, forces)
            except CollapseError as error:
                if not plastic.partial:
                    raise
                self.collapses.append(error)
                lost.add(n)
                yield _unknown(n, u, borne)
                continue
            yield Standing(n, u, stress, borne.members, yielded)
            branches.leave(n, u, borne)
        self._elastic.forget()

    def _advance(
        self,
        number: int,
        values: Mapping[str, float],
        names: Sequence[str],
        u: Floats,
        borne: Borne,
        forces: Floats,
    ) -> Bools:
        """Bring a state to equilibrium; updates u (n_dofs, 1 + n + k) and what is borne.

        Returns:
            (n_points,) the strain points that yield.
        """
        still = np.zeros(self._systems.points.n_points, dtype=bool)
        if number == 0:
            self._begin(values, names, borne, forces)
            return still
        system, state = self._systems[number], self._timeline.states[number]
        forces += self._release.forces(number, borne.stress, values, names)
        self._clear(system, state, borne, u)
        strain = self._thermal.change(number, values, names)
        task = self._task(number, values, names, borne, forces, strain)
        du, yielded = (
            self.plastic.step(task)
            if self.plastic.yields(state)
            else (self._elastic.step(task), still)
        )
        u += du
        return yielded

    def _begin(
        self, values: Mapping[str, float], names: Sequence[str], borne: Borne, forces: Floats
    ) -> None:
        """Set the in-situ stress; bring it to equilibrium if it is not, and forget the motion.

        What is out of balance is small; it is taken as elastic. Where the stress then is must be
        inside the yield surfaces.
        """
        system, stress = self._systems[0], borne.stress
        stress[..., : 1 + len(names)] = self._virgin.columns(values, names)
        stress[:, ~system.present] = 0.0
        self.imbalance = self._imbalance(system, stress, forces)
        task = self._task(0, values, names, borne, forces)
        if self.imbalance > BALANCED:
            self._elastic.step(task)
        self.plastic.refuse_virgin(task)

    def virgin(self, values: Mapping[str, float], names: Sequence[str]) -> tuple[Floats, float]:
        """The in-situ stress (n_strain, n_points, 1 + n) as given, and its imbalance.

        The imbalance is the largest out-of-balance force relative to the forces at work; nothing
        is factorized.
        """
        system, stress = self._systems[0], self._virgin.columns(values, names)
        stress[:, ~system.present] = 0.0
        forces = self._actions.forces(0, values, names)
        return stress, self._imbalance(system, stress, forces)

    def _imbalance(self, system: StageSystem, stress: Floats, forces: Floats) -> float:
        """Largest out-of-balance force of a free unknown relative to the forces at work."""
        internal = self._systems.points.forces(stress, system.volume)
        rest = np.abs(forces - internal)[system.pattern.dofs].max(axis=0, initial=0.0)
        scale = np.maximum(np.abs(internal).max(axis=0), np.abs(forces).max(axis=0))
        return float(np.max(rest / np.where(scale > 0, scale, 1.0)))

    def _clear(self, system: StageSystem, state: State, borne: Borne, u: Floats) -> None:
        """What is gone or placed anew bears nothing; nodes that are gone forget their motion."""
        borne.clear(~system.present)
        for group in state.placed:
            borne.clear(self._systems.points_of[group])
        self._structures.clear(state, borne.members)
        u[~system.touched] = 0.0

    def _task(
        self,
        number: int,
        values: Mapping[str, float],
        names: Sequence[str],
        borne: Borne,
        forces: Floats,
        thermal: Floats | None = None,
    ) -> StepTask:
        """A state to be brought to equilibrium.

        ``thermal`` is the normal strain (n_points, 1 + n) of a change of temperature.
        """
        system, state = self._systems[number], self._timeline.states[number]
        laws = {
            m: elasticity(self._case.materials[m], values, self._systems.points.n_strain)
            for m in set(state.materials.values())
        }
        if thermal is not None:
            _impose(thermal, system, laws, borne.stress)
        moduli = self._structures.moduli(state, values, names)
        return StepTask(number, system, state, values, names, laws, borne, forces, moduli, thermal)


def _unknown(state: int, u: Floats, borne: Borne) -> Standing:
    """A state that is not reached."""
    still = np.zeros(borne.stress.shape[1], dtype=bool)
    return Standing(state, u * np.nan, borne.stress * np.nan, borne.members * np.nan, still)


def _impose(
    thermal: Floats, system: StageSystem, laws: Mapping[str, Floats], stress: Floats
) -> None:
    """Take E eps_0 from the stress, with the derivatives of eps_0; those of E come later."""
    for material, mine in system.points_of.items():
        pressure = laws[material][:, :NORMAL_COMPONENTS].sum(axis=1)
        stress[:, mine, : thermal.shape[1]] -= pressure[:, None, None] * thermal[mine]
