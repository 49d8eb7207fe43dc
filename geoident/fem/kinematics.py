"""How displacements strain the ground in each kind of analysis (theory 1).

All kinds share one code. What tells them apart is the *gradient vector* of a node a, by whose
entries its displacement is multiplied in the strains: dN_a/dx_j, and in a body of revolution also
N_a / r, which gives the hoop strain u_r / r. A strain component is a sum of products
(displacement i) times (entry j), listed once per analysis; the compatibility operator, the
stiffness of node pairs and the load vectors all follow from that list.

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
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoident.fem.elements import raised_rule, reference_element
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis

Terms = tuple[tuple[int, int], ...]
"""Pairs (displacement i, entry j of the gradient vector) whose products are summed."""


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
    """

    dim: int
    strains: tuple[Terms, ...]
    rigid: tuple[int, ...]
    revolved: bool = False

    @property
    def n_strain(self) -> int:
        """Number of strain components."""
        return len(self.strains)

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

    def gradient_vectors(self, gradients: Floats, shapes: Floats, positions: Floats) -> Floats:
        """Gradient vectors (n_el, n_q, n_a, n_entries), 1/m.

        Args:
            gradients: (n_el, n_q, n_a, dim) dN_a/dx_j.
            shapes: (n_q, n_a) N_a.
            positions: (n_el, n_q, dim), m.
        """
        if not self.revolved:
            return gradients
        hoop = shapes[None] / positions[..., :1]
        return np.concatenate([gradients, hoop[..., None]], axis=3)

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
    def incidence(self) -> Floats:
        """(n_strain, dim, n_entries) 1 where displacement i adds to a component by entry j."""
        incidence = np.zeros((self.n_strain, self.dim, self.dim + self.revolved))
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
