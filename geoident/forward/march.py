"""The march through the stages and its exact derivatives (theory 2).

At every stage, with sigma the stress at the end of the stage before (zero in what is placed now),

    r_j = f_j - C^T V sigma                     over the points that are present
    K_j du_j = r_j
    sigma <- sigma + E C du_j ,   u <- u + du_j

and, for every parameter h, with the same factorization,

    g_h = dsigma/dp_h + dE/dp_h C du_j
    K_j ddu_j/dp_h = df_j/dp_h - C^T V g_h
    dsigma/dp_h <- g_h + E C ddu_j/dp_h

so one factorization per stage and two calls of the solver give the response and its whole
Jacobian. All columns travel together: column 0 of every array is the state, columns 1..n are
the derivatives.

A *push* adds forces: to the state (condensation's corrected displacements), or as further columns
that carry the response to unit forces (its flexibility). It costs no further factorization.

Computed once per mesh: C, V, the gradient products. Once per set of present groups: pattern,
analysis, which points are there. Per stage and parameter vector: values of K, factorization.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.protocol import Factor, NotPositiveDefinite
from geoident.forward.actions import Actions
from geoident.forward.in_situ import in_situ_stress
from geoident.forward.materials import elasticity, elasticity_slopes
from geoident.forward.stage_systems import StageSystem, StageSystems
from geoident.forward.timeline import State, Timeline
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case

_BALANCED = 1e-9
"""Largest out-of-balance force, relative to the forces at work, that counts as equilibrium."""


@dataclass(frozen=True)
class Push:
    """Forces along the readings, beside those of the case.

    Args:
        forces: (n_dofs, g) unit force along each reading, N.
        active: (n_states, g) whether it acts in each state.
        multipliers: (g,) the forces act on the state, so many times; None: each unit force has a
            further column, which carries its response.
    """

    forces: Floats
    active: Bools
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
    """

    state: int
    u: Floats
    stress: Floats


class March:
    """Marches one case on one mesh through its stages, for any parameter values."""

    def __init__(
        self, case: Case, timeline: Timeline, systems: StageSystems, actions: Actions
    ) -> None:
        self._case = case
        self._timeline = timeline
        self._systems = systems
        self._actions = actions
        self.imbalance = 0.0

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
        stop = len(self._timeline.states) if last is None else last + 1
        for n, state in enumerate(self._timeline.states[:stop]):
            system = self._systems[n]
            forces = np.zeros_like(u)
            forces[:, :n_columns] = self._actions.forces(n, values, names)
            if push is not None:
                push.add_to(forces, n)
            if n == 0:
                self._begin(system, state, values, names, stress, forces)
            else:
                self._clear(system, state, stress, u)
                u += self._step(system, state, values, names, stress, forces)
            yield Standing(n, u, stress)

    def _begin(
        self,
        system: StageSystem,
        state: State,
        values: Mapping[str, float],
        names: Sequence[str],
        stress: Floats,
        forces: Floats,
    ) -> None:
        """Set the in-situ stress; bring it to equilibrium if it is not, and forget the motion."""
        n_columns = 1 + len(names)
        positions = self._systems.points.position
        stress[..., :n_columns] = in_situ_stress(self._case.in_situ, values, names, positions)
        stress[:, ~system.present] = 0.0
        self.imbalance = self._imbalance(system, stress, forces)
        if self.imbalance > _BALANCED:
            self._step(system, state, values, names, stress, forces)

    def _imbalance(self, system: StageSystem, stress: Floats, forces: Floats) -> float:
        """Largest out-of-balance force of a free unknown relative to the forces at work."""
        internal = self._systems.points.forces(stress, system.volume)
        rest = np.abs(forces - internal)[system.pattern.dofs].max(axis=0, initial=0.0)
        scale = np.maximum(np.abs(internal).max(axis=0), np.abs(forces).max(axis=0))
        return float(np.max(rest / np.where(scale > 0, scale, 1.0)))

    def _clear(self, system: StageSystem, state: State, stress: Floats, u: Floats) -> None:
        """What is gone or placed anew bears no stress; nodes that are gone forget their motion."""
        stress[:, ~system.present] = 0.0
        for group in state.placed:
            stress[:, self._systems.points_of[group]] = 0.0
        u[~system.touched] = 0.0

    def _step(
        self,
        system: StageSystem,
        state: State,
        values: Mapping[str, float],
        names: Sequence[str],
        stress: Floats,
        forces: Floats,
    ) -> Floats:
        """Solve one state of equilibrium; updates the stress, returns the displacement steps.

        The state comes first, since the derivatives need its strains.
        """
        laws = {
            m: elasticity(self._case.materials[m], values, self._systems.points.n_strain)
            for m in set(state.materials.values())
        }
        factor = self._factorize(system, state, laws)
        first = self._advance(system, laws, factor, stress[..., :1], forces[:, :1])
        if stress.shape[2] == 1:
            return first
        strain = self._systems.points.strain(first[:, 0])
        self._add_moduli_slopes(system, values, names, stress, strain)
        others = self._advance(system, laws, factor, stress[..., 1:], forces[:, 1:])
        return np.hstack([first, others])

    def _advance(
        self,
        system: StageSystem,
        laws: Mapping[str, Floats],
        factor: Factor | None,
        stress: Floats,
        forces: Floats,
    ) -> Floats:
        """Balance forces and stress in some columns; updates the stress, returns du."""
        points = self._systems.points
        rest = forces - points.forces(stress, system.volume)
        du = np.zeros_like(rest)
        if factor is not None:
            du[system.pattern.dofs] = factor.solve(rest[system.pattern.dofs])
        strain = points.strain(du)
        for material, mine in system.points_of.items():
            stress[:, mine] += np.tensordot(laws[material], strain[:, mine], axes=1)
        return du

    def _factorize(
        self, system: StageSystem, state: State, laws: Mapping[str, Floats]
    ) -> Factor | None:
        """Factorization of K_j; None where every displacement is prescribed."""
        analysis = self._systems.analysis(system)
        if analysis is None:
            return None
        try:
            return analysis.factorize(self._systems.values(system, state, laws))
        except NotPositiveDefinite as error:
            place = self._systems.describe_unknown(system, error.unknown)
            msg = f"at stage '{state.name}' the stiffness matrix is not positive definite{place}"
            hint = "look there for elements without stiffness, or held by next to nothing"
            raise ModelError(msg, hint) from error

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
