"""Where the diffuse flow of non-associated ground ends: bands of shear (theory 5.4).

The path of viscous grounds (`viscous_path`) leads to the ground itself where it can be followed.
Where it ends before, a mode x of the ground's own tangent has lost its stability there,

    K_T x = l K x    with a real part of l that is not positive

(R. Hill 1958, J. Mech. Phys. Solids 6; J. R. Rice 1976); l is its stiffness as part of the elastic
one. Viscous ground has the same modes with l + mu (1 - l): so those of its tangent around zero are
the ones that are lost first as mu falls. If the shear of a mode stands in few strain points it is a
band, a few elements wide, in the directions of the acoustic tensor (`fem.yielding.localisation`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg as spla

from geoident.forward.analysis.stage_equations import Iterate, StageEquations
from geoident.model.arrays import Floats

_MODES = 4
"""Eigenvalues around zero that are looked at."""

_CLOSE_TO_ZERO = 1e-4
"""Relative accuracy of these eigenvalues."""

_HALF = 0.5
"""Of the square of its strain: where a mode stands."""


@dataclass(frozen=True)
class ShearBand:
    """A mode of flow that has lost its stability.

    Args:
        mode: (n_dofs,) how the ground moves, the largest 1; the real part of a complex pair.
        points: number of the strain points that have half of its squared strain.
        yielding: number of the points that yield.
    """

    mode: Floats
    points: int
    yielding: int


def band_at(equations: StageEquations, iterate: Iterate) -> ShearBand | None:
    """The least stable mode of flowing ground; None where all are stable without viscosity.

    Args:
        equations: of the stage, with the viscosity at which the state is in equilibrium.
        iterate: the state.
    """
    flowing = [one for one in iterate.flowing if not one.ground.of_structure]
    n, yielding = len(equations.dofs), sum(response.points.size for response in flowing)
    if n <= _MODES + 1 or not yielding:
        return None
    tangent = equations.tangent(iterate)
    inverse = spla.LinearOperator(
        (n, n),
        matvec=lambda x: tangent.solve(equations.elastic_forces(x.ravel())),
        dtype=np.float64,
    )
    start = np.random.default_rng(0).standard_normal(n)
    try:
        values, modes = spla.eigs(inverse, k=_MODES, v0=start, tol=_CLOSE_TO_ZERO)
    except spla.ArpackNoConvergence:
        return None
    own = (1.0 / values - equations.viscosity) / (1.0 - equations.viscosity)
    least = int(np.argmin(own.real))
    if own[least].real > 0.0:
        return None
    largest = modes[np.abs(modes[:, least]).argmax(), least]
    mode = modes[:, least] / largest  # of a pair of modes: in the phase of its largest motion
    held = np.zeros(equations.operators.n_points)
    for part in (mode.real, mode.imag):
        strain = equations.operators.strain(equations.spread(part))
        held += (strain**2).sum(axis=0) * equations.volume * equations.of_ground
    held = np.sort(held)[::-1].cumsum()
    points = int(np.searchsorted(held, _HALF * held[-1])) + 1
    return ShearBand(equations.spread(mode.real), points, yielding)
