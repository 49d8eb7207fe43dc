"""Adjoints of readings at one parameter vector, and their derivatives, as a basis elsewhere.

Let b_j be the adjoint strains of a reading in state j at p_i (see `bounds`), and b_j,h their
derivatives by parameters that move moduli,

    K_j lambda_j,h = - C^T V ( E a_j,h + E_h b_j ) ,      b_j,h = a_j,h + C lambda_j,h .

Then E b_j is a stress in equilibrium with what the reading sees of the state, and E b_j,h + E_h b_j
is in equilibrium with nothing, both at p_i. At p any sum of the strains and one of the stresses,

    b~ = sum_k c_k b_k ,    sigma^ = E b + sum_h d_h ( E b_h + E_h b )

leave no more out of balance than |sigma^ - E(p) b~| (Prager and Synge again). That is a sum
sum_k A_k b_k of matrices A of the material times strains, so its energy is

    sum_kl < A_k^T E(p)^-1 A_l , S_kl > ,      S_kl = sum V b_k b_l^T ,

with moments S that are kept of every material instead of the strains: no eigenvalue stands for the
moduli any more, they are measured as they are. Where the ground is isotropic, two numbers of S do.

What a displacement reads is in equilibrium with E b, which counts once. A stress is read by weights
that are part of b_j itself (a_j has them beside what later states leave it, by minus the volume),
and its E b is in equilibrium with nothing: of such readings the first c is 1, and d_0 is free.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoident.forward.reduced.affine_march import AffineForm
from geoident.forward.reduced.moduli import Span, moment_basis
from geoident.forward.reduced.zones import StressTerm
from geoident.model.arrays import Floats, Ints

ROUNDED = 1e-14
"""Part of an energy that is rounding, where it is a small difference."""

_FLAT = 1e-12
"""What is added to the diagonal of the least squares of a combination, relative to it."""


@dataclass(frozen=True, eq=False)
class StageDual:
    """The adjoints of readings (g) in one state, and their derivatives: K of each.

    Args:
        moments: by material, S (pairs, r, g) of pairs k <= l, in the basis of `moment_basis`.
        loads: (K, g, r) their work on the loads.
        terms: (r_m, K, g, N_l) their work on the stresses of the reduced model.
    """

    moments: Mapping[str, Floats]
    loads: Floats
    terms: Mapping[StressTerm, Floats]


@dataclass(frozen=True, eq=False)
class Combination:
    """Sums of the strains and of the stresses of a basis, at parameter vectors (b).

    Args:
        strains: c (b, K).
        stresses: d (b, K).
    """

    strains: Floats
    stresses: Floats


class DualBasis:
    """Adjoints of readings at one parameter vector, with derivatives.

    Args:
        form: of the moduli.
        place: (n,) the parameter vector.
        by: (K - 1,) parameters of the derivatives, which are taken in units of their sizes.
        stages: of every state.
        readings: (g,) which of all readings they are.
        forces: they read stresses, not displacements.
    """

    def __init__(
        self,
        form: AffineForm,
        place: Floats,
        by: Ints,
        stages: tuple[StageDual, ...],
        readings: Ints,
        *,
        forces: bool,
    ) -> None:
        self.place, self.by, self.stages = place, by, stages
        self.readings, self.forces = readings, forces
        self._form = form
        self.size = 1 + len(by)
        self.first, self.second = np.triu_indices(self.size)

    @property
    def count(self) -> int:
        """Number g of readings."""
        return len(self.readings)

    @cached_property
    def stresses(self) -> dict[str, Floats]:
        """Material to M (K, s, K, s): stress k of the basis is sum_l M_kl b_l."""
        return {name: self._stress(span) for name, span in self._form.spans.items()}

    def _stress(self, span: Span) -> Floats:
        c, slopes = (found[0] for found in span.coordinates(self.place[None]))
        E, s = span.matrix(c), span.basis.shape[1]
        found = np.zeros((self.size, s, self.size, s))
        for k in range(self.size):
            found[k, :, k] = E
        for k, h in enumerate(self.by, start=1):
            found[k, :, 0] = span.matrix(slopes[:, h] * self._form.loads.scale[h])
        return found

    def only(self, tau: Floats) -> Combination:
        """The adjoints at the place itself, their strains times tau (b,) by their stresses."""
        strains, stresses = np.zeros((2, len(tau), self.size))
        strains[:, 0] = 1.0 if self.forces else tau
        stresses[:, 0] = 1.0 / tau if self.forces else 1.0
        return Combination(strains, stresses)

    def best(self, moduli: Mapping[str, Floats], weights: Floats) -> Combination:
        """What leaves least out of balance of all readings together, states weighted.

        Args:
            moduli: material to E (b, s, s).
            weights: (b, n_states) squared.
        """
        K, b = self.size, len(weights)
        square = np.zeros((b, 2 * K, 2 * K))
        for name, E in moduli.items():
            if name not in self._mean:
                continue
            s = E.shape[1]
            S = np.tensordot(weights, self._mean[name], axes=1)  # (b, K, s, K, s)
            M = self.stresses[name].reshape(K * s, K * s)
            made = M @ S.reshape(b, K * s, K * s)  # of stresses with strains
            both = (made @ M.T).reshape(b, K, s, K, s)
            crossed = np.einsum("bkulu->bkl", made.reshape(b, K, s, K, s))
            square[:, :K, :K] += np.einsum("bkulv,buv->bkl", S, E)
            square[:, K:, :K] -= crossed
            square[:, :K, K:] -= crossed.swapaxes(1, 2)
            square[:, K:, K:] += np.einsum("bkulv,buv->bkl", both, np.linalg.inv(E))
        size = np.sqrt(np.einsum("bkk->bk", square))
        size[~(size > 0.0)] = 1.0
        scaled = square / (size[:, :, None] * size[:, None, :])
        once = 0 if self.forces else K  # what reads, or is read, counts once
        free = np.delete(np.arange(2 * K), once)
        rest = scaled[:, free[:, None], free] + _FLAT * np.eye(2 * K - 1)
        found = np.ones((b, 2 * K))
        found[:, free] = np.linalg.solve(rest, -scaled[:, free, once, None]).squeeze(2)
        found[:, free] *= size[:, once, None] / size[:, free]
        return Combination(found[:, :K], found[:, K:])

    @cached_property
    def _mean(self) -> dict[str, Floats]:
        """Material to moments (n_states, K, s, K, s) of all readings, each by its energy."""
        energy = np.zeros(self.count)
        for stage in self.stages:
            for name, moments in stage.moments.items():
                energy += self._reference_energy(name, moments)[0]
        share = 1.0 / np.where(energy > 0.0, energy, np.inf)
        found: dict[str, Floats] = {}
        for number, stage in enumerate(self.stages):
            for name, moments in stage.moments.items():
                basis = moment_basis(self._form.spans[name])
                s = basis.shape[1]
                shape = (len(self.stages), self.size, s, self.size, s)
                parts = np.tensordot(moments @ share, basis, axes=1)  # (pairs, s, s)
                whole = np.zeros((self.size, s, self.size, s))
                whole[self.first, :, self.second] = parts
                whole[self.second, :, self.first] = parts.swapaxes(1, 2)
                found.setdefault(name, np.zeros(shape))[number] = whole
        return found

    def _reference_energy(self, name: str, moments: Floats) -> Floats:
        """Energies (K, g) of the strains by the moduli of a material at the place."""
        span = self._form.spans[name]
        E = self.stresses[name][0, :, 0]
        own = moments[self.first == self.second]
        return np.tensordot(np.tensordot(moment_basis(span), E, axes=2), own, axes=(0, 1))

    def measures(self, moduli: Mapping[str, Floats], some: Combination) -> dict[str, Floats]:
        """Material to what makes energies of its moments: (b, pairs, r).

        Args:
            moduli: material to E (b, s, s).
            some: sums of strains and stresses.
        """
        found = {}
        for name, E in moduli.items():
            A = np.tensordot(some.stresses, self.stresses[name], axes=1).swapaxes(1, 2)
            A = A - some.strains[:, :, None, None] * E[:, None]  # (b, K, s, s)
            turned = np.linalg.solve(E[:, None], A)
            products = A[:, self.first].swapaxes(2, 3) @ turned[:, self.second]
            twice = np.where(self.first == self.second, 1.0, 2.0)
            basis = moment_basis(self._form.spans[name])
            found[name] = np.tensordot(products, basis, axes=((2, 3), (1, 2))) * twice[:, None]
        return found

    def unbalanced(self, stage: StageDual, measures: Mapping[str, Floats], count: int) -> Floats:
        """|sigma^ - E b~|^2 (b, g) in a state, rounding included.

        Args:
            stage: of the state.
            measures: see `measures`.
            count: number b.
        """
        found, sizes = np.zeros((count, self.count)), np.zeros((count, self.count))
        same = self.first == self.second
        for name, moments in stage.moments.items():
            z = measures[name]
            found += z.reshape(count, -1) @ moments.reshape(-1, self.count)
            sizes += np.abs(z[:, same].reshape(count, -1)) @ np.abs(
                moments[same].reshape(-1, self.count)
            )
        return np.maximum(found, 0.0) + ROUNDED * self.size * sizes
