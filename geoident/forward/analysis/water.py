"""The water in a part of a step in time: its equations beside those of the ground (theory 18.2).

With changes du and dp in the part, and w the pressures that drive the flow in it,

    K du - Q dp = ... ,     -Q^T du - (S + h H) dp = h H w .

Pressures that are given jump: what their jump makes goes to the right sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import Factor, SolverCounts
from geoident.fem.solvers.quasi_definite import QuasiDefinite
from geoident.fem.solvers.splu import general_factor
from geoident.forward.analysis.systems import StageSystem, StageSystems
from geoident.forward.consolidation.pores import PoreOperators
from geoident.model.arrays import Floats, Ints


class PoreBlocks:
    """The matrices [K, -Q; -Q^T, -(S + h H)] of displacements and of pressures that are free.

    Pressures are divided by a size, so that all entries are alike; a factor is that of the matrix
    of the unknowns (u, p / size), and its last rows are the size times those of the water.

    Args:
        systems: the equations of the stages.
        system: those of the stage.
        stiffness: (nnz,) K of elastic ground.
        operators: of the water.
        nodes: (n_p,) with pressures that are free.

    Attributes:
        dofs: (n,) of the displacements.
        nodes: see above.
        size: Pa/m.
        stiffness: see above.
    """

    def __init__(
        self,
        systems: StageSystems,
        system: StageSystem,
        stiffness: Floats,
        operators: PoreOperators,
        nodes: Ints,
    ) -> None:
        self.dofs, self.nodes, self.stiffness = system.dofs, nodes, stiffness
        self._counts, self._lower = systems.solver_counts, system.pattern.lower
        K = self._lower.whole(stiffness)
        Q = operators.coupling.value[self.dofs][:, nodes]
        S, H = (one.value[nodes][:, nodes] for one in (operators.storage, operators.flow))
        self.size = size = float(np.abs(K.data).mean() / np.abs(Q.data).mean()) if Q.nnz else 1.0
        above, below = sp.hstack([K, -size * Q]), sp.hstack([-size * Q.T, -(size**2) * S])
        self._constant = sp.csr_array(sp.vstack([above, below]))
        nothing = sp.csr_array((len(self.dofs), len(self.dofs)))
        self._growing = sp.csr_array(sp.block_diag([nothing, -(size**2) * H], format="csr"))
        dim = systems.discretization.kinematics.dim
        rank = systems.rank
        self._order = np.concatenate([2 * rank[self.dofs // dim], 2 * rank[nodes] + 1])
        self._systems = systems
        self._elastic = self._prepared()
        self._kept: tuple[float, Factor] | None = None
        self._changed: QuasiDefinite | None = None
        self._places: Ints | None = None

    def _prepared(self, changing: sp.csr_array | None = None) -> QuasiDefinite:
        return self._systems.quasi_definite(
            self._constant,
            self._growing,
            places=self._order,
            signs=np.repeat([1.0, -1.0], [len(self.dofs), len(self.nodes)]),
            changing=changing,
        )

    def forget(self) -> None:
        """Forget the factorization of elastic ground that is kept."""
        self._kept = None

    def factor(self, h: float) -> Factor:
        """Of elastic ground; the last one is kept.

        Raises:
            NotPositiveDefinite: the matrix is singular.
        """
        if self._kept is None or self._kept[0] != h:
            self._kept = None  # makes room first
            self._kept = h, self._elastic.factor(h)
        return self._kept[1]

    def changed(self, h: float, below: Floats, above: Floats | None = None) -> Factor:
        """With changes of K; the factor is valid until the next one.

        Args:
            h: s.
            below: (nnz,) in the lower triangle of K.
            above: (nnz,) in the upper one; None where they are symmetric.

        Raises:
            NotPositiveDefinite: the matrix is singular.
        """
        if self._changed is None:
            n, lower = len(self.dofs), self._lower
            ones = sp.coo_array(lower.whole(np.ones(len(lower.indices))))
            shape = self._constant.shape
            self._changed = self._prepared(sp.csr_array((ones.data, ones.coords), shape=shape))
            columns = np.repeat(np.arange(n), np.diff(lower.indptr))
            self._places = self._changed.places(lower.indices, columns)
        matrices, places = self._changed, self._places
        more = [np.zeros(len(matrices.pattern.indices)) for _ in range(2)]
        more[0][places] = below
        if above is None:
            return matrices.factor(h, more[0])
        more[1][places] = above
        values, order = matrices.values(h), matrices.order
        ordered = general_factor(matrices.pattern, values + more[0], values + more[1], self._counts)

        def solve(rhs: Floats) -> Floats:
            x = np.empty_like(rhs)
            x[order] = ordered.solve(rhs[order])
            return x

        return Factor(len(order), SolverCounts(), solve, lambda: True)


@dataclass(frozen=True, eq=False)
class WaterInPart:
    """What the water does in a part of a step.

    Args:
        operators: Q, S and H.
        h: by what flow is multiplied, s; 0 where none flows.
        drive: w (n_nodes, 1 + n), Pa.
        jump: (n_nodes, 1 + n) changes of the pressures that are given, Pa.
        blocks: the matrices; None where no pressure is free.
        span: when the part begins and ends, s since the beginning of the stage.
        loaded: parts of what the stage does that have come when it begins and ends.
        n_parts: number of the parts of all steps of the stage, about.
    """

    operators: PoreOperators
    h: float
    drive: Floats
    jump: Floats
    blocks: PoreBlocks | None
    span: tuple[float, float]
    loaded: tuple[float, float]
    n_parts: int = 1

    @property
    def n_nodes(self) -> int:
        """Pressures of the mesh, free or not."""
        return len(self.jump)

    def part(self, share: float) -> WaterInPart:
        """A part of what it does; it is linear, so parts of the whole add up."""
        return replace(self, drive=share * self.drive, jump=share * self.jump)

    def pushed(self) -> Floats:
        """(n_dofs, 1 + n) forces of the jump."""
        Q = self.operators.coupling.value
        if not self.jump.any():
            return np.zeros((Q.shape[0], self.jump.shape[1]))
        return np.asarray(Q @ self.jump)

    def right(self, motion: Floats | None) -> Floats:
        """(n_nodes, 1 + n) right sides of the water; of their slopes those at fixed du and dp.

        Args:
            motion: (n_dofs, 1 + n) that supports impose; None for none.
        """
        Q, S, H = self.operators.coupling, self.operators.storage, self.operators.flow
        right = self.h * H.at(self.drive)
        if self.jump.any():
            right += S.value @ self.jump + self.h * (H.value @ self.jump)
        if motion is not None:
            right += Q.value.T @ motion[:, : right.shape[1]]
        return np.asarray(right)

    def slopes(self, forces: Floats, right: Floats, u: Floats, p: Floats) -> None:
        """Add what derivatives of Q, S and H make of a state to right sides.

        Args:
            forces: (n_dofs, n) changed in place.
            right: (n_nodes, n) changed in place.
            u: (n_dofs,) change, with what supports impose.
            p: (n_nodes,) change, with the jump.
        """
        operators = self.operators
        for n, slope in operators.coupling.slopes.items():
            forces[:, n] += slope @ p
            right[:, n] += slope.T @ u
        for n, slope in operators.storage.slopes.items():
            right[:, n] += slope @ p
        for n, slope in operators.flow.slopes.items():
            right[:, n] += self.h * (slope @ p)

    def internal(self, u: Floats, p: Floats) -> tuple[Floats, Floats]:
        """The left sides (n_dofs, ...) and (n_nodes, ...) of changes u and p of these shapes."""
        Q, S, H = self.operators.coupling, self.operators.storage, self.operators.flow
        return -(Q.value @ p), -(Q.value.T @ u) - S.value @ p - self.h * (H.value @ p)
