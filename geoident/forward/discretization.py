"""The ground as strain points: what its elements amount to in one analysis, without any stage."""

from __future__ import annotations

import numpy as np

from geoident.fem.kinematics import Kinematics, StrainPoints, block_geometry, strain_points
from geoident.forward.stages import ConstructionSequence
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh

Index = Ints | slice
"""Places in an array: their numbers, or a slice where they are one run (no copies)."""


class Discretization:
    """Strain points of a mesh, made once.

    Args:
        mesh: the mesh, every element turned so that its volume is positive.
        kinematics: of the analysis.
        sequence: the groups of the case.

    Attributes:
        kinematics: of the analysis.
        geometries: shape functions and gradients of every block.
        points: the strain points.
        points_of: index of a group to its strain points, for groups that are ever present.
    """

    def __init__(self, mesh: Mesh, kinematics: Kinematics, sequence: ConstructionSequence) -> None:
        self.kinematics = kinematics
        self.geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
        self.points: StrainPoints = strain_points(mesh, self.geometries, kinematics)
        group_of_point = sequence.group_of[self.points.element]
        ever = sorted({g for state in sequence.states for g in state.materials})
        self.points_of: dict[int, Index] = {g: as_index(group_of_point == g) for g in ever}

    @property
    def n_dofs(self) -> int:
        """Number of degrees of freedom, free and fixed."""
        return int(self.points.compatibility.shape[1])

    def volume(self, present: Bools) -> Floats:
        """V (n_points,), zero at points of elements (n_elements,) that are absent."""
        return np.where(present[self.points.element], self.points.volume, 0.0)


def as_index(mask: Bools) -> Index:
    """A slice where the marked places (m,) are one run (no copies), else their numbers."""
    where = np.flatnonzero(mask)
    if len(where) and where[-1] - where[0] + 1 == len(where):
        return slice(int(where[0]), int(where[-1]) + 1)
    return where


def numbers(index: Index, n: int) -> Ints:
    """A slice of n, or an array (k,) of numbers, as numbers (k,)."""
    return np.arange(n)[index] if isinstance(index, slice) else index
