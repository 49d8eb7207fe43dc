"""The complementarity system of stages, point sets and laws (theory 5), made a bilinear system.

At every stage, building on the stage ``base`` (the state before the first stage for -1),

    sigma_j = sigma_base + E (C du_j - N dlam_j)          sigma_base = 0 in what the stage places
    C^T V sigma_j = F_j                                   on the free degrees of freedom
    psi_j = N^T sigma_j - k - H (lam_base + dlam_j) <= 0,   dlam_j >= 0,   psi_j^T dlam_j = 0

with F, k, H, E and the initial stress affine in the parameters p, and readings v that add up the
steps of the stages between their zero and their own:

    v_a = sum_j active[j, a] G_a du_j + offset_a

N is fixed: what turns a plane (a friction angle) is not of this form. `bilinear` numbers du, sigma
and dlam of all stages as the unknowns of one `BilinearSystem`, with the slacks -psi.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.response import Bilinear, BilinearSystem


@dataclass(frozen=True)
class Affine:
    """An array a_0 + sum_h p_h a_h.

    Args:
        constant: a_0, (...).
        slopes: a_h, (..., n).
    """

    constant: Floats
    slopes: Floats

    def at(self, p: Floats) -> Floats:
        """The array at parameters p (n,).

        >>> Affine(np.ones(2), np.eye(2)).at(np.array([3.0, 5.0]))
        array([4., 6.])
        """
        return np.asarray(self.constant + self.slopes @ p)

    @property
    def depends_on(self) -> Bools:
        """(n,) which parameters move it."""
        axes = tuple(range(self.slopes.ndim - 1))
        return np.asarray(np.any(self.slopes != 0.0, axis=axes))

    def terms(self) -> Iterator[tuple[int | None, Floats]]:
        """a_0 (...) with None, then every a_h (...) that is not zero with its h."""
        yield None, self.constant
        for h in np.flatnonzero(self.depends_on):
            yield int(h), self.slopes[..., h]


def fixed(array: Floats, n: int) -> Affine:
    """An array (...) that none of n parameters moves."""
    return Affine(array, np.zeros((*array.shape, n)))


@dataclass(frozen=True)
class PointSet:
    """Strain points that come, go and change their law together.

    Args:
        name: in messages.
        compatibility: C, (s m, d) sparse, component by component: row c m + i is component c of
            point i; 1/m.
        volume: V, (m,), m3.
        initial: (s, m) stress before the first stage, Pa.
    """

    name: str
    compatibility: sp.csr_array
    volume: Floats
    initial: Affine

    @property
    def n_points(self) -> int:
        """Number m of strain points."""
        return int(self.volume.shape[0])

    @property
    def n_strain(self) -> int:
        """Number s of strain components."""
        return int(self.initial.constant.shape[0])


@dataclass(frozen=True)
class PointLaw:
    """The law of a material: elastic where it has no plane (y = 0).

    Args:
        elasticity: E, (s, s), Pa.
        normals: n, (y, s), dimensionless.
        distances: k, (y,), Pa.
        hardening: H, (y, y), Pa; zero for perfect plasticity.
    """

    elasticity: Affine
    normals: Floats
    distances: Affine
    hardening: Affine

    @property
    def n_planes(self) -> int:
        """Number y of planes."""
        return int(self.normals.shape[0])


@dataclass(frozen=True)
class LoadStage:
    """One stage.

    Args:
        name: of the stage.
        base: index of the stage it builds on; -1 for the state before the first.
        laws: index of the law of every point set that is present.
        fresh: point sets that begin without stress and without history.
        dofs: (f,) free degrees of freedom.
        forces: F, (d,), N.
    """

    name: str
    base: int
    laws: Mapping[int, int]
    fresh: frozenset[int]
    dofs: Ints
    forces: Affine


@dataclass(frozen=True)
class EquationArrays:
    """All stages of one identification problem.

    Args:
        names: the n parameters.
        sets: point sets.
        laws: laws.
        stages: J stages; each comes after the one on which it builds.
        rows: G, (g, d) sparse; readings are in m where the rows are dimensionless.
        active: (J, g) weight of the step of a stage in a reading.
        offset: (g,) what the instruments add.
    """

    names: tuple[str, ...]
    sets: tuple[PointSet, ...]
    laws: tuple[PointLaw, ...]
    stages: tuple[LoadStage, ...]
    rows: sp.csr_array
    active: Floats
    offset: Affine

    @property
    def n_dofs(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.rows.shape[1])


def bilinear(staged: EquationArrays, p: Floats) -> BilinearSystem:
    """Stages, point sets and laws as one system of vectors.

    Unknowns are, stage by stage, du of the free degrees of freedom and, of one present point set
    after the other, sigma and dlam, each component by component or plane by plane. Displacements
    are of kind 0, the stresses of point set s of kind 1 + s.

    Args:
        staged: the stages.
        p: (n,) parameters at which the stiffness of the pairs is taken, SI.
    """
    return _Assembly(staged).system(p)


@dataclass(frozen=True)
class _Place:
    """Where a point set in a stage has its first unknowns, equation and pair.

    Args:
        law: index of its law.
        stress: column of sigma.
        multipliers: column of dlam.
        equation: row of the stress law.
        pair: row of the slacks.
    """

    law: int
    stress: int
    multipliers: int
    equation: int
    pair: int


class _Rows:
    """Collects a `Bilinear` of m rows block by block."""

    def __init__(self, m: int, n: int) -> None:
        self.constant, self.by_p = np.zeros(m), np.zeros((m, n))
        self._blocks: dict[int | None, list[tuple[Ints, Ints, Floats]]] = {None: []}

    def add(self, row: int, column: int, block: Any, h: int | None = None) -> None:
        """Adds a sparse block to A_h, or to A_0, with its first entry at a row and a column."""
        entries = sp.coo_array(block)
        rows = entries.row.astype(np.int64) + row
        columns = entries.col.astype(np.int64) + column
        self._blocks.setdefault(h, []).append((rows, columns, entries.data))

    def add_affine(self, row: int, array: Affine) -> None:
        """Adds an affine array, flat, to the rows that begin here."""
        flat = array.constant.ravel()
        rows = slice(row, row + len(flat))
        self.constant[rows] += flat
        self.by_p[rows] += array.slopes.reshape(len(flat), self.by_p.shape[1])

    def bilinear(self, n_unknowns: int) -> Bilinear:
        """All that was added."""
        shape = len(self.constant), n_unknowns
        matrices = {h: _matrix(blocks, shape) for h, blocks in self._blocks.items()}
        by_x = matrices.pop(None)
        return Bilinear(
            self.constant, self.by_p, by_x, {h: A for h, A in matrices.items() if h is not None}
        )


def _matrix(blocks: list[tuple[Ints, Ints, Floats]], shape: tuple[int, int]) -> sp.csr_array:
    if not blocks:
        return sp.csr_array(shape)
    row, column, value = (np.concatenate(part) for part in zip(*blocks, strict=True))
    return sp.csr_array((value, (row, column)), shape=shape)


class _Assembly:
    """The numbers of all unknowns, equations and pairs, and the blocks between them."""

    def __init__(self, staged: EquationArrays) -> None:
        self.staged = staged
        self.places: dict[tuple[int, int], _Place] = {}
        self.first: list[tuple[int, int]] = []
        column = row = pair = 0
        for j, stage in enumerate(staged.stages):
            self.first.append((column, row))
            column, row = column + stage.dofs.size, row + stage.dofs.size
            for s, law in stage.laws.items():
                points = staged.sets[s]
                size = points.n_strain * points.n_points
                self.places[j, s] = _Place(law, column, column + size, row, pair)
                count = staged.laws[law].n_planes * points.n_points
                column, row, pair = column + size + count, row + size, pair + count
        n = len(staged.names)
        self.n_unknowns, self.n_pairs = column, pair
        self.equations, self.slacks = _Rows(row, n), _Rows(pair, n)
        self.readings = _Rows(staged.rows.shape[0], n)

    def system(self, p: Floats) -> BilinearSystem:
        """All stages; the stiffness of the pairs at p (n,)."""
        staged = self.staged
        unknowns = np.full(self.n_unknowns, -1)
        equations = np.full(len(self.equations.constant), -1)
        slacks, multipliers = np.zeros((2, self.n_pairs), dtype=np.int64)
        stiffness, work = np.zeros((2, self.n_pairs))
        self.readings.add_affine(0, staged.offset)
        for j, stage in enumerate(staged.stages):
            unknowns[self.first[j][0] :][: stage.dofs.size] = 0
            self._balance(j, stage)
            for s in stage.laws:
                self._stress(j, stage, s)
                self._slack(j, s)
        for (_, s), place in self.places.items():
            law, points = staged.laws[place.law], staged.sets[s]
            size, count = points.n_strain * points.n_points, law.n_planes * points.n_points
            unknowns[place.stress :][:size] = equations[place.equation :][:size] = 1 + s
            pairs, n, E = slice(place.pair, place.pair + count), law.normals, law.elasticity.at(p)
            slacks[pairs], multipliers[pairs] = 1 + s, place.multipliers + np.arange(count)
            stiffness[pairs] = np.repeat(np.einsum("yi,ij,yj->y", n, E, n), points.n_points)
            work[pairs] = np.tile(points.volume, law.n_planes)
        return BilinearSystem(
            names=staged.names,
            equations=self.equations.bilinear(self.n_unknowns),
            slacks=self.slacks.bilinear(self.n_unknowns),
            readings=self.readings.bilinear(self.n_unknowns),
            multipliers=multipliers,
            stiffness=stiffness,
            work=work,
            kind_of_unknown=unknowns,
            kind_of_equation=equations,
            kind_of_slack=slacks,
        )

    def _balance(self, j: int, stage: LoadStage) -> None:
        """F - C^T V sigma on the free degrees of freedom, and what the step adds to readings."""
        staged, (column, row) = self.staged, self.first[j]
        forces = Affine(stage.forces.constant[stage.dofs], stage.forces.slopes[stage.dofs])
        self.equations.add_affine(row, forces)
        for s in stage.laws:
            points = staged.sets[s]
            back = points.compatibility.T * np.tile(points.volume, points.n_strain)
            self.equations.add(row, self.places[j, s].stress, -sp.csr_array(back)[stage.dofs])
        seen = sp.diags_array(staged.active[j]) @ staged.rows
        self.readings.add(0, column, sp.csr_array(seen)[:, stage.dofs])

    def _stress(self, j: int, stage: LoadStage, s: int) -> None:
        """The law sigma - sigma_base - E (C du - N dlam) of a point set."""
        place, points = self.places[j, s], self.staged.sets[s]
        law, one = self.staged.laws[place.law], sp.eye_array(points.n_points)
        row, add = place.equation, self.equations.add
        add(row, place.stress, sp.eye_array(points.n_strain * points.n_points))
        if s not in stage.fresh:
            before = self.places.get((stage.base, s))
            if before is not None:
                add(row, before.stress, -sp.eye_array(points.n_strain * points.n_points))
            elif stage.base < 0:
                initial = points.initial
                self.equations.add_affine(row, Affine(-initial.constant, -initial.slopes))
        C = sp.csr_array(points.compatibility)[:, stage.dofs]
        for h, E in law.elasticity.terms():
            add(row, self.first[j][0], -(sp.kron(sp.csr_array(E), one) @ C), h)
            add(row, place.multipliers, sp.kron(sp.csr_array(E @ law.normals.T), one), h)

    def _slack(self, j: int, s: int) -> None:
        """The slacks k + H lam - N^T sigma of a point set."""
        place, m = self.places[j, s], self.staged.sets[s].n_points
        law, one = self.staged.laws[place.law], sp.eye_array(m)
        k = law.distances
        self.slacks.add_affine(
            place.pair, Affine(np.repeat(k.constant, m), np.repeat(k.slopes, m, axis=0))
        )
        self.slacks.add(place.pair, place.stress, -sp.kron(sp.csr_array(law.normals), one))
        for before in self._history(j, s):
            for h, H in law.hardening.terms():
                self.slacks.add(place.pair, before.multipliers, sp.kron(sp.csr_array(H), one), h)

    def _history(self, j: int, s: int) -> Iterator[_Place]:
        """The places whose multipliers harden a point set: its own, then those it builds on."""
        own = self.places[j, s]
        planes = self.staged.laws[own.law].n_planes
        yield own
        while s not in self.staged.stages[j].fresh:
            j = self.staged.stages[j].base
            before = self.places.get((j, s))
            if before is None or self.staged.laws[before.law].n_planes != planes:
                return
            yield before
