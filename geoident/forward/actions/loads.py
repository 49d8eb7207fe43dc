"""Loads made ready: what does not depend on parameters is computed once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from geoident.fem.faces import FacetPatch
from geoident.fem.kinematics import Kinematics
from geoident.fem.loads import pressure_forces, pressure_operator, traction_weights
from geoident.fem.location import Site
from geoident.forward.actions.supports import group_nodes
from geoident.forward.actions.water import FacePressure
from geoident.model.actions import FaceLoad, PointForce, Pressure, Traction
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar

ReadyLoad: TypeAlias = Callable[[ParameterPoint], Floats]
"""A load that can be asked for its nodal forces (n_dofs, 1 + n) and their derivatives, N."""


def _scaled_forces(terms: Sequence[tuple[Floats, Scalar]], point: ParameterPoint) -> Floats:
    """Nodal forces (n_dofs,) that are given, each times a number of the case: (n_dofs, 1 + n)."""
    return np.asarray(sum(np.outer(unit, point.number(k).columns) for unit, k in terms))


def _water_forces(
    terms: Sequence[tuple[FacePressure, sp.csr_array]], point: ParameterPoint
) -> Floats:
    """Forces (n_dofs, 1 + n) of water on faces.

    Args:
        terms: the pressure at the quadrature points of a patch with the operator (n_dofs, m)
            that makes forces of it.
        point: the parameters.
    """
    return np.asarray(sum(matrix @ p.at(point).columns for p, matrix in terms))


def face_load(
    mesh: Mesh, load: FaceLoad, faces: Sequence[FacetPatch], kinematics: Kinematics
) -> ReadyLoad:
    """A load on the free faces of the ground.

    Args:
        mesh: the mesh.
        load: the load.
        faces: the free faces on which it acts.
        kinematics: of the analysis.
    """
    if isinstance(load, Pressure):
        push = sum((pressure_forces(mesh, p, kinematics) for p in faces), np.zeros(1))
        return partial(_scaled_forces, [(push, load.value)])
    if isinstance(load, Traction):
        area = sum((traction_weights(mesh, p, kinematics) for p in faces), np.zeros(1))
        return _along_axes(mesh, area, load.value)
    ready = [pressure_operator(mesh, p, kinematics) for p in faces]
    return partial(_water_forces, [(FacePressure(load, where), matrix) for where, matrix in ready])


def point_force(mesh: Mesh, load: PointForce, site: Site | None) -> ReadyLoad:
    """A force at a site, shared by the nodes around it; or on the nodes of a group.

    Args:
        mesh: the mesh.
        load: the force.
        site: where it acts, or None where it acts on nodes.
    """
    shares = np.zeros(mesh.n_nodes)
    if isinstance(load.place, str):
        nodes = group_nodes(mesh, load.place)
        shares[nodes] = 1 / len(nodes)
    elif site is not None:
        shares[site.nodes] = site.shapes
    return _along_axes(mesh, shares, load.value)


def _along_axes(mesh: Mesh, shares: Floats, value: Sequence[Scalar]) -> ReadyLoad:
    """Forces shared by the nodes (n_nodes,), with one number per axis."""
    axes = np.eye(mesh.dim)
    terms = [(np.outer(shares, a).ravel(), number) for a, number in zip(axes, value, strict=True)]
    return partial(_scaled_forces, terms)
