"""Factors of the tangents of one stage and parameter vector, on the whole mesh or on a patch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from geoident.fem.elasticity import Moduli
from geoident.fem.patches import Patch, PatchTangents, patch_around
from geoident.fem.solvers.direct import Factor
from geoident.fem.solvers.splu import general_factor
from geoident.forward.analysis.stage import StageTask
from geoident.forward.analysis.stage_points import MemberTangents, StagePoints
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.water import PoreBlocks
from geoident.model.arrays import Floats, Ints


class StageTangents:
    """Tangents of one stage and parameter vector.

    Args:
        systems: the equations of the stages.
        task: the stage.
        moduli: E of its materials, Pa.
        points: all that is strained in it.
    """

    def __init__(
        self,
        systems: StageSystems,
        task: StageTask,
        moduli: Mapping[str, Moduli],
        points: StagePoints,
    ) -> None:
        self._systems, self._system, self._n_ground = systems, task.system, points.n_ground
        self._members: MemberTangents | None = None
        if points.members is not None:
            rigidities = task.rigidities[:, 0]
            self._members = MemberTangents(points.members, rigidities, task.system.pattern)
        self._water = task.water
        self._blocks = None if task.water is None else task.water.blocks
        if self._blocks is not None:
            self._elastic = self._blocks.stiffness
        else:
            self._elastic = systems.stiffness_values(
                task.system, task.state, moduli, task.point.values, task.members_grown
            )

    def factorize(self, points: Ints, change: Floats, *, symmetric: bool) -> Factor:
        """Factor of K plus changes (q, s, s) of V E at some points (q,).

        It is that of displacements, pressures that are free, and rotations of members that yield.
        """
        if self._members is None:
            return self._factor(self._elastic, points, change, symmetric=symmetric)
        n = int(np.searchsorted(points, self._n_ground))
        below, above, turning = self._members.added(points[n:] - self._n_ground, change[n:])
        beyond = None if symmetric else above - below
        values = self._elastic + below
        return turning.expand(
            self._factor(values, points[:n], change[:n], symmetric=symmetric, beyond=beyond)
        )

    def _factor(
        self,
        values: Floats,
        points: Ints,
        change: Floats,
        *,
        symmetric: bool,
        beyond: Floats | None = None,
    ) -> Factor:
        """Factor of values (nnz,) plus changes at some points of the ground.

        Args:
            values: below the diagonal.
            points: (q,) points of the ground.
            change: (q, s, s) of V E there.
            symmetric: whether all is.
            beyond: (nnz,) by how much the values above the diagonal differ; None for not at all.
        """
        if self._water is not None and self._blocks is not None:
            return self._with_water(
                self._blocks,
                self._water.h,
                values,
                points,
                change,
                symmetric=symmetric,
                beyond=beyond,
            )
        upper = values if beyond is None else values + beyond
        if len(points):
            tangents = self._systems.tangents(self._system)
            below, above = tangents.added(points, change, symmetric=symmetric)
            values, upper = values + below, upper + above
        if not symmetric and (len(points) or beyond is not None):
            counts = self._systems.solver_counts
            return general_factor(self._system.pattern.lower, values, upper, counts)
        symbolic = self._systems.symbolic(self._system)
        assert symbolic is not None
        return symbolic.factorize(values)

    def _with_water(
        self,
        blocks: PoreBlocks,
        h: float,
        values: Floats,
        points: Ints,
        change: Floats,
        *,
        symmetric: bool,
        beyond: Floats | None,
    ) -> Factor:
        """The same of the matrix of displacements and pressures."""
        below = values - self._elastic
        above = below if beyond is None else below + beyond
        if len(points):
            tangents = self._systems.tangents(self._system)
            more = tangents.added(points, change, symmetric=symmetric)
            below, above = below + more[0], above + more[1]
        elif beyond is None:
            return blocks.changed(h, below) if below.any() else blocks.factor(h)
        return blocks.changed(h, below, None if symmetric else above)

    def around(self, unknowns: Ints, most: int) -> Patch | None:
        """The patch around unknowns (w,); None where more than a number of them would move."""
        system, points = self._system, self._systems.discretization.points
        return patch_around(points, system.present, system.dofs, unknowns, most)

    def solver(self, patch: Patch) -> PatchTangents:
        """What factorizes the stiffness of a patch."""
        lower, unknowns = self._system.pattern.lower, patch.unknowns
        whole = sp.csc_array((self._elastic, lower.indices, lower.indptr), shape=(lower.n, lower.n))
        return PatchTangents(patch, sp.csc_array(whole[:, unknowns][unknowns]))
