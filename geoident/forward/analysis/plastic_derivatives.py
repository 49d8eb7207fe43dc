"""Derivatives of a plastic step on its active pieces.

With s* = sigma_old + E C du and sigma = P(s*, p),

    g_h  = T (dsigma_old/dp_h + dE/dp_h C du) + dP/dp_h       (du kept)
    K_T ddu/dp_h = df/dp_h - C^T V g_h
    dsigma/dp_h = g_h + T E C ddu/dp_h

(where a part mu of the overstress is kept, T and dP/dp count 1 - mu, and mu is added to T),
so one factorization of the consistent tangent serves all columns; where the last Newton step did
not leave its pieces it is there already. At a kink the derivative is that of the planes which the
projection counts as active (see `geoident.fem.yielding.law`).
"""

from __future__ import annotations

import numpy as np

from geoident.errors import ModelError
from geoident.forward.analysis.constitutive import PlasticResponse
from geoident.forward.analysis.stage import StageTask
from geoident.forward.analysis.stage_equations import Balance, SingularTangent, StageEquations
from geoident.forward.analysis.systems import StageSystems
from geoident.model.arrays import Floats

_DERIVATIVES = slice(1, None)
"""Columns of what the analysis carries; column 0 is the state."""


def plastic_derivatives(
    task: StageTask, systems: StageSystems, equations: StageEquations, balance: Balance
) -> Floats:
    """Derivatives (n_dofs, n + k) of the displacement step; updates those of what is carried.

    Args:
        task: the stage; its state is still that of before.
        systems: the equations of the stages.
        equations: those of this stage.
        balance: their solution.

    Raises:
        ModelError: the consistent tangent is singular, so there are no derivatives.
    """
    iterate, structures, points = balance.end, systems.structures, systems.discretization.points
    g = np.ascontiguousarray(task.carried.stress[..., _DERIVATIVES])
    members = task.carried.members[:, _DERIVATIVES]
    task.add_stiffness_derivatives(systems, iterate.du, g, members)
    for response in iterate.flowing:
        before = None
        if response.ground.hardens:
            before = task.carried.multipliers(response.ground.name, response.points, _DERIVATIVES)
        g[:, response.points], dlam = response.derivatives(
            g[:, response.points], before, of_law=True
        )
        _add_multipliers(task, response, dlam)

    rest = task.forces[:, _DERIVATIVES] - points.forces(g, task.system.volume)
    if structures.n_rows:
        rest -= structures.nodal_forces(members)
    ddu, dofs = np.zeros_like(rest), equations.dofs
    if len(dofs):
        tangent = balance.tangent
        if tangent is None or not equations.serves(tangent, iterate):
            tangent = equations.tangent(iterate)
        try:
            ddu[dofs] = equations.solve_consistently(tangent, rest[dofs])
        except SingularTangent as error:
            msg = f"at stage '{task.state.name}' the displacements have no derivatives by the "
            msg += "parameters: the ground is at its limit load"
            hint = "Raise the strengths a little, or see whether the stage lacks support."
            raise ModelError(msg, hint) from error

    stress = points.strain(ddu)  # becomes T E C ddu
    for ground in equations.grounds:
        stress[:, ground.points] = ground.elasticity.stress(stress[:, ground.points])
    for response in iterate.flowing:
        stress[:, response.points], dlam = response.derivatives(
            stress[:, response.points], of_law=False
        )
        _add_multipliers(task, response, dlam)
    task.carried.stress[..., _DERIVATIVES] = g + stress
    task.add_member_forces(structures, ddu, _DERIVATIVES)
    return ddu


def _add_multipliers(task: StageTask, response: PlasticResponse, dlam: Floats | None) -> None:
    """Count further derivatives (y, q, n + k) of the multipliers of a material."""
    if dlam is not None and response.ground.hardens:
        task.carried.add_multipliers(response.ground.name, response.points, _DERIVATIVES, dlam)
