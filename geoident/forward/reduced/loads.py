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
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np

from geoident.forward.actions.release import UnreleasedForces
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.in_situ.stress import NEGLIGIBLE_IMBALANCE
from geoident.forward.reduced.points import AnalysisPoints
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Values

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
    moves = [
        np.any(part[:, 1:] != 0.0, axis=0)
        for p in samples[:2]
        for part in _given(analysis, dict(zip(names, map(float, p), strict=True)), last, names)
    ]

    @cache
    def given(sample: int) -> list[Floats]:
        values = dict(zip(names, map(float, samples[sample]), strict=True))
        return [part[:, 0] for part in _given(analysis, values, last)]

    # in-situ stress, forces of bars and nodal forces of each state count by their own sizes
    sizes = [float(np.abs(part).max(initial=0.0)) or 1.0 for part in given(0)]
    for exponents in _forms(np.any(moves, axis=0)):
        count = len(exponents)
        if count + _CHECKS > len(samples):
            return None
        tried = [*range(count), *range(len(samples) - _CHECKS, len(samples))]
        loads = np.stack([
            np.concatenate([part / size for part, size in zip(given(k), sizes, strict=True)])
            for k in tried
        ])  # fmt: skip
        nonzero = np.flatnonzero(loads.any(axis=0))  # most forces are zero
        design = monomials(samples[tried] / scale, exponents)
        fields = np.linalg.pinv(design[:count], rcond=count * _EPS) @ loads[:count, nonzero]
        missed = np.abs(design[count:] @ fields - loads[count:, nonzero]).max(initial=0.0)
        if missed <= _ROUNDED * max(1.0, np.abs(loads).max(initial=0.0)):
            break
    else:
        return None
    # as many fields as are independent
    left, size, rows = np.linalg.svd(fields, full_matrices=False)
    kept = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
    spread = np.zeros((np.count_nonzero(kept), loads.shape[1]))
    spread[:, nonzero] = rows[kept]
    ends = np.cumsum([len(part) for part in given(0)])[:-1]
    stress, bars, *forces = (
        np.ascontiguousarray((size * part).T)
        for size, part in zip(sizes, np.split(spread, ends, axis=1), strict=True)
    )
    points = AnalysisPoints(analysis.systems)
    in_situ = stress.reshape(points.n_strain, points.n_ground, len(spread))
    mix = (left[:, kept] * size[kept]).T
    form = LoadForm(scale, exponents, mix, points.joined(in_situ, bars), tuple(forces), False)
    psi, _ = form.coordinates(samples[-_CHECKS:])
    none = np.zeros((0, len(psi)))
    imbalance = analysis.imbalance(in_situ @ psi.T, forces[0] @ psi.T, none).max(initial=0.0)
    return replace(form, settles=bool(imbalance > NEGLIGIBLE_IMBALANCE))


def _given(
    analysis: StagedAnalysis, values: Values, last: int, names: Sequence[str] = ()
) -> list[Floats]:
    """In-situ stress, forces of jacked bars, and nodal forces of the states, (..., 1 + n) each.

    Args:
        analysis: of the case.
        values: parameters by name.
        last: the last state.
        names: the n of them by which to differentiate.
    """
    point = ParameterPoint(values, tuple(names))
    stress = analysis.in_situ.columns(point)
    stress[:, ~analysis.systems[0].present] = 0.0
    structures, unreleased = analysis.systems.structures, dict[int, UnreleasedForces]()
    jacked, forces = np.zeros((structures.n_rows, point.n_columns)), []
    for n, state in enumerate(analysis.sequence.states[: last + 1]):
        jacked += structures.given(state, point)
        unreleased[n] = (
            analysis.release.unreleased(n, unreleased[state.base], stress, point) if n else {}
        )
        forces.append(
            analysis.actions.forces(n, point) + analysis.release.forces(n, unreleased[n], point)
        )
    return [stress.reshape(-1, point.n_columns), jacked, *forces]


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
