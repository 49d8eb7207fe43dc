"""Moduli as a sum of few fixed matrices, and how far they are from those of a reference.

The matrices E(p) (s, s) of a material over the domain of its parameters lie in a space of few
dimensions: one where only a Young's modulus is sought, two for isotropy, five for strata, at most
s (s + 1) / 2. Whatever the map from p to E is (ratios, angles), E is linear in its coordinates
there, so stiffness matrices are sums of stored ones. Coordinates that do not give E back are
noticed. The rigidity of a member counts as a modulus that is the same for all components.

The smallest and largest eigenvalues of E(p) against E at the reference bound the stiffness from
below and above, point by point: for isotropic ground they are ratios of bulk and shear moduli, the
min-theta bound of theory 14; they hold for every symmetry.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem.elasticity import lame_constants
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.structures.members import rigidities
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Isotropic, constants, elastic_scalars
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar
from geoident.model.structures import Structure

_RANK = 1e-12
"""Singular value, relative to the largest, below which matrices span no further direction."""

OUTSIDE = 1e-10
"""Part of E that its coordinates may miss; beyond, it is not in the span."""

Moduli = Callable[[Floats], Floats]
"""E (b, s, s, 1 + n) at parameter vectors (b, n), with derivatives; Pa, or N and Nm2 of members."""


@dataclass(frozen=True, eq=False)
class Span:
    """Moduli E = sum_r c_r(p) J_r of a material, or rigidities of members.

    Args:
        name: of the material or rigidity.
        moduli: E at parameter vectors.
        basis: (r, s, s) J, orthonormal.
        fixed: (r,) coordinates c where no parameter moves them, else None.
    """

    name: str
    moduli: Moduli
    basis: Floats
    fixed: Floats | None

    def coordinates(self, values: Floats) -> tuple[Floats, Floats]:
        """Coordinates (b, r) at parameter vectors (b, n), and their derivatives (b, r, n).

        Raises:
            ValueError: the moduli at one of them are not in the span.
        """
        if self.fixed is not None:
            shape = (len(values), len(self.fixed))
            return np.broadcast_to(self.fixed, shape), np.zeros((*shape, values.shape[1]))
        E = self.moduli(values)
        c = np.einsum("rij,bijk->brk", self.basis, E)
        missed = np.abs(self.matrix(c[..., 0]) - E[..., 0]).max()
        if missed > OUTSIDE * np.abs(E[..., 0]).max():
            msg = f"the moduli of {self.name} leave the span of those that were seen"
            raise ValueError(msg)
        return c[..., 0], c[..., 1:]

    def matrix(self, coordinates: Floats) -> Floats:
        """E (..., s, s) of coordinates (..., r)."""
        return np.tensordot(coordinates, self.basis, axes=1)


def span_of(name: str, moduli: Moduli, samples: Floats) -> Span:
    """The span of moduli.

    Args:
        name: of the material or rigidity.
        moduli: E at parameter vectors.
        samples: (b, n) parameter vectors in the domain, more than s (s + 1) / 2.
    """
    E = moduli(samples)
    rows = E[..., 0].reshape(len(E), -1)
    _, size, rows = np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None])
    basis = rows[: int(np.sum(size > _RANK * size[0]))].reshape(-1, *E.shape[1:3])
    fixed = None if E[..., 1:].any() else np.einsum("rij,ij->r", basis, E[0, ..., 0])
    return Span(name, moduli, basis, fixed)


def material_moduli(material: Material, names: Sequence[str], n_strain: int) -> Moduli:
    """The moduli of a material.

    Args:
        material: the material.
        names: of all n parameters.
        n_strain: number s of strain components.
    """
    elastic = material.elastic
    plain = all(type(scalar) is Scalar for scalar in elastic_scalars(elastic).values())
    if isinstance(elastic, Isotropic) and plain:
        return lambda values: _isotropic(elastic, names, values, n_strain)

    def moduli(values: Floats) -> Floats:
        points = (ParameterPoint(dict(zip(names, map(float, p), strict=True)), names)
                  for p in values)  # fmt: skip
        each = [elastic_matrix(elastic, point, section=n_strain < 6).columns for point in points]
        return np.stack(each)[:, :n_strain, :n_strain]

    return moduli


def rigidity_moduli(
    structure: Structure | Interface, names: Sequence[str], n_strain: int, *, number: int
) -> Moduli:
    """One rigidity of a structure, times a unit matrix.

    Args:
        structure: the structure.
        names: of all n parameters.
        n_strain: number s of strain components.
        number: which of its rigidities (`rigidities`).
    """

    def moduli(values: Floats) -> Floats:
        points = (ParameterPoint(dict(zip(names, map(float, p), strict=True)), names)
                  for p in values)  # fmt: skip
        each = np.stack([rigidities(structure, at)[number].columns for at in points])
        return np.eye(n_strain)[:, :, None] * each[:, None, None]

    return moduli


def _isotropic(elastic: Isotropic, names: Sequence[str], values: Floats, s: int) -> Floats:
    """Isotropic moduli at all parameter vectors at once: grids and draws ask for thousands."""

    def number(scalar: Scalar) -> Dual:
        columns = np.zeros((len(values), 1 + len(names)))
        if scalar.parameter in names:
            k = names.index(scalar.parameter)
            columns[:, 0], columns[:, 1 + k] = scalar.factor * values[:, k], scalar.factor
        else:
            columns[:, 0] = scalar.factor
        return Dual(columns)

    lame, mu = lame_constants({n: number(scalar) for n, scalar in constants(elastic).items()})
    volumetric, shear = np.zeros((s, s)), np.diag([2.0] * 3 + [1.0] * (s - 3))
    volumetric[:3, :3] = 1.0
    return np.asarray(
        np.multiply.outer(volumetric, lame.columns) + np.multiply.outer(shear, mu.columns)
    ).transpose(2, 0, 1, 3)


def relative_eigenvalues(matrices: Floats, reference: Floats) -> Floats:
    """Eigenvalues (b, s), ascending, of matrices (b, s, s) against positive definite ones."""
    root = np.linalg.inv(np.linalg.cholesky(reference))
    return np.asarray(np.linalg.eigvalsh(root @ matrices @ root.swapaxes(-1, -2)))
