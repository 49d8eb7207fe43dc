"""Adjoints as a basis and what they leave: energies against those of strains that are summed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.sums import S, summed_model

from geoident.forward.reduced.duals.basis import Combination, DualBasis, StageDual
from geoident.forward.reduced.duals.bounds import ReadingBounds, ReadingDuals, _combinations
from geoident.forward.reduced.moduli import moment_basis

VALUES = np.array([[1.1, 4.6], [2.3, 3.1]])
PLACE = np.array([1.3, 4.4])
POINTS = 5
MADE = ({}, {"rock": 1, "clay": 1}, {"clay": 1}, {"steel": 1, "rock": 1})
"""Materials of every state."""


class Strains:
    """Strains of adjoints at a few points of every state and material, with their volumes."""

    def __init__(self, model, by, count, seed):
        random = np.random.default_rng(seed)
        self.K, self.count, self.model = 1 + len(by), count, model
        self.volume = random.uniform(0.5, 2.0, POINTS)
        self.of = [
            {m: random.standard_normal((self.K, S, POINTS, count)) for m in materials}
            for materials in MADE
        ]
        form = model.form
        self.loads = [random.standard_normal((self.K, count, 3)) for _ in MADE]
        self.terms = [
            {
                key: random.standard_normal((block.shape[0], self.K, count, block.shape[2]))
                for key, block in stage.matrices.items()
            }
            for stage in model.stages
        ]
        stages = []
        for n, strains in enumerate(self.of):
            moments = {}
            for m, b in strains.items():
                basis = moment_basis(form.spans[m])
                pairs = [(k, j) for k in range(self.K) for j in range(k, self.K)]
                S_kl = [np.einsum("q,iqg,jqg->ijg", self.volume, b[k], b[j]) for k, j in pairs]
                moments[m] = np.stack([np.einsum("rij,ijg->rg", basis, one) for one in S_kl])
            stages.append(StageDual(moments, self.loads[n], self.terms[n]))
        self.stages = tuple(stages)

    def basis(self, readings, by, *, forces):
        return DualBasis(self.model.form, PLACE, np.array(by, dtype=np.int64), self.stages,
                         np.array(readings), forces=forces)  # fmt: skip

    def left(self, number, moduli, by, c, d):
        """|sigma^ - E b~|^2 of every reading, the sums written out."""
        found = np.zeros(self.count)
        for m, b in self.of[number].items():
            span = self.model.form.spans[m]
            at, slopes = (x[0] for x in span.coordinates(PLACE[None]))
            E0, E = span.matrix(at), moduli[m]
            apart = d[0] * np.einsum("ij,jqg->iqg", E0, b[0])
            for k, h in enumerate(by, start=1):
                E_h = span.matrix(slopes[:, h] * self.model.form.loads.scale[h])
                apart += d[k] * np.einsum("ij,jqg->iqg", E0, b[k])
                apart += d[k] * np.einsum("ij,jqg->iqg", E_h, b[0])
            for k in range(self.K):
                apart -= c[k] * np.einsum("ij,jqg->iqg", E, b[k])
            found += np.einsum("q,iqg,ij,jqg->g", self.volume, apart, np.linalg.inv(E), apart)
        return found


CASES = [((), False), ((1,), False), ((1, 0), False), ((), True), ((0,), True), ((0, 1), True)]


@pytest.mark.parametrize(("by", "forces"), CASES)
def test_what_a_sum_leaves_out_of_balance_is_the_energy_of_its_strains(by, forces):
    model = summed_model()
    strains = Strains(model, by, 3, seed=4)
    basis = strains.basis([0, 1, 2], by, forces=forces)
    assert (basis.size, basis.count) == (1 + len(by), 3)
    moduli = {m: span.matrix(span.coordinates(VALUES)[0]) for m, span in model.form.spans.items()}
    random = np.random.default_rng(9)
    some = Combination(*random.standard_normal((2, 2, basis.size)))
    measures = basis.measures(moduli, some)
    for number, stage in enumerate(basis.stages):
        found = basis.unbalanced(stage, measures, 2)
        assert found.shape == (2, 3)
        for n in range(2):
            E = {m: whole[n] for m, whole in moduli.items()}
            exact = strains.left(number, E, by, some.strains[n], some.stresses[n])
            np.testing.assert_allclose(found[n], exact, rtol=1e-9)


def test_rounding_is_left_where_nothing_else_is():
    """At the place itself the strains fit; 1e-14 of the sizes of all products stays."""
    model = summed_model()
    by = (1, 0)
    basis = Strains(model, by, 2, seed=4).basis([0, 1], by, forces=False)
    moduli = {m: s.matrix(s.coordinates(PLACE[None])[0]) for m, s in model.form.spans.items()}
    measures = basis.measures(moduli, basis.only(np.ones(1)))
    for stage in basis.stages[1:]:
        left = basis.unbalanced(stage, measures, 1)
        assert np.all(left < 1e-20)
    z = {m: np.random.default_rng(1).standard_normal(x.shape) for m, x in measures.items()}
    stage = basis.stages[1]
    own = np.zeros(2)
    for m, moments in stage.moments.items():
        for pair, (k, j) in enumerate(zip(basis.first, basis.second, strict=True)):
            own += (k == j) * (np.abs(z[m][0, pair]) @ np.abs(moments[pair]))
    for sign in (1.0, -1.0):
        turned = {m: sign * x for m, x in z.items()}
        whole = sum(np.einsum("pr,prg->g", turned[m][0], stage.moments[m]) for m in stage.moments)
        found = basis.unbalanced(stage, turned, 1)[0]
        np.testing.assert_allclose(found - np.maximum(whole, 0.0), 3e-14 * own, rtol=2e-2)


@pytest.mark.parametrize("forces", [False, True])
def test_what_counts_once_where_only_the_adjoints_themselves_are_taken(forces):
    basis = Strains(summed_model(), (1,), 2, seed=4).basis([0, 1], (1,), forces=forces)
    some = basis.only(np.array([0.5, 4.0]))
    np.testing.assert_array_equal(
        some.strains, [[1.0, 0], [1.0, 0]] if forces else [[0.5, 0], [4.0, 0]]
    )
    np.testing.assert_array_equal(
        some.stresses, [[2.0, 0], [0.25, 0]] if forces else [[1.0, 0], [1.0, 0]]
    )


@pytest.mark.parametrize(("by", "forces"), [c for c in CASES if c[0]])
def test_the_best_sum_leaves_least_of_all_readings_together(by, forces):
    """Each reading by its energy at the place, each state by its weight."""
    model = summed_model()
    strains = Strains(model, by, 3, seed=4)
    basis = strains.basis([0, 1, 2], by, forces=forces)
    spans = model.form.spans
    moduli = {m: span.matrix(span.coordinates(VALUES)[0]) for m, span in spans.items()}
    weights = np.array([[7.0, 0.3, 2.0, 0.6], [1.0, 1.5, 0.2, 3.0]])
    energy = np.zeros(3)
    for materials in strains.of:
        for m, b in materials.items():
            E = spans[m].matrix(spans[m].coordinates(PLACE[None])[0][0])
            energy += np.einsum("q,iqg,ij,jqg->g", strains.volume, b[0], E, b[0])
    some = basis.best(moduli, weights)
    K, once = basis.size, 0 if forces else basis.size
    for n in range(2):
        E = {m: whole[n] for m, whole in moduli.items()}

        def left(x, E=E, n=n):
            parts = [
                weights[n, j] * np.sum(strains.left(j, E, by, x[:K], x[K:]) / energy)
                for j in range(4)
            ]
            return sum(parts)

        unit = np.eye(2 * K)
        square = np.zeros((2 * K, 2 * K))
        for k in range(2 * K):
            for m in range(2 * K):
                square[k, m] = (left(unit[k] + unit[m]) - left(unit[k] - unit[m])) / 4
        free = [k for k in range(2 * K) if k != once]
        exact = np.ones(2 * K)
        exact[free] = np.linalg.solve(square[np.ix_(free, free)], -square[free, once])
        found = np.concatenate([some.strains[n], some.stresses[n]])
        assert found[once] == 1.0
        np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-8)


def test_readings_that_see_nothing_do_not_count():
    model = summed_model()
    strains = Strains(model, (1,), 2, seed=4)
    blind = [
        StageDual({m: x * np.array([1.0, 0.0]) for m, x in s.moments.items()}, s.loads, s.terms)
        for s in strains.stages
    ]
    alone = [
        StageDual({m: x[..., :1] for m, x in s.moments.items()}, s.loads[:, :1], s.terms)
        for s in strains.stages
    ]
    moduli = {m: s.matrix(s.coordinates(VALUES)[0]) for m, s in model.form.spans.items()}
    weights = np.array([[7.0, 0.3, 2.0, 0.6], [1.0, 1.5, 0.2, 3.0]])
    found = [
        DualBasis(model.form, PLACE, np.array([1]), tuple(stages), np.arange(count), forces=False)
        .best(moduli, weights)
        for stages, count in ((blind, 2), (alone, 1))
    ]  # fmt: skip
    np.testing.assert_allclose(found[0].strains, found[1].strains, rtol=1e-12)
    np.testing.assert_allclose(found[0].stresses, found[1].stresses, rtol=1e-12)
    nothing = [
        StageDual({m: 0.0 * x for m, x in s.moments.items()}, s.loads, s.terms)
        for s in strains.stages
    ]
    still = DualBasis(model.form, PLACE, np.array([1]), tuple(nothing), np.arange(2), forces=False)
    none = still.best(moduli, weights)
    np.testing.assert_array_equal(none.strains, 0.0)
    np.testing.assert_array_equal(none.stresses, [[1.0, 0.0]] * 2)


def test_a_material_that_no_state_has_is_left_out():
    model = summed_model()
    strains = Strains(model, (1,), 2, seed=4)
    basis = strains.basis([0, 1], (1,), forces=False)
    moduli = {m: s.matrix(s.coordinates(VALUES)[0]) for m, s in model.form.spans.items()}
    weights = np.ones((2, 4))
    whole = basis.best({**moduli, "of another": moduli["rock"]}, weights)
    np.testing.assert_array_equal(whole.strains, basis.best(moduli, weights).strains)


def test_of_two_bounds_the_lesser_is_taken_reading_by_reading():
    mine = ReadingBounds(np.array([[1.0, -2.0, 3.0], [0.5, 0.0, -1.0]]),
                         np.array([[1.0, 2.0, 3.0], [0.25, np.inf, 4.0]]))  # fmt: skip
    other = ReadingBounds(
        np.array([[-5.0, 1.5], [-3.0, 0.75]]), np.array([[0.5, 0.25], [1.5, 7.0]])
    )
    mine.take(np.array([2, 0]), other)
    np.testing.assert_array_equal(mine.correction, [[1.5, -2.0, -5.0], [0.5, 0.0, -3.0]])
    np.testing.assert_array_equal(mine.error, [[0.25, 2.0, 0.5], [0.25, np.inf, 1.5]])
    same = ReadingBounds(np.array([[2.0]]), np.array([[1.0]]))
    same.take(np.array([0]), ReadingBounds(np.array([[-1.0]]), np.array([[2.0]])))
    np.testing.assert_array_equal(same.correction, [[2.0]])


def _whole(model, found, energy, strains, sums, n):
    """|correction| and bound (g,) of one sum of adjoints, at one parameter vector."""
    by, (c, d) = sums
    E = {m: s.matrix(found.at.moduli[m][n]) for m, s in model.form.spans.items()}
    squared = [strains.left(j, E, by, c, d) for j in range(4)]
    error, left, work = np.zeros(2), [np.zeros(2) for _ in range(4)], np.zeros(2)
    for j in (3, 2, 1, 0):
        error += (left[j] + np.sqrt(squared[j])) * energy.residual[j, n]
        growth = np.ravel(model.growth(model.stages[j], found.at) * np.ones(2))[n]
        if j:
            left[model.stages[j].base] += np.sqrt(growth * (left[j] ** 2 + squared[j]))
        work += np.einsum("k,kgr,r->g", c, strains.loads[j], found.at.loads[n])
        for (state, m), terms in strains.terms[j].items():
            q, at = found.states[state][n, :, 0], found.at.moduli[m][n]
            work -= np.einsum("k,r,rkgi,i->g", c, at, terms, q)
    return np.abs(work), error


@pytest.mark.parametrize("base", [1, 2])
def test_bounds_of_readings_are_the_least_of_all_sums_and_places(base):
    """Two bases, of motions with derivatives and of stresses without: each sum by loops.

    The last state builds on the first, beside the second, or on that.
    """
    model = summed_model()
    last = replace(model.stages[3], base=base)
    model = replace(model, stages=(*model.stages[:3], last))
    moved, pressed = Strains(model, (1,), 2, seed=4), Strains(model, (), 2, seed=6)
    bases = [moved.basis([0, 2], (1,), forces=False), pressed.basis([2, 1], (), forces=True)]
    found = model.states(VALUES, derivatives=False)
    energy = model.bounds(found)
    duals = ReadingDuals(model, bases, rounding=0.125)
    assert (duals.bases, duals.rounding) == (tuple(bases), 0.125)
    assert ReadingDuals(model, bases).rounding == 0.0
    bounds = duals.bounds(found, energy)
    assert bounds.correction.shape == bounds.error.shape == (2, 3)
    moduli = {m: s.matrix(found.at.moduli[m]) for m, s in model.form.spans.items()}
    for n in range(2):
        best: dict[int, tuple[float, float]] = {}
        for basis, strains, by in ((bases[0], moved, (1,)), (bases[1], pressed, ())):
            for some in _combinations(basis, moduli, energy):
                sums = by, (some.strains[n], some.stresses[n])
                for reading, *parts in zip(
                    basis.readings, *_whole(model, found, energy, strains, sums, n), strict=True
                ):
                    best[reading] = min(best.get(reading, (np.inf, 0.0)), tuple(parts), key=sum)
        for reading, (correction, error) in best.items():
            assert abs(bounds.correction[n, reading]) == pytest.approx(correction, rel=1e-7)
            assert bounds.error[n, reading] == pytest.approx(error, rel=1e-7)


def test_sums_are_tried_with_the_middle_of_all_moduli_and_of_each_material():
    """Strains times two over the sum of the ends of the eigenvalues; then the best."""
    model = summed_model()
    found = model.states(VALUES, derivatives=False)
    energy = model.bounds(found)
    moduli = {m: s.matrix(found.at.moduli[m]) for m, s in model.form.spans.items()}
    at = {m: s.matrix(s.coordinates(PLACE[None])[0][0]) for m, s in model.form.spans.items()}
    mu = {
        m: np.stack([np.sort(np.linalg.eigvals(np.linalg.solve(at[m], one)).real) for one in E])
        for m, E in moduli.items()
    }
    basis = Strains(model, (1,), 2, seed=4).basis([0, 1], (1,), forces=False)
    tried = list(_combinations(basis, moduli, energy))
    assert len(tried) == 5
    every = np.concatenate(list(mu.values()), axis=1)
    for some, values in zip(tried, [every, *mu.values()], strict=False):
        tau = 2.0 / (values.min(axis=1) + values.max(axis=1))
        np.testing.assert_allclose(some.strains[:, 0], tau, rtol=1e-9)
        np.testing.assert_array_equal(some.stresses[:, 0], 1.0)
    best = basis.best(moduli, energy.residual.T**2)
    np.testing.assert_array_equal(tried[-1].strains, best.strains)
    np.testing.assert_array_equal(tried[-1].stresses, best.stresses)
    plain = Strains(model, (), 2, seed=4).basis([0, 1], (), forces=False)
    assert len(list(_combinations(plain, moduli, energy))) == 4
    one = {"rock": moduli["rock"]}
    assert len(list(_combinations(plain, one, energy))) == 1
