"""A step of the march where nothing yields (theory 2): one factorization for all columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.protocol import Factor, NotPositiveDefinite
from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.ground.elasticity import elasticity_slopes
from geoident.forward.march.discretization import StageSystems
from geoident.forward.march.state import Borne
from geoident.forward.march.step import StepTask
from geoident.forward.stages import State
from geoident.model.arrays import Floats
from geoident.model.case import Case


class ElasticSteps:
    """Solves stages in which nothing yields.

    Args:
        case: the case.
        systems: the equations of the stages.
    """

    def __init__(self, case: Case, systems: StageSystems) -> None:
        self._case = case
        self._systems = systems
        self._structures = systems.structures
        self._last_factor = LastFactor()

    def forget(self) -> None:
        """The parameters change, or no stage follows."""
        self._last_factor.forget()

    def step(self, task: StepTask) -> Floats:
        """Solve one state of equilibrium; updates what is borne, returns the displacement steps.

        The state comes first, since the derivatives need its strains.

        Raises:
            ModelError: the stiffness is not positive definite.
        """
        factor = self._factorize(task)
        first = self._advance(task, factor, task.borne.columns(slice(1)), task.forces[:, :1])
        if task.forces.shape[1] == 1:
            return first
        strain = self._systems.points.strain(first[:, 0])
        if task.thermal is not None:
            strain[:NORMAL_COMPONENTS] -= task.thermal[:, 0]
        self._add_moduli_slopes(task, strain)
        members = task.borne.members[:, 1 : 1 + len(task.names)]
        members += task.moduli[:, 1:] * self._structures.strain(first)
        rest = task.borne.columns(slice(1, None))
        others = self._advance(task, factor, rest, task.forces[:, 1:])
        return np.hstack([first, others])

    def _advance(
        self, task: StepTask, factor: Factor | None, borne: Borne, forces: Floats
    ) -> Floats:
        """Balance forces and what is borne in some columns; updates the latter, returns du."""
        points = self._systems.points
        rest = forces - points.forces(borne.stress, task.system.volume)
        if self._structures.n_rows:
            rest -= self._structures.nodal_forces(borne.members)
        du = np.zeros_like(rest)
        if factor is not None:
            dofs = task.system.pattern.dofs
            du[dofs] = factor.solve(rest[dofs])
        strain = points.strain(du)
        for material, mine in task.system.points_of.items():
            borne.stress[:, mine] += np.tensordot(task.laws[material], strain[:, mine], axes=1)
        if self._structures.n_rows:
            borne.members[:] += task.moduli[:, :1] * self._structures.strain(du)
        return du

    def _factorize(self, task: StepTask) -> Factor | None:
        """Factorization of K_j; None where every displacement is prescribed."""
        system, state = task.system, task.state
        analysis = self._systems.analysis(system)
        if analysis is None:
            return None
        found = self._last_factor.find(state)
        if found is not None:
            return found
        self._last_factor.forget()
        try:
            factor = analysis.factorize(self._systems.values(system, state, task.laws, task.values))
        except NotPositiveDefinite as error:
            place = self._systems.describe_unknown(system, error.unknown)
            raise not_positive_definite(state.name, place) from error
        self._last_factor.keep(state, factor)
        return factor

    def _add_moduli_slopes(self, task: StepTask, strain: Floats) -> None:
        """dsigma/dp_h += dE/dp_h eps for the moduli that depend on parameters."""
        for material, mine in task.system.points_of.items():
            slopes = elasticity_slopes(
                self._case.materials[material], task.values, self._systems.points.n_strain
            )
            for name, slope in slopes.items():
                if name in task.names:
                    column = 1 + task.names.index(name)
                    task.borne.stress[:, mine, column] += slope @ strain[:, mine]


def not_positive_definite(stage: str, place: str) -> ModelError:
    """The elastic stiffness of a stage has a mechanism at some place."""
    msg = f"at stage '{stage}' the stiffness matrix is not positive definite{place}"
    hint = "look there for elements without stiffness, or held by next to nothing"
    return ModelError(msg, hint)


class LastFactor:
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
