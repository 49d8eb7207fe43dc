"""Bounds of the error of readings: adjoints at the reference weigh what is out of balance.

With lambda_aj the adjoint displacements of reading a in state j (theory 2, `march.adjoint`), the
error of a reading is exactly

    v_a - v~_a = sum_j lambda_aj(p)^T rho_j(p)
    K_j lambda_aj = g_aj - C^T V E a_aj ,    b_aj = a_aj + C lambda_aj

with a_aj the sum over the states that build on j of their b, zero at points that they take away or
place anew, and g_aj the weights of u_j in the reading and in those of all states that build on j: a
reading sees displacements since placing, of which the step of every state before is part.

Of lambda(p) only lambda at the reference p_r is known, computed once; tau lambda(p_r), with tau the
common factor of the moduli (all of them, or those of one material, whichever bounds the reading
best), takes its place. So readings are corrected by
tau sum_j lambda_aj(p_r)^T rho_j, and what is left is bounded by products of two errors,

    |v_a - corrected| <= sum_j |eta_aj| |rho_j| ,      eta = lambda(p) - tau lambda(p_r).

The adjoint strains b at the reference leave C^T V (E_r - tau E(p)) b_aj out of balance at p (g does
not depend on p), at most

    |pi_aj| <= ( sum_m chi_m^2 |b_aj|^2_m )^1/2 ,      chi = max |1 - tau mu| / sqrt(mu)

over the eigenvalues mu of E(p) against E_r of each material m, with the energies of b at the
reference. Backwards as forwards every state adds an error orthogonal to what is left of those
that build on it: with a_j the sum of theirs, |beta_j|^2 <= |a_j|^2 + |pi_j|^2 and
|eta_j| <= |a_j| + |pi_j|.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.forward.march.march import Run
from geoident.forward.march.stage import factorize
from geoident.forward.reduced.affine_march import AffineFactors
from geoident.forward.reduced.model import EnergyBounds, ReducedModel, ReducedStates
from geoident.forward.reduced.projection import GalerkinProjection
from geoident.forward.reduced.zones import StressTerm
from geoident.model.arrays import Floats

_AT_ONCE = 24
"""Readings that are taken back together."""


@dataclass(frozen=True, eq=False)
class StageDual:
    """The adjoints of readings (g) in one state, at the reference.

    Args:
        energy: by material, |b|^2 (g,).
        loads: (g, r) their work on the loads.
        terms: (r_m, g, N_l) their work on the stresses of the reduced model.
    """

    energy: Mapping[str, Floats]
    loads: Floats
    terms: Mapping[StressTerm, Floats]


@dataclass(frozen=True, eq=False)
class ReadingBounds:
    """Readings with bounds at parameter vectors (b).

    Args:
        correction: (b, g) to be added to the readings of the reduced model.
        error: (b, g) bound of what is left, SI.
    """

    correction: Floats
    error: Floats

    def or_less(self, other: ReadingBounds) -> ReadingBounds:
        """Of each reading the one of two that is less."""
        less = np.abs(other.correction) + other.error < np.abs(self.correction) + self.error
        return ReadingBounds(
            np.where(less, other.correction, self.correction),
            np.where(less, other.error, self.error),
        )


class ReadingDuals:
    """Adjoints of readings at the reference of a reduced model.

    Args:
        reduced: the model.
        stages: of every state.
        rounding: part of the largest reading that is rounding, see `ReducedResponse.see_rounding`.
    """

    def __init__(
        self, reduced: ReducedModel, stages: Sequence[StageDual], rounding: float = 0.0
    ) -> None:
        self._reduced, self.stages = reduced, tuple(stages)
        self.rounding = rounding

    def bounds(self, found: ReducedStates, energy: EnergyBounds) -> ReadingBounds:
        """Corrections and bounds of all readings.

        Args:
            found: states at parameter vectors (b).
            energy: the bounds of their errors in energy.
        """
        work = self._work(found)
        every = [np.concatenate(list(energy.moduli.values()), axis=1), *energy.moduli.values()]
        best: ReadingBounds | None = None
        for mu in every:  # each holds: a reading takes the least
            tau = 2.0 / (mu.min(axis=1) + mu.max(axis=1))
            left = self._left(found.at, energy, tau)
            this = ReadingBounds(tau[:, None] * work, left)
            best = this if best is None else best.or_less(this)
        assert best is not None
        return best

    def _work(self, found: ReducedStates) -> Floats:
        """(b, g) of the adjoints on what is out of balance."""
        total = np.zeros((len(found.at.loads), len(self.stages[0].loads)))
        for dual in self.stages:
            total += found.at.loads @ dual.loads.T
            for (state, material), terms in dual.terms.items():
                q, c = found.states[state][..., 0], found.at.moduli[material]
                total -= np.einsum("br,brg->bg", c, np.tensordot(q, terms, axes=(1, 2)))
        return total

    def _left(self, at: AffineFactors, energy: EnergyBounds, tau: Floats) -> Floats:
        """Bounds (b, g) of what the adjoints of the reference, tau (b,) times, leave."""
        chi = {
            name: np.abs((1.0 - tau[:, None] * own) / np.sqrt(own)).max(axis=1)
            for name, own in energy.moduli.items()
        }
        shape = len(tau), len(self.stages[0].loads)
        error = np.zeros(shape)
        left = [np.zeros(shape) for _ in self.stages]  # what the states that build on one leave it
        for number in reversed(range(len(self.stages))):
            stage, dual = self._reduced.stages[number], self.stages[number]
            squared = np.zeros(shape)
            for name, own in dual.energy.items():
                squared += chi[name][:, None] ** 2 * own
            error += (left[number] + np.sqrt(squared)) * energy.residual[number][:, None]
            beta = np.sqrt(left[number] ** 2 + squared)
            if number:
                growth = np.sqrt(self._reduced.growth(stage, at))
                left[stage.base] += beta * np.reshape(growth, (-1, 1))
        return error


class DualMarch:
    """Takes readings back through the stages at the reference of a reduced model.

    Args:
        projection: what made it.
        run: a traced run at the reference, all its states done.
    """

    def __init__(self, projection: GalerkinProjection, run: Run) -> None:
        self._projection, self._affine, self._run = projection, projection.affine, run
        self._systems = projection.affine.march.systems
        self._points = projection.affine.points

    def stages(self, rows: sp.csr_array, weights: Floats) -> tuple[StageDual, ...]:
        """The adjoints of readings in all states.

        Args:
            rows: G', (g, n_dofs).
            weights: (n_states, g) how often a reading counts the displacements of a state.
        """
        count = rows.shape[0]
        parts = [
            self._some(rows[some : some + _AT_ONCE], weights[:, some : some + _AT_ONCE])
            for some in range(0, max(count, 1), _AT_ONCE)
        ]
        return tuple(_joined([part[n] for part in parts]) for n in range(len(weights)))

    def _some(self, rows: sp.csr_array, weights: Floats) -> list[StageDual]:
        n_states, k = weights.shape
        s, points = self._points.n_strain, self._points.n_points
        left: dict[int, Floats] = {}
        read = np.unique(rows.indices)
        seeds = rows[:, read].T.toarray()
        seen = np.zeros((n_states, len(read), k))  # adjoints of the displacements that are read
        found: list[StageDual] = [self._nothing(k) for _ in range(n_states)]
        for number in range(n_states - 1, 0 if not self._affine.form.loads.settles else -1, -1):
            trace = self._run.traces[number]
            task, system = trace.task, trace.task.system
            a = left.pop(number, np.zeros((s, points, k)))
            self._points.clear(a, task.state, system)
            stress = self._stressed(number, a)
            rest = -self._points.forces(stress, system)
            if number:
                seen[number] += seeds * weights[number]
                rest[read] += seen[number]
            w, dofs = np.zeros_like(rest), system.pattern.dofs
            factor = factorize(task, self._systems, self._run.factors)
            if factor is not None and trace.stepped:
                w[dofs] = factor.solve(rest[dofs])
            strain = self._points.strain(w)
            a += strain
            self._points.clear(a, task.state, system)
            found[number] = self._tested(number, a, strain)
            if number:
                state = task.state
                self._points.clear_begun(a, state)
                base = state.base
                left[base] = left[base] + a if base in left else a
                seen[base][system.touched[read]] += seen[number][system.touched[read]]
        return found

    def _stressed(self, number: int, strain: Floats) -> Floats:
        """E eps of adjoint strains (s, n_points, k)."""
        found = np.zeros_like(strain)
        for zone in self._affine.zones[number]:
            E = self._projection.reference_matrix(zone.material)
            found[:, zone.points] = np.tensordot(E, strain[:, zone.points], axes=1)
        return found

    def _tested(self, number: int, b: Floats, strain: Floats) -> StageDual:
        """Energies of b (s, n_points, k), and the work of strains on loads and stresses."""
        particular, turn = self._projection.particular, self._projection.turn
        k = b.shape[-1]
        energy: dict[str, Floats] = {}
        work = np.zeros((k, particular.shape[1]))
        terms: dict[StressTerm, Floats] = {}
        for zone in self._affine.zones[number]:
            mine = zone.points
            volume = self._points.volume[mine][:, None]
            own, E = b[:, mine], self._projection.reference_matrix(zone.material)
            squares = np.sum(own * np.tensordot(E, own, axes=1) * volume, axis=(0, 1))
            energy[zone.material] = energy.get(zone.material, 0.0) + squares
            test = (strain[:, mine] * volume).reshape(-1, k)
            joined = self._projection.stresses(zone, mine)
            work += test.T @ joined.reshape(len(test), -1) @ particular
            for state, material, sign in zone.parts:
                if state not in turn:
                    continue
                raw = sign * self._projection.strains(state, mine)
                found = np.stack(
                    [
                        test.T @ np.tensordot(J, raw, axes=1).reshape(len(test), -1) @ turn[state]
                        for J in self._affine.form.spans[material].basis
                    ]
                )
                key = state, material
                terms[key] = terms[key] + found if key in terms else found
        return StageDual(energy, work, terms)

    def _nothing(self, k: int) -> StageDual:
        return StageDual({}, np.zeros((k, self._projection.particular.shape[1])), {})


def _joined(parts: Sequence[StageDual]) -> StageDual:
    """Of all readings."""
    first = parts[0]
    return StageDual(
        {name: np.concatenate([p.energy[name] for p in parts]) for name in first.energy},
        np.concatenate([p.loads for p in parts]),
        {key: np.concatenate([p.terms[key] for p in parts], axis=1) for key in first.terms},
    )
