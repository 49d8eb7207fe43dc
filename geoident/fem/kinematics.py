"""How displacements strain the ground in each kind of analysis (theory 1).

All kinds share one code. What tells them apart is the *gradient vector* of a node a, by whose
entries its displacement is multiplied in the strains: dN_a/dx_j, and in a body of revolution also
N_a / r, which gives the hoop strain u_r / r. A strain component is a sum of products
(displacement i) times (entry j), listed once per analysis; the compatibility operator, the
stiffness of node pairs and the load vectors all follow from that list.

Where ground yields, elements of first order take the *mean dilatation* (B-bar: Hughes 1980, Int. J.
Numer. Meth. Eng. 15, 1413-1418): flow that keeps its volume at every point of an element leaves it
no motion (Nagtegaal, Parks, Rice 1974). With d_ai the dilatation by displacement i of node a, the
gradient vector has dim more entries, (mean d_ai - d_ai) / k, which are added to the k normal
strains that displacements make. They are constant, so all else stays as it is.

Components: plane strain (xx, yy, zz, xy) with eps_zz = 0, so that the out-of-plane stress needs no
special case; axisymmetric (rr, zz, tt, rz) in the same places, with x the radius, y the axis and
the hoop direction out of plane; 3-D (xx, yy, zz, xy, yz, xz). Shear strains are gamma = 2 eps.

Quadrature in a body of revolution, on straight-sided elements (parallelograms for quadrilaterals):
weights have the factor 2 pi r, so triangles take the rule of the next higher degree. Then exact
are the gradient terms, r dN dN, those that couple gradients to hoop strains, N dN, the forces of a
stress that is linear in space, and weight. The hoop terms, N N / r, are exact in elements with an
edge on the axis, where N / r is a polynomial for every node that can move; elsewhere they are
rational, and their error is of higher order than that of the interpolation. Quadrature points lie
inside elements, so N / r is never asked for at r = 0.

The compatibility operator C and the integration weights V:

    eps = C u                 strains of all strain points from displacements
    f   = C^T diag(V) sigma   nodal forces of a stress field

Strain points are numbered element by element in the mesh's order. Vectors of strain or stress are
stored *component by component*, (n_strain, n_points), so that the elastic law of one material is
one small matrix times one long one; row c m + i of C is component c at point i.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from geoident.fem.elements import raised_rule, reference_element
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Analysis
from geoident.model.mesh import ElementBlock, Mesh

Terms = tuple[tuple[int, int], ...]
"""Pairs (displacement i, entry j of the gradient vector) whose products are summed."""

NORMAL_COMPONENTS = 3
"""The first three strain components, out of plane included, are normal strains."""

_ON_AXIS = 1e-9
"""Distance from the axis, in parts of the size of the mesh, that counts as on it."""


@dataclass(frozen=True)
class Kinematics:
    """Strains of one kind of analysis.

    Args:
        dim: space dimensions, and displacement components.
        strains: the terms of every strain component.
        rigid: which motions make no strain: the translations along the axes come first (0 to
            dim - 1), then the rotations (one in the plane, three in space).
        revolved: whether the plane is turned about the axis x = 0.
        mean_dilatation: whether elements of first order dilate alike at all their points.
    """

    dim: int
    strains: tuple[Terms, ...]
    rigid: tuple[int, ...]
    revolved: bool = False
    mean_dilatation: bool = False

    @property
    def n_strain(self) -> int:
        """Number of strain components."""
        return len(self.strains)

    @property
    def n_entries(self) -> int:
        """Number of entries of gradient vectors."""
        return self.dim * (1 + self.mean_dilatation) + self.revolved

    def with_mean_dilatation(self) -> Kinematics:
        """The same with the mean dilatation in elements of first order."""
        more = tuple((i, self.n_entries + i) for i in range(self.dim))
        normal, shear = self.strains[:NORMAL_COMPONENTS], self.strains[NORMAL_COMPONENTS:]
        dilating = tuple(terms + more if terms else terms for terms in normal)
        return replace(self, strains=dilating + shear, mean_dilatation=True)

    def on_axis(self, points: Floats) -> Bools:
        """(n,) which of the points (n, dim) lie on the axis of revolution.

        There the radial displacement is zero: no hoop strain is infinite.
        """
        if not self.revolved:
            return np.zeros(len(points), dtype=bool)
        return np.asarray(np.abs(points[:, 0]) <= _ON_AXIS * np.ptp(points, axis=0).max())

    def in_section(self, point: tuple[float, ...]) -> tuple[tuple[float, ...], Floats]:
        """A point of the mesh that moves as this one, and the signs (dim,) of its displacement.

        About an axis a point of negative radius stands across from one of the meshed half.
        """
        signs = np.ones(self.dim)
        if self.revolved and point[0] < 0:
            signs[0] = -1.0
            point = (-point[0], *point[1:])
        return point, signs

    def quadrature(self, kind: str) -> tuple[Floats, Floats]:
        """Strain points (n_q, dim) and weights (n_q,) of an element on its reference domain."""
        if self.revolved:
            return raised_rule(kind)
        reference = reference_element(kind)
        return reference.points, reference.weights

    def depth(self, positions: Floats) -> Floats | float:
        """Extent out of the plane at some positions (..., dim), m: 2 pi r, or a unit length."""
        return 2 * np.pi * positions[..., 0] if self.revolved else 1.0

    def gradient_vectors(
        self, gradients: Floats, shapes: Floats, positions: Floats, volumes: Floats, order: int
    ) -> Floats:
        """Gradient vectors (n_el, n_q, n_a, n_entries), 1/m.

        Args:
            gradients: (n_el, n_q, n_a, dim) dN_a/dx_j.
            shapes: (n_q, n_a) N_a.
            positions: (n_el, n_q, dim), m.
            volumes: (n_el, n_q) integration weights, m3.
            order: of the elements.
        """
        vectors, dilatation = [gradients], gradients
        if self.revolved:
            hoop = (shapes[None] / positions[..., :1])[..., None]
            vectors.append(hoop)
            dilatation = np.concatenate([gradients[..., :1] + hoop, gradients[..., 1:]], axis=3)
        if self.mean_dilatation:
            weights = volumes / volumes.sum(axis=1, keepdims=True)
            mean = np.einsum("eq,eqai->eai", weights, dilatation)[:, None]
            n_normal = sum(map(bool, self.strains[:NORMAL_COMPONENTS]))
            vectors.append((order == 1) * (mean - dilatation) / n_normal)
        return np.concatenate(vectors, axis=3) if len(vectors) > 1 else gradients

    def stiffness_map(self, elasticity: Floats) -> Floats:
        """How moduli turn products of gradient vectors into stiffness: (n_entries^2, dim^2).

        With g_a the gradient vector of node a and G_ab[j, l] the integral of g_a[j] g_b[l], the
        block of nodes a, b is
        K_ab[i, k] = sum_jl E_(ij)(kl) G_ab[j, l] = (G_ab.ravel() @ T)[i, k] for the T returned,
        where (ij) is the strain component to which displacement i adds by entry j. One map per
        material serves every symmetry of the moduli, so all cost the same.

        Args:
            elasticity: E, (n_strain, n_strain), Pa.
        """
        adds = self.incidence
        tensor = np.tensordot(adds.transpose(1, 2, 0) @ elasticity, adds, axes=1)
        return np.asarray(tensor.transpose(1, 3, 0, 2).reshape(-1, self.dim**2))

    @cached_property
    def adds(self) -> tuple[tuple[tuple[int, int], ...], ...]:
        """For every entry of gradient vectors, the pairs (component, displacement) it makes."""
        pairs = [(c, i, j) for c, terms in enumerate(self.strains) for i, j in terms]
        return tuple(tuple((c, i) for c, i, j in pairs if j == e) for e in range(self.n_entries))

    @cached_property
    def incidence(self) -> Floats:
        """(n_strain, dim, n_entries) 1 where displacement i adds to a component by entry j."""
        incidence = np.zeros((self.n_strain, self.dim, self.n_entries))
        for component, terms in enumerate(self.strains):
            for i, j in terms:
                incidence[component, i, j] = 1.0
        return incidence


PLANE_STRAIN = Kinematics(2, (((0, 0),), ((1, 1),), (), ((0, 1), (1, 0))), (0, 1, 2))
# A motion along the axis is the only one without strain: moving sideways opens the hoops.
AXISYMMETRIC = Kinematics(
    2, (((0, 0),), ((1, 1),), ((0, 2),), ((0, 1), (1, 0))), (1,), revolved=True
)
SOLID = Kinematics(
    3,
    (((0, 0),), ((1, 1),), ((2, 2),), ((0, 1), (1, 0)), ((1, 2), (2, 1)), ((0, 2), (2, 0))),
    (0, 1, 2, 3, 4, 5),
)

_KINEMATICS = {
    Analysis.PLANE_STRAIN: PLANE_STRAIN,
    Analysis.AXISYMMETRIC: AXISYMMETRIC,
    Analysis.SOLID: SOLID,
}


def kinematics_of(analysis: Analysis) -> Kinematics:
    """The kinematics of a kind of analysis."""
    return _KINEMATICS[analysis]


@dataclass(frozen=True)
class BlockGeometry:
    """Shape functions and what derives from them at the strain points of one block.

    Args:
        gradients: (n_el, n_q, n_a, n_entries) gradient vectors of the nodes, 1/m.
        volumes: (n_el, n_q) integration weights, m3 (of a unit thickness in plane strain, of the
            whole turn in a body of revolution).
        shapes: (n_q, n_a) shape functions.
        positions: (n_el, n_q, dim) strain points, m.
    """

    gradients: Floats
    volumes: Floats
    shapes: Floats
    positions: Floats


def block_geometry(points: Floats, block: ElementBlock, kinematics: Kinematics) -> BlockGeometry:
    """Geometry of a block of elements whose orientation is right.

    Args:
        points: (n_nodes, dim) nodes of the mesh, m.
        block: elements of one kind.
        kinematics: of the analysis.
    """
    reference = reference_element(block.kind)
    xi, weights = kinematics.quadrature(block.kind)
    shapes, local = reference.shapes(xi), reference.gradients(xi)
    corners = points[block.nodes]
    jacobian = np.einsum("eai,qaj->eqij", corners, local, optimize=True)
    determinant = np.linalg.det(jacobian)
    inverse = np.linalg.inv(jacobian)
    gradients = np.einsum("qaj,eqji->eqai", local, inverse, optimize=True)
    positions = np.einsum("qa,eai->eqi", shapes, corners, optimize=True)
    volumes = determinant * weights * kinematics.depth(positions)
    order = reference.cell.order
    vectors = kinematics.gradient_vectors(gradients, shapes, positions, volumes, order)
    # entry by entry in memory, so that what is made of one of them need not copy it
    by_entry = np.ascontiguousarray(np.moveaxis(vectors, -1, 0))
    return BlockGeometry(np.moveaxis(by_entry, 0, -1), volumes, shapes, positions)


@dataclass(frozen=True)
class StrainPoints:
    """The strain points of a mesh.

    C is not kept: with the gradients of the nodes at the points, D_j[q, a] = g_a[j], which have a
    third of its entries in space, C u is a sum of products of D_j with the displacements of all
    components at once.

    Args:
        kinematics: of the analysis.
        gradients: D_j, (n_points, n_nodes) sparse by rows, for each entry j of gradient vectors;
            their patterns are the same arrays.
        volume: V, (n_points,).
        element: (n_points,) element index of each point.
        position: (n_points, dim) coordinates, m.
    """

    kinematics: Kinematics
    gradients: tuple[sp.csr_array, ...]
    volume: Floats
    element: Ints
    position: Floats

    @property
    def n_points(self) -> int:
        """Number m of strain points."""
        return int(self.volume.shape[0])

    @property
    def n_strain(self) -> int:
        """Number s of strain components."""
        return self.kinematics.n_strain

    @property
    def n_dofs(self) -> int:
        """Number of degrees of freedom, free and fixed."""
        return int(self.gradients[0].shape[1]) * self.kinematics.dim

    def strain(self, u: Floats, points: Ints | slice | None = None) -> Floats:
        """Strains (n_strain, m, ...) of displacements (n_dofs, ...) at some points; None: all."""
        dim, columns = self.kinematics.dim, u.shape[1:]
        n = math.prod(columns)
        gradients = self.gradients
        if points is not None:
            gradients = tuple(D[points] for D in gradients)
        m = gradients[0].shape[0]
        strain = np.zeros((self.n_strain, m, n))
        moved = u.reshape(self.n_dofs // dim, dim, n)
        if n == 1:  # one by one: a product with a few columns takes as long as with ten
            lone = np.ascontiguousarray(moved[..., 0].T)
            for gradient, adds in zip(gradients, self.kinematics.adds, strict=True):
                for component, i in adds:
                    strain[component, :, 0] += gradient @ lone[i]
        else:
            wide = moved.reshape(len(moved), dim * n)
            for gradient, adds in zip(gradients, self.kinematics.adds, strict=True):
                slope = np.asarray(gradient @ wide).reshape(m, dim, n)
                for component, i in adds:
                    strain[component] += slope[:, i]
        return strain.reshape(self.n_strain, m, *columns)

    def forces(self, stress: Floats, volume: Floats) -> Floats:
        """Nodal forces (n_dofs, ...) of stresses (n_strain, n_points, ...), with weights (m,).

        The weights are ``volume`` with zeros at the points that are absent.
        """
        dim, columns = self.kinematics.dim, stress.shape[2:]
        n = math.prod(columns)
        stress = stress.reshape(self.n_strain, self.n_points, n)
        total = np.zeros((self.n_dofs // dim, dim, n))
        for transposed, adds in zip(self._transposed, self.kinematics.adds, strict=True):
            if n == 1:
                for component, i in adds:
                    total[:, i, 0] += transposed @ (stress[component, :, 0] * volume)
                continue
            pull = np.zeros((self.n_points, dim, n))
            for component, i in adds:
                pull[:, i] += stress[component]
            pull *= volume[:, None, None]
            total += (transposed @ pull.reshape(self.n_points, dim * n)).reshape(total.shape)
        return total.reshape(self.n_dofs, *columns)

    def compatibility(self, points: Ints | None = None) -> sp.csr_array:
        """C of some points, (n_strain k, n_dofs), component by component; None: of all."""
        some = [D if points is None else sp.csr_array(D[points]) for D in self.gradients]
        data, indices, counts = [], [], [np.zeros(1, dtype=np.int64)]
        for terms in self.kinematics.strains:
            values = [some[entry].data for _, entry in terms]
            columns = [some[entry].indices * self.kinematics.dim + i for i, entry in terms]
            counts.append(len(terms) * np.diff(some[0].indptr))
            if terms:
                data.append(np.stack(values, axis=-1).ravel())
                indices.append(np.stack(columns, axis=-1).ravel())
        indptr = np.cumsum(np.concatenate(counts))
        shape = (len(indptr) - 1, self.n_dofs)
        C = sp.csr_array((np.concatenate(data), np.concatenate(indices), indptr), shape=shape)
        if self.kinematics.mean_dilatation:  # several entries of a node by one displacement
            C.sum_duplicates()
        return C

    @cached_property
    def points_of_nodes(self) -> sp.csr_array:
        """(n_nodes, n_points) which points the nodes strain: a pattern by rows."""
        return sp.csr_array(self.gradients[0].T)

    @cached_property
    def _transposed(self) -> tuple[sp.csc_array, ...]:
        """The transposes of the gradients: views, by columns."""
        return tuple(gradient.T for gradient in self.gradients)


def strain_points(
    mesh: Mesh, geometries: tuple[BlockGeometry, ...], kinematics: Kinematics
) -> StrainPoints:
    """C, V and where the points are, for all elements of a mesh.

    Args:
        mesh: the mesh.
        geometries: of its blocks, in their order.
        kinematics: of the analysis.
    """
    volume = np.concatenate([g.volumes.ravel() for g in geometries])
    per_element = [np.full(len(g.volumes), g.volumes.shape[1]) for g in geometries]
    element = np.repeat(np.arange(mesh.n_elements), np.concatenate(per_element))
    position = [g.positions.reshape(-1, mesh.dim) for g in geometries]
    gradients = _gradients(mesh, geometries, kinematics)
    return StrainPoints(kinematics, gradients, volume, element, _joined(position))


def _gradients(
    mesh: Mesh, geometries: tuple[BlockGeometry, ...], kinematics: Kinematics
) -> tuple[sp.csr_array, ...]:
    """Built row by row in their final place: no sorting, no triplets, one pattern for all."""
    counts, nodes = [np.zeros(1, dtype=np.int32)], []
    for block, geometry in zip(mesh.blocks, geometries, strict=True):
        n_el, n_q, n_a, _ = geometry.gradients.shape
        counts.append(np.full(n_el * n_q, n_a, dtype=np.int32))
        nodes.append(np.repeat(block.nodes.astype(np.int32), n_q, axis=0).ravel())
    indptr, indices = np.cumsum(np.concatenate(counts), dtype=np.int32), _joined(nodes)
    shape = (len(indptr) - 1, mesh.n_nodes)
    values = [
        _joined([g.gradients[..., j].ravel() for g in geometries])
        for j in range(kinematics.n_entries)
    ]
    return tuple(sp.csr_array((data, indices, indptr), shape=shape) for data in values)


def _joined(parts: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Arrays one after the other; a single one as it is, not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
