"""The stages of one analysis that conduct heat, and the strains that this brings (theory 18.7).

Temperatures do not depend on motions, so a stage of heat goes its own steps, and whoever moves the
ground asks for the strain that comes in a part of a step, or between two moments.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from geoident.forward.heat.conduction import Conduction
from geoident.forward.heat.march import Definite, HeatMarch
from geoident.forward.stages import CaseOnMesh
from geoident.forward.time_steps import TimeStep
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint

StepsOf = Callable[[Sequence[float]], Sequence[TimeStep]]


class StageHeating:
    """The temperatures of one stage under way, and the strains that they bring.

    Args:
        conduction: of the case.
        on_mesh: the case on its mesh.
        state: number of the first state of the stage.
        point: the parameters.
        march: its temperatures.
        at_points: (n_points, 1 + n) temperatures from which strains count at its beginning.
    """

    def __init__(
        self,
        conduction: Conduction,
        on_mesh: CaseOnMesh,
        state: int,
        point: ParameterPoint,
        march: HeatMarch,
        at_points: Floats,
    ) -> None:
        self._conduction, self._march, self._state = conduction, march, state
        self._in_parts = self._at_moments = at_points
        materials, points_of = on_mesh.case.materials, on_mesh.discretization.points_of
        self._expansions = [
            (points_of[group], point.number(materials[name].expansion))
            for group, name in on_mesh.sequence.states[state].materials.items()
        ]

    @property
    def bends(self) -> tuple[float, ...]:
        """Times in the stage, s, at which something given changes its slope, ascending."""
        return self._conduction.bends(self._state)

    def temperatures(self, moment: float) -> Floats:
        """(n_nodes, 1 + n) at a moment of the stage, s since its beginning."""
        return self._march.at(moment)[self._conduction.joined]

    def until(self, time: float) -> Floats:
        """Normal strain (n_points, 1 + n) that came since the last time that was asked for, s."""
        now = self._conduction.at_points @ self._march.at(time)
        strain, self._in_parts = self._strain(now - self._in_parts), now
        return strain

    def until_moment(self, moment: float) -> Floats:
        """The same since the last moment: a part of a step may have gone on beyond it."""
        now = self._conduction.at_points @ self._march.at(moment)
        strain, self._at_moments = self._strain(now - self._at_moments), now
        return strain

    def forget(self) -> None:
        """Forget factorizations."""
        self._march.forget()

    def _strain(self, change: Floats) -> Floats:
        """Normal strains (n_points, 1 + n) of changes of temperature."""
        strain = np.zeros_like(change)
        for points, expansion in self._expansions:
            strain[points] = (Dual(change[points]) * expansion).columns
        return strain


class Heating:
    """Makes the heat of the stages of one analysis.

    Args:
        conduction: of the case.
        on_mesh: the case on its mesh.
        point: the parameters, and those to differentiate by in the run.
        definite: prepares matrices.
    """

    def __init__(
        self,
        conduction: Conduction,
        on_mesh: CaseOnMesh,
        point: ParameterPoint,
        definite: Definite,
    ) -> None:
        self._conduction, self._on_mesh, self._point = conduction, on_mesh, point
        self._definite = definite
        self._going: StageHeating | None = None  # the moments of a stage are in a row

    def initial(self) -> Floats:
        """(n_nodes, 1 + n) temperatures before the first stage."""
        scalar = self._on_mesh.case.initial_temperature
        assert scalar is not None  # of a case that conducts
        shape = self._on_mesh.mesh.n_nodes, self._point.n_columns
        return np.broadcast_to(self._point.number(scalar).columns, shape).copy()

    def stage(
        self, number: int, before: Floats, steps: StepsOf, moments: Sequence[float]
    ) -> StageHeating:
        """The stage of a state, begun now or at an earlier moment.

        Args:
            number: of the state.
            before: (n_nodes, 1 + n) temperatures of the state on which it builds.
            steps: those in time of a stage that begins, by the times at which what is given bends.
            moments: of the stage, s.
        """
        if self._going is not None and self._on_mesh.sequence.states[number].goes_on:
            return self._going
        begun, at_points = self._conduction.begin(number, before, self._point)
        march = HeatMarch(
            self._conduction,
            number,
            self._point,
            begun,
            steps(self._conduction.bends(number)),
            moments,
            self._definite,
        )
        self._going = StageHeating(
            self._conduction, self._on_mesh, number, self._point, march, at_points
        )
        return self._going

    def forget_factors(self) -> None:
        """Forget factorizations; they are made again where they are needed."""
        if self._going is not None:
            self._going.forget()
