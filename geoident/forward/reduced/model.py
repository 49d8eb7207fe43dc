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
distance of sigma~_j from any stress in equilibrium (see `projection`). That holds where moduli and
loads are the sums of `affine_analysis`, which is looked at for moduli at every p, and for loads at
vectors all over the bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.forward.reduced.affine_analysis import AffineFactors, AffineForm
from geoident.forward.reduced.moduli import relative_eigenvalues
from geoident.forward.reduced.projection import ReducedStage
from geoident.forward.reduced.zones import StressTerm
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
        columns = 1 + len(self.form.names) if derivatives else 1
        solved: list[Floats] = []
        for number, stage in enumerate(self.stages):
            own = {m: M for (state, m), M in stage.matrices.items() if state == number}
            before = {key: M for key, M in stage.matrices.items() if key[0] != number}
            right = _by_loads(stage.load, at, columns) - _by_states(before, at, solved, columns)
            if not own:  # nothing moves
                solved.append(np.zeros((len(values), stage.size, columns)))
                continue
            K = sum(np.tensordot(at.moduli[m], M, axes=1) for m, M in own.items())
            q = np.linalg.solve(K, right[..., :1])
            for m, M in own.items() if derivatives else ():
                work = np.tensordot(q[..., 0], M, axes=(1, 2))  # (b, r, N)
                right[..., 1:] -= np.einsum("bri,brn->bin", work, at.slopes[m])
            solved.append(np.concatenate([q, np.linalg.solve(K, right[..., 1:])], axis=2))
        return ReducedStates(at, tuple(solved))

    def observed(self, states: ReducedStates) -> Floats:
        """What all channels see, (n_states, n_channels, b, 1 + n or 1)."""
        seen = []
        for stage, q in zip(self.stages, states.states, strict=True):
            columns, forces = q.shape[2], stage.forces
            table = np.tensordot(stage.observed, q, axes=(1, 1))
            by_loads = _by_loads(forces.loads, states.at, columns)
            moved = _by_states(forces.terms, states.at, states.states, columns)
            table[forces.channels] = (by_loads + moved).swapaxes(0, 1)
            seen.append(table)
        return np.stack(seen)

    def errors(self, states: ReducedStates) -> Floats:
        """Error of the stresses in energy, relative to the largest energy of a state, (b,)."""
        at, b = states.at, len(states.at.loads)
        weights = {name: 1.0 / self._least_eigenvalues(name, at) for name in self.form.spans}
        squared, energy = np.zeros((2, len(self.stages), b))
        for number, stage in enumerate(self.stages):
            squared[number] = self._unbalanced(stage, states, weights)
            if number:
                squared[number] += squared[stage.base] * self._growth(stage, at)
            q = states.states[number][..., 0]
            own = {key: M for key, M in stage.matrices.items() if key[0] == number}
            moved = _by_states(own, at, states.states, 1)[..., 0]
            energy[number] = np.sum(q * moved, axis=1)
        largest = energy.max(axis=0, initial=0.0)
        return np.asarray(np.sqrt(squared.max(axis=0) / np.where(largest > 0.0, largest, 1.0)))

    def _least_eigenvalues(self, name: str, at: AffineFactors) -> Floats:
        """Smallest eigenvalue (b,) of E(p) against E at the reference."""
        span, c = self.form.spans[name], at.moduli[name]
        if span.fixed is not None:
            return np.ones(len(c))
        reference, _ = span.coordinates(self.reference[None])
        return relative_eigenvalues(span.matrix(c), span.matrix(reference[0]))[:, 0]

    def _growth(self, stage: ReducedStage, at: AffineFactors) -> Floats:
        """Kappa (b,)."""
        growth = np.ones(len(at.loads))
        for change in stage.changes:
            old, new = (self.form.spans[m].matrix(at.moduli[m]) for m in change)
            growth = np.maximum(growth, relative_eigenvalues(old, new)[:, -1])
        return growth

    def _unbalanced(
        self, stage: ReducedStage, states: ReducedStates, weights: Mapping[str, Floats]
    ) -> Floats:
        """|rho|^2 (b,) at most: the least distance of the two stresses.

        Args:
            stage: the state.
            states: all states.
            weights: of every material, (b,).
        """
        at, zones = states.at, stage.residuals
        total = np.zeros(len(at.loads))
        if not zones:
            return total
        apart = []
        for zone in zones:
            terms = {key: columns.swapaxes(0, 1) for key, columns in zone.terms.items()}
            y = _by_loads(zone.loads, at, 1) - _by_states(terms, at, states.states, 1)
            apart.append(y[..., 0])
        size = zones[0].rest.shape[1]
        normal, pull = np.zeros((len(total), size, size)), np.zeros((len(total), size, 1))
        for zone, y in zip(zones, apart, strict=True):
            weight = weights[zone.material][:, None, None]
            normal += weight * (zone.rest.T @ zone.rest)
            pull += weight * (y @ zone.rest)[..., None]
        best = -np.linalg.solve(normal, pull)[..., 0]
        for zone, y in zip(zones, apart, strict=True):
            left = y + best @ zone.rest.T
            total += weights[zone.material] * np.sum(left**2, axis=1)
        return total


def _by_loads(of_loads: Floats, at: AffineFactors, columns: int) -> Floats:
    """What (k, r) of the loads make, (b, k, columns) with derivatives or without."""
    forces = np.empty((len(at.loads), len(of_loads), columns))
    forces[..., 0] = at.loads @ of_loads.T
    if columns > 1:
        forces[..., 1:] = np.einsum("kr,brn->bkn", of_loads, at.load_slopes)
    return forces


def _by_states(
    terms: Mapping[StressTerm, Floats],
    at: AffineFactors,
    states: Sequence[Floats],
    columns: int,
) -> Floats:
    """Sum of c_r M_r q over states and materials, (b, k, columns); (b, 1, columns) of no terms.

    Args:
        terms: M (r, k, N) by state and material.
        at: moduli c.
        states: q of every state.
        columns: 1 + n with derivatives, 1 without.
    """
    size = next((M.shape[1] for M in terms.values()), 1)
    forces = np.zeros((len(at.loads), size, columns))
    for (state, material), M in terms.items():
        parts = np.tensordot(states[state][..., :columns], M, axes=(1, 2))  # (b, columns, r, k)
        forces += np.einsum("bxrk,br->bkx", parts, at.moduli[material])
        if columns > 1:
            forces[..., 1:] += np.einsum("brk,brn->bkn", parts[:, 0], at.slopes[material])
    return forces
