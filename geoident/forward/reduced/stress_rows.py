"""Gauges that read stresses of the ground or forces of structures, as sums over strain points.

What a load cell or a stress cell reads is a fixed sum of the forces of members or of the stresses
around it, so it is known with the stress of the reduced model, and its error with that of this
(theory 14.4). Left out is what is not linear in the stress (principal stresses), what makes a
strain of a force by a rigidity that is sought, and total stresses where water is in the pores.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.gauges.observation import AnalysisState, Observable, PlacedGauges
from geoident.forward.reduced.points import AnalysisPoints
from geoident.forward.reduced.zones import StressTerm
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint

_MOVED = 1e-3
"""Part of their size by which parameters are moved to see whether a gauge depends on them."""


@dataclass(frozen=True, eq=False)
class StressRows:
    """Channels (c) that read stresses or forces.

    Args:
        channels: (c,) which of all channels.
        points: (q,) strain points and members that they read, ascending.
        weights: (c, s, q) of the stresses there.
    """

    channels: Ints
    points: Ints
    weights: Floats

    def at(self, points: Ints) -> tuple[Ints, Floats]:
        """Those of some points (p,) that are read, and their weights (c, s, q)."""
        read = np.isin(self.points, points)
        return self.points[read], self.weights[:, :, read]


@dataclass(frozen=True, eq=False)
class StageForces:
    """What these channels see of the stress of a state of the reduced model.

    Args:
        channels: (c,) which of all channels.
        loads: (c, r) by the coordinates of the loads: the stress in situ, forces of jacks.
        terms: (r_m, c, N_l) by state and material.
    """

    channels: Ints
    loads: Floats
    terms: Mapping[StressTerm, Floats]


def stress_rows(analysis: StagedAnalysis, gauges: PlacedGauges) -> StressRows:
    """The channels of a case that read stresses or forces in a way that is covered."""
    points = AnalysisPoints(analysis.systems)
    s = points.n_strain
    channels, own = [], list[tuple[Ints, Floats]]()
    for row, observable, wanted in _others(gauges):
        covered = _covered(analysis, observable, wanted)
        if covered is None:
            continue
        stress, members = covered
        whole = np.zeros((s, points.n_points))
        whole[:, : points.n_ground] = stress.reshape(s, -1)
        whole[0, points.n_ground :] = members
        read = np.flatnonzero(whole.any(axis=0))
        channels.append(row)
        own.append((read, whole[:, read]))
    every = np.unique(np.concatenate([np.empty(0, np.int64), *(read for read, _ in own)]))
    weights = np.zeros((len(own), s, len(every)))
    for weight, (read, values) in zip(weights, own, strict=True):
        weight[:, np.searchsorted(every, read)] = values
    return StressRows(np.array(channels, dtype=np.int64), every, weights)


def beyond_reduction(analysis: StagedAnalysis, gauges: PlacedGauges, rows: Ints) -> str | None:
    """Why some channels have no reduced model, a clause, or None if they have.

    Args:
        analysis: of the case.
        gauges: those of the case, on its mesh.
        rows: (g,) the channels.
    """
    if analysis.case.in_steps is not None:
        return analysis.case.in_steps
    if gauges.not_linear(rows) is None:
        return None
    for row, observable, wanted in _others(gauges):
        if row in rows and _covered(analysis, observable, wanted) is None:
            name = gauges.channels[row]
            return f"gauge '{name}' reads more than displacements, normal stresses and forces"
    return None


def _others(gauges: PlacedGauges) -> list[tuple[int, Observable, Bools]]:
    """Channels that read more than displacements: row, what reads it, which of its rows."""
    others = []
    for channels, observable in gauges.parts:
        if observable.rows is None:
            for place, row in enumerate(channels):
                others.append((int(row), observable, np.arange(len(channels)) == place))
    return others


def _covered(
    analysis: StagedAnalysis, observable: Observable, wanted: Bools
) -> tuple[Floats, Floats] | None:
    """Weights of the stresses (s n_points,) and of the forces (n_rows,); None if not covered."""
    ground, structures = analysis.systems.discretization, analysis.systems.structures
    n_strain, n_points = ground.points.n_strain, ground.points.n_points
    nothing = StageEnd(
        0,
        np.zeros((ground.n_dofs, 1)),
        np.zeros((n_strain, n_points, 1)),
        np.zeros((structures.n_rows, 1)),
        np.zeros(n_points, dtype=bool),
    )
    start = analysis.case.start
    moved = {name: value * (1.0 + _MOVED) + 1e-12 for name, value in start.items()}
    weights = []
    for values in (start, moved):
        state = AnalysisState(nothing, ParameterPoint(values, ()), structures)
        rows = observable.linear(state, wanted)
        if rows is None or rows.u is not None:
            return None
        (chosen,) = np.flatnonzero(wanted)
        stress, members = (
            np.zeros(size) if part is None else part[[chosen]].toarray()[0]
            for part, size in (
                (rows.stress, nothing.stress.size),
                (rows.members, structures.n_rows),
            )
        )
        weights.append((stress, members))
        for number in range(len(analysis.sequence.states)):
            still = replace(state, end=replace(nothing, number=number))
            if np.any(observable.values(still)[wanted]):  # something beside the stress
                return None
    (stress, members), other = weights
    same = np.array_equal(stress, other[0]) and np.array_equal(members, other[1])
    return (stress, members) if same and (stress.any() or members.any()) else None
