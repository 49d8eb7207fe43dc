"""From snapshots to the reduced model: bases, projected matrices, and what the bounds need.

For every state j the displacements of the snapshots and their derivatives, scaled by the size of
the parameters, span the space of u_j; their strains are made orthonormal in the energy of the moduli
at the reference. With the strains at the points of every zone, all projections are sums over points:
no stiffness matrix is made, and nothing is factorized.

The stresses of the snapshots are in equilibrium with their loads, so

    sigma^(p) = sum_i c_i sigma_i ,     sum_i c_i psi(p_i) = psi(p)

is in equilibrium with the loads at p: a part P psi(p), and any part of the self-equilibrated rest H.
By the theorem of Prager and Synge its distance in complementary energy from the stress of the
reduced model is at least the error of that. Both sides of the difference are columns of one
matrix a zone, of which only the factor R is kept: differences of nearly equal numbers are formed
before they are squared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla

from geoident.forward.march.march import March
from geoident.forward.reduced.loads import LoadForm
from geoident.forward.reduced.moduli import MaterialSpan
from geoident.forward.reduced.snapshots import Snapshot, settling_strain, strain_of
from geoident.forward.reduced.zones import Zone
from geoident.model.arrays import Floats

DEPENDENT = 1e-10
"""A column of which less is new, relative to its size, spans no further direction."""

_ROWS = 256
"""Rows of a block that is factorized at once."""

Term = tuple[int, str]
"""State and material: E_material C u_state is part of the stress of a zone."""


@dataclass(frozen=True, eq=False)
class ZoneResidual:
    """The difference of the two stresses in a zone.

    Args:
        material: of which the zone is made: its moduli measure.
        loads: (k, r) factor of the columns P less the in-situ stress.
        rest: (k, h) of H.
        terms: (k, r_m, N_l) of the stresses of the reduced model.
    """

    material: str
    loads: Floats
    rest: Floats
    terms: Mapping[Term, Floats]


@dataclass(frozen=True, eq=False)
class ReducedStage:
    """One state of the reduced model.

    Args:
        base: the state on which it builds.
        observed: (n_channels, N) what the channels see of its displacements.
        matrices: <eps(U), J_r eps(U_l)> (r_m, N, N_l) by state and material.
        load: (N, r) work of the loads.
        residuals: of every zone.
        normal: by material, H^T H (h, h) in its measure.
        changes: materials that changed in it: before and after.
    """

    base: int
    observed: Floats
    matrices: Mapping[Term, Floats]
    load: Floats
    residuals: tuple[ZoneResidual, ...]
    normal: Mapping[str, Floats]
    changes: tuple[tuple[str, str], ...]

    @property
    def size(self) -> int:
        """Number N of unknowns."""
        return len(self.load)


class Projection:
    """Makes the stages of a reduced model from snapshots.

    Args:
        march: of the case.
        zones: of every state.
        spans: of every material.
        loads: in-situ stress and forces.
        snapshots: at least one.
        reference: (n,) parameters whose moduli measure.
    """

    def __init__(
        self,
        march: March,
        zones: Sequence[Sequence[Zone]],
        spans: Mapping[str, MaterialSpan],
        loads: LoadForm,
        snapshots: Sequence[Snapshot],
        reference: Floats,
    ) -> None:
        self._march, self._zones, self._spans, self._loads = march, zones, spans, loads
        self._snapshots = snapshots
        self._points = march.systems.discretization.points
        self._size = loads.scale
        self._root: dict[str, Floats] = {}
        for name, span in spans.items():
            c, _ = span.coordinates(reference[None])
            self._root[name] = np.linalg.cholesky(span.matrix(c[0]))
        self._strains: dict[int, Floats] = {}
        self._needed = self._starts()

    def stages(self) -> tuple[ReducedStage, ...] | None:
        """All states; None where the loads of the snapshots do not yet span those of the case."""
        found = []
        combination = self._combination()
        if combination is None:
            return None
        first = 0 if self._loads.settles else 1
        for state in range(self._snapshots[0].last + 1):
            made = self._stage(state, *combination) if state >= first else self._nothing(state)
            found.append(made)
            for other in list(self._strains):
                if other not in self._needed or self._needed[other] <= state:
                    del self._strains[other]
        return tuple(found)

    def _starts(self) -> dict[int, int]:
        """State to the last one whose stress its displacements are part of."""
        needed: dict[int, int] = {}
        for state, zones in enumerate(self._zones):
            for zone in zones:
                for part, _, _ in _parts(zone):
                    needed[part] = max(needed.get(part, 0), state)
        return needed

    def _combination(self) -> tuple[Floats, Floats] | None:
        """(M, r) and (M, h): what makes columns with loads of one psi each, and without loads."""
        columns = [self._load_columns(snapshot) for snapshot in self._snapshots]
        psi = np.hstack(columns) if columns else np.zeros((0, 0))
        if not len(psi):
            return np.zeros((psi.shape[1], 0)), np.eye(psi.shape[1])
        size = np.abs(psi).max(axis=1, initial=0.0)[:, None]
        left, values, right = np.linalg.svd(psi / np.where(size > 0.0, size, 1.0))
        rank = int(np.sum(values > 1e-9 * values[0]))
        if rank < len(psi):
            return None
        particular = (right[:rank].T / values) @ left.T / size.T
        return particular, right[rank:].T

    def _load_columns(self, snapshot: Snapshot) -> Floats:
        """Psi and its derivatives by the parameters in their sizes, (r, 1 + n)."""
        psi, slopes = self._loads.coordinates(snapshot.p[None])
        return np.hstack([psi[0][:, None], slopes[0] * self._size])

    def _scaled(self, columns: Floats) -> Floats:
        """Values and derivatives (..., 1 + n) by the parameters in their sizes."""
        return columns * np.concatenate([[1.0], self._size])

    def _nothing(self, state: int) -> ReducedStage:
        base, seen = self._march.sequence.states[state].base, self._snapshots[0].observed[state]
        r = self._loads.stress.shape[-1]
        empty = np.zeros((len(seen), 0))
        return ReducedStage(base, empty, {}, np.zeros((0, r)), (), {}, ())

    def _stage(self, state: int, particular: Floats, free: Floats) -> ReducedStage:
        zones = self._zones[state]
        raw = np.concatenate([self._strain(s, state) for s in self._snapshots], axis=-1)
        basis, turn = self._orthonormal(raw, zones)
        self._strains[state] = basis
        seen = [self._scaled(s.observed[state]) for s in self._snapshots]
        observed = np.hstack(seen) @ turn
        stress = np.concatenate([self._scaled(s.stress[state]) for s in self._snapshots], axis=-1)
        loads, rest = stress @ particular, stress @ free
        rest = self._orthonormal_rest(rest, zones)
        residuals = []
        matrices: dict[Term, Floats] = {}
        work = np.zeros((basis.shape[-1], loads.shape[-1]))
        for zone in zones:
            mine = zone.points
            own = loads[:, mine]
            if zone.history.virgin is not None:
                own = own - self._loads.stress[:, mine]
            terms = self._terms(zone)
            test = basis[:, mine] * self._points.volume[mine][:, None]
            test = test.reshape(-1, basis.shape[-1])
            work += test.T @ own.reshape(-1, own.shape[-1])
            for key, columns in terms.items():
                flat = columns.reshape(len(test), -1)
                product = (test.T @ flat).reshape(basis.shape[-1], *columns.shape[2:])
                matrices[key] = matrices.get(key, 0.0) + np.moveaxis(product, 1, 0)
            residuals.append(self._residual(zone, own, rest[:, mine], terms))
        normal: dict[str, Floats] = {}
        for one in residuals:
            normal[one.material] = normal.get(one.material, 0.0) + one.rest.T @ one.rest
        changes = {(z.before, z.material) for z in zones if z.before != z.material}
        base = self._march.sequence.states[state].base
        return ReducedStage(
            base, observed, matrices, work, tuple(residuals), normal, tuple(sorted(changes))
        )

    def _strain(self, snapshot: Snapshot, state: int) -> Floats:
        """Scaled strains (s, n_points, 1 + n) of the displacements of a state."""
        settled = self._settled(snapshot) if state == 0 else None
        return self._scaled(strain_of(self._march, snapshot, state, settled))

    def _settled(self, snapshot: Snapshot) -> Floats:
        psi, slopes = self._loads.coordinates(snapshot.p[None])
        columns = np.hstack([psi[0][:, None], slopes[0]])
        given, found = self._loads.stress @ columns, np.zeros_like(snapshot.stress[0])
        for zone in self._zones[0]:
            span, mine = self._spans[zone.material], zone.points
            c, dc = span.coordinates(snapshot.p[None])
            slopes_of = np.tensordot(dc[0], span.basis, axes=(0, 0))  # (n, s, s)
            found[:, mine] = settling_strain(
                snapshot.stress[0][:, mine],
                given[:, mine],
                span.matrix(c[0]),
                np.moveaxis(slopes_of, 0, -1),
            )
        return found

    def _orthonormal(self, raw: Floats, zones: Sequence[Zone]) -> tuple[Floats, Floats]:
        """Strains (s, n_points, N) orthonormal in energy, and what makes them of the raw (M, N)."""
        parts = [self._by_energy(zone, raw[:, zone.points]) for zone in zones]
        matrix = np.concatenate(parts)
        turn = orthonormal_columns(matrix)
        return raw @ turn, turn

    def _orthonormal_rest(self, raw: Floats, zones: Sequence[Zone]) -> Floats:
        if not raw.shape[-1]:
            return raw
        parts = [self._by_flexibility(zone.material, zone, raw[:, zone.points]) for zone in zones]
        return raw @ orthonormal_columns(np.concatenate(parts))

    def _by_energy(self, zone: Zone, strain: Floats) -> Floats:
        """Columns (s q, k) whose squares are the energy of strains (s, q, k)."""
        root = np.sqrt(self._points.volume[zone.points])[:, None]
        turned = np.tensordot(self._root[zone.material].T, strain, axes=1) * root
        return turned.reshape(-1, strain.shape[-1])

    def _by_flexibility(self, material: str, zone: Zone, stress: Floats) -> Floats:
        """Columns (s q, k) whose squares are the complementary energy of stresses (s, q, k)."""
        root = np.sqrt(self._points.volume[zone.points])[:, None]
        turned = np.tensordot(np.linalg.inv(self._root[material]), stress, axes=1) * root
        return turned.reshape(-1, stress.shape[-1])

    def _terms(self, zone: Zone) -> dict[Term, Floats]:
        """Stresses J_r eps(U_l) (s, q, r_m, N_l) of which that of a zone is made."""
        found: dict[Term, Floats] = {}
        for state, material, sign in _parts(zone):
            if state not in self._strains:
                continue
            strain = self._strains[state][:, zone.points]
            stress = sign * np.einsum("rij,jqn->iqrn", self._spans[material].basis, strain)
            key = state, material
            found[key] = found[key] + stress if key in found else stress
        return found

    def _residual(
        self, zone: Zone, loads: Floats, rest: Floats, terms: Mapping[Term, Floats]
    ) -> ZoneResidual:
        s, q = loads.shape[:2]
        columns = [loads, rest, *(t.reshape(s, q, -1) for t in terms.values())]
        joined = self._by_flexibility(zone.material, zone, np.concatenate(columns, axis=-1))
        factor = triangular_factor(joined)
        ends = np.cumsum([c.shape[-1] for c in columns])
        pieces = np.split(factor, ends[:-1], axis=1)
        shaped = {
            key: piece.reshape(len(factor), *term.shape[2:])
            for (key, term), piece in zip(terms.items(), pieces[2:], strict=True)
        }
        return ZoneResidual(zone.material, pieces[0], pieces[1], shaped)


def _parts(zone: Zone) -> list[tuple[int, str, float]]:
    """States whose displacements are part of the stress of a zone, with material and sign."""
    found: list[tuple[int, str, float]] = []
    if zone.history.virgin is not None:
        found.append((0, zone.history.virgin, 1.0))
    for segment in zone.history.segments:
        found.append((segment.end, segment.material, 1.0))
        if segment.start is not None:
            found.append((segment.start, segment.material, -1.0))
    return found


def orthonormal_columns(matrix: Floats) -> Floats:
    """(M, N) that makes orthonormal columns of (k, M) ones, those left out that add nothing."""
    size = np.linalg.norm(matrix, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    reduced = triangular_factor(matrix / scale)
    factor, order = sla.qr(reduced, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(factor))
    rank = int(np.sum(diagonal > DEPENDENT)) if size.any() else 0
    turn = np.zeros((matrix.shape[1], rank))
    inverse = sla.solve_triangular(factor[:rank, :rank], np.eye(rank))
    turn[order[:rank]] = inverse
    turn /= scale[:, None]
    # once more: what was nearly dependent is not yet orthogonal
    again = triangular_factor(matrix @ turn)
    return np.asarray(sla.solve_triangular(again.T, turn.T, lower=True).T)


def triangular_factor(matrix: Floats) -> Floats:
    """R of Q R of a matrix (k, M) with many rows: of blocks that stay near the processor."""
    while len(matrix) > 4 * max(_ROWS, 2 * matrix.shape[1]):
        rows = max(_ROWS, 2 * matrix.shape[1])
        whole = len(matrix) // rows * rows
        factors = np.linalg.qr(matrix[:whole].reshape(-1, rows, matrix.shape[1]), mode="r")
        matrix = np.concatenate([factors.reshape(-1, matrix.shape[1]), matrix[whole:]])
    return np.linalg.qr(matrix, mode="r")
