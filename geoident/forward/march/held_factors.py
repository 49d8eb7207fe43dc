"""Factors of tangents that outlive a stage, and products with the tangents that come after.

What yields changes little from one parameter vector of a search to the next, and from one Newton
step to the next near equilibrium: conjugate gradients preconditioned by the last factor of the same
ground then need a few solves instead of a factorization. Two factors of each ground (the groups
that are there) are held between marches: that of the elastic stiffness, which yielding ground is
never far from in most directions, and that of the last tangent.

In three dimensions factors are the largest thing in memory, so what is held is limited. A search
marches through the same stages over and over: where there is no room for all, the first ones are
held, and the others make their own every time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from geoident.fem.elasticity import Moduli
from geoident.fem.patches import Patch, PatchTangents, patch_around
from geoident.fem.solvers.conjugate_gradients import Product, conjugate_gradients
from geoident.fem.solvers.direct import Factor, LowerPattern, SymbolicFactorization
from geoident.fem.solvers.splu import GeneralFactor
from geoident.forward.march.stage import StageTask
from geoident.forward.march.systems import StageSystem, StageSystems, SystemKey
from geoident.model.arrays import Floats, Ints

HELD_ENTRIES = 8_000_000
"""Entries of the stiffness matrices whose factors are held: 1 to 3 GB, as for adjoints."""

FEWEST, MOST = 12, 40
"""Steps of conjugate gradients that a factorization must be worth to be left out, and at most."""

_ROUNDING = 1e-13
"""Residual, relative, that elastic states are solved to."""

_ELASTIC, _TANGENT = "elastic", "tangent"
_SPARE = {_TANGENT: 0, _ELASTIC: 1}

_Ground = SystemKey


@dataclass
class HeldFactors:
    """The factors that all marches of a model share.

    Args:
        entries: of matrices whose factors may be held at once.
    """

    entries: int = HELD_ENTRIES
    _held: dict[tuple[_Ground, str], tuple[Factor, int]] = field(default_factory=dict)

    def find(self, ground: _Ground, kind: str) -> Factor | None:
        """The factor of a ground, if it is held and still there."""
        factor, _ = self._held.get((ground, kind), (None, 0))
        return factor if factor is not None and factor.valid else None

    def make_room(self, ground: _Ground, kind: str, size: int) -> None:
        """Forget what must go before a factor of a matrix of some entries is made.

        Its own predecessor first, then the others, those held last before those held first.

        Args:
            ground: what stands at a stage.
            kind: of the tangent.
            size: entries of the matrix that is to come.
        """
        self._held.pop((ground, kind), None)
        others = [key for key in self._held if key[0] != ground]
        while others and sum(held[1] for held in self._held.values()) + size > self.entries:
            del self._held[others.pop()]

    def keep(self, ground: _Ground, kind: str, factor: Factor, size: int) -> None:
        """Hold a factor.

        Args:
            ground: what stands at a stage.
            kind: of the tangent.
            factor: its factor.
            size: entries of its matrix.
        """
        self._held[ground, kind] = factor, size


class StageTangents:
    """Tangents of one stage and parameter vector: factors of them, and products with them.

    Args:
        systems: the equations of the stages.
        task: the stage.
        moduli: E of its materials, Pa.
        held: the factors of all marches.
    """

    def __init__(
        self,
        systems: StageSystems,
        task: StageTask,
        moduli: Mapping[str, Moduli],
        held: HeldFactors,
    ) -> None:
        self._systems, self._system, self._held = systems, task.system, held
        self._elastic = systems.values(task.system, task.state, moduli, task.point.values)

    def __call__(self, points: Ints, change: Floats, *, symmetric: bool) -> Factor:
        """Factor of K plus changes (q, s, s) of V E at some points (q,)."""
        if symmetric or not len(points):
            return self._factorize(_TANGENT, self._changed(points, change))
        more = self._systems.tangents(self._system).added(points, change, symmetric=False)
        below, above = self._elastic + more[0], self._elastic + more[1]
        counts = self._systems.solver_counts
        return GeneralFactor(self._system.pattern.lower, below, above, counts)

    @property
    def most(self) -> int:
        """Steps of conjugate gradients that may take the place of a factorization."""
        dim = self._systems.discretization.points.position.shape[1]
        return steps_worth(self._system.pattern.lower.n, dim)

    def elastic(self, *, again: bool = False) -> Factor:
        """Factor of the elastic K, perhaps of moduli of other parameters; ``again``: of these."""
        found = None if again else self._held.find(self._system.key, _ELASTIC)
        return self._factorize(_ELASTIC, self._elastic) if found is None else found

    def last(self) -> Factor | None:
        """Factor of the last tangent of this ground, if it is still there."""
        return self._held.find(self._system.key, _TANGENT)

    def product(self, points: Ints, change: Floats) -> Product:
        """Products of K plus symmetric changes (q, s, s) of V E at some points (q,)."""
        return symmetric_product(self._system.pattern.lower, self._changed(points, change))

    def around(self, unknowns: Ints, most: int) -> Patch | None:
        """The patch around unknowns (w,); None where more than a number of them would move."""
        system, points = self._system, self._systems.discretization.points
        return patch_around(points, system.present, system.dofs, unknowns, most)

    def within(self, patch: Patch) -> PatchTangents:
        """What makes factors of the stiffness of a patch."""
        lower, mine = self._system.pattern.lower, patch.unknowns
        whole = sp.csc_array((self._elastic, lower.indices, lower.indptr), shape=(lower.n, lower.n))
        return PatchTangents(patch, sp.csc_array(whole[:, mine][mine]))

    def _changed(self, points: Ints, change: Floats) -> Floats:
        """Values (nnz,) of K plus symmetric changes."""
        if not len(points):
            return self._elastic
        added = self._systems.tangents(self._system).added(points, change, symmetric=True)
        return self._elastic + added[0]

    def _factorize(self, kind: str, values: Floats) -> Factor:
        """Factor of a matrix, held from now on."""
        system = self._system
        size = len(values)
        self._held.make_room(system.key, kind, size)
        factor = self._analysis(system, kind).factorize(values)
        self._held.keep(system.key, kind, factor, size)
        return factor

    def _analysis(self, system: StageSystem, kind: str) -> SymbolicFactorization:
        found = self._systems.analysis(system, _SPARE[kind])
        if found is None:
            raise AssertionError
        return found


def steps_worth(n: int, dim: int) -> int:
    """Steps of conjugate gradients to spend in place of a factorization; 0 where it is cheaper.

    In the plane a factorization costs about seven solves whatever the size, in space n^(2/3) of
    them by the order of operations, and steps are at least `FEWEST`.

    Args:
        n: unknowns.
        dim: of the mesh.
    """
    worth = int(0.02 * n ** (2 / 3)) if dim == 3 else 0
    return min(worth, MOST) if worth >= FEWEST else 0


class ElasticByHeld:
    """The elastic K of a stage as a `Factor`, solved on the one that is held.

    One step of conjugate gradients is enough where only the size of all moduli is another.

    Args:
        tangents: of the stage.
    """

    valid = True

    def __init__(self, tangents: StageTangents) -> None:
        self._tangents = tangents

    def solve(self, rhs: Floats) -> Floats:
        """Solutions (n, k) for right-hand sides (n, k)."""
        nowhere = np.empty(0, dtype=np.int64), np.empty((0, 0, 0))
        found = conjugate_gradients(
            self._tangents.product(*nowhere),
            rhs,
            self._tangents.elastic().solve,
            tolerance=_ROUNDING,
            most=FEWEST,
        )
        return found.x if found.reached else self._tangents.elastic(again=True).solve(rhs)


def symmetric_product(lower: LowerPattern, values: Floats) -> Product:
    """Products K x (n, k) of the symmetric matrix whose lower triangle has these values (nnz,)."""
    below = sp.csc_array((values, lower.indices, lower.indptr), shape=(lower.n, lower.n))
    above, diagonal = below.T, values[lower.indptr[:-1], None]
    return lambda x: np.asarray(below @ x + above @ x - diagonal * x)
