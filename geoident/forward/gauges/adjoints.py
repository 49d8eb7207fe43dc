"""Readings of a run and their derivatives by adjoints; whether these cost less than tangents."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from geoident.forward.analysis.adjoint import (
    AdjointAnalysis,
    AdjointPlan,
    EachAdjoint,
    ReadingSeeds,
    reach,
)
from geoident.forward.analysis.analysis import AnalysisRun, StagedAnalysis
from geoident.forward.analysis.stage import LinearRows, StageEnd
from geoident.forward.gauges.observation import AnalysisState, PlacedGauges
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import ParameterPoint

WeighAdjoint = Callable[[Floats], tuple[float, float]]

_TANGENT = 1.5
"""What a column of tangents costs, with its stresses at all points, in columns of adjoints."""


class ReadingAdjoints:
    """Some readings of a model (g), and the way back from them.

    Args:
        analysis: of the model.
        gauges: those of the case, on its mesh.
        rows: (g,) channels.
        states: (g,) states.
        last: number of the last state of the runs.
    """

    def __init__(
        self,
        analysis: StagedAnalysis,
        gauges: PlacedGauges,
        rows: Ints,
        states: Ints,
        last: int,
    ) -> None:
        self._analysis, self._gauges = analysis, gauges
        self.rows, self.states = rows, states
        self.last = last
        self._plan: AdjointPlan | None = None
        # by states, the last first: what an early state acts on then stands together
        (minus, row), of = np.unique(np.stack([-states, rows]), axis=1, return_inverse=True)
        self._of = of.ravel()
        self._channels, self._channel = np.unique(row, return_inverse=True)
        self._stage = -minus
        self._zero = np.minimum(gauges.zero[row], self.last)
        self._weights = gauges.weights[:, row]

    def _seeds(self, rows: LinearRows) -> ReadingSeeds:
        """Each pair of channel and state once."""
        return ReadingSeeds(rows, self._channel, self._stage, self._zero, self._weights)

    @cached_property
    def obstacle(self) -> str | None:
        """Why there are no adjoints, a clause, or None if there are."""
        analysis = self._analysis
        if analysis.case.in_steps is not None:
            return analysis.case.in_steps
        if analysis.case.interfaces:
            return "there are interfaces"
        for built in analysis.sequence.states[: self.last + 1]:
            for name in built.materials.values():
                if not analysis.case.materials[name].is_elastic:
                    return f"{name} yields"
            for part in analysis.systems.structures.yielding(built):
                return f"the structure '{part.name}' yields"
        discretization, structures = analysis.systems.discretization, analysis.systems.structures
        points = discretization.points
        nothing = StageEnd(
            0,
            np.zeros((discretization.n_dofs, 1)),
            np.zeros((points.n_strain, points.n_points, 1)),
            np.zeros((structures.n_rows, 1)),
            np.zeros(points.n_points, dtype=bool),
        )
        state = AnalysisState(nothing, ParameterPoint(analysis.case.start, ()), structures)
        if self._gauges.linear(state, self._channels) is None:
            return "a channel reads a principal stress"
        return None

    @cached_property
    def solves(self) -> int:
        """Columns for which adjoints solve, all states."""
        states = self._analysis.sequence.states[: self.last + 1]
        seeds = self._seeds(LinearRows())
        weights = np.array([seeds.at(n) for n in range(len(states))])
        return int(reach([state.base for state in states], weights).sum())

    def columns(self, n: int) -> tuple[int, str]:
        """Right-hand sides of an evaluation with derivatives by n parameters, and by which way."""
        if self.cost_less(n):
            return self.last + 1 + self.solves, "adjoints"
        return (self.last + 1) * (1 + n), "tangents"

    def cost_less(self, n: int) -> bool:
        """Whether they cost less than tangents by n parameters."""
        if not self.rows.size or not n:
            return False
        return self.solves < _TANGENT * n * (self.last + 1) and self.obstacle is None

    def observed(self, end: StageEnd, run: AnalysisRun) -> Floats:
        """What all channels see of a state of a traced run, (n_channels, 1 + n).

        The derivatives are those at a state that stays as it is, by the parameters that are no
        modes: of water in the pores, of the rigidity that makes strains of forces.
        """
        structures = self._analysis.systems.structures
        if self._gauges.displacements_only:
            return self._gauges.values(AnalysisState(end, run.point, structures))
        point = self._analysis.without_modes(run.full_point)
        more = point.n_columns - 1

        def fixed(values: Floats) -> Floats:
            return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, more)])

        still = replace(end, u=fixed(end.u), stress=fixed(end.stress), members=fixed(end.members))
        return self._gauges.values(AnalysisState(still, point, structures))

    def jacobian(self, run: AnalysisRun, end: StageEnd, observed: Floats) -> Floats:
        """Derivatives (g, n) of the readings by all n parameters.

        Without what gauges add by themselves. The run forgets its factors.

        Args:
            run: a traced run whose states are through.
            end: any of its states.
            observed: (n_states, n_channels, 1 + n) what all channels see, see `observed`.

        Raises:
            ValueError: a reading is not linear in the state.
        """
        analysis = self._analysis
        jacobian = self._back(run, end)
        if observed.shape[2] > 1:  # a reading depends on parameters at a state that stays
            direct = self._gauges.readings(observed[..., 1:], self.rows, self.states)
            names = analysis.without_modes(run.full_point).names
            jacobian[:, [run.full_point.names.index(name) for name in names]] += direct
        return np.asarray(jacobian)

    def weigh(self, run: AnalysisRun, end: StageEnd, weights: Mapping[int, WeighAdjoint]) -> Floats:
        """Two sums (2, g) over the stages that follow from the adjoint displacements of readings.

        For nodal forces r of a stage, lambda^T r is what they change a reading by, with all that
        later stages make of it. The run forgets its factors.

        Args:
            run: a traced run whose states are through.
            end: any of its states.
            weights: by state, what lambda (n_dofs,) of a reading adds to its two sums.
        """
        sums = np.zeros((self._of.max(initial=-1) + 1, 2))

        def each(state: int, readings: Ints, adjoint: Floats) -> None:
            if state in weights:
                for column, reading in enumerate(readings):
                    sums[reading] += weights[state](adjoint[:, column])

        self._back(run, end, each)
        return np.asarray(sums[self._of].T)

    def _back(self, run: AnalysisRun, end: StageEnd, each: EachAdjoint | None = None) -> Floats:
        """Derivatives (g, n) of the readings by what the states depend on."""
        analysis = self._analysis
        state = AnalysisState(end, run.point, analysis.systems.structures)
        rows = self._gauges.linear(state, self._channels)
        if rows is None:
            raise ValueError("a reading is not linear in the state")
        seeds = self._seeds(rows)
        if self._plan is None:
            self._plan = AdjointPlan(analysis, seeds, self.last)
        back = AdjointAnalysis(
            analysis, self._plan, run.traces, run.factors, run.full_point, seeds, each
        )
        jacobian = back.jacobian()[self._of]
        run.factors.forget()
        return np.asarray(jacobian)
