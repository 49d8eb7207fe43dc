"""From snapshots to the reduced model: bases, projected matrices, what its estimated error needs.

For every state j the displacements of the snapshots and their derivatives, by the parameters in
their sizes, span the space of u_j; a basis of it is made orthonormal in the energy of the moduli at
the reference. The stresses of the snapshots are in equilibrium with their loads, so

    sigma^(p) = sum_i c_i sigma_i ,     sum_i c_i psi(p_i) = psi(p)

is in equilibrium with the loads at p: a part P psi(p), and any of the self-equilibrated rest H.
By the theorem of Prager and Synge its distance in complementary energy from the stress of the
reduced model is at least the error of that.

All this needs is one pass over the strain points. With E = L L^T at the reference, the columns

    sqrt(V) L^-1 [ J_r C u_l ]

of a zone (the stresses of the displacements by every matrix J_r of its moduli) have one triangular
factor R. The stresses of the snapshots, less those of the virgin state, are sums of such columns
(`recorder`). Products of columns are those of R, and so are differences of nearly equal stresses
before they are squared. No stiffness matrix is made, and nothing is factorized but R.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as sla

from geoident.fem.solvers.threads import run_tasks
from geoident.forward.reduced.affine_analysis import AffineAnalysis
from geoident.forward.reduced.recorder import Snapshot
from geoident.forward.reduced.stress_rows import StageForces
from geoident.forward.reduced.zones import StressTerm, Zone
from geoident.forward.stages import Index
from geoident.model.arrays import Floats, Ints

DEPENDENT = 1e-10
"""A column of which less is new, relative to its size, spans no further direction."""

SMALL = 1e-2
"""Columns smaller than this part of the largest are not brought to its size: they may be noise."""

_ROWS = 256
"""Rows of a block that is factorized at once."""

_POINTS = 1024
"""Strain points of which columns are made at once: they stay near the processor."""


@dataclass(frozen=True, eq=False)
class ZoneResidual:
    """The difference of the two stresses in a zone, as columns of a triangular factor.

    Args:
        material: of which the zone is made: its moduli measure.
        loads: (k, r) P less the in-situ stress.
        rest: (k, h) H.
        terms: (k, r_m, N_l) the stresses of the reduced model.
    """

    material: str
    loads: Floats
    rest: Floats
    terms: Mapping[StressTerm, Floats]


@dataclass(frozen=True, eq=False)
class ReducedStage:
    """One state of the reduced model.

    Args:
        base: the state on which it builds.
        observed: (n_channels, N) what the channels see of the displacements of its basis.
        matrices: sum V eps(U)^T J_r eps(U_l), (r_m, N, N_l), by state and material.
        load: (N, r) work of the loads.
        residuals: of every zone.
        changes: materials that changed in it: before and after.
        forces: what channels see of its stress.
    """

    base: int
    observed: Floats
    matrices: Mapping[StressTerm, Floats]
    load: Floats
    residuals: tuple[ZoneResidual, ...]
    changes: tuple[tuple[str, str], ...]
    forces: StageForces

    @property
    def size(self) -> int:
        """Number N of unknowns."""
        return len(self.load)


@dataclass(frozen=True, eq=False)
class _Factor:
    """R of the columns of a zone: of the snapshots' stresses (k, M), and by term (k, r_m, M)."""

    zone: Zone
    stress: Floats
    terms: Mapping[StressTerm, Floats]


class GalerkinProjection:
    """Makes the stages of a reduced model from snapshots.

    Args:
        affine: the analysis with the form of its moduli and loads.
        snapshots: at least one.
        reference: (n,) parameters whose moduli measure.
    """

    def __init__(
        self, affine: AffineAnalysis, snapshots: Sequence[Snapshot], reference: Floats
    ) -> None:
        self._affine, self._snapshots = affine, snapshots
        self._spans, self._loads = affine.form.spans, affine.form.loads
        self._base = [state.base for state in affine.analysis.sequence.states]
        self._points = affine.points
        at = affine.form.at(reference[None])
        self._at_reference = {name: c[0] for name, c in at.moduli.items()}
        self._inverse_root = {
            name: np.linalg.inv(np.linalg.cholesky(span.matrix(self._at_reference[name])))
            for name, span in self._spans.items()
        }
        states = range(snapshots[0].last + 1)
        # the columns of all snapshots side by side: of every state, and T (r, M, M) by material
        self._motion = [np.hstack([s.motion[state] for s in snapshots]) for state in states]
        self._turns = {
            name: np.array([sla.block_diag(*T) for T in zip(*(s.turns[name] for s in snapshots),
                                                            strict=True)])
            for name in self._spans
        }  # fmt: skip
        self._turn: dict[int, Floats] = {}  # by state, what makes its basis of the columns

    def displacements(self, state: int, q: Floats) -> Floats:
        """Displacements (n_dofs, k) of a state by its coordinates (N, k)."""
        return np.asarray(self._motion[state] @ (self._turn[state] @ q))

    def stages(self) -> tuple[ReducedStage, ...] | None:
        """All states; None where the loads of the snapshots do not yet span those of the case."""
        combination = self._combination()
        if combination is None:
            return None
        return tuple(self._stage(state, *combination) for state in range(len(self._motion)))

    def _strains(self, state: int, points: Index) -> Floats:
        """Columns (s, q, M) of the snapshots: strains of the displacements of a state.

        Of the virgin state those of the motion that balanced it, if it moves.
        """
        if state == 0:
            settled = [s.settled[:, points] for s in self._snapshots if s.settled is not None]
            return np.concatenate(settled, axis=-1)
        return self._points.strain(self._motion[state], points)

    def _parts(self, zone: Zone) -> list[tuple[int, str, float]]:
        """Of what the stress of a zone consists, less that in situ."""
        return [part for part in zone.parts if part[0] or self._loads.settles]

    def _combination(self) -> tuple[Floats, Floats] | None:
        """(M, r) and (M, h): what makes columns with loads of one psi each, and without loads."""
        psi = np.hstack([snapshot.psi for snapshot in self._snapshots])
        if not len(psi):
            return np.zeros((psi.shape[1], 0)), np.eye(psi.shape[1])
        size = np.abs(psi).max(axis=1, initial=0.0)[:, None]
        left, values, right = np.linalg.svd(psi / np.where(size > 0.0, size, 1.0))
        rank = int(np.sum(values > 1e-9 * values[0]))
        if rank < len(psi):
            return None
        particular = (right[:rank].T / values) @ left.T / size.T
        return particular, right[rank:].T

    def _stage(self, state: int, particular: Floats, free: Floats) -> ReducedStage:
        """One state.

        Args:
            state: its number.
            particular: (M, r) what makes columns with loads of one psi each.
            free: (M, h) what makes columns without loads.
        """
        zones, M = self._affine.zones[state], len(particular)
        moves = bool(state) or self._loads.settles
        factors = [self._factor(zone) for zone in zones] if moves else []
        of_strain = [
            np.einsum("r,krm->km", self._at_reference[f.zone.material],
                      f.terms[state, f.zone.material])
            for f in factors
        ]  # fmt: skip
        # what settles is known as a small difference of stresses
        least = DEPENDENT if state else 1e3 * DEPENDENT
        turn = orthonormal_columns(np.concatenate([np.zeros((0, M)), *of_strain]), least)
        self._turn[state] = turn
        unloaded = [np.zeros((0, free.shape[1])), *(f.stress @ free for f in factors)]
        rest = free @ orthonormal_columns(np.concatenate(unloaded))
        load = np.zeros((turn.shape[1], particular.shape[1]))
        matrices: dict[StressTerm, Floats] = {}
        residuals = []
        for factor, strain in zip(factors, of_strain, strict=True):
            test = (strain @ turn).T
            terms = {key: part @ self._turn[key[0]] for key, part in factor.terms.items()}
            for key, part in terms.items():
                product = np.tensordot(test, part, axes=1).swapaxes(0, 1)
                matrices[key] = matrices.get(key, 0.0) + product
            own = factor.stress @ particular
            load += test @ own
            residuals.append(_residual(factor.zone.material, own, factor.stress @ rest, terms))
        return ReducedStage(
            base=self._base[state],
            observed=np.hstack([s.observed[state] for s in self._snapshots]) @ turn,
            matrices=matrices,
            load=load,
            residuals=tuple(residuals),
            changes=tuple(sorted({(z.before, z.material) for z in zones if z.before != z.material}))
            if moves
            else (),
            forces=self._forces(state),
        )

    def _forces(self, state: int) -> StageForces:
        """What channels see of the stress of a state: sums over the strain points they read."""
        rows, load_stress = self._affine.rows, self._loads.stress
        loads = np.zeros((len(rows.channels), load_stress.shape[-1]))
        terms: dict[StressTerm, Floats] = {}
        for zone in self._affine.zones[state]:
            points, weights = rows.at(zone.points)
            if not len(points):
                continue
            if zone.history.given:
                loads += np.einsum("csq,sqr->cr", weights, load_stress[:, points])
            for other, material, sign in self._parts(zone):
                strain, key = sign * self._strains(other, points), (other, material)
                stress = np.tensordot(self._spans[material].basis, strain, axes=1)  # (r, s, q, M)
                work = np.tensordot(stress, weights, axes=((1, 2), (1, 2))).swapaxes(1, 2)
                terms[key] = terms.get(key, 0.0) + work @ self._turn[other]
        jacked, weights = rows.at(self._affine.jacked(state))
        loads += np.einsum("csq,sqr->cr", weights, load_stress[:, jacked])
        return StageForces(rows.channels, loads, terms)

    def _factor(self, zone: Zone) -> _Factor:
        """R of a zone."""
        signs: dict[StressTerm, float] = {}
        for other, material, sign in self._parts(zone):
            signs[other, material] = signs.get((other, material), 0.0) + sign
        runs = list(_runs_of(zone.points))
        blocks = [np.zeros((0, 0))] * len(runs)

        def factorize(number: int) -> None:
            points, columns = runs[number], []
            for (other, name), sign in signs.items():
                strain = self._strains(other, points)
                columns += [np.tensordot(sign * J, strain, axes=1) for J in self._spans[name].basis]
            joined = np.concatenate(columns, axis=-1)
            joined = np.tensordot(self._inverse_root[zone.material], joined, axes=1)
            joined *= np.sqrt(self._points.volume[points])[:, None]
            blocks[number] = triangular_factor(joined.reshape(-1, joined.shape[-1]))

        run_tasks([partial(factorize, number) for number in range(len(runs))])
        triangular = triangular_factor(np.concatenate(blocks))
        ranks = [len(self._spans[name].basis) for _, name in signs]
        M = triangular.shape[1] // sum(ranks)
        parts = np.split(triangular, np.cumsum(ranks)[:-1] * M, axis=1)
        terms = {
            key: part.reshape(len(triangular), -1, M)
            for key, part in zip(signs, parts, strict=True)
        }
        stress = sum(
            np.tensordot(part, self._turns[name], axes=((1, 2), (0, 1)))
            for (_, name), part in terms.items()
        )
        return _Factor(zone, np.asarray(stress), terms)


def _residual(
    material: str, loads: Floats, rest: Floats, terms: Mapping[StressTerm, Floats]
) -> ZoneResidual:
    """The same columns with a factor of as many rows as there are of them."""
    flat = [loads, rest, *(columns.reshape(len(columns), -1) for columns in terms.values())]
    factor = _triangle(np.hstack(flat))
    pieces = np.split(factor, np.cumsum([part.shape[1] for part in flat])[:-1], axis=1)
    shaped = {
        key: piece.reshape(len(factor), *columns.shape[1:])
        for (key, columns), piece in zip(terms.items(), pieces[2:], strict=True)
    }
    return ZoneResidual(material, pieces[0], pieces[1], shaped)


def _runs_of(points: Ints) -> Iterator[Index]:
    """Points (q,) some at a time, as slices where they stand together."""
    for first in range(0, len(points), _POINTS):
        some = points[first : first + _POINTS]
        whole = int(some[-1]) - int(some[0]) + 1 == len(some)
        yield slice(int(some[0]), int(some[-1]) + 1) if whole else some


def orthonormal_columns(matrix: Floats, least: float = DEPENDENT) -> Floats:
    """(M, N) that makes orthonormal columns of (k, M) ones.

    Args:
        matrix: (k, M).
        least: a column of which less is new, relative to its size, is left out.
    """
    size = np.linalg.norm(matrix, axis=0)
    if not size.any():
        return np.zeros((matrix.shape[1], 0))
    scale = np.maximum(size, SMALL * size.max())
    factor, order = sla.qr(matrix / scale, mode="r", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(factor)) > least))
    turn = np.zeros((matrix.shape[1], rank))
    turn[order[:rank]] = sla.solve_triangular(factor[:rank, :rank], np.eye(rank))
    turn /= scale[:, None]
    # once more: what was nearly dependent is not yet orthogonal
    again = _triangle(matrix @ turn)
    return np.asarray(np.linalg.solve(again.T, turn.T).T)


def triangular_factor(matrix: Floats) -> Floats:
    """R of Q R of a matrix (k, M) with many rows: of blocks that stay near the processor."""
    rows = max(_ROWS, 2 * matrix.shape[1])
    while len(matrix) > 2 * rows:
        whole = len(matrix) // rows * rows
        factors = _triangle(matrix[:whole].reshape(-1, rows, matrix.shape[1]))
        matrix = np.concatenate([factors.reshape(-1, matrix.shape[1]), matrix[whole:]])
    return _triangle(matrix)


def _triangle(matrices: Floats) -> Floats:
    """R of matrices (..., k, M)."""
    return np.asarray(np.linalg.qr(matrices, mode="r"))
