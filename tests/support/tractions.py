"""Tractions of a stress that is the same everywhere."""

from __future__ import annotations

import numpy as np

from geoident.fem.loads import facet_geometry, stress_forces


def uniform_tractions(mesh, patch, kinematics, stress):
    """Nodal forces (n_dofs,) of the tractions of one stress (n_strain,) on a patch."""
    geometry = facet_geometry(mesh.points, patch, kinematics)
    n_points = geometry.positions.shape[0] * geometry.positions.shape[1]
    return stress_forces(mesh, patch, geometry, np.outer(stress, np.ones(n_points)))
