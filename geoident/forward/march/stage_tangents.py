"""Factors of the consistent tangent of one stage."""

from __future__ import annotations

from geoident.fem.solvers.general import GeneralFactor
from geoident.fem.solvers.protocol import Factor
from geoident.forward.march.discretization import StageSystems
from geoident.forward.march.step import StepTask
from geoident.model.arrays import Floats, Ints


class StageTangents:
    """Factors of K plus changes at strain points, for one stage and parameter vector."""

    def __init__(self, systems: StageSystems, task: StepTask) -> None:
        self._systems = systems
        self._system = task.system
        self._elastic = systems.values(task.system, task.state, task.laws, task.values)

    def __call__(self, points: Ints, change: Floats, *, symmetric: bool) -> Factor:
        """Factor of K plus changes (q, s, s) of V E at some points (q,)."""
        below, above = self._elastic, self._elastic
        if len(points):
            more = self._systems.tangents(self._system).added(points, change, symmetric=symmetric)
            below, above = below + more[0], above + more[1]
        analysis = self._systems.analysis(self._system)
        if analysis is None:
            raise AssertionError
        if symmetric or not len(points):
            return analysis.factorize(below)
        counts = self._systems.solver_counts
        return GeneralFactor(self._system.pattern.lower, below, above, counts)
