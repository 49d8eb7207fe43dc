"""The multifrontal factorization: its fronts, what it keeps, and what threads may not change."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from geoident.fem.solvers.direct import LowerPattern, NotPositiveDefinite, SolverCounts
from geoident.fem.solvers.fronts import blas, elimination, layout, tree
from geoident.fem.solvers.fronts.graph import elimination_tree, node_graph
from geoident.fem.solvers.fronts.tasks import run_tasks
from geoident.fem.solvers.multifrontal import MultifrontalSolver
from geoident.fem.solvers.ordering import lasting_first, nested_dissection


@pytest.fixture
def fine(monkeypatch):
    """Leaves, strips, branches and blocks so small that a small matrix has many of each."""
    monkeypatch.setattr(tree, "LEAF", 3)
    monkeypatch.setattr(tree, "CALL", 20.0)
    monkeypatch.setattr(tree, "PASS", 0.1)
    monkeypatch.setattr(layout, "STRIP", 7)
    monkeypatch.setattr(layout, "BRANCHED", 0.0)
    monkeypatch.setattr(elimination, "BLOCK", 5)
    monkeypatch.setattr(elimination, "ZEROS", 11)


def grid(shape):
    """Points of a grid and the graph of nodes that share a cell: (points, indptr, indices)."""
    points = np.array(list(itertools.product(*map(range, shape))), dtype=float)
    near = np.abs(points[:, None] - points[None]).max(axis=2) <= 1
    graph = sp.csr_array(near)
    return points, graph.indptr.astype(np.int64), graph.indices.astype(np.int64)


def stiffness(indptr, indices, dofs, seed, scale=None):
    """A positive definite matrix on a node graph, in dense form; scale multiplies each edge."""
    rng = np.random.default_rng(seed)
    n = len(indptr) - 1
    i = np.repeat(np.arange(n), np.diff(indptr))
    i, j = i[indices < i], indices[indices < i]
    half = rng.normal(size=(len(i), 2 * dofs, 2 * dofs))
    part = half @ half.transpose(0, 2, 1)
    if scale is not None:
        part *= scale[i, j][:, None, None]
    at = (np.stack([i, j], axis=1)[:, :, None] * dofs + np.arange(dofs)).reshape(len(i), -1)
    matrix = np.eye(n * dofs) * 1e-2
    np.add.at(matrix, (at[:, :, None], at[:, None, :]), part)
    return matrix


def lower(matrix, order, **more):
    """Pattern and values of the lower triangle in an order."""
    triangle = sp.csc_array(np.tril(matrix[np.ix_(order, order)]))
    triangle.sort_indices()
    arrays = (np.asarray(a, dtype=np.int64) for a in (triangle.indptr, triangle.indices))
    return LowerPattern(*arrays, **more), triangle.data


def spread(order, dofs):
    return (np.asarray(order)[:, None] * dofs + np.arange(dofs)).ravel()


def residual(matrix, order, solution, rhs):
    full = np.empty_like(solution)
    full[order] = solution
    given = np.empty_like(rhs)
    given[order] = rhs
    scale = np.abs(matrix).sum(axis=1).max() * np.abs(solution).max() + np.abs(rhs).max()
    return np.abs(matrix @ full - given).max() / scale


@pytest.mark.parametrize("shape", [(9, 8), (5, 4, 4)])
def test_the_elimination_tree_is_that_of_the_dense_factor(shape):
    points, *graph = grid(shape)
    matrix = stiffness(*graph, 1, 0)
    pattern, _ = lower(matrix, nested_dissection(points, *graph))
    factor = np.linalg.cholesky(matrix[np.ix_(o := nested_dissection(points, *graph), o)])
    below = np.tril(np.abs(factor) > 1e-14, -1)
    parent = [int(np.flatnonzero(column)[0]) if column.any() else -1 for column in below.T]
    nodes = node_graph(pattern.indptr, pattern.indices, pattern.n)
    assert nodes.n_eliminated <= pattern.n
    found = elimination_tree(nodes)
    firsts, lasts = nodes.starts[:-1], nodes.starts[1:] - 1
    expected = [parent[last] for last in lasts]
    assert [firsts[p] if p >= 0 else -1 for p in found] == expected


@pytest.mark.parametrize("dofs", [1, 2, 3])
@pytest.mark.parametrize("shape", [(12, 11), (5, 4, 4)])
def test_many_small_fronts_give_the_solution_of_the_dense_matrix(fine, shape, dofs):
    points, *graph = grid(shape)
    matrix = stiffness(*graph, dofs, 1)
    order = spread(nested_dissection(points, *graph), dofs)
    pattern, values = lower(matrix, order)
    rhs = np.random.default_rng(0).normal(size=(pattern.n, 5))
    solution = MultifrontalSolver().analyse(pattern).factorize(values).solve(rhs)
    assert residual(matrix, order, solution, rhs) < 1e-14


@pytest.mark.parametrize("order", ["random", "backwards", "banded"])
def test_any_order_is_taken(fine, order):
    points, *graph = grid((10, 7))
    matrix = stiffness(*graph, 2, 2)
    n = len(points)
    nodes = {
        "random": np.random.default_rng(0).permutation(n),
        "backwards": np.arange(n)[::-1],
        "banded": np.arange(n),
    }[order]
    at = spread(nodes, 2)
    pattern, values = lower(matrix, at)
    rhs = np.ones((pattern.n, 2))
    solution = MultifrontalSolver().analyse(pattern).factorize(values).solve(rhs)
    assert residual(matrix, at, solution, rhs) < 1e-14


def test_operations_are_about_those_of_the_exact_factor():
    points, *graph = grid((7, 7, 7))
    matrix = stiffness(*graph, 1, 0)
    pattern, values = lower(matrix, order := nested_dissection(points, *graph))
    counts = SolverCounts()
    MultifrontalSolver(counts).analyse(pattern).factorize(values)
    factor = np.abs(np.linalg.cholesky(matrix[np.ix_(order, order)])) > 1e-14
    exact = float((factor.sum(axis=0).astype(float) ** 2).sum())
    assert exact <= counts.flops < exact + 60 * tree.CALL


def test_threads_do_not_change_a_bit(fine, monkeypatch):
    points, *graph = grid((5, 5, 4))
    matrix = stiffness(*graph, 3, 3)
    pattern, values = lower(matrix, spread(nested_dissection(points, *graph), 3))
    rhs = np.random.default_rng(0).normal(size=(pattern.n, 3))
    found = []
    for threads in ("1", "4"):
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", threads)
        found.append(MultifrontalSolver().analyse(pattern).factorize(values).solve(rhs))
    assert np.array_equal(*found)


class Staged:
    """A grid of which some nodes change; `stage` is a pattern without some of those."""

    def __init__(self, dofs=2):
        self.points, *self.graph = grid((11, 9))
        middle = np.abs(self.points - [5, 4]).max(axis=1)
        self.changes, self.gone = middle <= 2, middle == 0
        self.dofs = dofs
        self.order = lasting_first(self.points, *self.graph, self.changes)

    def stage(self, *, gone, seed=4, change=1.0, lasting=1.0):
        """(dense matrix, its order, pattern, values)."""
        n = len(self.points)
        scale = np.full((n, n), lasting)
        scale[np.ix_(self.changes, self.changes)] = lasting * change
        matrix = stiffness(*self.graph, self.dofs, seed, scale) * 1.0
        matrix += np.eye(len(matrix)) * 1e-2 * (lasting - 1.0)
        order = self.order[~self.gone[self.order]] if gone else self.order
        at = spread(order, self.dofs)
        lasting_unknowns = self.dofs * int(np.count_nonzero(~self.changes))
        pattern, values = lower(matrix, at, lasting=lasting_unknowns, names=at)
        return matrix[np.ix_(at, at)], pattern, values


def test_what_lasts_comes_first_and_its_border_last():
    staged = Staged()
    changes = staged.changes[staged.order]
    n = int(np.count_nonzero(~changes))
    assert not changes[:n].any()
    assert changes[n:].all()
    radius = np.abs(staged.points - [5, 4]).max(axis=1)[staged.order]
    assert set(radius[n:-16]) == {0, 1}
    assert set(radius[-16:]) == {2}


def test_what_lasts_is_eliminated_once_for_all_stages(fine):
    staged, counts = Staged(), SolverCounts()
    solver = MultifrontalSolver(counts)
    kept = [solver.analyse(staged.stage(gone=gone)[1]) for gone in (False, True)]
    kept[0].factorize(staged.stage(gone=False)[2])
    before = first = counts.flops
    assert counts.kept_flops == 0
    for change in (1.0, 3.0):
        for analysis, gone in zip(kept, (False, True), strict=True):
            matrix, pattern, values = staged.stage(gone=gone, change=change)
            rhs = np.ones((pattern.n, 2))
            solution = analysis.factorize(values).solve(rhs)
            assert residual(matrix, np.arange(pattern.n), solution, rhs) < 1e-14
    assert counts.flops - before < 4 * 0.5 * first
    assert counts.kept_flops > 4 * 0.5 * first


def test_what_lasts_may_change_by_a_factor_and_is_found_anew_otherwise(fine):
    staged, counts = Staged(), SolverCounts()
    solver = MultifrontalSolver(counts)
    _, pattern, values = staged.stage(gone=False)
    analysis = solver.analyse(pattern)
    analysis.factorize(values)
    whole = counts.flops
    for more, kept in (({"lasting": 1.7}, True), ({"lasting": 1e-3}, True), ({"seed": 5}, False)):
        before = counts.flops
        matrix, _, values = staged.stage(gone=False, **more)
        rhs = np.random.default_rng(1).normal(size=(pattern.n, 3))
        solution = analysis.factorize(values).solve(rhs)
        assert residual(matrix, np.arange(pattern.n), solution, rhs) < 1e-14
        assert (counts.flops - before < whole) == kept


def test_a_single_value_that_differs_is_seen(fine):
    staged, counts = Staged(), SolverCounts()
    _, pattern, values = staged.stage(gone=False)
    analysis = MultifrontalSolver(counts).analyse(pattern)
    analysis.factorize(values)
    before = counts.flops
    values[5] *= 1.0 + 1e-12
    analysis.factorize(values)
    assert counts.flops - before == before


def test_an_indefinite_matrix_is_found_in_what_lasts_and_in_the_rest(fine):
    staged = Staged()
    matrix, pattern, values = staged.stage(gone=False)
    solver = MultifrontalSolver()
    analysis = solver.analyse(pattern)
    for unknown in range(0, pattern.n, 19):
        bad = values.copy()
        bad[pattern.indptr[unknown]] *= 1e-3
        with pytest.raises(NotPositiveDefinite) as caught:
            analysis.factorize(bad)
        assert caught.value.unknown is not None
    rhs = np.ones((pattern.n, 1))
    solution = analysis.factorize(values).solve(rhs)
    assert residual(matrix, np.arange(pattern.n), solution, rhs) < 1e-14


def test_memory_of_what_lasts_goes_with_its_last_analysis(fine):
    staged, solver = Staged(), MultifrontalSolver()
    _, pattern, values = staged.stage(gone=False)
    analysis = solver.analyse(pattern)
    factor = analysis.factorize(values)
    assert len(solver._parts) == 1
    del analysis, factor
    assert len(solver._parts) == 0


def mechanism(n, hold):
    """A chain of n springs, held at one end by a spring of a given stiffness."""
    matrix = np.diag(np.full(n, 2.0)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1)
    matrix[-1, -1], matrix[0, 0] = 1.0, 1.0 + hold
    return matrix


def in_single(matrix):
    """(analysis in single precision, values) of a matrix in its own order."""
    pattern, values = lower(matrix, np.arange(len(matrix)))
    return MultifrontalSolver(single=True).analyse(pattern), values


def test_single_precision_is_refined_to_double_in_few_steps():
    points, *graph = grid((6, 6, 6))
    matrix = stiffness(*graph, 3, 0)
    order = spread(nested_dissection(points, *graph), 3)
    pattern, values = lower(matrix, order)
    solver = MultifrontalSolver(single=True)
    analysis = solver.analyse(pattern)
    rhs = np.random.default_rng(0).normal(size=(pattern.n, 70))
    solution = analysis.factorize(values).solve(rhs)
    assert analysis.single
    assert residual(matrix, order, solution, rhs) < 2e-15
    exact = MultifrontalSolver(single=False).analyse(pattern).factorize(values).solve(rhs)
    np.testing.assert_allclose(solution, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    assert 70 <= solver.counts.refinements <= 4 * 70


@pytest.mark.parametrize("ratio", [1e-6, 1e6, 1e12])
def test_units_and_stiff_inclusions_do_not_hurt_single_precision(ratio):
    points, *graph = grid((6, 5, 5))
    scale = np.ones((len(points),) * 2)
    inside = np.abs(points - 2).max(axis=1) <= 1
    scale[np.ix_(inside, inside)] = ratio
    matrix = stiffness(*graph, 3, 0, scale) * 1e10
    order = spread(nested_dissection(points, *graph), 3)
    pattern, values = lower(matrix, order)
    rhs = np.random.default_rng(0).normal(size=(pattern.n, 2))
    solution = MultifrontalSolver(single=True).analyse(pattern).factorize(values).solve(rhs)
    assert residual(matrix, order, solution, rhs) < 1e-14


@pytest.mark.parametrize("hold", [1e-4, 1e-6, 1e-8, 1e-10])
def test_a_body_that_is_barely_held_is_solved_in_double_where_single_is_not_enough(hold):
    matrix = mechanism(50, hold)
    analysis, values = in_single(matrix)
    rhs = np.ones((50, 1))
    solution = analysis.factorize(values).solve(rhs)
    exact = MultifrontalSolver(single=False).analyse(analysis.pattern).factorize(values).solve(rhs)
    assert analysis.single == (hold > 1e-5)
    assert residual(matrix, np.arange(50), solution, rhs) < 1e-14
    np.testing.assert_allclose(solution, exact, rtol=1e-3 * 1e-12 / hold + 1e-9)


@pytest.mark.parametrize("hold", [0.0, -1e-9, -1e-7, -1e-4])
def test_a_body_that_is_not_held_or_pushed_away_is_refused_in_single_precision(hold):
    for n in (10, 50, 300):
        analysis, values = in_single(mechanism(n, hold))
        with pytest.raises(NotPositiveDefinite):
            analysis.factorize(values)


def test_an_indefinite_matrix_is_refused_in_single_precision_wherever_it_is():
    points, *graph = grid((5, 5, 4))
    matrix = stiffness(*graph, 2, 7)
    least = np.linalg.eigvalsh(matrix)[0]
    order = spread(nested_dissection(points, *graph), 2)
    for unknown in range(0, len(matrix), 19):
        bad = matrix.copy()
        # The entry at which the smallest eigenvalue is just below zero.
        bad[unknown, unknown] -= (1.0 + 1e-9) / np.linalg.inv(matrix)[unknown, unknown]
        assert np.linalg.eigvalsh(bad)[0] < least
        pattern, values = lower(bad, order)
        with pytest.raises(NotPositiveDefinite):
            MultifrontalSolver(single=True).analyse(pattern).factorize(values)


def test_single_precision_keeps_what_lasts_too(fine):
    staged, counts = Staged(), SolverCounts()
    solver = MultifrontalSolver(counts, single=True)
    for gone, factor in ((False, 1.0), (True, 1.0), (True, 2.3), (False, 2.3)):
        matrix, pattern, values = staged.stage(gone=gone, lasting=factor, change=1.0)
        if factor == 1.0 and not gone:
            analyses = {g: solver.analyse(staged.stage(gone=g)[1]) for g in (False, True)}
        rhs = np.random.default_rng(0).normal(size=(pattern.n, 2))
        solution = analyses[gone].factorize(values).solve(rhs)
        assert residual(matrix, np.arange(pattern.n), solution, rhs) < 1e-14
    assert counts.kept_flops > counts.flops / 3
    assert counts.refinements > 0


def test_nearly_incompressible_ground_is_solved(fine):
    """Bulk against shear modulus as at nu = 0.4999: an element's K = B B^T + 5000 b b^T."""
    points, *graph = grid((5, 4, 4))
    rng = np.random.default_rng(0)
    matrix = stiffness(*graph, 3, 0)
    n = len(matrix)
    for i in range(len(points)):
        near = graph[1][graph[0][i] : graph[0][i + 1]]
        at = spread(near, 3)
        b = rng.normal(size=len(at))
        matrix[np.ix_(at, at)] += 5e3 * np.outer(b, b) * (len(near) == 27)
    order = spread(nested_dissection(points, *graph), 3)
    rhs = rng.normal(size=(n, 2))
    for single in (False, True):
        full = sp.csc_array(np.tril(matrix[np.ix_(order, order)]))
        full.sort_indices()
        arrays = (np.asarray(a, dtype=np.int64) for a in (full.indptr, full.indices))
        analysis = MultifrontalSolver(single=single).analyse(LowerPattern(*arrays))
        solution = analysis.factorize(full.data).solve(rhs)
        assert residual(matrix, order, solution, rhs) < 1e-14


def test_memory_is_used_again_and_given_back():
    points, *graph = grid((6, 6, 5))
    pattern, values = lower(stiffness(*graph, 2, 0), spread(nested_dissection(points, *graph), 2))
    solver = MultifrontalSolver(single=False)
    analysis = solver.analyse(pattern)
    first = analysis.factorize(values)
    rhs = np.ones((pattern.n, 1))
    before = first.solve(rhs)
    second = analysis.factorize(2.0 * values)
    with pytest.raises(RuntimeError):
        first.solve(rhs)
    np.testing.assert_allclose(second.solve(rhs), 0.5 * before, rtol=1e-12)
    spare = solver._memory._spare
    assert len(spare) == 1  # all stacks
    del first
    spare = solver._memory._spare
    assert len(spare) == 2
    kept = {id(block) for block in spare}
    third = analysis.factorize(3.0 * values)
    np.testing.assert_allclose(third.solve(rhs), before / 3.0, rtol=1e-12)
    assert {id(block) for block in solver._memory._spare} < kept


def test_branches_have_nothing_to_do_with_each_other(fine):
    points, *graph = grid((7, 6, 5))
    order = nested_dissection(points, *graph)
    pattern, _ = lower(stiffness(*graph, 2, 0), spread(order, 2))
    plan = layout.layout(pattern.indptr, pattern.indices, pattern.n)
    assert len(plan.branches) >= 2
    seen = sorted([k for branch in plan.branches for k in branch] + plan.rest.tolist())
    assert seen == list(range(len(plan.fronts)))
    for branch in plan.branches:
        own = set(branch)
        last = plan.fronts[branch[-1]]
        end = last.first + last.width
        for k in branch:
            assert {child for child, _ in plan.fronts[k].children} <= own
            inside = plan.fronts[k].rows
            inside = inside[inside < end]
            assert (inside >= plan.fronts[branch[0]].first).all()
        stacks = {plan.fronts[k].stack for k in branch}
        others = {plan.fronts[k].stack for k in set(seen) - own}
        assert not stacks & others


def test_little_work_is_not_divided():
    points, *graph = grid((4, 4, 4))
    order = nested_dissection(points, *graph)
    pattern, _ = lower(stiffness(*graph, 2, 0), spread(order, 2))
    assert layout.layout(pattern.indptr, pattern.indices, pattern.n).branches == ()


@pytest.mark.parametrize("columns", [1, 2, blas.FEW, blas.FEW + 1, 20])
@pytest.mark.parametrize("below", [0, 1, 90])
@pytest.mark.parametrize(("dtype", "close"), [("f8", 1e-13), ("f4", 1e-5)])
def test_panel_solves_with_its_triangle_and_passes_on_what_is_below(dtype, close, below, columns):
    rng = np.random.default_rng(7)
    width = 700  # several tiles, the last one narrower
    strip = np.asfortranarray(rng.normal(size=(width + below, width)) * 0.02, dtype=dtype)
    strip[np.arange(width), np.arange(width)] += 1.0
    lower, rest = np.tril(strip[:width]).astype("f8"), strip[width:].astype("f8")
    panel, kernels = blas.Panel(strip), blas.Kernels(dtype)
    given = rng.normal(size=(width, columns)).astype(dtype)
    under = rng.normal(size=(below, columns)).astype(dtype)

    x = given.copy()
    passed = kernels.forward(panel, x)
    wanted = scipy.linalg.solve_triangular(lower, given, lower=True)
    np.testing.assert_allclose(x, wanted, rtol=0, atol=close * np.abs(wanted).max())
    np.testing.assert_allclose(passed, -rest @ wanted, rtol=0, atol=close * np.abs(wanted).max())

    y = given.copy()
    kernels.backward(panel, y, under)
    wanted = scipy.linalg.solve_triangular(lower.T, given - rest.T @ under)
    np.testing.assert_allclose(y, wanted, rtol=0, atol=close * np.abs(wanted).max())


def test_nothing_runs_any_more_when_a_task_has_failed(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    done = []

    def fail():
        raise ArithmeticError("first")

    def late():
        time.sleep(0.05)
        done.append(True)

    with pytest.raises(ArithmeticError, match="first"):
        run_tasks([fail, late])
    assert done == [True]
