"""Derivatives of a plastic step on its active pieces.

With s* = sigma_old + E C du and sigma = P(s*, p),

    g_h  = T (dsigma_old/dp_h + dE/dp_h C du) + dP/dp_h       (du kept)
    K_T ddu/dp_h = df/dp_h - C^T V g_h
    dsigma/dp_h = g_h + T E C ddu/dp_h

(in a part of a step in time with the rows of the water, theory 18.6; where a part mu of the
overstress is kept, T and dP/dp count 1 - mu, and mu is added to T),
so one factorization of the consistent tangent serves all columns; where the last Newton step did
not leave its pieces it is there already. Where overstress was balanced, derivatives go from each
solution to the next with those of its field o' (`balanced_overstress`): on the right side stands
mu C^T V (dt/dp_h o' + t do'/dp_h) as well, and dt/dp_h follows from the work of what is left. At a
kink the derivative is that of the planes which the projection counts as active (see
`geoident.fem.yielding.law`).
"""

from __future__ import annotations

import numpy as np

from geoident.errors import ModelError
from geoident.forward.analysis.constitutive import PlasticResponse
from geoident.forward.analysis.stage import StageTask
from geoident.forward.analysis.stage_equations import (
    Balance,
    BalancedStep,
    SingularTangent,
    StageEquations,
    Tangent,
)
from geoident.forward.analysis.stage_points import StagePoints
from geoident.forward.analysis.systems import StageSystems
from geoident.model.arrays import Floats

_DERIVATIVES = slice(1, None)
"""Columns of what the analysis carries; column 0 is the state."""


def plastic_derivatives(
    task: StageTask,
    systems: StageSystems,
    points: StagePoints,
    equations: StageEquations,
    balance: Balance,
) -> tuple[Floats, Floats]:
    """Derivatives of the displacement step (n_motions, n + k) and of stresses (s, m, n + k).

    Those of multipliers, and of forces in structures by their moduli, are carried on.

    Pressures of water, divided by their size, and rotations of members that yield follow the
    displacements.

    Args:
        task: the stage; its state is still that of before.
        systems: the equations of the stages.
        points: all that is strained in it.
        equations: those of this stage, with the viscosity at its end.
        balance: their solution.

    Raises:
        ModelError: the consistent tangent is singular, so there are no derivatives.
    """
    steps = balance.steps or (BalancedStep(balance.end, balance.viscosity),)
    field = None  # derivatives of o'
    for step in steps[:-1]:
        before = _AtStep(task, systems, points, equations.viscous(step.viscosity), step)
        field = before.overstress(before.solve(None, field)[0])
    last = _AtStep(task, systems, points, equations, steps[-1])
    ddu, multiples = last.solve(balance.tangent, field)
    return ddu, last.end(ddu, multiples, field)


class _AtStep:
    """Derivatives at a solution: of what is there at fixed displacements, and by these.

    Args:
        task: the stage.
        systems: the equations of the stages.
        points: all that is strained in it.
        equations: those of this stage, with the viscosity of the solution.
        step: the solution.
    """

    def __init__(
        self,
        task: StageTask,
        systems: StageSystems,
        points: StagePoints,
        equations: StageEquations,
        step: BalancedStep,
    ) -> None:
        self._task, self._equations, self._step = task, equations, step
        self._points = points
        trial = points.trial(_DERIVATIVES)
        self._members = task.carried.members[:, _DERIVATIVES].copy()
        points.add_stiffness_derivatives(systems, step.iterate.du, trial, self._members)
        self._trial, self._stress = trial, trial.copy()
        self._multipliers = []
        for response in step.iterate.flowing:
            before, place = None, response.points
            if response.ground.hardens:
                before = task.carried.multipliers(response.ground.name, place, _DERIVATIVES)
            ends = response.derivatives(trial[:, place], before, of_law=True)
            self._stress[:, place] = ends[0]
            self._multipliers.append((response, ends[1]))

    def solve(self, tangent: Tangent | None, field: Floats | None) -> tuple[Floats, Floats]:
        """Derivatives (n_dofs, n + k) of the displacement step, and (n + k,) of t.

        Args:
            tangent: of the last step of Newton's method, or None.
            field: (s, m, n + k) derivatives of o'; None where nothing is taken off.

        Raises:
            ModelError: the consistent tangent is singular.
        """
        task, equations, step = self._task, self._equations, self._step
        volume = self._points.volume
        rest = self._points.given_forces(_DERIVATIVES)
        rest = rest - self._points.forces(self._stress, volume)
        self._points.add_water_derivatives(step.iterate.du, rest)
        if len(self._members):
            rest -= self._points.elastic_forces(self._members)
        if field is not None and step.field is not None:
            part = step.viscosity * step.multiple
            along = step.viscosity * self._points.forces(step.field, volume)
            rest = np.column_stack([rest + part * self._points.forces(field, volume), along])
        ddu, dofs = np.zeros_like(rest), equations.dofs
        if len(dofs):
            if tangent is None or not equations.serves(tangent, step.iterate):
                tangent = equations.tangent(step.iterate)
            try:
                ddu[dofs] = equations.solve_consistently(tangent, rest[dofs])
            except SingularTangent as error:
                msg = f"at stage '{task.state.name}' the displacements have no derivatives by the "
                msg += "parameters: the ground is at its limit load"
                hint = "Raise the strengths a little, or see whether the stage lacks support."
                raise ModelError(msg, hint) from error
        if field is None or step.field is None:
            return ddu, np.zeros(ddu.shape[1])
        strain = self._points.strain(step.iterate.du)
        more = self._points.strain(ddu)
        change = self._overstress_by(ddu)
        change[..., :-1] += self._overstress_alone() - step.multiple * field
        work = np.einsum("smn,sm,m->n", change, strain, volume, optimize=True)
        work += np.einsum("smn,sm,m->n", more, step.left, volume, optimize=True)
        by_multiple = work[-1] - np.einsum("sm,sm,m->", step.field, strain, volume)
        multiples = -work[:-1] / by_multiple
        return ddu[:, :-1] + np.multiply.outer(ddu[:, -1], multiples), multiples

    def overstress(self, ddu: Floats) -> Floats:
        """(s, m, n + k) of the overstress, with those (n_dofs, n + k) of the displacements."""
        return self._overstress_alone() + self._overstress_by(ddu)

    def _overstress_alone(self) -> Floats:
        """The same at fixed displacements: o = (s* - sigma) / (1 - mu)."""
        return self._of_ground((self._trial - self._stress) / (1.0 - self._step.viscosity))

    def _overstress_by(self, ddu: Floats) -> Floats:
        """What displacements (n_dofs, ...) add to it."""
        trial = self._elastic(ddu)
        stress, _ = self._returned(trial.copy())
        return self._of_ground((trial - stress) / (1.0 - self._step.viscosity))

    def _of_ground(self, stress: Floats) -> Floats:
        """Stresses (s, m, ...) without those of structures, which keep no overstress."""
        return np.asarray(stress * self._equations.of_ground[:, None])

    def _elastic(self, ddu: Floats) -> Floats:
        """E C ddu (s, m, n + k)."""
        stress = self._points.strain(ddu)
        for ground in self._equations.grounds:
            stress[:, ground.points] = ground.elasticity.stress(stress[:, ground.points])
        return stress

    def _returned(
        self, stress: Floats
    ) -> tuple[Floats, list[tuple[PlasticResponse, Floats | None]]]:
        """T E C ddu of E C ddu, written over it, and the multipliers."""
        multipliers = []
        for response in self._step.iterate.flowing:
            place = response.points
            stress[:, place], dlam = response.derivatives(stress[:, place], of_law=False)
            multipliers.append((response, dlam))
        return stress, multipliers

    def end(self, ddu: Floats, multiples: Floats, field: Floats | None) -> Floats:
        """Derivatives (s, m, n + k) of stresses; those of multipliers are carried on."""
        carried, step = self._task.carried, self._step
        stress, multipliers = self._returned(self._elastic(ddu))
        stress += self._stress
        if field is not None and step.field is not None:
            taken = step.multiple * field + np.multiply.outer(step.field, multiples)
            stress -= step.viscosity * taken
        carried.members[:, _DERIVATIVES] = self._members
        for response, dlam in (*self._multipliers, *multipliers):
            if dlam is not None and response.ground.hardens:
                carried.add_multipliers(response.ground.name, response.points, _DERIVATIVES, dlam)
        return stress
