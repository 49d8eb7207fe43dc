"""What a forward model hands to condensation.

The complementarity system of a staged model (theory 5) as plain arrays.

At every stage, building on the stage ``base`` (the state before the first stage for -1),

    sigma_j = sigma_base + E (C du_j - N dlam_j)          sigma_base = 0 in what the stage places
    C^T V sigma_j = F_j                                   on the free degrees of freedom
    psi_j = N^T sigma_j - k - H (lam_base + dlam_j) <= 0,   dlam_j >= 0,   psi_j^T dlam_j = 0

with F, k, H, E and the initial stress affine in the parameters p, and readings v that add up the
steps of the stages between their zero and their own:

    v_a = sum_j active[j, a] G_a du_j + offset_a

N is fixed: what turns a plane (a friction angle) is not of this form.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.model.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Condensed:
    """The condensed equations of an affine elastic model at one parameter vector (theory 4.1).

    With the displacements corrected so that they meet the measured readings, the equation error of
    the parameters q, carried to the gauges by the frozen model, is ``matrix @ q - vector``.
    At q = p it equals measured - v(p) as far as the readings are independent.

    Args:
        readings: (g,) v(p).
        flexibility: (g, g) S = G K^-1 G^T; its inverse turns an error in readings to one in forces.
        matrix: (g, n).
        vector: (g,).
    """

    readings: Floats
    flexibility: Floats
    matrix: Floats
    vector: Floats


@dataclass(frozen=True)
class Affine:
    """An array a_0 + sum_h p_h a_h.

    Args:
        constant: a_0, (...).
        slopes: a_h, (..., n).
    """

    constant: Floats
    slopes: Floats

    def at(self, p: Floats) -> Floats:
        """The array at parameters p (n,).

        >>> Affine(np.ones(2), np.eye(2)).at(np.array([3.0, 5.0]))
        array([4., 6.])
        """
        return np.asarray(self.constant + self.slopes @ p)

    @property
    def depends_on(self) -> Bools:
        """(n,) which parameters move it."""
        axes = tuple(range(self.slopes.ndim - 1))
        return np.asarray(np.any(self.slopes != 0.0, axis=axes))


def fixed(array: Floats, n: int) -> Affine:
    """An array (...) that none of n parameters moves."""
    return Affine(array, np.zeros((*array.shape, n)))


@dataclass(frozen=True)
class PointSet:
    """Strain points that come, go and change their law together.

    Args:
        name: in messages.
        compatibility: C, (s m, d) sparse, component by component: row c m + i is component c of
            point i; 1/m.
        volume: V, (m,), m3.
        initial: (s, m) stress before the first stage, Pa.
    """

    name: str
    compatibility: sp.csr_array
    volume: Floats
    initial: Affine

    @property
    def n_points(self) -> int:
        """Number m of strain points."""
        return int(self.volume.shape[0])

    @property
    def n_strain(self) -> int:
        """Number s of strain components."""
        return int(self.initial.constant.shape[0])


@dataclass(frozen=True)
class PointLaw:
    """The law of a material: elastic where it has no plane (y = 0).

    Args:
        elasticity: E, (s, s), Pa.
        normals: n, (y, s), dimensionless.
        distances: k, (y,), Pa.
        hardening: H, (y, y), Pa; zero for perfect plasticity.
    """

    elasticity: Affine
    normals: Floats
    distances: Affine
    hardening: Affine

    @property
    def n_planes(self) -> int:
        """Number y of planes."""
        return int(self.normals.shape[0])


@dataclass(frozen=True)
class LoadStage:
    """One stage.

    Args:
        name: of the stage.
        base: index of the stage it builds on; -1 for the state before the first.
        laws: index of the law of every point set that is present.
        fresh: point sets that begin without stress and without history.
        dofs: (f,) free degrees of freedom.
        forces: F, (d,), N.
    """

    name: str
    base: int
    laws: Mapping[int, int]
    fresh: frozenset[int]
    dofs: Ints
    forces: Affine


@dataclass(frozen=True)
class StagedSystem:
    """All stages of one identification problem.

    Args:
        names: the n parameters.
        sets: point sets.
        laws: laws.
        stages: J stages; each comes after the one on which it builds.
        rows: G, (g, d) sparse; readings are in m where the rows are dimensionless.
        active: (J, g) weight of the step of a stage in a reading.
        offset: (g,) what the instruments add.
    """

    names: tuple[str, ...]
    sets: tuple[PointSet, ...]
    laws: tuple[PointLaw, ...]
    stages: tuple[LoadStage, ...]
    rows: sp.csr_array
    active: Floats
    offset: Affine

    @property
    def n_dofs(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.rows.shape[1])

    @property
    def n_pairs(self) -> int:
        """Number of complementarities: planes of present points, over all stages."""
        return sum(
            self.sets[s].n_points * self.laws[law].n_planes
            for stage in self.stages
            for s, law in stage.laws.items()
        )
