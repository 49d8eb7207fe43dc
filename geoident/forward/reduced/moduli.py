"""Moduli as a sum of few fixed matrices, and how far they are from those of a reference.

The matrices E(p) (s, s) of a material over the domain of its parameters lie in a space of few
dimensions: one where only a Young's modulus is sought, two for isotropy, five for strata, at most
s (s + 1) / 2. Whatever the map from p to E is (ratios, angles), E is linear in its coordinates
there, so stiffness matrices are sums of stored ones. Coordinates that do not give E back are
noticed.

The smallest and largest eigenvalues of E(p) against E at the reference bound the stiffness from
below and above, point by point: for isotropic ground they are ratios of bulk and shear moduli, the
min-theta bound of theory 14; they hold for every symmetry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.fem.elasticity import lame_constants
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.structures.members import rigidities
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Isotropic, constants, elastic_scalars
from geoident.model.parameter import Scalar
from geoident.model.structures import Structure

_RANK = 1e-12
"""Singular value, relative to the largest, below which matrices span no further direction."""

OUTSIDE = 1e-10
"""Part of E that its coordinates may miss; beyond, it is not in the span."""


@dataclass(frozen=True, eq=False)
class MaterialSpan:
    """The moduli of one material.

    Args:
        material: the material.
        names: of all n parameters.
        section: the model is a plane section.
        basis: (r, s, s) orthonormal matrices.
        fixed: (r,) coordinates where no parameter moves them, else None.
    """

    material: Material
    names: tuple[str, ...]
    section: bool
    basis: Floats
    fixed: Floats | None

    @property
    def rank(self) -> int:
        """Number r of matrices."""
        return len(self.basis)

    def coordinates(self, values: Floats) -> tuple[Floats, Floats]:
        """Coordinates (b, r) at parameter vectors (b, n), and their derivatives (b, r, n).

        Raises:
            ValueError: the moduli at one of them are not in the span.
        """
        if self.fixed is not None:
            shape = (len(values), self.rank)
            return np.broadcast_to(self.fixed, shape), np.zeros((*shape, len(self.names)))
        elastic = self.material.elastic
        plain = all(type(scalar) is Scalar for scalar in elastic_scalars(elastic).values())
        if isinstance(elastic, Isotropic) and plain:
            coordinates = _isotropic(elastic, self.names, values, self.basis)
        else:
            matrices = [moduli_at(self.material, self.names, p, self.section) for p in values]
            columns = np.stack([m[: self._s, : self._s] for m in matrices])
            coordinates = np.einsum("rij,bijk->brk", self.basis, columns)
            back = np.einsum("rij,br->bij", self.basis, coordinates[..., 0])
            missed = np.abs(back - columns[..., 0]).max()
            if missed > OUTSIDE * np.abs(columns[..., 0]).max():
                msg = f"the moduli of {self.material.name} leave the span of those that were seen"
                raise ValueError(msg)
        return coordinates[..., 0], coordinates[..., 1:]

    @property
    def _s(self) -> int:
        return int(self.basis.shape[1])

    def matrix(self, coordinates: Floats) -> Floats:
        """E (..., s, s) of coordinates (..., r)."""
        return np.tensordot(coordinates, self.basis, axes=1)


@dataclass(frozen=True, eq=False)
class RigiditySpan:
    """EA or EI of a structure as the modulus of its members, the same for all components.

    Args:
        structure: the structure.
        bending: EI, else EA.
        names: of all n parameters.
        basis: (1, s, s) a unit matrix of norm one.
        fixed: (1,) the coordinate where no parameter moves it, else None.
    """

    structure: Structure
    bending: bool
    names: tuple[str, ...]
    basis: Floats
    fixed: Floats | None

    @property
    def rank(self) -> int:
        """Number of matrices."""
        return 1

    def coordinates(self, values: Floats) -> tuple[Floats, Floats]:
        """Coordinates (b, 1) at parameter vectors (b, n), and their derivatives (b, 1, n)."""
        if self.fixed is not None:
            return np.broadcast_to(self.fixed, (len(values), 1)), np.zeros(
                (len(values), 1, len(self.names))
            )
        coordinates = np.sqrt(self.basis.shape[1]) * np.array([self._rigidity(p) for p in values])
        return coordinates[:, :1], coordinates[:, None, 1:]

    def _rigidity(self, p: Floats) -> Floats:
        """(1 + n,) at p (n,) with its derivatives."""
        point = ParameterPoint(dict(zip(self.names, map(float, p), strict=True)), self.names)
        return np.asarray(rigidities(self.structure, point)[int(self.bending)].columns)

    def matrix(self, coordinates: Floats) -> Floats:
        """D times a unit matrix (..., s, s) of coordinates (..., 1)."""
        return np.tensordot(coordinates, self.basis, axes=1)


Span = MaterialSpan | RigiditySpan
"""Moduli of a material, or of the members of a structure."""


def rigidity_span(
    structure: Structure, names: tuple[str, ...], samples: Floats, n_strain: int, *, bending: bool
) -> RigiditySpan:
    """EA or EI of a structure.

    Args:
        structure: the structure.
        names: of all n parameters.
        samples: (b, n) parameter vectors in the domain.
        n_strain: number s of strain components.
        bending: EI, else EA.
    """
    basis = np.eye(n_strain)[None] / np.sqrt(n_strain)
    span = RigiditySpan(structure, bending, names, basis, None)
    coordinates, slopes = span.coordinates(samples)
    return span if slopes.any() else replace(span, fixed=coordinates[0])


def moduli_at(material: Material, names: Sequence[str], values: Floats, section: bool) -> Floats:
    """E (6, 6, 1 + n) of a material with its derivatives, Pa.

    Args:
        material: the material.
        names: of the n parameters.
        values: (n,) them.
        section: the model is a plane section.
    """
    point = ParameterPoint(dict(zip(names, map(float, values), strict=True)), names)
    return elastic_matrix(material.elastic, point, section=section).columns


def span_of(
    material: Material, names: tuple[str, ...], samples: Floats, n_strain: int
) -> MaterialSpan:
    """The span of the moduli of a material.

    Args:
        material: the material.
        names: of the n parameters.
        samples: (b, n) parameter vectors in the domain, more than s (s + 1) / 2.
        n_strain: number s of strain components.
    """
    section, s = n_strain < 6, n_strain
    scalars = elastic_scalars(material.elastic).values()
    moved = any(not scalar.parameters.isdisjoint(names) for scalar in scalars)
    if not moved:
        samples = samples[:1]
    vectors = [moduli_at(material, names, p, section)[:s, :s, 0].ravel() for p in samples]
    matrix = np.stack([row / np.linalg.norm(row) for row in vectors])
    _, size, rows = np.linalg.svd(matrix, full_matrices=False)
    basis = rows[size > _RANK * size[0]].reshape(-1, s, s)
    fixed = None if moved else np.einsum("rij,ij->r", basis, vectors[0].reshape(s, s))
    return MaterialSpan(material, names, section, basis, fixed)


def _isotropic(elastic: Isotropic, names: Sequence[str], values: Floats, basis: Floats) -> Floats:
    """Coordinates (b, r, 1 + n) of isotropic moduli at parameter vectors (b, n), all at once."""

    def number(scalar: Scalar) -> Dual:
        columns = np.zeros((len(values), 1 + len(names)))
        if scalar.parameter in names:
            k = names.index(scalar.parameter)
            columns[:, 0], columns[:, 1 + k] = scalar.factor * values[:, k], scalar.factor
        else:
            columns[:, 0] = scalar.factor
        return Dual(columns)

    lame, mu = lame_constants({n: number(scalar) for n, scalar in constants(elastic).items()})
    s = basis.shape[1]
    volumetric, shear = np.zeros((s, s)), np.diag([2.0] * 3 + [1.0] * (s - 3))
    volumetric[:3, :3] = 1.0
    of_lame, of_mu = (np.einsum("rij,ij->r", basis, one) for one in (volumetric, shear))
    return np.asarray(
        of_lame[:, None] * lame.columns[:, None] + of_mu[:, None] * mu.columns[:, None]
    )


def relative_eigenvalues(matrices: Floats, reference: Floats) -> Floats:
    """Eigenvalues (b, s), ascending, of matrices (b, s, s) against a positive definite one."""
    root = np.linalg.inv(np.linalg.cholesky(reference))
    return np.asarray(np.linalg.eigvalsh(root @ matrices @ root.T))
