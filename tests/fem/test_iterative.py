"""Conjugate gradients on several levels: as exact as a factor, in steps that do not grow."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from support.anisotropy import moduli
from support.meshes import box

from geoident import processors
from geoident.errors import ModelError
from geoident.fem import solvers
from geoident.fem.elasticity import isotropic
from geoident.fem.kinematics import SOLID, block_geometry
from geoident.fem.solvers import Solver, is_beyond, iterative, levels, pick_solver
from geoident.fem.solvers import conjugate_gradients as cg
from geoident.fem.solvers.direct import NotPositiveDefinite, SolverCounts, UnknownPlaces
from geoident.fem.solvers.factor_cost import FactorCost
from geoident.fem.solvers.ordering import nested_dissection
from geoident.fem.solvers.splu import SpluFactorization
from geoident.fem.stiffness import group_blocks, node_graph, nodes_on_edges, stiffness_pattern


@lru_cache(maxsize=16)
def system(kind, n, *, nu=0.3, stiff=8e9, held=None):
    """Pattern and values of a cube of rock on rollers with a block of another stiffness in it.

    Args:
        held: (k,) degrees of freedom; None for the rollers.
    """
    mesh = box(kind, (n, n, n), size=(8.0, 8.0, 8.0), distortion=0.15)
    geometries = tuple(block_geometry(mesh.points, b, SOLID) for b in mesh.blocks)
    inside = np.abs(mesh.points[mesh.blocks[0].nodes].mean(axis=1) - 4.0).max(axis=1) < 2.1
    order = nested_dissection(mesh.points, *node_graph(mesh))
    groups = {
        name: group_blocks(mesh, geometries, np.flatnonzero(members), np.argsort(order))
        for name, members in enumerate((~inside, inside))
    }
    fixed = (mesh.points == 0.0).ravel()
    if held is not None:
        fixed = np.isin(np.arange(mesh.points.size), held)
    edges = nodes_on_edges(mesh)
    pattern = stiffness_pattern(
        groups,
        node_of_rank=order,
        fixed=fixed,
        dim=3,
        places=lambda dofs: UnknownPlaces(dofs, mesh.points, edges),
    )
    maps = {
        name: SOLID.stiffness_map(moduli(isotropic, {"E": E, "nu": nu}))
        for name, E in enumerate((8e9, stiff))
    }
    values = pattern.values(groups, maps)
    values.setflags(write=False)
    return pattern.lower, values


def iterative_solver():
    """Conjugate gradients for matrices of any size, with what is always installed beneath."""
    return Solver("iterative", SpluFactorization, lambda pattern: True)


def loads(pattern, k=3):
    """Smooth forces, a point force and forces at random."""
    x = pattern.places.points[pattern.places.dofs // 3]
    rhs = np.random.default_rng(1).normal(size=(pattern.n, k))
    rhs[:, 0] = np.sin(x[:, 0]) * x[:, 2]
    rhs[:, 1] = 0.0
    rhs[pattern.n // 2, 1] = 1e6
    return rhs


def energy_error(matrix, x, exact):
    error = x - exact
    return np.sqrt((error * (matrix @ error)).sum(axis=0) / (exact * (matrix @ exact)).sum(axis=0))


def close(x, exact, part):
    """Whether displacements are the same to a part of the largest of their column."""
    return (np.abs(x - exact).max(axis=0) <= part * np.abs(exact).max(axis=0)).all()


@pytest.mark.parametrize(
    ("kind", "n"),
    [
        ("tet10", 4),
        ("tet4", 8),
        ("wedge15", 3),
        pytest.param("hex20", 4, marks=pytest.mark.slow),
        pytest.param("pyramid13", 3, marks=pytest.mark.slow),
        pytest.param("hex8", 9, marks=pytest.mark.slow),
    ],
)
def test_solutions_are_those_of_a_factor(kind, n):
    pattern, values = system(kind, n)
    rhs = loads(pattern)
    exact = pick_solver().analyse(pattern).factorize(values).solve(rhs)
    solver = iterative_solver()
    x = solver.analyse(pattern).factorize(values).solve(rhs)
    assert (energy_error(pattern.whole(values), x, exact) < 2 * cg.TOLERANCE).all()
    assert close(x, exact, 1e-9)
    counts = solver.counts
    assert (counts.analyses, counts.factorizations, counts.solves) == (1, 1, 3)
    assert 3 * 5 < counts.iterations < 3 * 40


@pytest.mark.parametrize(
    ("kind", "sizes"),
    [
        ("tet10", (3, 5)),
        ("tet4", (6, 9)),
        pytest.param("tet10", (3, 5, 7), marks=pytest.mark.slow),
        pytest.param("tet4", (6, 9, 13), marks=pytest.mark.slow),
    ],
)
def test_steps_do_not_grow_with_the_mesh(kind, sizes):
    steps = []
    for n in sizes:
        pattern, values = system(kind, n)
        solver = iterative_solver()
        solver.analyse(pattern).factorize(values).solve(loads(pattern)[:, :2])
        steps.append(solver.counts.iterations)
    assert max(steps) <= 1.5 * min(steps)


def test_stiff_and_soft_ground_beside_each_other_takes_no_more():
    found = []
    for stiff in (8e9, 8e5, 8e12):
        pattern, values = system("tet10", 3, stiff=stiff)
        solver = iterative_solver()
        solver.analyse(pattern).factorize(values).solve(loads(pattern))
        found.append(solver.counts.iterations)
    assert max(found) <= 2 * found[0]


def test_corners_too_many_to_factorize_have_a_coarser_level(monkeypatch):
    pattern, values = system("tet10", 5)
    rhs = loads(pattern)
    exact = pick_solver().analyse(pattern).factorize(values).solve(rhs)
    monkeypatch.setattr(levels, "MOST_CORNERS", 300)
    solver = iterative_solver()
    x = solver.analyse(pattern).factorize(values).solve(rhs)
    assert close(x, exact, 1e-9)
    assert solver.counts.iterations < 3 * 45


def test_the_same_input_gives_the_same_bits():
    pattern, values = system("tet10", 3)
    first, second = (
        iterative_solver().analyse(pattern).factorize(values).solve(loads(pattern))
        for _ in range(2)
    )
    assert np.array_equal(first, second)


@pytest.mark.parametrize("fixed", [(), (0, 1, 2), (0, 1, 2, 3, 4, 5)])
def test_a_body_that_nothing_holds_is_refused(fixed):
    """Nothing holds it, or one place or two of them, about which it can turn."""
    pattern, values = system("tet10", 4, held=fixed)
    with pytest.raises(NotPositiveDefinite) as caught:
        iterative_solver().analyse(pattern).factorize(values)
    assert caught.value.unknown is not None


@pytest.mark.parametrize("kind", ["tet10", "tet4"])
@pytest.mark.parametrize("where", ["everywhere", "at a node", "in a mode"])
def test_an_indefinite_matrix_is_refused_whatever_the_loads(kind, where):
    pattern, values = system(kind, 4 if kind == "tet10" else 8)
    k, n = pattern.whole(values), pattern.n
    if where == "everywhere":
        values = values.copy()
        values[pattern.indptr[:-1]] *= 0.8
    else:
        # soften the diagonal about one unknown to just below zero along its own motion there
        at = n // 3
        column = k[:, [at]].toarray().ravel()
        inverse = pick_solver().analyse(pattern).factorize(values)
        unit = np.zeros((n, 1))
        unit[at] = 1.0
        flexibility = float(inverse.solve(unit)[at, 0])
        values = values.copy()
        part = 1.001 if where == "in a mode" else 1.2
        values[pattern.indptr[at]] -= part / flexibility
        assert column[at] > 0
    with pytest.raises(NotPositiveDefinite):
        pick_solver().analyse(pattern).factorize(values)
    with pytest.raises(NotPositiveDefinite):
        iterative_solver().analyse(pattern).factorize(values)


@pytest.mark.parametrize("entry", [0.0, -1.0, np.nan])
def test_a_bad_diagonal_entry_is_named(entry):
    pattern, values = system("tet10", 3)
    values = values.copy()
    values[pattern.indptr[40]] = entry
    with pytest.raises(NotPositiveDefinite) as caught:
        iterative_solver().analyse(pattern).factorize(values)
    assert caught.value.unknown == 40


def test_nearly_incompressible_ground_takes_more_steps_and_is_as_exact():
    pattern, values = system("tet10", 3, nu=0.495)
    rhs = loads(pattern)
    exact = pick_solver().analyse(pattern).factorize(values).solve(rhs)
    x = iterative_solver().analyse(pattern).factorize(values).solve(rhs)
    assert (energy_error(pattern.whole(values), x, exact) < 2 * cg.TOLERANCE).all()


@pytest.mark.parametrize("at", ["factorize", "solve"])
def test_what_does_not_come_to_the_end_is_factorized_or_refused(monkeypatch, at):
    pattern, values = system("tet10", 4, nu=0.3 if at == "solve" else 0.4999)
    rhs = loads(pattern)
    exact = pick_solver().analyse(pattern).factorize(values).solve(rhs)
    if at == "solve":

        def stagnates(*_args: object) -> None:
            raise cg.Stagnation

        monkeypatch.setattr(iterative, "solve_in_energy", stagnates)
    else:
        monkeypatch.setattr(cg, "MOST_STEPS", 20)
    solver = iterative_solver()
    analysis = solver.analyse(pattern)
    assert close(analysis.factorize(values).solve(rhs), exact, 1e-9)
    spent = solver.counts.iterations
    assert spent >= (5 if at == "solve" else cg.MOST_STEPS)  # what was in vain is counted
    assert close(analysis.factorize(values).solve(rhs), exact, 1e-9)
    assert solver.counts.iterations == spent  # it is not tried again
    monkeypatch.setattr(iterative, "memory_limit", lambda: 1e3)
    with pytest.raises(ModelError) as caught:
        iterative_solver().analyse(pattern).factorize(values).solve(rhs)
    assert caught.value.message.startswith(
        "conjugate gradients do not come to the solution: ground is all but incompressible, or "
        "elements are nearly flat; a factorization would take 0.0 GB"
    )
    assert caught.value.hint == (
        "look for moduli near a Poisson's ratio of 0.5 and for slivers in the mesh, or take a "
        "coarser mesh or more memory"
    )


@pytest.mark.parametrize("what", ["indefinite", "no number"])
def test_a_preconditioner_lost_in_rounding_ends_no_column(what):
    """r^T M^-1 r below zero is no small error: so it was near nu = 0.49999999."""
    n = 40
    k = np.diag(np.linspace(1.0, 9.0, n))
    inverse = np.ones((n, 1))
    inverse[n // 2 :] = -1e-3 if what == "indefinite" else np.nan
    rhs = np.ones((n, 2))
    rhs[n // 2 :, 1] = 100.0
    with pytest.raises(cg.Stagnation):
        cg.solve_in_energy(k.__matmul__, lambda r: inverse * r, rhs, 1e-3, SolverCounts())
    with pytest.raises(cg.Stagnation):
        cg.least_eigenvalue(k.__matmul__, lambda r: inverse * r, np.diag(k), SolverCounts())


def test_small_matrices_and_those_without_places_are_factorized():
    pattern, values = system("tet10", 3)
    solver = pick_solver("iterative")
    for one in (pattern, replace(pattern, places=None)):
        assert pattern.n < solvers.SMALL
        solver.analyse(one).factorize(values).solve(loads(pattern))
    assert solver.counts.iterations == 0


def test_iterations_are_chosen_by_the_counted_work_and_entries():
    """The cubes of the benchmark as counted: 150,000 and 1,000,000 unknowns."""
    middle, large = FactorCost(169_000_000, 5.11e11), FactorCost(2_650_000_000, 2.77e13)
    assert not is_beyond(middle, 5_900_000)
    assert is_beyond(large, 42_000_000)
    assert is_beyond(replace(middle, entries=500_000_000), 5_900_000)


def test_the_choice_among_solvers_iterates_where_a_factor_takes_too_much(monkeypatch):
    pattern, values = system("tet10", 5)
    rhs = loads(pattern)
    exact = pick_solver().analyse(pattern).factorize(values).solve(rhs)
    monkeypatch.setattr(solvers, "COUNTED", 0)
    monkeypatch.setattr(solvers, "MOST_ENTRIES", 1000)
    solver = pick_solver()
    assert close(solver.analyse(pattern).factorize(values).solve(rhs), exact, 1e-9)
    assert solver.counts.iterations > 0
    nowhere = replace(pattern, places=None)
    factorized = pick_solver()
    assert close(factorized.analyse(nowhere).factorize(values).solve(rhs), exact, 1e-9)
    assert factorized.counts.iterations == 0


def test_a_limit_of_the_process_counts(monkeypatch):
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (3e9, 3e9))
    assert processors.memory_limit() <= 3e9
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY,) * 2)
    monkeypatch.setattr(processors, "GROUP_LIMITS", ())
    assert processors.memory_limit() > 1e9
