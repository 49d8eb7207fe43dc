"""Derivatives of a plastic step on its active pieces.

With s* = sigma_old + E C du and sigma = P(s*, p),

    g_h  = T (dsigma_old/dp_h + dE/dp_h C du) + dP/dp_h       (du kept)
    K_T ddu/dp_h = df/dp_h - C^T V g_h
    dsigma/dp_h = g_h + T E C ddu/dp_h

so one factorization of the consistent tangent serves all columns; where the last Newton step did
not leave its pieces it is there already. At a kink the derivative is that of the planes which the
projection counts as active (see `geoident.fem.yielding.law`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.fem.solvers.protocol import Factor
from geoident.fem.yielding.law import LawSlopes
from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.march.discretization import StageSystems
from geoident.forward.march.equilibrium import Balance
from geoident.forward.march.hardening import Hardening
from geoident.forward.march.stage_equations import StageEquations, Trial, flowing
from geoident.forward.march.step import StepTask
from geoident.forward.yielding.laws import law_slopes
from geoident.model.arrays import Floats
from geoident.model.case import Case

_SAME_TANGENT = 1e-7
"""Relative difference of tangents up to which a factor serves the derivatives."""


class PlasticSlopes:
    """Differentiates stages in which materials yield.

    Args:
        case: the case.
        systems: the equations of the stages.
    """

    def __init__(self, case: Case, systems: StageSystems) -> None:
        self._case = case
        self._systems = systems
        self._structures = systems.structures

    def of(self, task: StepTask, equations: StageEquations, balance: Balance) -> Floats:
        """Derivatives (n_dofs, n + k) of the displacement step; updates what is borne.

        Args:
            task: the stage; its state is still that of before.
            equations: its equations.
            balance: their solution.
        """
        trial = balance.trial
        members = task.borne.members[:, 1:]
        strain = self._structures.strain(trial.du)[:, None]
        members[:, : len(task.names)] += task.moduli[:, 1:] * strain
        slopes = self._at_rest(task, equations, trial)
        rest = task.forces[:, 1:] - self._systems.points.forces(slopes, task.system.volume)
        if self._structures.n_rows:
            rest -= self._structures.nodal_forces(members)
        ddu = np.zeros_like(rest)
        if len(equations.dofs):
            factor = _exact_factor(equations, balance)
            ddu[equations.dofs] = factor.solve(rest[equations.dofs])
        task.borne.stress[..., 1:] = slopes + self._following(task, equations, trial, ddu)
        if self._structures.n_rows:
            members += task.moduli[:, :1] * self._structures.strain(ddu)
        return ddu

    def _at_rest(self, task: StepTask, equations: StageEquations, trial: Trial) -> Floats:
        """Derivatives g (s, n_points, n + k) of the stress, the displacements kept."""
        slopes = np.ascontiguousarray(task.borne.stress[..., 1:])
        strain = self._systems.points.strain(trial.du)
        if task.thermal is not None:
            strain[:NORMAL_COMPONENTS] -= task.thermal[:, 0]
        further = slopes.shape[2] - len(task.names)
        hardening = Hardening(task, slopes.shape[2])
        of_laws = {m: self._of_law(task, m) for m in task.system.points_of}
        for material, mine in task.system.points_of.items():
            for column, name in enumerate(task.names):
                found = of_laws[material].get(name)
                if found is not None and found.elasticity is not None:
                    slopes[:, mine, column] += found.elasticity @ strain[:, mine]
        for ground, projection, mine in flowing(equations, trial):
            given = [of_laws[ground.name].get(name) for name in task.names] + [None] * further
            before = hardening.before(ground, mine)
            slopes[:, mine], more = projection.slopes(slopes[:, mine], given, before)
            hardening.add(ground, mine, more)
        return slopes

    def _following(
        self, task: StepTask, equations: StageEquations, trial: Trial, ddu: Floats
    ) -> Floats:
        """T E C ddu (s, n_points, n + k)."""
        stress = self._systems.points.strain(ddu)
        hardening = Hardening(task, stress.shape[2])
        for ground in equations.grounds:
            mine = ground.points
            stress[:, mine] = np.tensordot(ground.elasticity, stress[:, mine], axes=1)
        for ground, projection, points in flowing(equations, trial):
            stress[:, points], more = projection.slopes(stress[:, points])
            hardening.add(ground, points, more)
        return stress

    def _of_law(self, task: StepTask, material: str) -> Mapping[str, LawSlopes]:
        n_strain = self._systems.points.n_strain
        given = self._case.materials[material]
        return law_slopes(given, task.values, task.names, n_strain)


def _exact_factor(equations: StageEquations, balance: Balance) -> Factor:
    """The factor of the tangent at the end: the last one, unless it was made on other pieces."""
    if balance.factor is not None and balance.made_at is not None:
        before, after = (equations.changes(t) for t in (balance.made_at, balance.trial))
        if np.array_equal(before[0], after[0]) and np.allclose(
            before[1], after[1], rtol=0.0, atol=_SAME_TANGENT * np.abs(after[1]).max(initial=0.0)
        ):
            return balance.factor
    return equations.factor(balance.trial)[0]
