"""In-situ stress and forces as a sum of few fixed ones (theory 14).

    sigma_0(p) = sum_k psi_k(p) sigma_k ,   f_j(p) = sum_k psi_k(p) f_j,k

with psi linear combinations of monomials in the parameters: of degree two (a unit weight times a
K0 is one), or products of three (times the part of it that is released). Which monomials is found
by trying: what is given at as many parameter vectors as there are monomials must give what is found
at others, or the case has no such form.

Where ground leaves that no stage has changed, and part of its stress is held, what is held is made
of the stress in situ: a force as any other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from geoident.forward.actions.release import Held
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.in_situ.stress import NEGLIGIBLE_IMBALANCE
from geoident.forward.reduced.points import AnalysisPoints
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint

_ROUNDED = 1e-10
"""Relative difference of loads, interpolated and computed, that is rounding."""

_EPS = float(np.finfo(np.float64).eps)

_CHECKS = 4
"""Parameter vectors at which a form is tried: two inside, and the two ends of the bounds."""


@dataclass(frozen=True, eq=False)
class LoadForm:
    """Loads of all states.

    Args:
        scale: (n,) sizes of the parameters.
        exponents: (k, n) of the monomials, of p / scale.
        mix: (r, k) psi of the monomials.
        stress: (s, n_points, r) in-situ stress, Pa, and forces to which bars are brought, N.
        forces: of every state, (n_dofs, r), N.
        settles: whether the virgin ground moves to balance them.
    """

    scale: Floats
    exponents: Ints
    mix: Floats
    stress: Floats
    forces: tuple[Floats, ...]
    settles: bool

    def coordinates(self, values: Floats) -> tuple[Floats, Floats]:
        """Psi (b, r) at parameter vectors (b, n), and its derivatives (b, r, n)."""
        x = values / self.scale
        slopes = np.zeros((len(x), len(self.exponents), x.shape[1]))
        for h in np.flatnonzero(self.exponents.any(axis=0)):
            lower = self.exponents.copy()
            lower[:, h] = np.maximum(lower[:, h] - 1, 0)
            slopes[:, :, h] = self.exponents[:, h] * monomials(x, lower) / self.scale[h]
        return monomials(x, self.exponents) @ self.mix.T, np.einsum("rk,bkn->brn", self.mix, slopes)


def monomials(x: Floats, exponents: Ints) -> Floats:
    """Products (b, k) of powers of x (b, n) by exponents (k, n)."""
    return np.asarray(np.prod(x[:, None, :] ** exponents, axis=2))


def load_form(
    analysis: StagedAnalysis, names: Sequence[str], samples: Floats, last: int
) -> LoadForm | None:
    """The form of the loads of a case up to a state; None where they have none.

    Args:
        analysis: of the case.
        names: of the n parameters.
        samples: (b, n) parameter vectors spread over the domain, the last ones its ends.
        last: the last state.
    """
    scale = np.abs(samples).max(axis=0)
    scale[scale == 0.0] = 1.0
    loads = _Loads(analysis, names, last)
    moves = loads.moved_by(samples[:2])
    for exponents in _forms(moves):
        count = len(exponents)
        if count + _CHECKS > len(samples):
            return None
        tried = np.concatenate([samples[:count], samples[-_CHECKS:]])
        all_given = [loads.at(p) for p in tried]
        there = np.flatnonzero(np.any(all_given, axis=0))  # most forces are zero
        given = np.stack([one[there] for one in all_given])
        design = monomials(tried / scale, exponents)
        fields = np.linalg.pinv(design[:count], rcond=count * _EPS) @ given[:count]
        missed = np.abs(design[count:] @ fields - given[count:]).max(initial=0.0)
        if missed <= _ROUNDED * max(1.0, np.abs(given).max()):
            return _shortened(loads, (fields, there), exponents, scale, samples)
    return None


def _forms(moves: Bools) -> Iterator[Ints]:
    """Exponents (k, n): constant and linear, with products of two, with squares, of three."""
    n, some = len(moves), np.flatnonzero(moves)
    unit = np.eye(n, dtype=np.int64)
    linear = [np.zeros(n, dtype=np.int64), *(unit[h] for h in some)]
    pairs = [unit[h] + unit[k] for h, k in combinations(some, 2)]
    yield np.stack(linear)
    if pairs:
        yield np.stack([*linear, *pairs])
    squares = [2 * unit[h] for h in some]
    if squares:
        yield np.stack([*linear, *pairs, *squares])
    triples = [unit[list(three)].sum(axis=0) for three in combinations(some, 3)]
    if triples:
        yield np.stack([*linear, *pairs, *squares, *triples])


class _Loads:
    """In-situ stress and forces of some states as one vector, each part by its size."""

    def __init__(self, analysis: StagedAnalysis, names: Sequence[str], last: int) -> None:
        self.analysis, self.names, self.last = analysis, tuple(names), last
        self._sizes: list[float] = []
        self._known: dict[bytes, Floats] = {}

    def _parts(self, p: Floats, *, slopes: bool = False) -> list[Floats]:
        values = dict(zip(self.names, map(float, p), strict=True))
        point = ParameterPoint(values, self.names if slopes else ())
        analysis = self.analysis
        stress = analysis.in_situ.columns(point)
        stress[:, ~analysis.systems[0].present] = 0.0
        states, structures = analysis.sequence.states[: self.last + 1], analysis.systems.structures
        jacked = np.zeros((structures.n_rows, point.n_columns))
        for state in states:
            jacked += structures.given(state, point)
        return [stress.reshape(-1, point.n_columns), jacked, *self._forces(stress, point)]

    def _forces(self, stress: Floats, point: ParameterPoint) -> Iterator[Floats]:
        """Forces (n_dofs, 1 + n) of the states, with what is held of ground that left.

        Args:
            stress: (s, n_points, 1 + n) in situ.
            point: the parameters.
        """
        analysis, held = self.analysis, dict[int, Held]()
        for n, state in enumerate(analysis.sequence.states[: self.last + 1]):
            forces = analysis.actions.forces(n, point)
            held[n] = analysis.release.held(n, held[state.base], stress, point) if n else {}
            yield forces + analysis.release.forces(n, held[n], point)

    def moved_by(self, samples: Floats) -> Bools:
        """(n,) parameters by which any of them has a derivative."""
        moved = [
            np.any(part[:, 1:] != 0.0, axis=0)
            for p in samples
            for part in self._parts(p, slopes=True)
        ]
        return np.asarray(np.any(moved, axis=0))

    @property
    def size(self) -> int:
        """Numbers in all parts."""
        return len(next(iter(self._known.values())))

    def at(self, p: Floats) -> Floats:
        """All parts at parameters (n,)."""
        if p.tobytes() not in self._known:
            self._known[p.tobytes()] = self._made(p)
        return self._known[p.tobytes()]

    def _made(self, p: Floats) -> Floats:
        parts = [part[:, 0] for part in self._parts(p)]
        if not self._sizes:
            sizes = [float(np.abs(part).max(initial=0.0)) for part in parts]
            self._sizes = [size or 1.0 for size in sizes]
        scaled = (part / size for part, size in zip(parts, self._sizes, strict=True))
        return np.concatenate(list(scaled))

    def split(self, fields: Floats) -> tuple[Floats, tuple[Floats, ...]]:
        """Stress and forces of bars (s, n_points, r), forces (n_dofs, r), of vectors (r, ...)."""
        points, n_dofs = (
            AnalysisPoints(self.analysis.systems),
            self.analysis.systems.discretization.n_dofs,
        )
        n_rows = points.n_points - points.n_ground
        sizes = (points.n_strain * points.n_ground, n_rows, *[n_dofs] * (self.last + 1))
        parts = np.split(fields, np.cumsum(sizes)[:-1], axis=1)
        stress, jacked, *forces = (
            np.ascontiguousarray((size * part).T)
            for size, part in zip(self._sizes, parts, strict=True)
        )
        in_situ = stress.reshape(points.n_strain, points.n_ground, len(fields))
        return points.joined(in_situ, jacked), tuple(forces)


def _shortened(
    loads: _Loads, given: tuple[Floats, Ints], exponents: Ints, scale: Floats, samples: Floats
) -> LoadForm:
    """The form by as many fields as are independent.

    Args:
        loads: of the case.
        given: fields (k, q), and of which entries they are (q,); the others are zero.
        exponents: of the monomials.
        scale: of the parameters.
        samples: some of them.
    """
    fields, there = given
    left, size, rows = np.linalg.svd(fields, full_matrices=False)
    kept = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
    spread = np.zeros((np.count_nonzero(kept), loads.size))
    spread[:, there] = rows[kept]
    stress, forces = loads.split(spread)
    mix = (left[:, kept] * size[kept]).T
    analysis, settles = loads.analysis, False
    form = LoadForm(scale, exponents, mix, stress, forces, settles)
    psi, _ = form.coordinates(samples[-_CHECKS:])
    in_situ = stress[:, : analysis.systems.discretization.points.n_points]
    of_samples = analysis.imbalance(in_situ @ psi.T, forces[0] @ psi.T)
    settles = bool(of_samples.max(initial=0.0) > NEGLIGIBLE_IMBALANCE)
    return LoadForm(scale, exponents, mix, stress, forces, settles)
