"""The marches of a case at any parameter vector, and what they have cost."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geoident.fem.solvers.direct import Solver
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.adjoints import AdjointTable
from geoident.forward.gauges.instrument_errors import InstrumentErrors
from geoident.forward.gauges.observation import Observation
from geoident.forward.ground.moduli import inadmissible_moduli
from geoident.forward.march.march import March, Run, RunOptions
from geoident.forward.march.systems import StageSystems
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.results.result import Counts

WHOLE = RunOptions()
"""All states with their derivatives."""


class Marches:
    """Marches of a case with its gauges, each counted.

    Args:
        on_mesh: the case and the mesh that it fits.
        observation: its gauges there.
        solver: factorizes the stiffness matrices.

    Attributes:
        on_state: is told of every state computed.
        last_adjoints: readings with their derivatives at the parameters that were evaluated last.
    """

    def __init__(self, on_mesh: CaseOnMesh, observation: Observation, *, solver: Solver) -> None:
        self.on_mesh, self.observation = on_mesh, observation
        self.case, self.mesh, self.sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
        self.names = tuple(parameter.name for parameter in self.case.parameters)
        self.instrument_errors = InstrumentErrors(self.case, self.sequence.built_on)
        self._solver = solver
        self._evaluations = 0
        self.on_state: Callable[[int], None] | None = None
        self.last_adjoints: AdjointTable | None = None
        self.discretization = on_mesh.discretization
        self.systems = StageSystems(on_mesh, solver)
        self.structures = self.systems.structures
        self.march = March(on_mesh, self.systems)
        self.actions = self.march.actions

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        spent = self._solver.counts
        return Counts(self._evaluations, spent.analyses, spent.factorizations, spent.solves)

    @property
    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return any(material.yields for material in self.case.materials.values())

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        if not np.all(np.isfinite(p)):
            return "a parameter is not finite"
        values = self.values(p)
        found = inadmissible_numbers(self.case, self.sequence, values)
        for name in () if found else self.sequence.materials:
            fields = self.on_mesh.elastic_fields(name)
            if fields:
                s = self.discretization.points.n_strain
                found = found or inadmissible_moduli(self.case.materials[name], fields, values, s)
        return found

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def count_evaluation(self) -> int:
        """One more parameter vector was evaluated: how many so far."""
        self._evaluations += 1
        return self._evaluations

    def at(self, p: Floats, options: RunOptions = WHOLE) -> Run:
        """One march at parameters p (n,); its states come one by one.

        Args:
            p: (n,) parameters.
            options: how to march.
        """
        return Run(self.march, ParameterPoint(self.values(p), self.names), options, self._tell)

    def _tell(self, state: int) -> None:
        if self.on_state is not None:
            self.on_state(state)
