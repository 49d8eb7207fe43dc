"""The reaction of a mesh's own opening: what it releases so that its wall moves as a profile says.

A stage with a distance to the face wants that the wall has made a part s_k of its final motion.
With the motion of a wall the mean of what it moves inwards,

    ubar = - integral u . n dl / integral dl ,    n out of the opening,

counted from the state before the tunnel, its K released parts lambda solve

    F_k = ubar_k(lambda, p) - s_k(p) ubar_end(lambda, p) = 0 ,    k = 1 .. K,

where the states k are those of an analysis of their own: the stages with a distance one after the
other, with nothing built, and at last all of the stress released. The parts are parameters of
that run, so one run gives F and its derivatives by lambda and p; Newton's method solves it, and

    dlambda/dp = - (dF/dlambda)^-1 dF/dp .

Where the ground yields, ubar is convex in what is released: a step beyond all of the stress is
halved, and from above Newton's method comes down. The next parameter vector starts at
lambda + dlambda/dp dp, which leaves one or two analyses.

Newton's method begins with s, the parts of elastic ground, and then with what the curve through
their motions gives.

Where a stage ends with a residual (theory 5.4), what it leaves is as much as the last stage
releases, often less than a percent of the stress. Then ubar_end is that of all of the stress
released at once, from the state before the tunnel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from geoident.errors import CollapseError
from geoident.fem.faces import FacetPatch, patches
from geoident.fem.loads import pressure_forces, traction_weights
from geoident.fem.solvers import Solver
from geoident.forward.actions.release import ReleasedParts
from geoident.forward.analysis.analysis import AnalysisRun, RunOptions, StagedAnalysis
from geoident.forward.analysis.plastic_step import WarmStart
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.stages import CaseOnMesh, used_groups
from geoident.model.actions import FaceDistance
from geoident.model.arrays import Floats
from geoident.model.case import VIRGIN, Case, Stage
from geoident.model.dual import Dual, ParameterPoint, stacked
from geoident.model.parameter import Scalar

_SMALL = 1e-8
"""Step of the parts after which the next one is below rounding: steps are squared."""

_SMALL_AT_ONCE = 1e-5
"""The same where stages end with a residual: the next step is below what their motions are good
for."""

_MOST_ANALYSES = 40

_ROUGH = 0.02
"""Of the final motion: how far off the wall may be where stages end with a residual and Newton's
method does not end."""

_MOST_ROUGH = 12
"""Analyses after which the nearest parts are taken there."""

_END = " all released"
"""Name of the last stage of the analysis; no stage can have it, with its blank."""


class NoFinalMotion(Exception):
    """Without support the ground has no motion of which a part would be known.

    Args:
        reason: why, a clause.
        collapse: whether it comes to no rest.
    """

    def __init__(self, reason: str, *, collapse: bool = False) -> None:
        self.reason, self.collapse = reason, collapse
        super().__init__(reason)


@dataclass(frozen=True)
class _Solved:
    """The solution at a parameter vector.

    Args:
        values: the parameters.
        names: by which it is differentiated.
        columns: (K, 1 + n) the parts and their derivatives.
    """

    values: Mapping[str, float]
    names: tuple[str, ...]
    columns: Floats


class MeshReaction:
    """Released parts by which the wall of an opening in a mesh makes given parts of its motion.

    Args:
        on_mesh: the case, the stages with a distance of which build on each other.
        parts: how much of the stress is released before the tunnel.
        solver: factorizes the stiffness matrices.

    Attributes:
        releases: the distances that say a part each, in the order of the stages.
    """

    def __init__(self, on_mesh: CaseOnMesh, parts: ReleasedParts, solver: Solver) -> None:
        case, chain = on_mesh.case, stages_by_distance(on_mesh)
        assert case.face is not None
        stated = [case.stages[number - 1].distance for number in chain]
        distances = [FaceDistance(distance) for distance in stated if distance is not None]
        self.releases: tuple[FaceDistance, ...] = tuple(dict.fromkeys(distances))
        self._names = tuple(f"released part {k}" for k in range(len(self.releases)))
        named = dict(zip(self.releases, self._names, strict=True))
        in_turn, at_once = (
            replace(on_mesh, case=_unsupported(on_mesh, case.face.groups, names))
            for names in (named, {})
        )
        self._in_turn, self._at_once = (
            StagedAnalysis(one, StageSystems(one, solver), parts) for one in (in_turn, at_once)
        )
        self._end = len(in_turn.sequence.states) - 1
        self._before = self._end - len(chain) - 1
        self._states = [self._before + 1 + distances.index(release) for release in self.releases]
        self._inwards = _mean_inwards(in_turn, case.face.groups, self._before)
        self._last: _Solved | None = None

    @property
    def warm(self) -> WarmStart:
        """Where the stages of the opening may start; the case's own begin there, too."""
        return self._in_turn.warm

    def forget(self) -> None:
        """Begin the next solution as a new model does."""
        self._in_turn.forget()
        self._at_once.forget()
        self._last = None

    def parts(self, shares: Sequence[Dual], point: ParameterPoint) -> dict[FaceDistance, Dual]:
        """The parts of the stress (), 0 to 1, that are released, by distance.

        Args:
            shares: () of its final motion that the wall has made, for every release.
            point: the parameters.

        Raises:
            NoFinalMotion: without support the opening has none, or no part of it is found.
            ModelError: the analysis has no solution otherwise.
        """
        last = self._last
        at_last = last is not None and dict(last.values) == dict(point.values)
        if last is None or not (at_last and set(point.names) <= set(last.names)):
            self._last = last = self._solve(stacked(shares), point)
            self.warm.released = dict(zip(self._names, last.columns[:, 0].tolist(), strict=True))
        columns = [0, *(1 + last.names.index(name) for name in point.names)]
        return {r: Dual(last.columns[k, columns]) for k, r in enumerate(self.releases)}

    def _start(self, shares: Dual, point: ParameterPoint) -> Floats:
        """(K,) parts to begin with: those of elastic ground, or what the last ones lead to."""
        last = self._last
        if last is None:
            return np.array(shares.value)
        moved = [point.values[name] - last.values[name] for name in last.names]
        parts = last.columns[:, 0] + last.columns[:, 1:] @ np.array(moved)
        return parts if np.all((parts > 0.0) & (parts < 1.0)) else last.columns[:, 0].copy()

    def _solve(self, shares: Dual, point: ParameterPoint) -> _Solved:
        """Newton's method on F = 0, with what all of the stress moves, in turn or at once."""
        n, parts = len(point.names), self._start(shares, point)
        nearest, least, at_once = None, np.inf, None
        left, first = _MOST_ANALYSES, self._last is None
        while left > 0:
            wall, end = self._moved(parts, point, at_once)
            left -= 1
            if end is None:
                if at_once is None:
                    at_once, left = self._moved_at_once(point), _MOST_ROUGH
                end = at_once
            if not end[0] > 0.0:
                raise NoFinalMotion("the mean convergence is outward")
            off = wall - np.multiply.outer(shares.value, end)
            off[:, 1 : 1 + n] -= shares.columns[:, 1:] * end[0]
            step = np.linalg.solve(off[:, 1 + n :], off[:, : 1 + n])
            after = parts - step[:, 0]
            after = np.where(after < 1.0, after, 0.5 * (parts + 1.0))
            after = np.where(after >= 0.0, after, 0.5 * parts)
            curve = np.concatenate([[0.0], wall[:, 0], end[:1]])
            if first and np.all(np.diff(curve) > 0.0):
                released = np.concatenate([[0.0], parts, [1.0]])
                after = np.interp(shares.value * end[0], curve, released)
            first = False
            change, parts = np.abs(after - parts).max(), after
            columns = np.hstack([parts[:, None], -step[:, 1:]])
            solved = _Solved(dict(point.values), point.names, columns)
            if change <= (_SMALL if at_once is None else _SMALL_AT_ONCE):
                return solved
            away = float(np.abs(off[:, 0]).max() / end[0])
            if away < least and at_once is not None:
                nearest, least = solved, away
        if nearest is not None and least <= _ROUGH:
            return nearest
        reason = "no part of the stress is found at which it has made that part"
        if nearest is not None:
            reason += f"; the nearest is off by {100.0 * least:.2g} % of the final motion"
        raise NoFinalMotion(reason)

    def _moved(
        self, parts: Floats, point: ParameterPoint, at_once: Floats | None
    ) -> tuple[Floats, Floats | None]:
        """Motion of the wall, m, by n parameters and K parts: (K, 1 + n + K), and its end.

        Args:
            parts: (K,) of the stress.
            point: the parameters.
            at_once: the end, where all of the stress is released at once.

        Returns:
            The end is None where it is known, or a stage ends with a residual.
        """
        released = dict(zip(self._names, map(float, parts), strict=True))
        wider = ParameterPoint({**point.values, **released}, (*point.names, *self._names))
        run = AnalysisRun(self._in_turn, wider, RunOptions(explain=False))
        states = run.states()
        moved = self._walls(states, self._end)
        walls, end = moved[self._states] - moved[self._before], None
        if at_once is None and not _has_residual(run):
            end = self._walls(states, 1)[0] - moved[self._before]
        return walls, None if _has_residual(run) else end

    def _moved_at_once(self, point: ParameterPoint) -> Floats:
        """The end (1 + n + K,) where all of the stress is released at once, m."""
        run = AnalysisRun(self._at_once, point, RunOptions(explain=False))
        moved = self._walls(run.states(), self._before + 2)
        return np.append(moved[-1] - moved[self._before], np.zeros(len(self._names)))

    def _walls(self, states: Iterator[StageEnd], count: int) -> Floats:
        """Motion of the wall (count, ...) at the next states, m."""
        try:
            return np.stack([self._inwards @ end.u for end in islice(states, count)])
        except CollapseError as collapse:
            msg = "the mesh finds no equilibrium when all of the stress is released"
            raise NoFinalMotion(msg, collapse=True) from collapse


def _has_residual(run: AnalysisRun) -> bool:
    """Whether a stage so far ended with a residual."""
    plastic = run.findings.plastic
    return plastic is not None and bool(plastic.overstressed)


def stages_by_distance(on_mesh: CaseOnMesh) -> list[int]:
    """Numbers of the states that say how far the face is, in their order."""
    stages = on_mesh.case.stages
    return [n for n, stage in enumerate(stages, start=1) if stage.distance is not None]


def follow_each_other(on_mesh: CaseOnMesh) -> bool:
    """Whether all stages with a distance are one sequence, without branches."""
    chain = stages_by_distance(on_mesh)
    return not chain or bool(on_mesh.sequence.built_on[chain, chain[-1]].all())


def yields_at_tunnel(on_mesh: CaseOnMesh) -> bool:
    """Whether any ground that is there before the tunnel may yield; else lambda = s."""
    before = on_mesh.sequence.states[tunnel_base(on_mesh)]
    return any(on_mesh.case.materials[name].yields for name in before.materials.values())


def tunnel_base(on_mesh: CaseOnMesh) -> int:
    """Index of the state on which the first stage with a distance builds."""
    return on_mesh.sequence.states[stages_by_distance(on_mesh)[0]].base


def _unsupported(
    on_mesh: CaseOnMesh,
    inside: Sequence[str],
    names: Mapping[FaceDistance, str],
) -> Case:
    """The case up to its tunnel, which is then left to itself and released by named parts.

    Args:
        on_mesh: the whole one.
        inside: element groups that the tunnel fills.
        names: of the parts, by distance; without them all of the stress is released at once.
    """
    case, chain, built_on = on_mesh.case, stages_by_distance(on_mesh), on_mesh.sequence.built_on
    before = np.flatnonzero(built_on[:, tunnel_base(on_mesh)]).tolist()
    stages = [case.stages[number - 1] for number in before if number]
    leaving = tuple(n for k in chain for n in case.stages[k - 1].excavate if n in inside)
    for number in chain if names else ():
        stage = case.stages[number - 1]
        assert stage.distance is not None
        part = Scalar(1.0, names[FaceDistance(stage.distance)])
        leaves = tuple(name for name in stage.excavate if name in inside)
        stages.append(Stage(stage.name, leaves, release=dict.fromkeys(inside, part)))
    bases = [VIRGIN, *(stage.name for stage in stages)]
    stages.append(Stage(_END, () if names else leaving, release=dict.fromkeys(inside, Scalar(1.0))))
    in_turn = [
        replace(stage, base=base, independent=False)
        for stage, base in zip(stages, bases, strict=False)
    ]
    absent = {name: None for name in used_groups(case) if name not in case.groups}
    groups = {**case.groups, **absent}
    return replace(case, groups=groups, stages=tuple(in_turn), channels=(), readings=(), face=None)


def wall_of(on_mesh: CaseOnMesh, inside: Sequence[str], before: int) -> tuple[FacetPatch, ...]:
    """The faces of the ground that stays where a tunnel is dug.

    Args:
        on_mesh: the case.
        inside: element groups within the wall.
        before: index of the state before they leave.
    """
    table, sequence = on_mesh.table, on_mesh.sequence
    within = np.isin(sequence.group_of, [sequence.groups.index(name) for name in inside])
    rows = table.free(sequence.present(before) & ~within)
    rows = rows[np.isin(table.face[rows], table.face[within[table.element]])]
    return patches(on_mesh.mesh, table, rows)


def _mean_inwards(on_mesh: CaseOnMesh, inside: Sequence[str], before: int) -> Floats:
    """What turns displacements (n_dofs,) into the mean motion of a wall inwards (), m.

    Args:
        on_mesh: the case.
        inside: element groups within the wall.
        before: index of the state before they leave.
    """
    mesh, wall = on_mesh.mesh, wall_of(on_mesh, inside, before)
    outwards = sum(pressure_forces(mesh, patch, on_mesh.kinematics) for patch in wall)
    length = sum(float(traction_weights(mesh, p, on_mesh.kinematics).sum()) for p in wall)
    return -np.asarray(outwards) / length
