"""Bounds of the error of readings: adjoints at a few places weigh what is out of balance.

With lambda_aj the adjoint displacements of reading a in state j (theory 2, `march.adjoint`), the
error of a reading is exactly

    v_a - v~_a = sum_j lambda_aj(p)^T rho_j(p)
    K_j lambda_aj = g_aj - C^T V E a_aj ,    b_aj = a_aj + C lambda_aj

with a_aj the sum over the states that build on j of their b, zero at points that they take away or
place anew, and g_aj the weights of u_j in the reading and in those of all states that build on j: a
reading sees displacements since placing, of which the step of every state before is part.

Of lambda(p) only lambda at a few parameter vectors is known, with derivatives (`basis`). A sum
lambda~ = sum_k c_k lambda_k, the same c in all states, takes its place: b~ and a~ belong together
as b and a do. So readings are corrected by sum_j lambda~_aj^T rho_j, and what is left is bounded by
products of two errors,

    |v_a - corrected| <= sum_j |eta_aj| |rho_j| ,      eta = lambda(p) - lambda~ .

What b~ leaves out of balance at p, pi_aj = g_aj - C^T V E(p) b~_aj, is known in energy (`basis`).
Backwards as forwards every state adds an error orthogonal to what is left of those that build on
it: with a_j the sum of theirs, |beta_j|^2 <= |a_j|^2 + |pi_j|^2 and |eta_j| <= |a_j| + |pi_j|.
Every sum gives a bound, and each reading takes the least: of those of all places, each times the
common factor of all moduli, or of those of one material, and with the derivatives that are best.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.forward.reduced.affine_march import AffineFactors
from geoident.forward.reduced.duals.basis import Combination, DualBasis
from geoident.forward.reduced.model import EnergyBounds, ReducedModel, ReducedStates
from geoident.forward.reduced.moduli import relative_eigenvalues
from geoident.model.arrays import Floats, Ints


@dataclass(frozen=True, eq=False)
class ReadingBounds:
    """Readings with bounds at parameter vectors (b).

    Args:
        correction: (b, g) to be added to the readings of the reduced model.
        error: (b, g) bound of what is left, SI.
    """

    correction: Floats
    error: Floats

    def take(self, readings: Ints, other: ReadingBounds) -> None:
        """Take over the bounds of some readings (k,) where others are less."""
        whole = np.abs(self.correction[:, readings]) + self.error[:, readings]
        less = np.abs(other.correction) + other.error < whole
        for mine, theirs in ((self.correction, other.correction), (self.error, other.error)):
            mine[:, readings] = np.where(less, theirs, mine[:, readings])


class ReadingDuals:
    """Adjoints of readings of a reduced model.

    Args:
        reduced: the model.
        bases: of one place or more, the first the reference of the model.
        rounding: part of the largest reading that is rounding, see `ReducedResponse.see_rounding`.
    """

    def __init__(
        self, reduced: ReducedModel, bases: Sequence[DualBasis], rounding: float = 0.0
    ) -> None:
        self._reduced, self.bases = reduced, tuple(bases)
        self.rounding = rounding

    def bounds(self, found: ReducedStates, energy: EnergyBounds) -> ReadingBounds:
        """Corrections and bounds of all readings.

        Args:
            found: states at parameter vectors (b).
            energy: the bounds of their errors in energy.
        """
        spans = self._reduced.form.spans
        moduli = {name: span.matrix(found.at.moduli[name]) for name, span in spans.items()}
        count = len(np.unique(np.concatenate([basis.readings for basis in self.bases])))
        shape = len(found.at.loads), count
        best = ReadingBounds(np.zeros(shape), np.full(shape, np.inf))
        for basis in self.bases:
            work, mine = _work(basis, found), basis.readings
            for some in _combinations(basis, moduli, energy):
                left = self._left(basis, found.at, energy, basis.measures(moduli, some))
                correction = np.einsum("bk,bkg->bg", some.strains, work)
                best.take(mine, ReadingBounds(correction, left))
        return best

    def _left(
        self,
        basis: DualBasis,
        at: AffineFactors,
        energy: EnergyBounds,
        measures: Mapping[str, Floats],
    ) -> Floats:
        """Bounds (b, g) of what a sum of adjoints leaves."""
        count = len(at.loads)
        error = np.zeros((count, basis.count))
        left = [np.zeros_like(error) for _ in basis.stages]  # what states that build on one leave
        for number in reversed(range(len(basis.stages))):
            stage = self._reduced.stages[number]
            squared = basis.unbalanced(basis.stages[number], measures, count)
            error += (left[number] + np.sqrt(squared)) * energy.residual[number][:, None]
            beta = np.sqrt(left[number] ** 2 + squared)
            if number:
                growth = np.sqrt(self._reduced.growth(stage, at))
                left[stage.base] += beta * np.reshape(growth, (-1, 1))
        return error


def _combinations(
    basis: DualBasis, moduli: Mapping[str, Floats], energy: EnergyBounds
) -> Iterator[Combination]:
    """Sums that may bound a reading best, at parameter vectors (b)."""
    of_each = []
    for name, E in moduli.items():
        reference = basis.stresses[name][0, :, 0]
        of_each.append(relative_eigenvalues(E, reference))
    every = [np.concatenate(of_each, axis=1)]
    if len(of_each) > 1:
        every += of_each
    for mu in every:
        yield basis.only(2.0 / (mu.min(axis=1) + mu.max(axis=1)))
    if basis.size > 1:
        yield basis.best(moduli, energy.residual.T**2)


def _work(basis: DualBasis, found: ReducedStates) -> Floats:
    """(b, K, g) of the adjoints on what is out of balance."""
    total = np.zeros((len(found.at.loads), basis.size, basis.count))
    for dual in basis.stages:
        total += np.tensordot(found.at.loads, dual.loads, axes=(1, 2))
        for (state, material), terms in dual.terms.items():
            q, c = found.states[state][..., 0], found.at.moduli[material]
            total -= np.einsum("br,brkg->bkg", c, np.tensordot(q, terms, axes=(1, 3)))
    return total
