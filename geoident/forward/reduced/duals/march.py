"""Takes readings back through the stages at one parameter vector, with derivatives.

The adjoints themselves come first in every state: what their derivatives leave out of balance is
made of their strains (see `basis`). Both go through the same factorization.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.forward.march.march import Run
from geoident.forward.march.stage import factorize
from geoident.forward.reduced.duals.basis import DualBasis, StageDual
from geoident.forward.reduced.moduli import moment_basis
from geoident.forward.reduced.projection import GalerkinProjection
from geoident.forward.reduced.zones import StressTerm, Zone
from geoident.model.arrays import Floats, Ints

_AT_ONCE = 24
"""Columns that are taken back together: readings, and as many derivatives."""


@dataclass(frozen=True, eq=False)
class ReadRows:
    """What readings (g) of one kind see of the states.

    Args:
        readings: (g,) which of all readings they are.
        rows: G', (g, n_dofs); zero where they see stresses.
        weights: (n_states, g) how often a reading counts what it sees of a state.
        stresses: (g, s, q) weights of the stresses at the points of `StressRows`; None where they
            see displacements.
    """

    readings: Ints
    rows: sp.csr_array
    weights: Floats
    stresses: Floats | None = None

    def some(self, which: slice) -> ReadRows:
        """Some of the readings."""
        stresses = None if self.stresses is None else self.stresses[which]
        return ReadRows(self.readings[which], self.rows[which], self.weights[:, which], stresses)


class DualMarch:
    """Takes readings back through the stages at one parameter vector.

    Args:
        projection: what made the reduced model.
        run: a traced run, all its states done.
        place: (n,) its parameters.
        by: parameters of the derivatives.
    """

    def __init__(
        self, projection: GalerkinProjection, run: Run, place: Floats, by: Sequence[int]
    ) -> None:
        self._projection, self._affine, self._run = projection, projection.affine, run
        self._systems = projection.affine.march.systems
        self._points = projection.affine.points
        self._place, self._by = place, np.array(by, dtype=np.int64)
        form = self._affine.form
        at, scale = form.at(place[None]), form.loads.scale
        self._moduli = {name: form.spans[name].matrix(c[0]) for name, c in at.moduli.items()}
        self._slopes = {
            name: [form.spans[name].matrix(slopes[0, :, h] * scale[h]) for h in self._by]
            for name, slopes in at.slopes.items()
        }

    def basis(self, read: ReadRows) -> DualBasis:
        """The adjoints in all states.

        Args:
            read: what readings see of the states.
        """
        count, together = len(read.readings), max(_AT_ONCE // (1 + len(self._by)), 1)
        parts = [
            self._some(read.some(slice(some, some + together)))
            for some in range(0, max(count, 1), together)
        ]
        stages = tuple(_joined([part[n] for part in parts]) for n in range(len(read.weights)))
        forces = read.stresses is not None
        return DualBasis(
            self._affine.form, self._place, self._by, stages, read.readings, forces=forces
        )

    def _some(self, reads: ReadRows) -> list[StageDual]:
        rows, weights = reads.rows, reads.weights
        n_states, k = weights.shape
        K, s, points = 1 + len(self._by), self._points.n_strain, self._points.n_points
        left: dict[int, Floats] = {}
        read = np.unique(rows.indices)
        seeds = rows[:, read].T.toarray()
        seen = np.zeros((n_states, len(read), k))  # adjoints of the displacements that are read
        found: list[StageDual] = [self._nothing(k) for _ in range(n_states)]
        for number in range(n_states - 1, 0 if not self._affine.form.loads.settles else -1, -1):
            task = self._run.traces[number].task
            state, system = task.state, task.system
            a = left.pop(number, np.zeros((s, points, K * k)))
            if reads.stresses is not None:
                mine = self._affine.rows.points
                of_volume = reads.stresses / self._points.volume[mine]
                a[:, mine, :k] -= np.moveaxis(of_volume, 0, -1) * weights[number]
            self._points.clear(a, state, system)
            strain = np.zeros_like(a)
            forces = np.zeros((rows.shape[1], k))
            if number:
                seen[number] += seeds * weights[number]
                forces[read] = seen[number]
            strain[..., :k] = self._solved(number, forces, self._stressed(number, a[..., :k]))
            if K > 1:
                b = a[..., :k] + strain[..., :k]
                self._points.clear(b, state, system)
                stress = self._stressed(number, a[..., k:]) + self._turned(number, b)
                strain[..., k:] = self._solved(number, 0.0, stress)
            a += strain
            self._points.clear(a, state, system)
            found[number] = self._tested(number, a, strain)
            if number:
                self._points.clear_begun(a, state)
                base = state.base
                left[base] = left[base] + a if base in left else a
                seen[base][system.touched[read]] += seen[number][system.touched[read]]
        return found

    def _solved(self, number: int, forces: Floats | float, stress: Floats) -> Floats:
        """Strains (s, n_points, k) of the adjoint displacements: of forces, less those of stress.

        Args:
            number: of the state.
            forces: (n_dofs, k).
            stress: (s, n_points, k).
        """
        trace = self._run.traces[number]
        system = trace.task.system
        rest = forces - self._points.forces(stress, system)
        w, dofs = np.zeros_like(rest), system.pattern.dofs
        factor = factorize(trace.task, self._systems, self._run.factors)
        if factor is not None and trace.stepped:
            w[dofs] = factor.solve(rest[dofs])
        return self._points.strain(w)

    def _stressed(self, number: int, strain: Floats) -> Floats:
        """E eps of adjoint strains (s, n_points, k)."""
        found = np.zeros_like(strain)
        for zone in self._affine.zones[number]:
            E = self._moduli[zone.material]
            found[:, zone.points] = np.tensordot(E, strain[:, zone.points], axes=1)
        return found

    def _turned(self, number: int, strain: Floats) -> Floats:
        """E_h eps (s, n_points, (K - 1) k) of adjoint strains (s, n_points, k)."""
        s, points, k = strain.shape
        found = np.zeros((s, points, len(self._by), k))
        for zone in self._affine.zones[number]:
            for h, slope in enumerate(self._slopes[zone.material]):
                if slope.any():
                    found[:, zone.points, h] = np.tensordot(slope, strain[:, zone.points], axes=1)
        return found.reshape(s, points, -1)

    def _tested(self, number: int, b: Floats, strain: Floats) -> StageDual:
        """Moments of b (s, n_points, K k), and the work of strains on loads and stresses."""
        particular, turn = self._projection.particular, self._projection.turn
        columns = b.shape[-1]
        K = 1 + len(self._by)
        k = columns // K
        moments: dict[str, Floats] = {}
        work = np.zeros((columns, particular.shape[1]))
        terms: dict[StressTerm, Floats] = {}
        for zone in self._affine.zones[number]:
            mine = zone.points
            volume = self._points.volume[mine][:, None]
            some = self._moments(zone, b[:, mine].reshape(len(b), len(mine), K, k))
            moments[zone.material] = moments.get(zone.material, 0.0) + some
            test = (strain[:, mine] * volume).reshape(-1, columns)
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
                ).reshape(-1, K, k, turn[state].shape[1])
                key = state, material
                terms[key] = terms[key] + found if key in terms else found
        return StageDual(moments, work.reshape(K, k, -1), terms)

    def _moments(self, zone: Zone, b: Floats) -> Floats:
        """Moments (pairs, r, k) of strains (s, q, K, k) in a zone."""
        s, q, K, k = b.shape
        x = np.ascontiguousarray(b.transpose(3, 2, 0, 1)).reshape(k, K * s, q)
        S = (x * self._points.volume[zone.points]) @ x.swapaxes(1, 2)
        first, second = np.triu_indices(K)
        pairs = S.reshape(k, K, s, K, s)[:, first, :, second]  # (pairs, k, s, s)
        basis = moment_basis(self._affine.form.spans[zone.material])
        return np.tensordot(pairs, basis, axes=((2, 3), (1, 2))).swapaxes(1, 2)

    def _nothing(self, k: int) -> StageDual:
        K, r = 1 + len(self._by), self._projection.particular.shape[1]
        return StageDual({}, np.zeros((K, k, r)), {})


def _joined(parts: Sequence[StageDual]) -> StageDual:
    """Of all readings."""
    first = parts[0]
    return StageDual(
        {name: np.concatenate([p.moments[name] for p in parts], axis=2) for name in first.moments},
        np.concatenate([p.loads for p in parts], axis=1),
        {key: np.concatenate([p.terms[key] for p in parts], axis=2) for key in first.terms},
    )
