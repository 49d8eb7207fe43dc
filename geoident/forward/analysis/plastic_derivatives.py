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

from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.analysis.constitutive import Flow
from geoident.forward.analysis.stage import StageTask, add_stress_from_moduli_slopes
from geoident.forward.analysis.stage_equations import Balance, StageEquations, Trial
from geoident.forward.analysis.systems import StageSystems
from geoident.model.arrays import Floats

_SAME_TANGENT = 1e-7
"""Relative difference of tangents up to which a factor serves the derivatives."""

_SAME_GENERAL_TANGENT = 1e-11
"""The same without potential, where eigenvalues may be a ten thousandth of the elastic ones."""

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
    """
    trial, structures, points = balance.trial, systems.structures, systems.discretization.points
    du = trial.du if task.motion is None else trial.du + task.motion[:, 0]
    members = task.carried.members[:, 1:]
    members[:, : task.n] += task.rigidities[:, 1:] * structures.strain(du)[:, None]
    slopes = _at_rest(task, systems, equations, trial, du)
    rest = task.forces[:, 1:] - points.forces(slopes, task.system.volume)
    if structures.n_rows:
        rest -= structures.nodal_forces(members)
    ddu = np.zeros_like(rest)
    if len(equations.dofs):
        ddu[equations.dofs] = _solved(equations, balance, rest[equations.dofs])
    task.carried.stress[..., 1:] = slopes + _following(task, points.strain(ddu), equations, trial)
    if structures.n_rows:
        members += task.rigidities[:, :1] * structures.strain(ddu)
    return ddu


def _at_rest(
    task: StageTask, systems: StageSystems, equations: StageEquations, trial: Trial, du: Floats
) -> Floats:
    """Derivatives g (s, n_points, n + k) of the stress, the displacements (n_dofs,) kept."""
    slopes = np.ascontiguousarray(task.carried.stress[..., 1:])
    strain = systems.discretization.points.strain(du)
    if task.thermal is not None:
        strain[:NORMAL_COMPONENTS] -= task.thermal[:, 0]
    add_stress_from_moduli_slopes(task, strain, slopes)
    for flow in equations.flowing(trial):
        before, points = None, flow.points
        if flow.ground.hardens:
            before = task.carried.multipliers(flow.ground.name, points, _DERIVATIVES)
        slopes[:, points], more = flow.derivatives(
            slopes[:, points], before, of_law=True, viscosity=equations.viscosity
        )
        _add_multipliers(task, flow, more)
    return slopes


def _following(task: StageTask, strain: Floats, equations: StageEquations, trial: Trial) -> Floats:
    """T E C ddu (s, n_points, n + k) of strains C ddu, which are overwritten."""
    stress = strain
    for ground in equations.grounds:
        points = ground.points
        stress[:, points] = ground.elasticity.stress(stress[:, points])
    for flow in equations.flowing(trial):
        stress[:, flow.points], more = flow.derivatives(
            stress[:, flow.points], of_law=False, viscosity=equations.viscosity
        )
        _add_multipliers(task, flow, more)
    return stress


def _add_multipliers(task: StageTask, flow: Flow, more: Floats | None) -> None:
    """Count further derivatives (y, q, n + k) of the multipliers of a flow."""
    if more is not None and flow.ground.hardens:
        task.carried.add_multipliers(flow.ground.name, flow.points, _DERIVATIVES, more)


def _solved(equations: StageEquations, balance: Balance, rest: Floats) -> Floats:
    """Solutions (n, k) with the tangent at the end; the last factor serves on the same pieces."""
    factor = balance.factor
    if factor is None or not _is_exact(equations, balance):
        factor, _ = equations.factor(balance.trial)
    return factor.solve(rest)


def _is_exact(equations: StageEquations, balance: Balance) -> bool:
    """Whether the last factor was made on the pieces of the end."""
    if balance.made_at is None:
        return False
    same = _SAME_TANGENT if equations.associated else _SAME_GENERAL_TANGENT
    before, after = (equations.changes(t) for t in (balance.made_at, balance.trial))
    least = same * np.abs(after[1]).max(initial=0.0)
    alike = np.array_equal(before[0], after[0])
    return alike and bool(np.allclose(before[1], after[1], rtol=0.0, atol=least))
