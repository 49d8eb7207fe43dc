"""A step of the march where nothing yields (theory 2): one factorization for all columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.direct import Factor, NotPositiveDefinite
from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.march.state import Carried, StageTask
from geoident.forward.march.systems import StageSystems
from geoident.forward.stages import ConstructionState
from geoident.model.arrays import Floats


class LastFactor:
    """The last factorization of a march, good as long as K stays the same.

    K depends on the material of every present group, and on the structures. One is held, not one
    for every stage: in three dimensions a factor is the largest thing in memory.
    """

    def __init__(self) -> None:
        self._ground: object = None
        self._factor: Factor | None = None

    def find(self, state: ConstructionState) -> Factor | None:
        """The factorization of K at a state, if it is the one that is held and still there."""
        if self._factor is None or self._ground != _what_stands(state) or not self._factor.valid:
            return None
        return self._factor

    def forget(self) -> None:
        """Make room for the next one."""
        self._ground, self._factor = None, None

    def keep(self, state: ConstructionState, factor: Factor) -> None:
        """A factorization that was made for a state."""
        self._ground, self._factor = _what_stands(state), factor


def elastic_step(task: StageTask, systems: StageSystems, last: LastFactor) -> Floats:
    """Bring a state to equilibrium.

    The state comes first, since the derivatives need its strains.

    Args:
        task: the stage; what it carries is brought to its end.
        systems: the equations of the stages.
        last: the last factorization of this march.

    Returns:
        (n_dofs, 1 + n + k) displacement steps.

    Raises:
        ModelError: the stiffness is not positive definite.
    """
    factor, structures = _factorize(task, systems, last), systems.structures
    first = _advance(task, systems, factor, task.carried.columns(slice(1)), task.forces[:, :1])
    if task.forces.shape[1] == 1:
        return first
    strain = systems.discretization.points.strain(first[:, 0])
    if task.thermal is not None:
        strain[:NORMAL_COMPONENTS] -= task.thermal[:, 0]
    add_moduli_slopes(task, strain, task.carried.stress[..., 1:])
    members = task.carried.members[:, 1 : 1 + task.n]
    members += task.moduli[:, 1:] * structures.strain(first)
    rest = task.carried.columns(slice(1, None))
    others = _advance(task, systems, factor, rest, task.forces[:, 1:])
    return np.hstack([first, others])


def add_moduli_slopes(task: StageTask, strain: Floats, slopes: Floats) -> None:
    """dsigma/dp_h += dE/dp_h eps for the moduli that depend on parameters.

    Args:
        task: the stage.
        strain: eps (s, n_points) of the step, without thermal strains.
        slopes: (s, n_points, n + k), changed in place.
    """
    for material, mine in task.system.points_of.items():
        elasticity = task.ground.elasticity(material)
        for column in range(task.n):
            slope = elasticity.slope(column)
            if slope is not None:
                slopes[:, mine, column] += slope @ strain[:, mine]


def not_positive_definite(stage: str, place: str) -> ModelError:
    """The elastic stiffness of a stage has a mechanism at some place."""
    msg = f"at stage '{stage}' the stiffness matrix is not positive definite{place}"
    hint = "look there for elements without stiffness, or held by next to nothing"
    return ModelError(msg, hint)


def _advance(
    task: StageTask, systems: StageSystems, factor: Factor | None, carried: Carried, forces: Floats
) -> Floats:
    """Balance forces and what is carried in some columns; updates the latter, returns du."""
    points, structures = systems.discretization.points, systems.structures
    rest = forces - points.forces(carried.stress, task.system.volume)
    if structures.n_rows:
        rest -= structures.nodal_forces(carried.members)
    du = np.zeros_like(rest)
    if factor is not None:
        dofs = task.system.pattern.dofs
        du[dofs] = factor.solve(rest[dofs])
    strain, moduli = points.strain(du), task.elasticity()
    for material, mine in task.system.points_of.items():
        carried.stress[:, mine] += np.tensordot(moduli[material], strain[:, mine], axes=1)
    if structures.n_rows:
        carried.members[:] += task.moduli[:, :1] * structures.strain(du)
    return du


def _factorize(task: StageTask, systems: StageSystems, last: LastFactor) -> Factor | None:
    """Factorization of K_j; None where every displacement is prescribed."""
    system, state = task.system, task.state
    analysis = systems.analysis(system)
    if analysis is None:
        return None
    found = last.find(state)
    if found is not None:
        return found
    last.forget()
    try:
        values = systems.values(system, state, task.elasticity(), task.point.values)
        factor = analysis.factorize(values)
    except NotPositiveDefinite as error:
        place = systems.describe_unknown(system, error.unknown)
        raise not_positive_definite(state.name, place) from error
    last.keep(state, factor)
    return factor


def _what_stands(state: ConstructionState) -> tuple[Mapping[int, str], frozenset[str], set[str]]:
    """On what K depends: the material of every group, the structures, those under a given force."""
    return state.materials, state.structures, set(state.stressed)
