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
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.protocol import Factor, NotPositiveDefinite
from geoident.forward.actions import Actions
from geoident.forward.in_situ import InSituStress
from geoident.forward.materials import elasticity, elasticity_slopes
from geoident.forward.release import PartialRelease
from geoident.forward.stage_systems import StageSystem, StageSystems
from geoident.forward.thermal import NORMAL_COMPONENTS, ThermalStrains
from geoident.forward.timeline import State, Timeline
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.mesh import Mesh

_BALANCED = 1e-9
"""Largest out-of-balance force, relative to the forces at work, that counts as equilibrium."""


@dataclass(frozen=True)
class Push:
    """Forces along the readings, beside those of the case.

    Args:
        forces: (n_dofs, g) unit force along each reading, N.
        active: (n_states, g) how it acts in each state: 1, not at all, 0, or against it, -1.
        multipliers: (g,) the forces act on the state, so many times; None: each unit force has a
            further column, which carries its response.
    """

    forces: Floats
    active: Floats
    multipliers: Floats | None = None

    @property
    def n_columns(self) -> int:
        """Number of further columns."""
        return 0 if self.multipliers is not None else int(self.forces.shape[1])

    def add_to(self, forces: Floats, state: int) -> None:
        """Add to the forces (n_dofs, 1 + n + k) of a state."""
        if self.multipliers is not None:
            forces[:, 0] += self.forces @ (self.active[state] * self.multipliers)
        elif self.n_columns:
            forces[:, -self.n_columns :] = self.forces * self.active[state]


@dataclass(frozen=True)
class Standing:
    """Where the march stands at the end of a state. Arrays are the march's own: copy to keep.

    Args:
        state: index of the state.
        u: (n_dofs, 1 + n + k) displacements since placing, m, and their derivatives.
        stress: (n_strain, n_points, 1 + n + k), Pa.
        members: (n_rows, 1 + n + k) forces in linings and bolts (`structures`).
    """

    state: int
    u: Floats
    stress: Floats
    members: Floats


@dataclass(frozen=True)
class _Borne:
    """What ground and structures bear, changed in place.

    Args:
        stress: (n_strain, n_points, k), Pa.
        members: (n_rows, k) forces in linings and bolts.
    """

    stress: Floats
    members: Floats

    def columns(self, part: slice) -> _Borne:
        """Some of its columns, not copied."""
        return _Borne(self.stress[..., part], self.members[:, part])


class _LastFactor:
    """The last factorization, good as long as K stays the same.

    Only for one parameter vector. K depends on it and on the material of every present group. One
    is held, not one for every stage: in three dimensions a factor is the largest thing in memory.
    """

    def __init__(self) -> None:
        self._standing: object = None
        self._factor: Factor | None = None

    def find(self, state: State) -> Factor | None:
        """The factorization of K at a state, if it is the one that is held."""
        return self._factor if self._standing == _what_stands(state) else None

    def forget(self) -> None:
        """Make room for the next one."""
        self._standing, self._factor = None, None

    def keep(self, state: State, factor: Factor) -> None:
        """A factorization that was made for a state."""
        self._standing, self._factor = _what_stands(state), factor


def _what_stands(state: State) -> tuple[Mapping[int, str], frozenset[str]]:
    """On what K depends: the material of every group, and the structures."""
    return state.materials, state.structures


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
        self._last_factor = _LastFactor()
        self.imbalance = 0.0

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
    ) -> Iterator[Standing]:
        """Yield the standing at the end of every state, the virgin state first.

        Args:
            values: parameter values.
            names: the parameters to differentiate by.
            last: index of the last state wanted.
            push: forces beside those of the case.

        Raises:
            ModelError: the stiffness of a stage is not positive definite.
        """
        points = self._systems.points
        n_columns = 1 + len(names)
        k = push.n_columns if push else 0
        stress = np.zeros((points.n_strain, points.n_points, n_columns + k))
        u = np.zeros((points.compatibility.shape[1], stress.shape[2]))
        borne = _Borne(stress, np.zeros((self._structures.n_rows, stress.shape[2])))
        states = self._timeline.states[: None if last is None else last + 1]
        branches = _Branches(states)
        self._last_factor.forget()
        for n, state in enumerate(states):
            branches.go_to(n, u, borne)
            system = self._systems[n]
            forces = np.zeros_like(u)
            forces[:, :n_columns] = self._actions.forces(n, values, names)
            if push is not None:
                push.add_to(forces, n)
            if n == 0:
                self._begin(system, state, values, names, borne, forces)
            else:
                forces += self._release.forces(n, stress, values, names)
                self._clear(system, state, borne, u)
                strain = self._thermal.change(n, values, names)
                u += self._step(system, state, values, names, borne, forces, strain)
            yield Standing(n, u, stress, borne.members)
            branches.leave(n, u, borne)
        self._last_factor.forget()

    def _begin(
        self,
        system: StageSystem,
        state: State,
        values: Mapping[str, float],
        names: Sequence[str],
        borne: _Borne,
        forces: Floats,
    ) -> None:
        """Set the in-situ stress; bring it to equilibrium if it is not, and forget the motion."""
        n_columns, stress = 1 + len(names), borne.stress
        stress[..., :n_columns] = self._virgin.columns(values, names)
        stress[:, ~system.present] = 0.0
        self.imbalance = self._imbalance(system, stress, forces)
        if self.imbalance > _BALANCED:
            self._step(system, state, values, names, borne, forces)

    def _imbalance(self, system: StageSystem, stress: Floats, forces: Floats) -> float:
        """Largest out-of-balance force of a free unknown relative to the forces at work."""
        internal = self._systems.points.forces(stress, system.volume)
        rest = np.abs(forces - internal)[system.pattern.dofs].max(axis=0, initial=0.0)
        scale = np.maximum(np.abs(internal).max(axis=0), np.abs(forces).max(axis=0))
        return float(np.max(rest / np.where(scale > 0, scale, 1.0)))

    def _clear(self, system: StageSystem, state: State, borne: _Borne, u: Floats) -> None:
        """What is gone or placed anew bears nothing; nodes that are gone forget their motion."""
        borne.stress[:, ~system.present] = 0.0
        for group in state.placed:
            borne.stress[:, self._systems.points_of[group]] = 0.0
        self._structures.clear(state, borne.members)
        u[~system.touched] = 0.0

    def _step(
        self,
        system: StageSystem,
        state: State,
        values: Mapping[str, float],
        names: Sequence[str],
        borne: _Borne,
        forces: Floats,
        thermal: Floats | None = None,
    ) -> Floats:
        """Solve one state of equilibrium; updates what is borne, returns the displacement steps.

        The state comes first, since the derivatives need its strains. ``thermal`` is the normal
        strain (n_points, 1 + n) of a change of temperature.
        """
        laws = {
            m: elasticity(self._case.materials[m], values, self._systems.points.n_strain)
            for m in set(state.materials.values())
        }
        if thermal is not None:
            _impose(thermal, system, laws, borne.stress)
        moduli = self._structures.moduli(state, values, names)
        factor = self._factorize(system, state, laws, values)
        first = self._advance(system, laws, moduli, factor, borne.columns(slice(1)), forces[:, :1])
        if forces.shape[1] == 1:
            return first
        strain = self._systems.points.strain(first[:, 0])
        if thermal is not None:
            strain[:NORMAL_COMPONENTS] -= thermal[:, 0]
        self._add_moduli_slopes(system, values, names, borne.stress, strain)
        borne.members[:, 1 : 1 + len(names)] += moduli[:, 1:] * self._structures.strain(first)
        others = self._advance(
            system, laws, moduli, factor, borne.columns(slice(1, None)), forces[:, 1:]
        )
        return np.hstack([first, others])

    def _advance(
        self,
        system: StageSystem,
        laws: Mapping[str, Floats],
        moduli: Floats,
        factor: Factor | None,
        borne: _Borne,
        forces: Floats,
    ) -> Floats:
        """Balance forces and what is borne in some columns; updates the latter, returns du."""
        points = self._systems.points
        rest = forces - points.forces(borne.stress, system.volume)
        if self._structures.n_rows:
            rest -= self._structures.nodal_forces(borne.members)
        du = np.zeros_like(rest)
        if factor is not None:
            du[system.pattern.dofs] = factor.solve(rest[system.pattern.dofs])
        strain = points.strain(du)
        for material, mine in system.points_of.items():
            borne.stress[:, mine] += np.tensordot(laws[material], strain[:, mine], axes=1)
        if self._structures.n_rows:
            borne.members[:] += moduli[:, :1] * self._structures.strain(du)
        return du

    def _factorize(
        self,
        system: StageSystem,
        state: State,
        laws: Mapping[str, Floats],
        values: Mapping[str, float],
    ) -> Factor | None:
        """Factorization of K_j; None where every displacement is prescribed."""
        analysis = self._systems.analysis(system)
        if analysis is None:
            return None
        found = self._last_factor.find(state)
        if found is not None:
            return found
        self._last_factor.forget()
        try:
            factor = analysis.factorize(self._systems.values(system, state, laws, values))
        except NotPositiveDefinite as error:
            place = self._systems.describe_unknown(system, error.unknown)
            msg = f"at stage '{state.name}' the stiffness matrix is not positive definite{place}"
            hint = "look there for elements without stiffness, or held by next to nothing"
            raise ModelError(msg, hint) from error
        self._last_factor.keep(state, factor)
        return factor

    def _add_moduli_slopes(
        self,
        system: StageSystem,
        values: Mapping[str, float],
        names: Sequence[str],
        stress: Floats,
        strain: Floats,
    ) -> None:
        """dsigma/dp_h += dE/dp_h eps for the moduli that depend on parameters."""
        for material, mine in system.points_of.items():
            slopes = elasticity_slopes(
                self._case.materials[material], values, self._systems.points.n_strain
            )
            for name, slope in slopes.items():
                if name in names:
                    stress[:, mine, 1 + names.index(name)] += slope @ strain[:, mine]


class _Branches:
    """Keeps what later states build on, as long as they need it, and no longer."""

    def __init__(self, states: Sequence[State]) -> None:
        self._bases = [state.base for state in states]
        self._last_use = {base: n for n, base in enumerate(self._bases) if base != n - 1}
        self._kept: dict[int, tuple[Floats, Floats, Floats]] = {}

    def go_to(self, state: int, u: Floats, borne: _Borne) -> None:
        """Put the displacements and stresses in place on which a state builds."""
        base = self._bases[state]
        if base == state - 1 or state == 0:
            return
        u[:], borne.stress[:], borne.members[:] = self._kept[base]
        if self._last_use[base] == state:
            del self._kept[base]

    def leave(self, state: int, u: Floats, borne: _Borne) -> None:
        """Copy them where a later state builds on this one, but not the next."""
        if self._last_use.get(state, -1) > state:
            self._kept[state] = (u.copy(), borne.stress.copy(), borne.members.copy())


def _impose(
    thermal: Floats, system: StageSystem, laws: Mapping[str, Floats], stress: Floats
) -> None:
    """Take E eps_0 from the stress, with the derivatives of eps_0; those of E come later."""
    for material, mine in system.points_of.items():
        pressure = laws[material][:, :NORMAL_COMPONENTS].sum(axis=1)
        stress[:, mine, : thermal.shape[1]] -= pressure[:, None, None] * thermal[mine]
