"""Temperatures of one stage in time, with exact derivatives (theory 18.7).

The heat balance M T' + H T = F theta(t) + M A'(t), with films F among H and A the adiabatic rise,
goes the steps of `time_steps` (TR-BDF2). A part of a step from T_0 to T_1:

    M (T_1 - T_0) = - h H (T_1 + w) + F int theta dt + M (A_1 - A_0)

with w of what was before (`PartOfStep`). What comes in a part is exact (of a theta that is linear
the formulas make the same), so concrete without exchange warms by A whatever the steps. Given
temperatures are on the right, as known changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import Factor
from geoident.fem.solvers.quasi_definite import QuasiDefinite
from geoident.forward.heat.conduction import Conduction
from geoident.forward.time_steps import PartOfStep, TimeLoop, TimeStep
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import ParameterPoint

Definite = Callable[[sp.csr_array, sp.csr_array, Ints], QuasiDefinite]
"""Prepares A_0 + h A_1, both (n, n) and positive definite, of unknowns at nodes (n,)."""


class HeatMarch:
    """The temperatures of one stage at one parameter vector, as far as they were asked for.

    Args:
        conduction: of the case.
        state: number of the first state of the stage.
        point: the parameters.
        begun: (n_nodes, 1 + n) temperatures at the beginning.
        steps: in time; none where no time passes.
        moments: times that are asked for later than others, s.
        definite: prepares matrices.
    """

    def __init__(
        self,
        conduction: Conduction,
        state: int,
        point: ParameterPoint,
        begun: Floats,
        steps: Sequence[TimeStep],
        moments: Sequence[float],
        definite: Definite,
    ) -> None:
        self._conduction, self._state, self._point = conduction, state, point
        self._system = conduction[state]
        self._loop = TimeLoop(steps, begun, self._after, _sum)
        self._operators = conduction.operators(state, point)
        held = self._system.held
        self._free = self._system.nodes[~held[self._system.nodes]]
        self._moments = sorted(moments)
        self._reached = {0.0: begun}
        M, H = self._operators.capacity.value, self._operators.flow.value
        free, self._matrices = self._free, None
        if len(free) and steps:
            self._matrices = definite(M[free][:, free], H[free][:, free], free)
        self._factor: tuple[float, Factor] | None = None

    def at(self, time: float) -> Floats:
        """Temperatures (n_nodes, 1 + n) at a time, s: a moment, or not before the last step."""
        while self._moments and self._moments[0] <= time:
            moment = self._moments.pop(0)
            self._reached[moment] = self._loop.to(moment)
        return self._reached[time] if time in self._reached else self._loop.to(time)

    def forget(self) -> None:
        """Forget the factorization; it is made again where it is needed."""
        self._factor = None

    def _after(self, part: PartOfStep[Floats]) -> Floats:
        """Temperatures (n_nodes, 1 + n) at the end of a part of a step."""
        before, span, h = part.before, part.span, part.h
        M, H = self._operators.capacity, self._operators.flow
        given = self._conduction.given(self._state, span[1], self._point)
        change = np.where(self._system.held[:, None], given - before, 0.0)
        driving = before + change + sum(weight * T for weight, T in part.past)
        heat = -M.at(change) - h * H.at(driving)
        if self._system.films:
            heat += self._conduction.let_in(self._state, span, self._point)
        source = self._conduction.set_free(self._state, span, self._point)
        if source is not None:
            heat += source
        if len(self._free):
            self._solve(h, heat, change)
        return before + change

    def _solve(self, h: float, heat: Floats, change: Floats) -> None:
        """Add the changes of what is not given to change (n_nodes, 1 + n), from heat likewise."""
        factor, free = self._factorized(h), self._free
        state = factor.solve(heat[free, :1])
        change[free, :1] += state
        alone = change[:, 0].copy()
        alone[self._system.held] = 0.0  # what is given has its slopes in `heat`
        for n, slope in self._operators.capacity.slopes.items():
            heat[:, 1 + n] -= slope @ alone
        for n, slope in self._operators.flow.slopes.items():
            heat[:, 1 + n] -= h * (slope @ alone)
        columns = 1 + np.flatnonzero(heat[free, 1:].any(axis=0))
        if len(columns):
            change[np.ix_(free, columns)] += factor.solve(heat[np.ix_(free, columns)])

    def _factorized(self, h: float) -> Factor:
        if self._factor is None or self._factor[0] != h or not self._factor[1].valid:
            assert self._matrices is not None
            self._factor = h, self._matrices.factor(h)
        return self._factor[1]


def _sum(temperatures: Sequence[Floats], weights: Sequence[float]) -> Floats:
    return np.asarray(sum(w * T for w, T in zip(weights, temperatures, strict=True)))
