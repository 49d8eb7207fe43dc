"""The reduced model: all states at many parameter vectors, with their error in energy.

With q_j the coordinates of u_j, the equations of a state are those of the run (theory 2), tested
with the basis of the state:

    sum_m sum_r theta_mr(p) [ M_jj q_j + sum_l M_jl q_l ] = F_j psi(p)

The analysis with the stress sigma~ that they leave out of balance, rho_j = f_j - C^T V sigma~_j, is
the true one under other forces. With s the error of the stress, every stage adds a part that is in
equilibrium with rho_j and takes away what is a strain of the stage from what it carried,

    s_j = (1 - P) s_base + E C K_j^-1 rho_j ,

and the two are orthogonal in the complementary energy, |s|^2 = sum V s^T E^-1 s. So

    |s_j|^2  <=  kappa_j |s_base|^2 + |rho_j|^2_{K_j^-1}

where kappa is 1, or the largest eigenvalue of the moduli before a change of material against those
after it: excavation takes energy away, and what is placed brings none. |rho_j| is at most the
distance of sigma~_j from any stress in equilibrium (see `projection`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.forward.reduced.affine_analysis import AffineFactors, AffineForm
from geoident.forward.reduced.moduli import relative_eigenvalues
from geoident.forward.reduced.projection import ReducedStage
from geoident.forward.reduced.stress_rows import StageForces
from geoident.model.arrays import Floats


@dataclass(frozen=True, eq=False)
class ReducedStates:
    """All states at parameter vectors (b).

    Args:
        at: moduli and loads there.
        states: of every state, q (b, N) with derivatives, (b, N, 1 + n), or (b, N, 1) without.
    """

    at: AffineFactors
    states: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """The analysis on the space of few states.

    Args:
        form: of moduli and loads.
        reference: (n,) parameters whose moduli measure.
        stages: of all states.
    """

    form: AffineForm
    reference: Floats
    stages: tuple[ReducedStage, ...]

    def states(self, values: Floats, *, derivatives: bool = True) -> ReducedStates:
        """All states at parameter vectors (b, n).

        Raises:
            ValueError: moduli leave the span of those that were seen.
        """
        at = self.form.at(values)
        solved: list[Floats] = []
        for number, stage in enumerate(self.stages):
            solved.append(self._solve(stage, number, at, solved, derivatives=derivatives))
        return ReducedStates(at, tuple(solved))

    def _solve(
        self,
        stage: ReducedStage,
        number: int,
        at: AffineFactors,
        before: Sequence[Floats],
        *,
        derivatives: bool,
    ) -> Floats:
        """Q (b, N, 1 + n or 1) of a state."""
        b, n = len(at.loads), len(self.form.names)
        q = np.zeros((b, stage.size, 1 + n if derivatives else 1))
        if not stage.size:
            return q
        right = at.loads @ stage.load.T
        K = np.zeros((b, stage.size, stage.size))
        for (state, material), matrices in stage.matrices.items():
            c = at.moduli[material]
            if state == number:
                K += np.tensordot(c, matrices, axes=1)
            else:
                right -= _product(matrices, c, before[state][..., 0])
        q[..., :1] = np.linalg.solve(K, right[..., None])
        if not derivatives:
            return q
        rest = np.einsum("ir,brn->bin", stage.load, at.load_slopes)
        for (state, material), matrices in stage.matrices.items():
            own = q if state == number else before[state]
            parts = np.tensordot(own[..., 0], matrices, axes=(1, 2))  # (b, r, N)
            rest -= np.einsum("bri,brn->bin", parts, at.slopes[material])
            if state != number:
                turned = np.tensordot(own[..., 1:], matrices, axes=(1, 2))  # (b, n, r, N)
                rest -= np.einsum("bnri,br->bin", turned, at.moduli[material])
        q[..., 1:] = np.linalg.solve(K, rest)
        return q

    def observed(self, states: ReducedStates) -> Floats:
        """What all channels see, (n_states, n_channels, b, 1 + n or 1)."""
        seen = []
        for stage, q in zip(self.stages, states.states, strict=True):
            table = np.tensordot(stage.observed, q, axes=(1, 1))
            table[stage.forces.channels] = _forces(stage.forces, states, table.shape[2])
            seen.append(table)
        return np.stack(seen)

    def errors(self, states: ReducedStates) -> Floats:
        """Error of the stresses in energy, relative to the largest energy of a state, (b,)."""
        stress = self.stress_errors(states)
        size = np.zeros_like(stress)
        for number, stage in enumerate(self.stages):
            q = states.states[number][..., 0]
            for (state, material), matrices in stage.matrices.items():
                if state == number:
                    moved = _product(matrices, states.at.moduli[material], q)
                    size[number] += np.sum(q * moved, axis=1)
        largest = np.sqrt(np.maximum(size, 0.0)).max(axis=0, initial=0.0)
        return np.asarray(stress.max(axis=0) / np.where(largest > 0.0, largest, 1.0))

    def stress_errors(self, states: ReducedStates) -> Floats:
        """Error of the stresses of every state in complementary energy, (n_states, b)."""
        at = states.at
        moduli = {name: self._eigenvalues(name, at) for name in self.form.spans}
        stress = np.zeros((len(self.stages), len(at.loads)))
        for number, stage in enumerate(self.stages):
            squared = self._residual(stage, at, states, moduli)
            if number:
                squared = squared + stress[stage.base] ** 2 * self._growth(stage, at)
            stress[number] = np.sqrt(squared)
        return stress

    def _eigenvalues(self, name: str, at: AffineFactors) -> Floats:
        span = self.form.spans[name]
        c, b = at.moduli[name], len(at.loads)
        if span.fixed is not None:
            return np.ones((b, span.basis.shape[1]))
        reference, _ = span.coordinates(self.reference[None])
        return relative_eigenvalues(span.matrix(c), span.matrix(reference[0]))

    def _growth(self, stage: ReducedStage, at: AffineFactors) -> Floats | float:
        """Kappa (b,)."""
        growth: Floats | float = 1.0
        for before, after in stage.changes:
            matrices = (self.form.spans[m].matrix(at.moduli[m]) for m in (before, after))
            old, new = matrices
            root = np.linalg.inv(np.linalg.cholesky(new))
            largest = np.linalg.eigvalsh(root @ old @ root.swapaxes(1, 2))[:, -1]
            growth = np.maximum(growth, largest)
        return growth

    def _residual(
        self,
        stage: ReducedStage,
        at: AffineFactors,
        states: ReducedStates,
        moduli: Mapping[str, Floats],
    ) -> Floats:
        """Bound (b,) of |rho|^2: the least distance of the two stresses."""
        if not stage.residuals:
            return np.zeros(len(at.loads))
        apart = []
        for zone in stage.residuals:
            y = at.loads @ zone.loads.T
            for (state, material), columns in zone.terms.items():
                q = states.states[state][..., 0]
                y -= _product_columns(columns, at.moduli[material], q)
            apart.append(y)
        weight = {name: 1.0 / values[:, 0] for name, values in moduli.items()}
        h = np.zeros((len(at.loads), 0))
        if stage.residuals[0].rest.shape[1]:
            normal = sum(weight[m][:, None, None] * N for m, N in stage.normal.items())
            pull = sum(
                weight[z.material][:, None] * (y @ z.rest)
                for z, y in zip(stage.residuals, apart, strict=True)
            )
            h = -np.linalg.solve(normal, np.asarray(pull)[..., None]).squeeze(2)
        total = np.zeros(len(at.loads))
        for zone, y in zip(stage.residuals, apart, strict=True):
            left = y + h @ zone.rest.T
            total += weight[zone.material] * np.sum(left**2, axis=1)
        return total


def _forces(forces: StageForces, states: ReducedStates, columns: int) -> Floats:
    """What channels see of the stress of a state, (c, b, 1 + n or 1)."""
    at = states.at
    table = np.zeros((len(forces.channels), len(at.loads), columns))
    table[..., 0] = forces.loads @ at.loads.T
    if columns > 1:
        table[..., 1:] = np.einsum("cr,brn->cbn", forces.loads, at.load_slopes)
    for (state, material), terms in forces.terms.items():
        q, c = states.states[state], at.moduli[material]
        parts = np.tensordot(terms, q, axes=(2, 1))  # (r, c, b, columns)
        table += np.einsum("rcbn,br->cbn", parts, c)
        if columns > 1:
            table[..., 1:] += np.einsum("rcb,brn->cbn", parts[..., 0], at.slopes[material])
    return table


def _product(matrices: Floats, c: Floats, q: Floats) -> Floats:
    """Sum_r c_r M_r q (b, N) of matrices (r, N, M), c (b, r) and q (b, M)."""
    parts = np.tensordot(q, matrices, axes=(1, 2))  # (b, r, N)
    return np.asarray(np.einsum("brn,br->bn", parts, c))


def _product_columns(columns: Floats, c: Floats, q: Floats) -> Floats:
    """(b, k) of columns (k, r, N)."""
    return np.asarray(
        np.einsum("br,bn->brn", c, q).reshape(len(q), -1) @ columns.reshape(len(columns), -1).T
    )
