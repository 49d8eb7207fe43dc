"""The stages of a complementarity system for given plastic strains: a linear march.

With sigma^ = sigma_base - E N dlam (zero base stress in what is fresh),

    K_j du_j = F_j - C^T V sigma^       sigma_j = sigma^ + E C du_j       K_j = C^T V E C

All columns travel together; what a column stands for (a state, the effect of a parameter or of a
multiplier) is the caller's business. One factorization a stage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geoident.errors import ModelError
from geoident.model.arrays import Floats
from geoident.model.equations import LoadStage, PointSet, StagedSystem

Stresses = Mapping[int, Floats]
"""Point set to stress (s, m, K)."""

PlasticStrain = Callable[[int, int], Floats | None]
"""(stage, point set) to the step N dlam of plastic strain (s, m, K), or None for no step."""


@dataclass(frozen=True)
class ElasticStep:
    """What one stage does, in K columns.

    Args:
        stage: number of the stage.
        du: (d, K) step of the displacements.
        stress: of all present point sets, at the end.
    """

    stage: int
    du: Floats
    stress: Stresses


def elastic_march(
    system: StagedSystem,
    elasticity: Sequence[Floats],
    *,
    initial: Stresses,
    forces: Sequence[Floats],
    plastic: PlasticStrain = lambda stage, points: None,
) -> Iterator[ElasticStep]:
    """Walk through the stages.

    Args:
        system: the stages.
        elasticity: E (s, s) of every law.
        initial: stresses of all point sets before the first stage.
        forces: F (d, K) of every stage.
        plastic: steps of plastic strain.

    Yields:
        One step a stage.

    Raises:
        ModelError: the stiffness of a stage is singular.
    """
    done: list[Stresses] = []
    for number, stage in enumerate(system.stages):
        base = initial if stage.base < 0 else done[stage.base]
        stress: dict[int, Floats] = {}
        for s, law in stage.laws.items():
            bare = s in stage.fresh or s not in base
            stress[s] = np.zeros_like(initial[s]) if bare else base[s].copy()
            step = plastic(number, s)
            if step is not None:
                stress[s] -= np.tensordot(elasticity[law], step, axes=1)
        du = _balance(system, stage, elasticity, stress, forces[number])
        for s, law in stage.laws.items():
            strain = (system.sets[s].compatibility @ du).reshape(stress[s].shape)
            stress[s] += np.tensordot(elasticity[law], strain, axes=1)
        done.append(stress)
        yield ElasticStep(number, du, stress)


def readings_of(system: StagedSystem, steps: Sequence[ElasticStep]) -> Floats:
    """Readings (g, K) without what the instruments add."""
    total = np.zeros((system.rows.shape[0], steps[0].du.shape[1]))
    for step in steps:
        total += system.active[step.stage][:, None] * (system.rows @ step.du)
    return total


def weighted_transpose(points: PointSet) -> sp.csr_array:
    """C^T V, (d, s m): nodal forces of stresses."""
    return sp.csr_array(points.compatibility.T * np.tile(points.volume, points.n_strain))


def _balance(
    system: StagedSystem,
    stage: LoadStage,
    elasticity: Sequence[Floats],
    stress: Stresses,
    forces: Floats,
) -> Floats:
    """The step of the displacements (d, K) that restores equilibrium."""
    d = system.n_dofs
    rest, stiffness = forces.copy(), sp.csr_array((d, d))
    for s, law in stage.laws.items():
        points = system.sets[s]
        back = weighted_transpose(points)
        rest -= back @ stress[s].reshape(-1, forces.shape[1])
        moduli = sp.kron(sp.csr_array(elasticity[law]), sp.eye_array(points.n_points))
        stiffness = stiffness + back @ moduli @ points.compatibility
    du = np.zeros_like(rest)
    if stage.dofs.size:
        inner = sp.csc_array(stiffness[stage.dofs][:, stage.dofs])
        du[stage.dofs] = _factor(inner, stage.name).solve(rest[stage.dofs])
    return du


def _factor(stiffness: sp.csc_array, name: str) -> spla.SuperLU:
    try:
        return spla.splu(stiffness)
    except RuntimeError as error:
        raise ModelError(f"at stage '{name}' the stiffness matrix is singular") from error
